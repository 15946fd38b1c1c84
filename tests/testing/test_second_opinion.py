"""Second opinions: three checkers find planted contacts, disagreements are named, and the referee agrees with them."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from concave_meshes import terrain, torus

import rr1plan as rp
from rr1plan.testing.collision_checkers import ElementChecker, FclChecker, MujocoChecker
from rr1plan.transforms import pose

_ALL = ("FCL", "Coal", "MuJoCo")


@pytest.fixture(scope="module")
def swing() -> tuple[rp.Scene, rp.Trajectory]:
    """RR1 that turns its shoulder through a post."""
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    scene = scene.with_obstacle("post", rp.Cylinder(0.03, 0.8), [-0.35, 0.0, 0.4])
    q = np.array([[-1.0, 0.0, 0.3, 0.0, 0.5, 0.0], [1.0, 0.0, 0.3, 0.0, 0.5, 0.0]])
    return scene, rp.Trajectory.from_samples(scene.joint_names(), [0.0, 2.0], q, np.zeros((2, 6)))


def test_all_checkers_see_a_post_in_the_way(swing: tuple[rp.Scene, rp.Trajectory]) -> None:
    scene, motion = swing
    seen = rp.second_opinion(motion, scene, step=0.002)
    assert not seen
    assert seen.agree, seen
    assert seen.checkers == _ALL
    firsts = [seen.first_contact(name) for name in _ALL]
    assert all("post" in contact.pair for contact in firsts)
    assert np.ptp([contact.first for contact in firsts]) < 0.005
    hits = {v.subject: v for v in rp.validate(motion, scene).violations if v.kind == "collision"}
    assert {contact.pair for contact in seen.contacts} == set(hits)
    for contact in seen.contacts:
        assert contact.first <= hits[contact.pair].time <= contact.last
    assert "post from" in str(seen)
    assert "they agree" in str(seen)


def test_a_path_is_sampled_by_waypoint(swing: tuple[rp.Scene, rp.Trajectory]) -> None:
    scene, motion = swing
    path = rp.Path(scene.joint_names(), motion([0.0, 0.5, 2.0]))
    seen = rp.second_opinion(path, scene, step=0.005, checkers=["Coal"])
    assert seen.checkers == ("Coal",)
    assert 1.0 < seen.first_contact("Coal").first < 2.0
    assert rp.second_opinion(rp.Path(scene.joint_names(), motion([0.0])), scene)


def test_an_arm_that_turns_often_is_seen_at_every_turn(swing: tuple[rp.Scene, rp.Trajectory]) -> None:
    """Also if it has the same pose at regular samples."""
    scene, motion = swing
    q = motion(0.0) + 98.0 * np.pi * np.eye(6)[[1, 0]] * [[0.0], [1.0]]
    seen = rp.second_opinion(rp.Path(scene.joint_names(), q), scene, step=0.05, checkers=["Coal"])
    assert seen.samples > 49 * 2.0 * np.pi * 0.3 / 0.05
    assert any("post" in contact.pair for contact in seen.contacts)


def everything(seed: int) -> tuple[rp.Scene, rp.Trajectory]:
    """Two RR1 among obstacles of all shapes, one of which holds a tray, and a random motion of both."""
    rng = np.random.default_rng(seed)
    rr1 = rp.load_robot("rr1")
    scene = rp.Scene().with_arm("left", rr1, [0.0, 0.45, 0.0]).with_arm("right", rr1, [0.0, -0.45, 0.0])
    scene = scene.with_obstacle("floor", rp.HalfSpace(), [0.0, 0.0, -0.05])
    cloud = rp.PointCloud(rng.uniform(-0.06, 0.06, (60, 3)), 0.02)
    shapes = {"ring": torus(0.12, 0.03, 20, 10), "ground": terrain(8, height=0.03), "cloud": cloud}
    shapes |= {"ball": rp.Sphere(0.06), "pill": rp.Capsule(0.04, 0.1), "brick": rp.Box((0.1, 0.08, 0.2))}
    shapes |= {"can": rp.Cylinder(0.05, 0.12)}
    for name, shape in shapes.items():
        at = [*rng.uniform(-0.7, 0.1, 1), *rng.uniform(-0.8, 0.8, 1), *rng.uniform(0.1, 0.6, 1)]
        scene = scene.with_obstacle(name, shape, pose(at, rpy=rng.uniform(-3.0, 3.0, 3)))
    scene = scene.with_obstacle("tray", rp.Box((0.12, 0.2, 0.01)), [0.0, 0.0, 2.0])
    scene = scene.attach("tray", "right", pose=pose([0.0, 0.0, -0.01]), touch=["finger_link", "opposite_finger_link"])
    limits, q = scene.limits(), scene.configuration()
    rows = np.clip(q + 0.9 * rng.normal(size=(3, len(q))), limits.lower, limits.upper)
    return scene, rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.0, 2.0], rows, np.zeros((3, len(q))))


def test_checkers_agree_with_each_other_and_with_the_referee() -> None:
    """Many arms, attached objects, pairs that may touch, and all shapes: contacts deeper than sampling can miss."""
    step, touched = 0.012, set()
    for seed in range(3):
        scene, motion = everything(seed)
        hits = {v.subject: v.value for v in rp.validate(motion, scene).violations if v.kind == "collision"}
        seen = rp.second_opinion(motion, scene, step=step)
        assert seen.agree, seen
        for name in _ALL:
            found = {contact.pair for contact in seen.contacts if contact.checker == name}
            assert found <= set(hits)
            assert {pair for pair, value in hits.items() if value < -step} <= found
            touched.update(name for pair in found for name in pair)
    assert {"floor", "ring", "ground", "cloud", "tray"} <= touched


def test_a_body_inside_a_closed_mesh_touches_no_triangle_and_is_in_contact_with_the_mesh() -> None:
    slide = rp.Robot(
        name="slider",
        links=(rp.Link("base"), rp.Link("ball", collisions=(rp.Geometry("ball", rp.Sphere(0.02)),))),
        joints=(rp.Joint("x", "prismatic", "base", "ball", axis=np.array([1.0, 0.0, 0.0]), lower=-1.0, upper=1.0),),
        joint_names=("x",),
        limits=rp.Limits(*(np.full(1, v) for v in (-1.0, 1.0, 9.0, 9.0, 9.0, 9.0))),
        configurations={"home": np.zeros(1)},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool="ball",
    )
    scene = rp.Scene().with_arm("arm", slide).with_obstacle("ring", torus(0.5, 0.2, 32, 24))
    (hole, wall, outside) = ElementChecker(scene, ["arm/x"]).contacts(np.array([[0.0], [0.5], [0.9]]))
    assert hole == outside == {}
    assert wall == {("arm/ball", "ring"): {"FCL", "Coal"}}
    # MuJoCo has plates for triangles only; what is inside counts for it, too.
    motion = rp.Path(["arm/x"], [[0.49], [0.51]])
    seen = rp.second_opinion(motion, scene)
    assert not seen.free
    assert seen.agree, seen


def test_loose_bodies_stand_still_and_may_touch_what_they_stand_on(swing: tuple[rp.Scene, rp.Trajectory]) -> None:
    scene, motion = swing
    crates = scene.without_obstacle("post").with_obstacle("floor", rp.Box((3.0, 3.0, 0.1)), [0.0, 0.0, -0.06])
    crates = crates.allow("rr1", "floor")
    for k in range(2):
        at = [0.5, 0.0, 0.04 + 0.1 * k - 1e-4 * k]
        crates = crates.with_obstacle(f"crate{k}", rp.Box((0.1, 0.1, 0.1)), at, mass=1.0)
    assert rp.second_opinion(motion, crates, step=0.01)
    at = scene.link_poses({"rr1": motion(1.0)})["rr1/tool"][:3, 3]
    hit = rp.second_opinion(motion, crates.with_obstacle("late", rp.Sphere(0.03), at, mass=0.1), step=0.005)
    assert hit.agree, hit
    assert {contact.checker for contact in hit.contacts} == set(_ALL)


def test_a_held_object_inside_its_holder_is_seen_by_all(planar2r: rp.Robot) -> None:
    """MuJoCo itself does not check bodies that cannot move relative to each other."""
    scene = rp.Scene().with_arm("arm", planar2r)
    tool = scene.link_poses()["arm/tool"]
    scene = scene.with_obstacle("rod", rp.Box((0.05, 0.05, 0.05)), tool).attach("rod", "arm")
    seen = rp.second_opinion(rp.Trajectory.rest(scene.joint_names(), scene.configuration()), scene)
    assert seen.agree, seen
    assert [(contact.pair, contact.checker) for contact in seen.contacts] == [
        (("arm/link2", "rod"), name) for name in _ALL
    ]
    apart = scene.detach("rod").with_obstacle_at("rod", tool @ pose([0.1, 0.0, 0.0])).attach("rod", "arm")
    assert rp.second_opinion(rp.Trajectory.rest(apart.joint_names(), apart.configuration()), apart)


def test_a_checker_that_misses_a_contact_is_named(
    swing: tuple[rp.Scene, rp.Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, motion = swing
    monkeypatch.setattr(FclChecker, "touches", lambda *_: False)
    seen = rp.second_opinion(motion, scene, step=0.005)
    assert not seen.agree
    first = seen.disagreements[0]
    assert (first.touching, first.free) == (("Coal", "MuJoCo"), ("FCL",))
    assert "post" in first.pair
    assert first.distance < -1e-4
    assert first.samples > 1
    assert f"Coal and MuJoCo: contact, FCL: none; {first.samples} samples" in str(seen)


def test_a_checker_that_invents_a_contact_is_named(
    swing: tuple[rp.Scene, rp.Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, motion = swing
    found = MujocoChecker.contacts

    def invents(self: MujocoChecker, time: float) -> dict[tuple[str, str], float]:
        return {("rr1/shoulder_link", "post"): 0.02} if time == 0.0 else found(self, time)

    monkeypatch.setattr(MujocoChecker, "contacts", invents)
    (only,) = rp.second_opinion(motion, scene, step=0.01).disagreements
    assert (only.time, only.samples, only.touching) == (0.0, 1, ("MuJoCo",))
    assert set(only.pair) == {"post", "rr1/shoulder_link"}
    assert only.distance > 0.02


def test_contacts_within_the_tolerance_are_grazing(
    swing: tuple[rp.Scene, rp.Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, motion = swing
    monkeypatch.setattr(FclChecker, "touches", lambda *_: False)
    seen = rp.second_opinion(motion, scene, step=0.005, tolerance=1.0)
    assert seen.agree
    assert seen.grazing > 10
    assert "judged differently within the tolerance" in str(seen)


def test_without_python_fcl_the_error_says_how_to_get_it(
    swing: tuple[rp.Scene, rp.Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, motion = swing
    monkeypatch.setitem(sys.modules, "fcl", None)
    with pytest.raises(rp.MissingPackageError, match="pip install 'python-fcl'"):
        rp.second_opinion(motion, scene)
    assert not rp.second_opinion(motion, scene, step=0.01, checkers=["Coal", "MuJoCo"])


def test_where_nothing_can_touch_all_agree(planar2r: rp.Robot) -> None:
    bare = replace(planar2r, links=tuple(replace(link, collisions=()) for link in planar2r.links))
    for scene in (rp.Scene().with_arm("arm", bare), rp.Scene().with_arm("arm", planar2r)):
        motion = rp.plan_motion(rp.Problem(scene, "home", [0.5, 0.5]), rng=0)
        for what in (motion.trajectory, motion.path):
            opinion = rp.second_opinion(what, scene)
            assert opinion.free
            assert opinion.agree
            assert opinion.queries == 0


def test_wrong_questions_are_refused(swing: tuple[rp.Scene, rp.Trajectory]) -> None:
    scene, motion = swing
    with pytest.raises(rp.UnknownNameError, match="unknown checker 'Bullet'"):
        rp.second_opinion(motion, scene, checkers=["Bullet"])
    with pytest.raises(rp.InputError, match="checkers is empty"):
        rp.second_opinion(motion, scene, checkers=[])
    with pytest.raises(rp.InputError, match=r"step of 1e-09 m takes .* samples"):
        rp.second_opinion(motion, scene, step=1e-9)
    with pytest.raises(rp.UnknownNameError, match="unknown joint 'rr1/shoulder_joint'"):
        rp.second_opinion(motion, rp.Scene())
    partial = rp.Trajectory.rest(("rr1/elbow_joint",), [0.0])
    with pytest.raises(rp.InputError, match="has no column for 'rr1/shoulder_joint'"):
        rp.second_opinion(partial, scene)
    turn = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)
    rim = np.column_stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), np.zeros(300)])
    hull = trimesh.convex.convex_hull(np.concatenate([rim, [[0.0, 0.0, 0.1]]]))
    cone = scene.with_obstacle("cone", rp.Mesh(hull.vertices, hull.faces, convex=True))
    with pytest.raises(rp.InputError, match="300 neighbors, expected at most 255"):
        rp.second_opinion(motion, cone)
    with pytest.raises(rp.CancelledError):
        rp.second_opinion(motion, scene, progress=lambda progress: False)
