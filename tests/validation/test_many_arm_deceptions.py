"""Motions of many arms that look right: contacts between ticks, at the ends, with an arm at rest, at another base."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.scene import Arm
from rr1plan.transforms import pose
from rr1plan.validation import validate

Make = Callable[..., Any]
RADIUS = 0.05
BALL = rp.Sphere(RADIUS)
TICK = 0.01
# Depths of contacts and a clearance that is none [m], duration of the shortest contact [s].
DEPTH, CLEAR, BLINK = 1e-3, 2e-3, 5e-4


def collisions(report: rp.Report) -> list[rp.Violation]:
    return [violation for violation in report.violations if violation.kind == "collision"]


def rails(slider: Make, count: int, gap: float) -> rp.Scene:
    """Balls on parallel rails along x; the two in the middle pass each other with a gap, the others are far away."""
    robot = slider(BALL)
    places = [float(i) for i in range(count)]
    places[count // 2] = places[count // 2 - 1] + 2.0 * RADIUS + gap
    return rp.Scene(arms={f"arm{i}": Arm(robot, pose([0.0, y, 0.0])) for i, y in enumerate(places)})


def pair_of(scene: rp.Scene) -> tuple[str, str]:
    count = len(scene.arms)
    return f"arm{count // 2 - 1}", f"arm{count // 2}"


def with_others(scene: rp.Scene, *parts: rp.Trajectory) -> rp.Trajectory:
    """Some motions, and slow ones of all other arms."""
    moved = {arm for part in parts for arm in part.arms}
    names = [f"{arm}/slide" for arm in scene.arms if arm not in moved]
    if not names:
        return rp.Trajectory.merge(*parts)
    q = np.zeros((2, len(names)))
    q[1] = 0.3
    merged = rp.Trajectory.merge(*parts, rp.Trajectory.from_samples(names, [0.0, 1.0], q, np.zeros_like(q)))
    order = [merged.joint_names.index(name) for name in scene.joint_names()]
    return rp.Trajectory(scene.joint_names(), merged.breaks, merged.coefficients[:, :, order])


def assert_free_at_ticks(motion: rp.Trajectory, scene: rp.Scene) -> None:
    checker = rp.CollisionChecker(scene, motion.arms)
    assert all(checker.is_free_slowly(q) for q in motion.sample(TICK)[1])


def passing(scene: rp.Scene, at: float) -> rp.Trajectory:
    """Two balls pass each other at a time, at the speed at which a contact 1 mm deep takes half a millisecond."""
    one, two = pair_of(scene)
    near = 2.0 * np.sqrt((2.0 * RADIUS) ** 2 - (2.0 * RADIUS - DEPTH) ** 2)
    speed = 0.5 * near / BLINK
    names = (f"{one}/slide", f"{two}/slide")
    ramp = rp.Trajectory.from_samples(names, [0.0, at, 2.0 * at], [[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]])
    q = ramp(np.array(at))
    far = np.array([1.0, -1.0]) * speed * 2e-3
    rows = [[0.0, 1.0], q - far, q + far, [1.0, 0.0]]
    rates = [[0.0, 0.0], [speed, -speed], [speed, -speed], [0.0, 0.0]]
    return rp.Trajectory.from_samples(names, [0.0, at - 2e-3, at + 2e-3, 1.0], rows, rates)


@pytest.mark.parametrize("count", [2, 9, 60])
def test_a_contact_of_half_a_millisecond_between_ticks_is_seen(count: int, slider: Make) -> None:
    at = 50.5 * TICK
    scene = rails(slider, count, -DEPTH)
    motion = with_others(scene, passing(scene, at))
    if count < 60:
        assert_free_at_ticks(motion, scene)
    (hit,) = collisions(validate(motion, scene))
    assert {name.split("/")[0] for name in hit.subject} == set(pair_of(scene))
    assert hit.value == pytest.approx(-DEPTH, abs=2e-5)
    assert abs(hit.time - at) < BLINK
    scene = rails(slider, count, CLEAR)
    report = validate(with_others(scene, passing(scene, at)), scene)
    assert not collisions(report)
    assert report.margins["clearance"].value == pytest.approx(CLEAR, abs=2e-4)


@pytest.mark.parametrize(("depth", "caught"), [(DEPTH, True), (-CLEAR, False)])
@pytest.mark.parametrize("end", ["start", "end"])
@pytest.mark.parametrize("count", [2, 12])
def test_touching_in_the_first_or_last_instant_only_is_seen(
    count: int, end: str, depth: float, caught: bool, slider: Make, quintic: Make
) -> None:
    scene = rails(slider, count, -0.05)
    one, two = pair_of(scene)
    across = scene.arms[two].base[1, 3] - scene.arms[one].base[1, 3]
    touching = float(np.sqrt((2.0 * RADIUS - depth) ** 2 - across**2))
    ends = ([touching, 0.0], [1.0, 0.0]) if end == "start" else ([1.0, 0.0], [touching, 0.0])
    motion = with_others(scene, quintic([f"{one}/slide", f"{two}/slide"], *ends, 1.0))
    hits = collisions(validate(motion, scene))
    assert bool(hits) is caught
    if caught:
        assert hits[0].time == pytest.approx(0.0 if end == "start" else 1.0, abs=0.2)
        assert hits[0].value == pytest.approx(-DEPTH, abs=5e-5)


@pytest.mark.parametrize(("depth", "caught"), [(DEPTH, True), (-CLEAR, False)])
def test_an_arm_that_has_finished_is_hit_by_one_that_takes_longer(
    depth: float, caught: bool, slider: Make, quintic: Make
) -> None:
    scene = rails(slider, 8, -0.05)
    one, two = pair_of(scene)
    across = scene.arms[two].base[1, 3] - scene.arms[one].base[1, 3]
    near = float(np.sqrt((2.0 * RADIUS - depth) ** 2 - across**2))
    short = quintic([f"{one}/slide"], [0.0], [0.5], 0.3)
    for seconds in (2.0, 4.0):
        long = quintic([f"{two}/slide"], [1.5], [0.5 + near], seconds)
        for motion in (rp.Trajectory.merge(short, long), rp.Trajectory.merge(long, short)):
            hits = collisions(validate(motion, scene))
            assert bool(hits) is caught
            assert all(hit.time > 0.8 * seconds for hit in hits)


# ---- real arms -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plan(rr1: rp.Robot) -> tuple[rp.Problem, rp.Trajectory]:
    problem = rp.ring_swap(rr1, 4, 0.5, rng=1)
    result = rp.plan_many_arms(problem, rng=0, budget=rp.Budget(seconds=60.0))
    assert result.trajectory is not None, result.reason
    assert validate(result.trajectory, problem.scene, problem).certified
    return problem, result.trajectory


def _toward(problem: rp.Problem, q: np.ndarray, arm: str, clearance: float, rng: np.random.Generator) -> np.ndarray:
    """Displacement of an arm along some direction until it is this close to another arm, shape (nq,)."""
    scene = problem.scene
    for name, part in scene.split(q, problem.arms).items():
        scene = scene.with_configuration(name, part)
    checker = rp.CollisionChecker(scene, [arm])
    here = scene.arms[arm].q
    while True:
        direction = 0.5 * rng.normal(size=len(here))
        low, high = 0.0, None
        for share in np.linspace(0.05, 1.0, 20):
            if checker.nearest(here + share * direction).distance < clearance:
                high = share
                break
            low = share
        if high is None:
            continue
        for _ in range(40):
            middle = 0.5 * (low + high)
            near = checker.nearest(here + middle * direction)
            low, high = (low, middle) if near.distance < clearance else (middle, high)
        near = checker.nearest(here + high * direction)
        owners = {scene.owner(name) for name in near.pair}
        if len(owners) == 2 and owners <= set(scene.arms):
            return np.asarray(high * direction)


def _blink(motion: rp.Trajectory, arm: str, change: np.ndarray, at: float) -> rp.Trajectory:
    """A motion at whose end one arm goes somewhere and comes back within half a millisecond."""
    q = motion(motion.end_time)
    columns = [i for i, name in enumerate(motion.joint_names) if name.startswith(f"{arm}/")]
    bump = np.zeros((1, 5, len(q)))
    bump[0, 0] = q
    for power, factor in ((2, 16.0), (3, -32.0), (4, 16.0)):
        bump[0, power, columns] = factor * change / BLINK**power
    begin = motion.end_time
    still = rp.Trajectory.rest(motion.joint_names, q, duration=at)
    breaks = np.concatenate([motion.breaks, begin + at + np.array([0.0, BLINK, 0.01])])
    terms = max(motion.coefficients.shape[1], 5)
    rows = [motion.coefficients, still.coefficients, bump, still.coefficients]
    padded = [np.pad(part, ((0, 0), (0, terms - part.shape[1]), (0, 0))) for part in rows]
    return rp.Trajectory(motion.joint_names, breaks, np.concatenate(padded))


@pytest.mark.parametrize(("clearance", "caught"), [(-DEPTH, True), (CLEAR, False)])
@pytest.mark.parametrize("arm", ["arm01", "arm03"])
def test_a_blink_of_a_real_arm_is_seen(
    arm: str, clearance: float, caught: bool, plan: tuple[rp.Problem, rp.Trajectory]
) -> None:
    problem, motion = plan
    q = motion(motion.end_time)
    change = _toward(problem, q, arm, clearance, np.random.default_rng(0))
    ticks = np.ceil(motion.end_time / TICK) * TICK - motion.end_time
    blink = _blink(motion, arm, change, float(ticks) + 0.45 * TICK)
    hits = collisions(validate(blink, problem.scene))
    assert bool(hits) is caught
    if caught:
        assert_free_at_ticks(blink, problem.scene)
        assert any(arm in name for name in hits[0].subject)
        assert hits[0].time > motion.end_time


def test_a_plan_at_another_base_is_seen(plan: tuple[rp.Problem, rp.Trajectory]) -> None:
    problem, motion = plan
    scene = problem.scene
    caught = 0
    for arm in scene.arms:
        for offset in ((0.1, 0.0, 0.0), (-0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, -0.1, 0.0)):
            base = scene.arms[arm].base.copy()
            base[:3, 3] += offset
            moved = replace(scene, arms={**scene.arms, arm: replace(scene.arms[arm], base=base)})
            report = validate(motion, moved)
            checker = rp.CollisionChecker(moved, motion.arms)
            touches = not all(checker.is_free_slowly(q) for q in motion.sample(TICK)[1])
            caught += bool(collisions(report))
            assert not touches or collisions(report)
    assert caught


def test_arms_that_come_late_or_take_longer_are_seen(plan: tuple[rp.Problem, rp.Trajectory]) -> None:
    """For all delays, the referee finds the contacts that samples find, and some between samples."""
    problem, motion = plan
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(12):
        late = rp.Trajectory.merge(
            *(motion.select(a).stretched(rng.uniform(1.0, 2.0)).shifted(rng.uniform(0.0, 0.5)) for a in motion.arms)
        )
        hits = collisions(validate(late, problem.scene))
        checker = rp.CollisionChecker(problem.scene, late.arms)
        touches = not all(checker.is_free_slowly(q) for q in late.sample(TICK)[1])
        assert hits or not touches
        found += bool(hits)
    assert found
