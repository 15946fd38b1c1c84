"""Several to hundreds of arms: the same verdicts as with all pairs of shapes, whatever the broad phase omits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Geometry, Link
from rr1plan.scene import Arm
from rr1plan.transforms import pose
from rr1plan.validation import validate

Make = Callable[..., Any]
BALL = rp.Sphere(0.05)
# Largest overestimate of Coal's distance of two convex shapes [m].
COAL = 2e-5


def crowd(rng: np.random.Generator, chain: Make, shape: Make, count: int, spacing: float) -> rp.Scene:
    """Arms of two robots on a grid, obstacles among them, one held thing, and some rules."""
    robots = chain(rng, 3), chain(rng, 2)
    arms = {
        f"arm{i}": Arm(robots[i % 2], pose([spacing * (i // 3), spacing * (i % 3), 0.0], rpy=rng.normal(size=3)))
        for i in range(count)
    }
    scene = rp.Scene(arms=arms)
    for k in range(2):
        place = pose([*rng.uniform(-0.5, 2.5 * spacing, 2), rng.uniform(-0.5, 0.5)], rpy=rng.normal(size=3))
        scene = scene.with_obstacle(f"thing{k}", shape(rng), place)
    tool = scene.arms["arm0"].robot.tool
    where = scene.link_poses()[f"arm0/{tool}"] @ pose(0.2 * rng.normal(size=3))
    scene = scene.with_obstacle("held", rp.Box((0.02, 0.02, 0.1)), where).attach("held", "arm0")
    scene = scene.with_padding(0.002).with_padding(0.01, "arm0", "arm1").allow("held", "thing0")
    return scene.with_padding(0.03, f"arm1/{robots[1].tool}", "thing1")


def moving(scene: rp.Scene, rng: np.random.Generator, reach: float) -> rp.Trajectory:
    """Some arms move along cubics, some from a later time on, in columns of any order."""
    names = [name for name in scene.arms if rng.uniform() < 0.7] or ["arm0"]
    parts = []
    for name in names:
        q = scene.arms[name].q
        begin, seconds = rng.uniform(0.0, 0.5), rng.uniform(0.3, 1.5)
        times = begin + seconds * np.linspace(0.0, 1.0, 3)
        rows = np.stack([q, q + reach * rng.normal(size=len(q)), q + reach * rng.normal(size=len(q))])
        columns = [f"{name}/{joint}" for joint in scene.arms[name].robot.joint_names]
        parts.append(rp.Trajectory.from_samples(columns, times, rows, np.zeros_like(rows)))
    whole = rp.Trajectory.merge(*parts)
    order = rng.permutation(len(whole.joint_names))
    columns = tuple(whole.joint_names[i] for i in order)
    return rp.Trajectory(columns, whole.breaks, whole.coefficients[:, :, order])


@pytest.mark.parametrize("count", [2, 3, 5, 9])
def test_all_pairs_say_the_same_of_random_crowds(
    count: int, chain: Make, shape: Make, proof_of: Make, all_pairs: Make
) -> None:
    verdicts = []
    for seed in range(24):
        rng = np.random.default_rng(100 * count + seed)
        scene = crowd(rng, chain, shape, count, (0.35, 0.6, 1.5)[seed % 3])
        move = moving(scene, rng, (0.1, 0.5)[seed % 2])
        found, sure = proof_of(scene, move), all_pairs(scene, move)
        hits = [contact.pair for contact in found.contacts]
        assert hits == sure.hits, seed
        assert [contact.pair for contact in proof_of(scene, move, clearance=False).contacts] == hits, seed
        verdicts.append(bool(hits))
        for nearest, proven, smallest in zip(found.nearest, found.proven, sure.smallest, strict=True):
            if hits or nearest is None:
                assert hits or np.isinf(smallest)
                continue
            assert nearest.clearance == pytest.approx(smallest, abs=2e-4 + COAL), seed
            assert nearest.clearance - 2e-4 - COAL <= proven <= nearest.clearance
        ends_are_nearest(scene, move, found, all_pairs)
    assert 0 < sum(verdicts) < len(verdicts)


def ends_are_nearest(scene: rp.Scene, move: rp.Trajectory, found: Any, all_pairs: Make) -> None:
    """The smallest clearance at each end is that of a motion that stays there."""
    for end, time in zip(found.ends, move.breaks[[0, -1]], strict=True):
        still = all_pairs(scene, rp.Trajectory.rest(move.joint_names, move(time)))
        if not still.hits:
            assert end.clearance == pytest.approx(still.smallest[0], abs=COAL)
            assert end.time == time


@pytest.mark.parametrize("seed", range(6))
def test_fcl_agrees_at_every_sample_of_several_arms(
    seed: int, chain: Make, shape: Make, proof_of: Make, fcl_world: Make
) -> None:
    rng = np.random.default_rng(seed)
    scene = crowd(rng, chain, shape, 4, (0.8, 1.5, 3.0)[seed % 3])
    scene = rp.Scene(scene.arms, scene.obstacles, scene.attachments, scene.allowed)
    move = moving(scene, rng, 0.2)
    found, world = proof_of(scene, move), fcl_world(scene)
    hits = [contact.pair for contact in found.contacts]
    for t in np.linspace(move.breaks[0], move.breaks[-1], 60):
        world.place(move.joint_names, move(t))
        assert all(pair in hits or not world.pair_touches(*pair) for pair in scene.checked_pairs)
        if not hits:
            assert found.proven[0] <= world.distance(own=False) + 1e-4
    for contact in found.contacts:
        world.place(move.joint_names, move(contact.time))
        assert contact.clearance > -1e-5 or world.pair_touches(*contact.pair)


# ---- planted contacts ----------------------------------------------------------------------


def sliders(slider: Make, count: int, spacing: float) -> rp.Scene:
    """Balls on rails along x, side by side."""
    robot = slider(BALL)
    arms = {f"arm{i}": Arm(robot, pose([0.0, spacing * i, 0.0])) for i in range(count)}
    return rp.Scene(arms=arms)


@pytest.mark.parametrize("depth", [0.0005, 0.001, -0.0005, -0.001])
@pytest.mark.parametrize("count", [2, 9, 60])
def test_balls_that_pass_each_other_touch_for_an_instant(depth: float, count: int, slider: Make, quintic: Make) -> None:
    """Two of many cross between samples; their least distance is known in closed form."""
    scene = sliders(slider, count, 0.3)
    one, two = f"arm{count // 2 - 1}", f"arm{count // 2}"
    # Both balls reach x = 0.5 at half time, one from each side, on rails as far apart as they touch.
    base = scene.arms[one].base.copy()
    base[1, 3] = scene.arms[two].base[1, 3] - (0.1 - depth)
    scene = replace(scene, arms={**scene.arms, one: Arm(scene.arms[one].robot, base)})
    names = scene.joint_names()
    start, goal = np.zeros(count), np.zeros(count)
    start[count // 2 - 1], goal[count // 2 - 1], start[count // 2], goal[count // 2] = 0.0, 1.0, 1.0, 0.0
    report = validate(quintic(names, start, goal, 0.01), scene)
    hits = [v for v in report.violations if v.kind == "collision"]
    assert [set(v.subject) for v in hits] == ([{f"{one}/carriage", f"{two}/carriage"}] if depth > 0.0 else [])
    if hits:
        assert hits[0].value == pytest.approx(-depth, abs=1e-6)
        assert hits[0].time == pytest.approx(0.005, abs=1e-5)
    else:
        assert report.margins["clearance"].value == pytest.approx(-depth, abs=1e-7)
        assert set(report.margins["clearance"].subject) == {f"{one}/carriage", f"{two}/carriage"}
        assert report.margins["clearance"].time == pytest.approx(0.005, abs=1e-5)
        assert 0.0 < report.margins["clearance_proven"].value <= -depth


def test_a_large_padding_of_two_arms_counts_beside_others_that_are_nearer(slider: Make, quintic: Make) -> None:
    scene = sliders(slider, 9, 0.3)
    move = quintic(scene.joint_names(), np.zeros(9), np.full(9, 0.1))
    least = validate(move, scene.with_padding(0.75, "arm1", "arm4")).margins["clearance"]
    assert least.value == pytest.approx(0.05, abs=1e-9)
    assert set(least.subject) == {"arm1/carriage", "arm4/carriage"}
    for padding, certified in ((0.79, True), (0.81, False)):
        padded = scene.with_padding(padding, "arm1", "arm4")
        for names in (scene.joint_names(), ("arm1/slide", "arm4/slide")):
            part = quintic(names, np.zeros(len(names)), np.full(len(names), 0.1))
            assert validate(part, padded).certified is certified
        assert validate(rp.Trajectory.rest(("arm0/slide",), [0.0]), padded).certified is certified


def test_the_base_of_an_arm_counts(slider: Make, quintic: Make) -> None:
    scene = sliders(slider, 20, 0.3)
    names = scene.joint_names()
    move = quintic(names, np.zeros(20), np.linspace(0.0, 0.5, 20))
    assert validate(move, scene).certified
    base = scene.arms["arm7"].base.copy()
    base[1, 3] += 0.201
    moved = replace(scene, arms={**scene.arms, "arm7": Arm(scene.arms["arm7"].robot, base)})
    assert [v.subject for v in validate(move, moved).violations if v.kind == "collision"] == [
        ("arm7/carriage", "arm8/carriage")
    ]


def test_an_arm_that_comes_late_hits_one_that_has_finished(slider: Make, quintic: Make) -> None:
    scene = sliders(slider, 12, 0.3).with_arm("late", slider(rp.Box((0.02, 3.0, 0.02))), q=[-1.0])
    first = quintic([f"arm{i}/slide" for i in range(12)], np.zeros(12), np.linspace(0.1, 0.9, 12), 0.5)
    short = quintic(["late/slide"], [-1.0], [0.1 - 0.06 - 1e-4], 0.5).shifted(3.0)
    assert validate(rp.Trajectory.merge(first, short), scene).certified
    far = quintic(["late/slide"], [-1.0], [0.1 - 0.06 + 5e-4], 0.5).shifted(3.0)
    (hit,) = [v for v in validate(rp.Trajectory.merge(first, far), scene).violations if v.kind == "collision"]
    assert set(hit.subject) == {"late/carriage", "arm0/carriage"}
    assert hit.time == pytest.approx(3.5, abs=1e-4)
    assert hit.value == pytest.approx(-5e-4, abs=1e-6)


# ---- arms that stand still -----------------------------------------------------------------


def test_arms_that_stand_still_are_decided_with_each_other(slider: Make, quintic: Make) -> None:
    scene = sliders(slider, 30, 0.3)
    base = scene.arms["arm20"].base.copy()
    base[1, 3] -= 0.2 + 1e-4
    touching = replace(scene, arms={**scene.arms, "arm20": Arm(scene.arms["arm20"].robot, base)})
    move = quintic(["arm3/slide"], [0.0], [0.5])
    assert validate(move, scene).certified
    assert validate(move, scene).margins["clearance"].value == pytest.approx(0.2, abs=1e-9)
    (hit,) = [v for v in validate(move, touching).violations if v.kind == "collision"]
    assert set(hit.subject) == {"arm19/carriage", "arm20/carriage"}
    assert hit.value == pytest.approx(-1e-4, abs=1e-8)


def test_own_contacts_of_arms_in_equal_configurations_are_reported_of_each(
    slider: Make, quintic: Make, proof_of: Make, all_pairs: Make
) -> None:
    robot = slider(BALL)
    base = Link("base", collisions=(Geometry("block", rp.Sphere(0.1)),))
    robot = replace(robot, links=(base, *robot.links[1:]))
    stands = {0: 0.3, 1: 0.1, 2: 0.1, 3: 0.3, 4: 0.1, 5: 0.12}
    arms = {f"arm{i}": Arm(robot, pose([0.0, float(i), 0.0]), [q]) for i, q in stands.items()}
    # One of them has a rule about its own pair, so that its configuration is no contact.
    scene = rp.Scene(arms=arms).allow("arm4/base", "arm4/carriage")
    move = quintic(["arm0/slide"], [0.3], [0.4])
    found, sure = proof_of(scene, move), all_pairs(scene, move)
    assert [contact.pair for contact in found.contacts] == sure.hits
    assert sure.hits == [(f"arm{i}/base", f"arm{i}/carriage") for i in (1, 2, 5)]
    depths = [contact.clearance for contact in found.contacts]
    assert depths == pytest.approx([-0.05, -0.05, -0.03], abs=1e-6)


def test_arms_far_apart_cost_no_more_than_each_alone(rr1: rp.Robot) -> None:
    """A hundred arms with the same motion: no pair of shapes of two arms is examined."""
    shapes = []
    for count in (1, 100):
        scene = rp.Scene(arms={f"arm{i}": Arm(rr1, pose([5.0 * (i % 10), 5.0 * (i // 10), 0.0])) for i in range(count)})
        q = scene.configuration()
        move = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], [q, q + 0.2], np.zeros((2, len(q))))
        report = validate(move, scene, clearance=False)
        assert "collision" in report.checked
        shapes.append(report.statistics["pair_checks"])
    assert shapes[1] == 100 * shapes[0]


@pytest.mark.parametrize("moving", [1, 40])
def test_a_concave_mesh_among_many_arms_is_found(moving: int, slider: Make, quintic: Make) -> None:
    scene = sliders(slider, 40, 0.3)
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
    cup = rp.Mesh(corners, np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 4, 1], [1, 4, 5]]), convex=False)
    near = scene.with_obstacle("cup", cup, [0.5, 0.3 * 20, 0.0])
    names = [f"arm{i}/slide" for i in ((20,) if moving == 1 else range(40))]
    report = validate(quintic(names, np.zeros(moving), np.full(moving, 0.3)), near)
    assert report.certified
    assert report.margins["clearance"].value == pytest.approx(0.05, abs=1e-4)
    assert "cup" in report.margins["clearance_end"].subject
    report = validate(quintic(names, np.zeros(moving), np.full(moving, 0.36)), near)
    assert [set(v.subject) for v in report.violations if v.kind == "collision"] == [{"arm20/carriage", "cup"}]
