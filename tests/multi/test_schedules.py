"""Schedules on fixed paths: dynamics of hops, occupancy, and the earliest schedule among moving agents."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import place_grid
from rr1plan.checks import Array
from rr1plan.multi.agents import Agent
from rr1plan.multi.execution.route import route_of
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.plan_quality import plan_quality
from rr1plan.multi.timing.safe_intervals import BlockedTimes, blocked_times, earliest_schedule, safe_intervals
from rr1plan.multi.timing.schedule import Leg, Occupancy, Schedule, extended, rest_row
from rr1plan.path import Path

_POINTS = np.array(
    [
        [-2.28, -0.2, 1.13, -1.58, 2.17, -1.18],
        [-2.05, -0.24, 0.56, 0.01, 1.72, -0.22],
        [-1.06, -0.01, 1.33, -1.41, 2.3, -1.17],
    ]
)


class _Checker:
    """Certifies all blends, or none."""

    def __init__(self, free: bool) -> None:
        self.free = free

    def polynomial_is_free(self, coefficients: Array, duration: float) -> bool:
        return self.free


@pytest.fixture(scope="module", params=[True, False], ids=["rounded", "halting"])
def path(request, rr1: rp.Robot) -> AgentPath:
    scene = place_grid(rr1, 1, 1)
    problem = rp.Problem(scene, _POINTS[0], _POINTS[-1])
    agent = Agent(problem, problem.arms)
    return AgentPath(agent, Path(agent.joint_names, _POINTS), _Checker(request.param))


def test_the_fastest_hop_is_the_motion_of_the_retiming(path: AgentPath) -> None:
    method = "stop" if path.halts else "blend"
    scene = path.agent.problem.scene
    reference = rp.retime(path.path, scene, method=method, checker=_Checker(not path.halts))
    assert path.fastest == pytest.approx(reference.duration, rel=0.02)


def test_every_hop_ends_on_blends_of_a_gantry_with_one_slow_joint() -> None:
    """On a coarse grid, the highest speed before a gridpoint on a blend may require rest there."""
    points = np.array([[0.89, 0.23], [0.12, 0.29], [0.59, 0.55]])
    robot = rp.planar_arm("PP", (1.0, 1.0))
    limits = replace(robot.limits, velocity=np.array([0.5, 0.05]), acceleration=np.array([2.0, 0.2]))
    scene = rp.Scene().with_arm("gantry", robot.with_limits(limits))
    agent = Agent(rp.Problem(scene, points[0], points[-1]), ["gantry"])
    path = AgentPath(agent, Path(agent.joint_names, points), _Checker(True))
    for begin, end in combinations(path.stops, 2):
        stretch = path.at(end) - path.at(begin)
        slowest = float((np.abs(stretch) / limits.velocity).max() + (limits.velocity / limits.acceleration).max())
        assert path.hop_duration(begin, end) < 4.0 * slowest
        assert np.isfinite(path.hop_times(end, begin)).all()


def test_hops_keep_limits_and_are_where_they_say_when_they_say(path: AgentPath) -> None:
    limits = path.agent.limits
    for begin, end in [(0, path.segments), (path.stops[2], path.stops[3]), (path.stops[5], path.stops[1])]:
        schedule = Schedule(path, (Leg(0.3, 0, begin), Leg(9.0, begin, end))[begin == 0 :])
        motion = schedule.trajectory()
        departure = schedule.legs[-1].departure
        times = path.hop_times(begin, end)
        assert (np.diff(times) > 0.0).all()
        step = 1 if end > begin else -1
        for time, gridpoint in zip(times, range(begin, end + step, step), strict=True):
            np.testing.assert_allclose(motion(departure + time), path.at(gridpoint), atol=1e-7)
        clock = np.linspace(motion.start_time, motion.end_time, 3000)
        assert (np.abs(motion(clock, 1)) <= limits.velocity * (1 + 1e-6)).all()
        assert (np.abs(motion(clock, 2)) <= limits.acceleration * (1 + 1e-6)).all()
        np.testing.assert_array_equal(motion(np.array([0.0]))[0], path.at(0))


def test_legs_without_a_pause_are_occupied_in_order_at_any_time(path: AgentPath) -> None:
    middle = path.stops[4]
    there = path.hop_duration(0, middle)
    plain = (Leg(0.1, 0, middle), Leg(0.1 + there, middle, path.segments))
    decreasing = 0
    for time in np.random.default_rng(0).uniform(0.0, 100.0, 300).tolist():
        legs = tuple(Leg(leg.departure + time, leg.begin, leg.end) for leg in plain)
        schedule = Schedule(path, legs)
        assert (np.diff(schedule.occupancy.enter[1:]) >= 0.0).all()
        assert route_of(schedule).segments == path.segments
        decreasing += schedule.instants(legs[0])[-1] > legs[1].departure
    assert decreasing


def test_a_schedule_is_always_in_a_row_that_it_occupies(path: AgentPath) -> None:
    stops = path.stops
    schedule = Schedule(path, (Leg(0.2, 0, stops[4]), Leg(2.0, stops[4], stops[2]), Leg(4.0, stops[2], path.segments)))
    occupied, motion = schedule.occupancy, schedule.trajectory()
    assert occupied.enter[0] == -math.inf
    assert occupied.leave[-1] == math.inf
    np.testing.assert_array_equal(occupied.leave[:-1], occupied.enter[1:])
    for time in np.linspace(0.0, schedule.arrival + 0.5, 400):
        row = int(occupied.rows[np.searchsorted(occupied.enter, time, side="right") - 1])
        q = motion(time)
        if row > path.segments + 1:
            np.testing.assert_allclose(q, path.at(row - path.segments - 1), atol=1e-9)
        elif row in (0, path.segments + 1):
            np.testing.assert_allclose(q, path.at(0 if row == 0 else path.segments), atol=1e-9)
        else:
            piece, offset, delta = (part[row - 1] for part in path.grid)
            c = path.curve.coefficients[piece]
            s = offset + np.linspace(-1e-3, 1.0 + 1e-3, 300)[:, None] * delta
            assert np.abs(c[0] + s * (c[1] + s * c[2]) - q).max(axis=1).min() < 5e-3
    assert schedule.waiting == pytest.approx(
        schedule.arrival - sum(path.hop_duration(leg.begin, leg.end) for leg in schedule.legs)
    )
    sampled = motion(np.linspace(0.0, schedule.arrival, 20_001))
    assert schedule.length == pytest.approx(np.linalg.norm(np.diff(sampled, axis=0), axis=1).sum(), rel=1e-5)


def test_arms_that_move_as_one_wait_while_others_move(planar2r: rp.Robot) -> None:
    scene = place_grid(planar2r, 1, 2, spacing=4.0)
    points = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 1, 0], [1, 1, 1, 0]], float)
    start, goal = (dict(zip(scene.arms, np.split(points[k], 2), strict=True)) for k in (0, -1))
    agent = Agent(rp.Problem(scene, start, goal), scene.arms)
    path = AgentPath.chained([AgentPath(agent, Path(agent.joint_names, pair), None) for pair in pairwise(points)])
    _, first, second, _ = path.stops
    legs = (Leg(0.5, 0, first), Leg(4.0, first, second), Leg(9.0, second, path.segments))
    one, _, last = (path.hop_duration(*leg[1:]) for leg in legs)
    schedule = Schedule(path, legs)
    # The first arm rests before its first and its second motion, the second arm before its only one.
    expected = (0.5 + (9.0 - 0.5 - one)) + 4.0
    assert schedule.waiting_of_arms == pytest.approx(expected)
    assert schedule.arrival == pytest.approx(9.0 + last)
    line = rp.timeline(schedule.trajectory(), scene)
    assert line.waiting == pytest.approx(expected)
    assert plan_quality([schedule], {}).waiting == pytest.approx(expected)
    assert Schedule(path, legs[:2]).waiting_of_arms == pytest.approx(0.5 + 4.0)


def test_arms_that_move_all_the_time_never_wait_less_than_no_time(planar2r: rp.Robot) -> None:
    scene = place_grid(planar2r, 1, 2, spacing=4.0)
    rng = np.random.default_rng(0)
    for points in rng.uniform(-1.0, 1.0, (40, 4, 4)):
        start, goal = (dict(zip(scene.arms, np.split(points[k], 2), strict=True)) for k in (0, -1))
        agent = Agent(rp.Problem(scene, start, goal), scene.arms)
        path = AgentPath(agent, Path(agent.joint_names, points), None)
        schedule = Schedule(path, (Leg(0.0, 0, path.segments),))
        assert schedule.waiting == 0.0
        assert 0.0 <= schedule.waiting_of_arms < 1e-9


def test_rest_between_two_segments_is_free_where_either_is() -> None:
    blocked = np.array([[0, 0, 0, 0], [0, 1, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0]], np.uint8)
    made = extended(blocked)
    assert made.shape == (5, 5)
    assert made[4].tolist() == [0, 1, 0, 0, 0]
    assert made[:, 4].tolist() == [0, 0, 1, 0, 0]


def test_safe_intervals_are_the_gaps() -> None:
    begins, ends = np.array([2.0, -math.inf, 2.5]), np.array([3.0, 1.0, 4.0])
    assert safe_intervals(begins, ends) == [(1.0, 2.0), (4.0, math.inf)]
    assert safe_intervals(np.zeros(0), np.zeros(0)) == [(-math.inf, math.inf)]


def _times(path: AgentPath, intervals: list[tuple[int, float, float]]) -> BlockedTimes:
    rows = sorted(intervals)
    return BlockedTimes(
        np.array([r for r, _, _ in rows], np.int64), np.array([b for _, b, _ in rows]), np.array([e for *_, e in rows])
    )


def _is_safe(schedule: Schedule, blocked: BlockedTimes) -> bool:
    occupied = schedule.occupancy
    for row, enter, leave in zip(*occupied, strict=True):
        begins, ends = blocked.of(int(row))
        if ((begins < leave) & (ends > max(enter, 0.0))).any():
            return False
    return True


def test_nothing_in_the_way_takes_the_fastest_motion(path: AgentPath) -> None:
    schedule = earliest_schedule(path, _times(path, []))
    assert schedule is not None
    assert schedule.arrival == path.fastest
    assert schedule.waiting == 0.0


def test_an_agent_waits_until_a_segment_is_free_and_leaves_its_start_in_time(path: AgentPath) -> None:
    middle = path.segments // 2
    blocked = _times(path, [(middle, -math.inf, 3.0)])
    schedule = earliest_schedule(path, blocked)
    assert schedule is not None
    assert _is_safe(schedule, blocked)
    assert 3.0 < schedule.arrival < 3.0 + path.fastest
    # Another agent needs the start before that.
    blocked = _times(path, [(0, 1.0, 2.5), (1, 1.0, 2.5), (middle, -math.inf, 3.0)])
    schedule = earliest_schedule(path, blocked)
    assert schedule is not None
    assert _is_safe(schedule, blocked)
    assert len(schedule.legs) > 1


def test_an_agent_backs_up_when_it_has_to(path: AgentPath) -> None:
    last, away = path.segments, path.stops[4]
    # It must leave the first half, which is swept until 2 s, and then give way at the end again.
    rows = [(row, 0.9, 1.6) for row in range(path.stops[2] + 1)]
    rows += [(rest_row(path, k), 0.9, 1.6) for k in path.stops[1:3]]
    rows += [(row, 2.2, 5.0) for row in range(path.stops[3], last + 2)]
    rows += [(rest_row(path, k), 2.2, 5.0) for k in path.stops[3:-1]]
    blocked = _times(path, rows)
    schedule = earliest_schedule(path, blocked)
    assert schedule is not None
    assert _is_safe(schedule, blocked)
    assert any(leg.end < leg.begin for leg in schedule.legs), (schedule.legs, away)


def test_a_goal_or_start_that_is_never_free_has_no_schedule(path: AgentPath) -> None:
    assert earliest_schedule(path, _times(path, [(path.segments + 1, 5.0, math.inf)])) is None
    assert earliest_schedule(path, _times(path, [(0, -math.inf, 0.5)])) is None


def test_the_search_for_a_schedule_ends_with_its_time(path: AgentPath, monkeypatch: pytest.MonkeyPatch) -> None:
    """Under limits of jerk and torque each motion between stops takes milliseconds to time."""
    blocked = _times(path, [(path.segments // 2, 0.0, 3.0)])
    left, timed = [5], []
    hop_times = AgentPath.hop_times

    def counted(self: AgentPath, begin: int, end: int) -> Array:
        timed.append((begin, end))
        return hop_times(self, begin, end)

    def goes_on() -> bool:
        left[0] -= 1
        return left[0] >= 0

    monkeypatch.setattr(AgentPath, "hop_times", counted)
    assert earliest_schedule(path, blocked, goes_on) is None
    assert len(timed) == 5
    assert earliest_schedule(path, blocked) is not None
    assert len(timed) > 10


def test_blocked_times_join_cells_one_after_the_other(path: AgentPath) -> None:
    blocked = np.zeros((path.cells, 4), np.uint8)
    blocked[3, 1:3] = 1
    occupied = Occupancy(
        np.array([0, 1, 2, 3]), np.array([-math.inf, 1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0, math.inf])
    )
    times = blocked_times([(blocked, occupied)])
    assert times.rows.tolist() == [3]
    assert times.begin[0] == pytest.approx(1.0)
    assert times.end[0] == pytest.approx(3.0)


def test_a_long_motion_at_one_speed_ends_exactly_where_the_next_piece_begins(planar2r: rp.Robot) -> None:
    limits = planar2r.limits
    slow = planar2r.with_limits(
        rp.Limits(
            limits.lower, limits.upper, 0.01 * limits.velocity, 50.0 * limits.acceleration, limits.jerk, limits.effort
        )
    )
    problem = rp.Problem(rp.Scene().with_arm("arm", slow), [-2.4, -1.2], [1.7, 1.9])
    agent = Agent(problem, problem.arms)
    points = np.array([[-2.4, -1.2], [0.91, 1.0], [1.7, 1.9]])
    path = AgentPath(agent, Path(agent.joint_names, points), _Checker(True))
    durations, c = path.hop(0, path.segments)
    assert durations.max() > 10.0
    ends = sum(c[:, k] * durations[:, None] ** k for k in range(c.shape[1]))
    np.testing.assert_allclose(ends[:-1], c[1:, 0], atol=1e-13)
    rates = sum(k * c[:, k] * durations[:, None] ** (k - 1) for k in range(1, c.shape[1]))
    np.testing.assert_allclose(rates[:-1], c[1:, 1], atol=1e-9)
    np.testing.assert_allclose(ends[-1], path.goal, atol=1e-13)
    assert durations.sum() == pytest.approx(path.fastest)
