"""The certified corridor: levers bound how far bodies approach each other, and no state inside is in contact."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.mirror import corridor


def two_arms() -> rp.Scene:
    robot = rp.load_robot("rr1")
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, rp.transforms.pose([0.0, 0.55, 0.0]))
    box = scene.with_obstacle("box", rp.Box((0.2, 0.2, 0.3)), [-0.5, 0.2, 0.15])
    return box.with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.02))


def scene_of(name: str) -> rp.Scene:
    if name in ("RP", "PR", "PP"):
        arm = rp.planar_arm(name, (1.0, 0.7), limits=[(-3.0, 3.0), (-3.0, 3.0)])
        return rp.Scene().with_arm("arm", arm).with_obstacle("disc", rp.Cylinder(0.1, 0.2), (0.9, 0.9, 0.0))
    return two_arms() if name == "two arms" else rp.load_scene(name)


@pytest.mark.parametrize("name", ["rr1_table", "planar2r_path", "two arms", "RP", "PR", "PP"])
def test_no_pair_comes_nearer_than_its_levers_say(name: str) -> None:
    checker = rp.CollisionChecker(scene_of(name))
    levers, rng = checker.tables.pair_levers(np.full(checker.nq, 3.0)), np.random.default_rng(0)
    assert levers.max() < 10.0
    compared = 0
    for _ in range(100):
        q = rng.uniform(-2.0, 2.0, checker.nq)
        change = rng.uniform(-1.0, 1.0, len(q)) * 10.0 ** rng.uniform(-3, 0)
        before, after = checker.solid_distances(q), checker.solid_distances(q + change)
        apart = (before > 0.0) & (after > 0.0)
        compared += int(apart.sum())
        assert (np.abs(after - before) <= levers @ np.abs(change) + 1e-6)[apart].all()
    assert compared > 100


def motion_in(scene: rp.Scene, goal: object) -> rp.Trajectory:
    motion = rp.plan_motion(rp.Problem(scene, None, goal), rng=0)
    assert motion.trajectory is not None
    return motion.trajectory


def test_configurations_inside_are_free() -> None:
    scene = rp.load_scene("rr1_table")
    motion = motion_in(scene, rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
    tube, checker, rng = rp.certified_corridor(scene, motion), rp.CollisionChecker(scene), np.random.default_rng(0)
    inside = touching = 0
    for _ in range(1500):
        q = motion(rng.uniform(0.0, motion.duration)) + rng.uniform(-0.15, 0.15, 6) * rng.uniform()
        free = checker.is_free_slowly(q)
        touching += not free
        if tube.position(q).use < 1.0:
            inside += 1
            assert free
    assert inside > 300
    assert touching > 20  # so the corridor had something to tell apart


def test_the_motion_itself_is_inside_and_names_come_with_a_place() -> None:
    scene = two_arms()
    goal = {"left": rp.JointGoal(np.full(6, 0.3)), "right": rp.JointGoal([-0.4, 0.1, 0.2, 0.0, 1.0, 0.0])}
    motion = motion_in(scene, goal)
    tube = rp.certified_corridor(scene, motion)
    assert set(tube.joint_names) == set(motion.joint_names)
    columns = [motion.joint_names.index(name) for name in tube.joint_names]
    for time in np.linspace(0.0, motion.duration, 37):
        place = tube.position(motion(time)[columns])
        assert place.use < 1.0
        assert place.time == pytest.approx(time, abs=0.06)
    assert all("/" in name or name in scene.obstacles for name in place.pair)
    assert (tube.free_change() > 0.0).all()


def test_a_pause_of_an_hour_takes_no_more_samples_than_a_short_one() -> None:
    """It used to take one every 50 ms, which was refused as too much memory."""
    scene = rp.load_scene("rr1_table")
    home = scene.configuration()
    q = np.array([home, home + 0.1, home + 0.1, home])
    short, hour = (
        rp.certified_corridor(
            scene, rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0, 1.0 + pause, 2.0 + pause], q, 0.0 * q)
        )
        for pause in (0.1, 3600.0)
    )
    assert len(hour.times) == len(short.times)
    assert hour.times[-1] == 3602.0
    np.testing.assert_allclose(hour.distances, short.distances, atol=1e-9)


def test_a_whole_turn_is_no_deviation(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("box", rp.Box((0.1, 0.1, 0.1)), [0.4, -0.4, 0.0])
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0], [[0.0, 0.5], [1.0, 0.5]])
    tube = rp.certified_corridor(scene, motion)
    turned = motion(0.4) + 2.0 * np.pi * np.array([1.0, -2.0])
    assert tube.position(turned).use == pytest.approx(tube.position(motion(0.4)).use, abs=1e-6)
    np.testing.assert_allclose(tube.deviation(turned, motion(0.4)), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["rr1_table", "two arms", "RP"])
def test_the_smallest_share_is_that_of_a_search_through_all_pairs(name: str) -> None:
    scene = scene_of(name)
    start, rng = scene.configuration(), np.random.default_rng(3)
    end, still = start + rng.uniform(-0.05, 0.05, len(start)), np.zeros((2, len(start)))
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 2.0], [start, end], still, still)
    tube = rp.certified_corridor(scene, motion)
    for displacement in (0.0, 0.002):
        for q in rng.uniform(np.minimum(start, end), np.maximum(start, end), (20, len(start))):
            off = np.abs(tube.configurations - q)
            near = np.argsort(off @ tube.levers.max(axis=0), kind="stable")[: corridor._NEAREST]
            uses = (off[near] @ tube.levers.T + 2.0 * displacement) / tube.distances[near]
            k = int(np.argmin(uses.max(axis=1)))
            found = tube.position(q, displacement=displacement)
            assert found.use == pytest.approx(uses[k].max(), rel=1e-12)
            assert found.time == tube.times[near[k]]
            assert found.pair == tube.pairs[int(np.argmax(uses[k]))]


def test_a_motion_in_collision_or_of_too_many_bodies_has_no_corridor(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rp.load_scene("rr1_table")
    motion = motion_in(scene, rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
    inside = scene.with_obstacle("block", rp.Box((0.1, 0.1, 0.1)), [-0.30, 0.25, 0.20])
    with pytest.raises(rp.InputError, match=r"no corridor: at \d.*'block'.* touch"):
        rp.certified_corridor(inside, motion)
    monkeypatch.setattr(corridor, "_MOST_DISTANCES", 10_000)
    with pytest.raises(rp.InputError, match=r"too much memory after \d.* s; take a part"):
        rp.certified_corridor(scene, motion)
    with pytest.raises(rp.InputError, match="the trajectory has no joints"):
        rp.Mirror(scene, rp.Trajectory.rest((), []))
    with pytest.raises(rp.UnknownNameError, match="unknown arm 'rr1'"):
        rp.certified_corridor(rp.Scene().with_arm("other", rp.load_robot("rr1")), motion)
