"""Edges among arms that follow trajectories: against Coal sampled finely, the referee, and arithmetic."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker, TimedChecker, timed_checker
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.kernels.planner_kernels import LIBRARY
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Sphere
from rr1plan.trajectory import Trajectory
from rr1plan.transforms import pose


@pytest.fixture(scope="module")
def pair():
    return rp.load_scene("rr1_pair")


@pytest.fixture(scope="module")
def sliders():
    """Balls of 5 cm on rails along x, one of which is turned: it slides along y."""
    limits = Limits(np.full(1, -5.0), np.full(1, 5.0), *(np.ones(1) for _ in range(4)))
    links = (
        Link("rail", collisions=(Geometry("r", Box((0.02, 0.02, 0.02)), pose([-3.0, 0, -1.0])),)),
        Link("cart", collisions=(Geometry("c", Sphere(0.05)),)),
    )
    joint = Joint("slide", "prismatic", "rail", "cart", axis=[1, 0, 0])
    robot = Robot("slider", links, (joint,), ("slide",), limits, {"home": np.zeros(1)}, {}, frozenset(), "cart")
    scene = Scene().with_arm("one", robot, q=[-1.0])
    scene = scene.with_arm("two", robot, pose([0, 0, 0], rpy=[0, 0, np.pi / 2]), q=[-1.0])
    return scene.with_arm("far", robot, pose([0, 3.0, 0]), q=[-1.0])


def slide(arm, times, positions):
    return Trajectory.from_samples((f"{arm}/slide",), times, np.array(positions, float)[:, None])


def random_motion(names, rng, low, high):
    count = int(rng.integers(2, 9))
    times = np.sort(rng.uniform(0.0, 3.0, count)) + 0.05 * np.arange(count)
    q, qd = rng.uniform(low, high, (count, len(names))), rng.normal(size=(count, len(names)))
    return Trajectory.from_samples(names, times, q, qd if rng.random() < 0.7 else None)


def line(checker, q_from, q_to, t_from, t_to):
    return Trajectory.from_samples(checker.joint_names, [t_from, t_to], [q_from, q_to])


def between(contacts, arms=("left", "right")):
    """Contacts between two arms of a scene."""
    return [c for c in contacts if {c.a.split("/")[0], c.b.split("/")[0]} == set(arms)]


def test_random_edges_agree_with_coal_sampled_and_with_the_referee(pair):
    rng = np.random.default_rng(3)
    left, whole = CollisionChecker(pair, ["left"]), CollisionChecker(pair)
    alone = CollisionChecker(pair.without_arm("right"))
    low, high = np.maximum(left.limits.lower, -2.5), np.minimum(left.limits.upper, 2.5)
    verdicts = []
    for _ in range(7):
        motion = random_motion(pair.joint_names(["right"]), rng, 0.8 * low, 0.8 * high)
        timed = TimedChecker(left, {"right": motion})
        for _ in range(4):
            a = rng.uniform(low, high)
            b = np.clip(a + 0.4 * rng.normal(size=6), low, high)
            if not alone.edge_is_free(a, b):
                assert not timed.edge_is_free(a, b, 0.0, 1.0)
                continue
            t0 = float(rng.uniform(-0.5, 3.0))
            t1 = t0 + float(rng.uniform(0.05, 1.5))
            free, contact = timed.edge_is_free(a, b, t0, t1), timed.first_contact(a, b, t0, t1)
            own = line(left, a, b, t0, t1)
            sampled = [t for t in np.linspace(t0, t1, 60) if between(whole.contacts(np.append(own(t), motion(t))))]
            report = rp.validate(part(Trajectory.merge(own, motion), t0, t1), pair)
            crossing = [v for v in report.violations if v.kind in ("collision", "undecided") and crosses(v.subject)]
            assert free == (contact is None) == (not crossing)
            assert free == timed.trajectory_is_free(own)
            if not free:
                assert {name.split("/")[0] for name in contact.pair} == {"left", "right"}
                assert np.allclose(contact.q, own(contact.time), atol=1e-12)
                # Free until then, and in contact right after.
                assert not sampled or contact.time <= sampled[0] + 1e-9
                assert timed.edge_is_free(a, own(contact.time - 1e-6), t0, contact.time - 1e-6) or contact.time <= t0
                at = np.append(own(contact.time), motion(contact.time))
                index = whole.pairs.index(contact.pair if contact.pair in whole.pairs else contact.pair[::-1])
                assert whole.distances(at)[index] < 1e-5
                of = timed.first_contact_of(own)
                assert abs(of.time - contact.time) < 1e-6
            assert not (free and sampled)
            verdicts.append(free)
    assert 5 < sum(verdicts) < len(verdicts) - 3


def part(trajectory, t_from, t_to):
    """A trajectory in an interval of time."""
    inner = trajectory.breaks[(trajectory.breaks > t_from) & (trajectory.breaks < t_to)]
    breaks = np.array([t_from, *inner, t_to])
    clock = Trajectory(("clock/x",), breaks, np.zeros((len(breaks) - 1, 1, 1)))
    merged = Trajectory.merge(trajectory, clock)
    first, last = np.searchsorted(merged.breaks, [t_from, t_to])
    return Trajectory(trajectory.joint_names, breaks, merged.coefficients[first:last, :, :-1])


def crosses(subject):
    return {name.split("/")[0] for name in subject} == {"left", "right"}


def touching_configurations(pair, rng, count):
    """Lines on which both arms first come within 2 mm, then overlap by 1 mm; nothing else is near.

    Returns:
        Configurations of both arms, steps of the second arm, and the fractions of the steps at 2 mm and at -1 mm.
    """
    whole = CollisionChecker(pair)
    cross = np.array([crosses(names) for names in whole.pairs])
    low, high = np.maximum(whole.limits.lower, -2.5), np.minimum(whole.limits.upper, 2.5)
    found = []
    while len(found) < count:
        q, step = rng.uniform(low, high), np.append(np.zeros(6), rng.normal(size=6))
        contact = whole.first_contact(q, q + 0.5 * step) if whole.clearance(q) > 0.01 else None
        if contact is None or not crosses(contact.pair):
            continue
        touch = 0.5 * contact.fraction
        near = bisect(lambda s, q=q, step=step: whole.clearance(q + s * step) > 0.002, 0.0, touch)
        deep = bisect(
            lambda s, q=q, step=step: whole.distances(q + s * step)[cross].min() > -0.001, touch, touch + 0.05, 14
        )
        if whole.distances(q + deep * step)[~cross].min() > 0.005:
            found.append((q, step, near, deep))
    return found


def bisect(holds, low, high, steps=40):
    """The largest number up to which something holds."""
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def test_a_contact_of_half_a_millisecond_and_one_millimeter_is_found_between_ticks(pair):
    rng = np.random.default_rng(5)
    left, names = CollisionChecker(pair, ["left"]), pair.joint_names(["right"])
    for q, step, near, deep in touching_configurations(pair, rng, 4):
        right = [(q + s * step)[6:] for s in (0.0, near, deep)]
        tick = 0.01 * int(rng.integers(40, 60)) + 0.005  # halfway between two ticks of 10 ms
        times = [0.0, tick - 4e-4, tick, tick + 4e-4, 2 * tick]
        hit = Trajectory.from_samples(names, times, [right[0], right[1], right[2], right[1], right[0]])
        miss = Trajectory.from_samples(names, times, [right[0], right[1], right[1], right[1], right[0]])
        moved = q[:6] + 1e-5 * rng.normal(size=6)
        assert not TimedChecker(left, {"right": hit}).edge_is_free(q[:6], moved, 0.0, 2 * tick)
        contact = TimedChecker(left, {"right": hit}).first_contact(q[:6], moved, 0.0, 2 * tick)
        assert abs(contact.time - tick) < 4e-4
        # No false alarm at 2 mm, wherever the edge begins and ends in time.
        timed = TimedChecker(left, {"right": miss})
        assert timed.edge_is_free(q[:6], q[:6], 0.0, 2 * tick)
        assert timed.edge_is_free(q[:6], q[:6], tick, tick)
        # Who arrives there late is hit by an arm that has finished.
        finished = Trajectory.from_samples(names, [0.0, 0.1], [right[0], right[2]])
        timed = TimedChecker(left, {"right": finished})
        assert not timed.edge_is_free(q[:6], q[:6], 5.0, 6.0)
        assert timed.edge_is_free(q[:6], q[:6], -5.0, 0.0)


def test_arms_rest_before_and_after_their_trajectories(sliders):
    one = CollisionChecker(sliders, ["one"])
    # It crosses the way of the other after it has stood at the crossing until 1 s, or stops there at 3 s.
    for times, positions in (([1.0, 2.0], [0.0, 1.0]), ([2.0, 3.0], [1.0, 0.0])):
        timed = TimedChecker(one, {"two": slide("two", times, positions)})
        begins, ends = [[-1.0], [1.0]], ([-2.0, 0.9], [2.05, 2.9], [3.5, 4.5])
        free = [timed.edge_is_free(*begins, *interval) for interval in ends]
        assert free == ([False, True, True] if times[0] == 1.0 else [True, True, False])
        assert [timed.edge_is_free(begins[0], begins[0], *i) for i in ends] == [True] * 3


def test_the_first_contact_is_that_of_arithmetic(sliders):
    # Both at 1 m/s toward the crossing: the balls touch where both are 0.1 / sqrt(2) m away from it.
    timed = TimedChecker(CollisionChecker(sliders, ["one"]), {"two": slide("two", [0.0, 2.0], [-1.0, 1.0])})
    contact = timed.first_contact([-1.0], [1.0], 0.0, 2.0)
    assert contact.time == pytest.approx(1.0 - 0.1 / np.sqrt(2.0), abs=2e-6)
    assert contact.q == pytest.approx([-0.1 / np.sqrt(2.0)], abs=2e-6)
    assert set(contact.pair) == {"one/cart", "two/cart"}
    # A delay of 0.15 s lets them pass, one of 0.14 s does not: they pass at a distance of delay / sqrt(2).
    assert timed.edge_is_free([-1.0], [1.0], 0.1415, 2.1415)
    assert not timed.edge_is_free([-1.0], [1.0], 0.1414, 2.1414)
    # The same far from time zero.
    late = TimedChecker(CollisionChecker(sliders, ["one"]), {"two": slide("two", [1e6, 1e6 + 2.0], [-1.0, 1.0])})
    assert late.edge_is_free([-1.0], [1.0], 1e6 + 0.1415, 1e6 + 2.1415)
    assert not late.edge_is_free([-1.0], [1.0], 1e6 + 0.1414, 1e6 + 2.1414)
    # Less than a micrometer counts as contact.
    assert not timed.edge_is_free([-1.0], [1.0], 0.1 * np.sqrt(2.0) + 1e-7, 2.0 + 0.1 * np.sqrt(2.0) + 1e-7)


def test_every_arm_moves_at_its_own_base(sliders):
    one = CollisionChecker(sliders, ["one"])
    for name, free in (("two", False), ("far", True)):
        assert (
            TimedChecker(one, {name: slide(name, [0.0, 2.0], [-1.0, 1.0])}).edge_is_free([-1.0], [1.0], 0.0, 2.0)
            == free
        )
    both = {name: slide(name, [0.0, 2.0], [-1.0, 1.0]) for name in ("far", "two")}
    assert TimedChecker(one, both).first_contact([-1.0], [1.0], 0.0, 2.0).pair in (
        ("one/cart", "two/cart"),
        ("two/cart", "one/cart"),
    )


def test_a_fast_arm_is_met_wherever_it_is_on_its_way(sliders):
    # Slices of its motion are boxes several times as long as it.
    for times in ([0.0, 0.3], [0.0, 0.1], [5.0, 6.0]):
        for name, place in (("one", 0.0), ("far", 3.0)):
            for positions in ([-4.0, 4.0], [4.0, -4.0]):
                timed = TimedChecker(CollisionChecker(sliders, [name]), {"two": slide("two", times, positions)})
                met = times[0] + (place - positions[0]) / (positions[1] - positions[0]) * (times[1] - times[0])
                near = 0.1 / 8.0 * (times[1] - times[0])
                for begin, end, free in (
                    (times[0], times[1], False),
                    (met - near, times[1], False),
                    (times[0], met - 1.01 * near, True),
                    (met + 1.01 * near, times[1] + 1.0, True),
                ):
                    assert timed.edge_is_free([0.0], [0.0], begin, end) == free
                assert timed.first_contact([0.0], [0.0], *times).time == pytest.approx(met - near, abs=1e-6)


def test_arms_without_a_trajectory_stand_still_and_those_with_one_are_not_obstacles(sliders):
    blocked = sliders.with_configuration("two", [0.0])
    one = CollisionChecker(blocked, ["one"])
    assert not TimedChecker(one, {}).edge_is_free([-1.0], [1.0], 0.0, 1.0)
    contact = TimedChecker(one, {}).first_contact([-1.0], [1.0], 2.0, 4.0)
    assert contact.time == pytest.approx(2.9, abs=1e-5)
    away = {"two": Trajectory.rest(("two/slide",), [-1.0])}
    assert TimedChecker(one, away).edge_is_free([-1.0], [1.0], 0.0, 1.0)
    # Contacts of the others with each other or with obstacles are not this edge's.
    wall = sliders.with_obstacle("wall", Box((0.2, 0.2, 0.2)), [0, 1.0, 0])
    assert TimedChecker(CollisionChecker(wall, ["one"]), {"two": slide("two", [0.0, 1.0], [0.5, 1.0])}).edge_is_free(
        [-1.0], [1.0], 0.0, 1.0
    )


def test_the_earlier_of_two_contacts_is_reported(sliders):
    wall = sliders.with_obstacle("wall", Box((0.2, 0.2, 0.2)), [0.5, 0, 0])
    one = CollisionChecker(wall, ["one"])
    crossing = TimedChecker(one, {"two": slide("two", [0.0, 2.0], [-1.0, 1.0])})
    assert set(crossing.first_contact([-1.0], [1.0], 0.0, 2.0).pair) == {"one/cart", "two/cart"}
    late = TimedChecker(one, {"two": slide("two", [3.0, 4.0], [-1.0, 1.0])}).first_contact([-1.0], [1.0], 0.0, 2.0)
    assert set(late.pair) == {"one/cart", "wall"}
    assert late.time == pytest.approx(1.35, abs=1e-5)


def test_a_contact_at_rest_before_the_trajectory_comes_first(sliders):
    for scene in (
        sliders.with_obstacle("post", Sphere(0.05), (-1.0, 0.0, 0.0)),
        sliders.with_arm("two", sliders.arms["two"].robot, pose([-1.0, 1.0, 0.0], rpy=[0, 0, np.pi / 2])),
    ):
        timed = TimedChecker(CollisionChecker(scene, ["one"]), {"two": slide("two", [0.0, 1.0], [-1.0, -1.0])})
        late = slide("one", [2.0, 3.0], [-1.0, 1.0])
        for t_to in (1.0, 3.0):
            contact = timed.first_contact_of(late, 0.0, t_to)
            assert contact.time == 0.0
            assert contact.q == pytest.approx([-1.0])
            assert not timed.trajectory_is_free(late, 0.0, t_to)


def test_several_arms_move_along_edges_together(pair, sliders):
    both = CollisionChecker(sliders, ["one", "far"])
    timed = TimedChecker(both, {"two": slide("two", [0.0, 4.0], [-1.0, 3.5])})
    assert not timed.edge_is_free([0.5, -1.0], [0.6, 1.0], 0.0, 7.11)
    found = timed.first_contact([0.5, 0.0], [0.6, 0.0], 0.0, 4.0)
    assert set(found.pair) == {"far/cart", "two/cart"}
    # As if all three were one composite.
    whole = CollisionChecker(sliders)
    for end in np.linspace(-1.0, 1.0, 9):
        free = whole.edge_is_free([0.5, -1.0, -1.0], [end, 3.0, 1.0])
        assert (
            TimedChecker(both, {"two": slide("two", [1.0, 2.0], [-1.0, 3.0])}).edge_is_free(
                [0.5, -1.0], [end, 1.0], 1.0, 2.0
            )
            == free
        )


def test_padding_margin_and_allowed_contacts_hold_among_moving_arms(sliders):
    def passes(scene, margin=0.0):
        timed = TimedChecker(
            CollisionChecker(scene, ["one"], margin=margin), {"two": slide("two", [0.0, 2.0], [-1.0, 1.0])}
        )
        return timed.edge_is_free([-1.0], [1.0], 0.16, 2.16)  # at 0.0131 m

    assert passes(sliders)
    assert passes(sliders.with_padding(0.012))
    assert not passes(sliders.with_padding(0.014))
    assert not passes(sliders.with_padding(0.014, "one/cart", "two/cart"))
    assert passes(sliders, 0.012)
    assert not passes(sliders, 0.014)
    assert passes(sliders.with_padding(0.014).allow("one/cart", "two/cart"))


def test_a_motion_that_jumps_is_refused_where_the_jump_may_touch(sliders):
    one = CollisionChecker(sliders, ["one"])
    jump = Trajectory(("two/slide",), [0.0, 1.0, 2.0], [[[-1.0]], [[1.0]]])
    assert not TimedChecker(one, {"two": jump}).edge_is_free([0.0], [0.0], 0.0, 2.0)
    assert TimedChecker(one, {"two": jump}).edge_is_free([2.5], [2.5], 0.0, 2.0)


def test_trajectories_of_any_degree_and_order_of_columns(pair):
    rng = np.random.default_rng(8)
    left, names = CollisionChecker(pair, ["left"]), pair.joint_names(["right"])
    low, high = np.maximum(left.limits.lower, -2.0), np.minimum(left.limits.upper, 2.0)
    q, rates = rng.uniform(low, high, (3, 6)), rng.normal(size=(2, 3, 6))
    motion = Trajectory.from_samples(names, [0.0, 0.7, 1.5], q, *rates)
    order = [3, 0, 5, 1, 2, 4]
    turned = Trajectory(tuple(names[i] for i in order), motion.breaks, motion.coefficients[:, :, order])
    own = Trajectory.from_samples(left.joint_names, [0.2, 0.9, 1.2], rng.uniform(low, high, (3, 6)), rates[0])
    one, two = (TimedChecker(left, {"right": m}) for m in (motion, turned))
    for t0, t1 in ((None, None), (0.0, 0.5), (0.25, 0.25), (-1.0, 0.0), (1.0, 3.0), (2.0, 3.0)):
        assert one.trajectory_is_free(own, t0, t1) == two.trajectory_is_free(own, t0, t1)
        assert one.trajectory_is_free(own, t0, t1) == (one.first_contact_of(own, t0, t1) is None)


def test_all_libraries_give_the_same_answers(pair, monkeypatch):
    answers = []
    for variant in LIBRARY.variants:
        library = LIBRARY.load(LIBRARY.variant_file(variant))
        monkeypatch.setattr(timed_checker, "load_library", lambda library=library: library)
        rng, left = np.random.default_rng(1), CollisionChecker(pair, ["left"])
        low, high = np.maximum(left.limits.lower, -2.0), np.minimum(left.limits.upper, 2.0)
        found = []
        for _ in range(10):
            timed = TimedChecker(left, {"right": random_motion(pair.joint_names(["right"]), rng, low, high)})
            contact = timed.first_contact(rng.uniform(low, high), rng.uniform(low, high), 0.5, 1.5)
            found.append(None if contact is None else (contact.time, contact.pair, contact.q.tobytes()))
        answers.append(found)
    assert all(found == answers[0] for found in answers)


def test_a_copy_by_pickle_gives_the_same_answers(sliders):
    timed = TimedChecker(
        CollisionChecker(sliders, ["one"], margin=0.01), {"two": slide("two", [0.0, 2.0], [-1.0, 1.0])}
    )
    contact = timed.first_contact([-1.0], [1.0], 0.0, 2.0)
    copy = pickle.loads(pickle.dumps(timed))
    again = copy.first_contact([-1.0], [1.0], 0.0, 2.0)
    assert (again.time, again.pair) == (contact.time, contact.pair)
    assert set(copy.motions) == {"two"}


def test_bad_input_is_named(sliders, pair):
    one = CollisionChecker(sliders, ["one"])
    good = slide("two", [0.0, 1.0], [-1.0, 1.0])
    with pytest.raises(UnknownNameError, match="tow"):
        TimedChecker(one, {"tow": good})
    with pytest.raises(InputError, match="'one' moves along the edges"):
        TimedChecker(one, {"one": slide("one", [0.0, 1.0], [-1.0, 1.0])})
    with pytest.raises(InputError, match=r"trajectory of 'far' has the joints two/slide, expected far/slide"):
        TimedChecker(one, {"far": good})
    with pytest.raises(InputError, match="motions"):
        TimedChecker(one, [good])
    with pytest.raises(InputError, match="motion of 'two'"):
        TimedChecker(one, {"two": np.zeros(3)})
    with pytest.raises(InputError, match="may reach"):
        TimedChecker(one, {"two": slide("two", [0.0, 1.0], [-1.0, 1e6])})
    timed = TimedChecker(one, {"two": good})
    with pytest.raises(InputError, match=r"t_to = 1.0 s is before t_from = 2.0 s"):
        timed.edge_is_free([0.0], [1.0], 2.0, 1.0)
    with pytest.raises(InputError, match="t_from"):
        timed.edge_is_free([0.0], [1.0], np.nan, 1.0)
    with pytest.raises(InputError, match="expected at most"):
        timed.edge_is_free([0.0], [1.0], 0.0, 1e12)
    with pytest.raises(InputError, match="give it time to move"):
        timed.edge_is_free([0.0], [1.0], 1.0, 1.0)
    with pytest.raises(InputError, match="q"):
        timed.edge_is_free([0.0, 1.0], [1.0], 0.0, 1.0)
    with pytest.raises(InputError, match="q"):
        timed.first_contact([np.nan], [1.0], 0.0, 1.0)
    with pytest.raises(InputError, match=r"has the joints two/slide, expected one/slide"):
        timed.trajectory_is_free(good)
    with pytest.raises(InputError, match="trajectory"):
        timed.first_contact_of("good")
