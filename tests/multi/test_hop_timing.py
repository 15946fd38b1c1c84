"""Motions from stop to stop under torque and jerk limits: the limits hold, and arms follow their schedules."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import place_grid, plan_many_arms, random_grid
from rr1plan.checks import Array
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.multi.paths.hop_timing import HopTiming, jerk_limited_line, times_along
from rr1plan.multi.timing.schedule import Leg, Schedule
from rr1plan.path import Path
from rr1plan.planning import Budget, PlanStatus

_BUDGET = Budget(seconds=120.0)
_POINTS = np.array(
    [
        [-2.28, -0.2, 1.13, -1.58, 2.17, -1.18],
        [-2.05, -0.24, 0.56, 0.01, 1.72, -0.22],
        [-1.06, -0.01, 1.33, -1.41, 2.3, -1.17],
    ]
)


class _Free:
    """Certifies all blends."""

    def polynomial_is_free(self, coefficients: Array, duration: float) -> bool:
        return True


def _weak(robot: rp.Robot, share: float) -> rp.Robot:
    """The robot with a fraction of its effort limits."""
    kept = {name: getattr(robot.limits, name) for name in ("lower", "upper", "velocity", "acceleration", "jerk")}
    return replace(robot, limits=rp.Limits(**kept, effort=share * robot.limits.effort))


_TIMINGS = {
    "torque": HopTiming(torque_limits=True),
    "jerk": HopTiming("ruckig"),
    "both": HopTiming("ruckig", torque_limits=True),
    "stop": HopTiming("stop"),
}


@pytest.fixture(scope="module", params=list(_TIMINGS))
def path(request: pytest.FixtureRequest, rr1: rp.Robot) -> AgentPath:
    problem = rp.Problem(place_grid(_weak(rr1, 0.5), 1, 1), _POINTS[0], _POINTS[-1])
    agent = Agent(problem, problem.arms, _TIMINGS[request.param])
    return AgentPath(agent, Path(agent.joint_names, _POINTS), _Free())


def test_hops_are_where_they_say_when_they_say(path: AgentPath) -> None:
    hops = [(0, path.segments), (path.stops[2], path.stops[7]), (path.stops[8], path.stops[1])]
    for begin, end in hops:
        schedule = Schedule(path, (Leg(0.0, 0, begin), Leg(30.0, begin, end))[begin == 0 :])
        times = path.hop_times(begin, end)
        assert (np.diff(times) > 0.0).all()
        assert times[-1] == pytest.approx(path.hop_duration(begin, end))
        gridpoints = range(begin, end + 1) if begin < end else range(begin, end - 1, -1)
        places = schedule.trajectory()(schedule.legs[-1].departure + times)
        np.testing.assert_allclose(places, [path.at(k) for k in gridpoints], atol=1e-6)


def test_hops_keep_all_limits(path: AgentPath) -> None:
    timing, scene = path.agent.timing, path.agent.problem.scene
    motion = Schedule(path, (Leg(0.0, 0, path.segments),)).trajectory()
    report = rp.validate(
        motion, scene, torque_limits=timing.torque_limits, jerk_limits=timing.method == "ruckig", clearance=False
    )
    kinds = {violation.kind for violation in report.violations}
    assert not kinds & {"velocity", "acceleration", "torque", "jerk"}
    assert motion.duration == pytest.approx(path.fastest)


def test_the_motion_is_that_of_the_retiming(path: AgentPath) -> None:
    timing, scene = path.agent.timing, path.agent.problem.scene
    reference = rp.retime(path.path, scene, method=timing.method, checker=_Free())
    if timing.torque_limits:
        assert path.fastest >= reference.duration * (1.0 - 1e-3)
    else:
        assert path.fastest == pytest.approx(reference.duration, rel=0.02)


def test_times_along_a_line_invert_the_motion(rr1: rp.Robot) -> None:
    direction = np.array([0.6, 0.0, -0.8, 0.0, 0.0, 0.0])
    start = np.array([0.1, 0.2, 0.9, 0.4, 0.5, 0.6])
    line = jerk_limited_line(start, direction, 1.3, rr1.limits)
    distances = np.linspace(0.0, 1.3, 41)
    times = times_along(line, direction, distances)
    motion = rp.Trajectory(rr1.joint_names, np.concatenate([[0.0], np.cumsum(line.durations)]), line.coefficients)
    np.testing.assert_allclose((motion(times) - start) @ direction, distances, atol=1e-9)


def test_torque_limits_are_kept_by_all_arms_together(rr1: rp.Robot) -> None:
    problem = random_grid(_weak(rr1, 0.45), 8, 0.6, 1)
    limited = rp.plan_motion(problem, rng=0, torque_limits=True, budget=_BUDGET)
    assert limited
    assert limited.result.planner == "many_arms"
    assert limited.report.certified
    assert "torque" in limited.report.checked
    free = plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert free.trajectory is not None
    report = rp.validate(free.trajectory, problem.scene, problem, torque_limits=True)
    assert {violation.kind for violation in report.violations} == {"torque"}
    assert limited.many_arms is not None
    assert limited.many_arms.makespan > free.makespan


def test_jerk_limits_are_kept_by_all_arms_together(rr1: rp.Robot) -> None:
    problem = random_grid(rr1, 4, 0.6, 0)
    motion = rp.plan_motion(problem, planner="many_arms", rng=0, retiming="ruckig", budget=_BUDGET)
    assert motion
    assert motion.report.certified
    assert "jerk" in motion.report.checked


def test_an_arm_that_cannot_hold_itself_is_named(rr1: rp.Robot) -> None:
    problem = random_grid(_weak(rr1, 0.2), 3, 0.8, 0)
    result = plan_many_arms(problem, rng=0, torque_limits=True)
    assert result.status is PlanStatus.TIMEOUT
    assert "holding the arm still against gravity" in result.reason


def test_what_is_impossible_is_refused(rr1: rp.Robot) -> None:
    problem = random_grid(rr1, 3, 0.8, 0)
    with pytest.raises(InputError, match=r"leaves the paths.*blend, stop, ruckig"):
        plan_many_arms(problem, retiming="ruckig_direct")
    with pytest.raises(UnknownNameError, match=r"retiming.*blend, stop, ruckig") as refused:
        plan_many_arms(problem, retiming="smooth")
    assert "ruckig_direct" not in str(refused.value)
    with pytest.raises(InputError, match="torque_limits"):
        plan_many_arms(problem, torque_limits=1)
