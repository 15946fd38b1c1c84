"""Plain descriptions of problems are equivalent to the problems."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.transforms import pose


@pytest.fixture
def plain(script):
    return script("plain")


@pytest.fixture
def scene():
    """An RR1 off the origin, over a sloping ground, with a post and a capsule."""
    return (
        rp.Scene()
        .with_arm("rr1", rp.load_robot("rr1").with_locked_joints("closed"), pose([0.2, -0.1, 0.3], rpy=[0.0, 0.0, 0.7]))
        .with_obstacle("ground", rp.HalfSpace((0.1, 0.0, 1.0), -0.2))
        .with_obstacle("post", rp.Cylinder(0.05, 1.0), [-0.1, 0.2, 0.5])
        .with_obstacle("pipe", rp.Capsule(0.04, 0.4), pose([0.1, 0.3, 0.6], rpy=[0.4, 0.3, 0.2]))
        .allow("rr1/base_link", "ground")
    )


def _configurations(scene, n):
    limits = scene.limits()
    return np.random.default_rng(3).uniform(limits.lower, limits.upper, (n, len(limits)))


def test_a_slab_blocks_what_the_half_space_blocks(plain, scene):
    settled = plain.settle(rp.Problem(scene, "home", "home"), 0).scene
    before, after = rp.CollisionChecker(scene), rp.CollisionChecker(settled)
    free = [before.is_free(q) for q in _configurations(scene, 300)]
    assert [after.is_free(q) for q in _configurations(scene, 300)] == free
    assert 0 < sum(free) < 300


def test_the_written_robot_is_the_same_robot(plain, scene, tmp_path):
    problem = plain.settle(rp.Problem(scene, "home", "home"), 0)
    told = plain.describe_problem(problem, tmp_path)
    copy = rp.load_robot(told["robot"]["urdf"], srdf=told["robot"]["srdf"])
    robot = scene.arms["rr1"].robot
    assert copy.joint_names == robot.joint_names == tuple(told["robot"]["joints"])
    np.testing.assert_allclose(copy.limits.velocity, told["robot"]["velocity"])
    for q in _configurations(scene, 20):
        ours, theirs = robot.link_poses(q), copy.link_poses(q)
        assert all(np.allclose(ours[name], theirs[name], atol=1e-12) for name in robot.link_names)


def test_the_written_scene_has_the_same_free_configurations(plain, scene, tmp_path):
    problem = plain.settle(rp.Problem(scene, "home", "home"), 0)
    told = plain.describe_problem(problem, tmp_path)
    robot = told["robot"]
    copy = rp.Scene().with_arm("rr1", rp.load_robot(robot["urdf"], srdf=robot["srdf"]))
    shapes = {"box": lambda *size: rp.Box(size), "cylinder": rp.Cylinder, "sphere": rp.Sphere}
    for thing in told["obstacles"]:
        name = thing["name"].replace(".", "_")
        copy = copy.with_obstacle(name, shapes[thing["kind"]](*thing["size"]), np.array(thing["pose"]))
    for link, name in told["may_touch"]:
        copy = copy.allow(f"rr1/{link}", name.replace(".", "_"))
    before, after = rp.CollisionChecker(problem.scene), rp.CollisionChecker(copy)
    free = [before.is_free(q) for q in _configurations(scene, 300)]
    assert [after.is_free(q) for q in _configurations(scene, 300)] == free


def test_a_goal_in_space_becomes_one_configuration(plain):
    query = rp.load_problems("rr1_table")["reach_over_crate"]
    settled = plain.settle(query, 0)
    (goal,) = settled.goal["rr1"]
    place = settled.scene.link_poses({"rr1": goal.q})["rr1/" + settled.scene.arms["rr1"].robot.tool][:3, 3]
    np.testing.assert_allclose(place, [-0.3, 0.25, 0.2], atol=1e-3)


def test_hulls_are_written_where_each_peer_looks(plain, tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.1
    mesh = rp.Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]), convex=True)
    source = rp.load_robot("rr1")
    link = source.link("hand_link")
    shape = replace(link.collisions[0], shape=mesh)
    links = tuple(replace(o, collisions=(shape,)) if o is link else o for o in source.links)
    told = plain.write_robot(replace(source, links=links), [], tmp_path)
    place = Path(told["urdf"]).parent
    assert sorted(f.name for f in place.glob("*.stl")) == ["hand_link.0.stl", "hand_link.0.stl.convex.stl"]
    (written,) = rp.load_robot(told["urdf"], srdf=told["srdf"]).link("hand_link").collisions
    np.testing.assert_allclose(sorted(map(tuple, written.shape.vertices)), sorted(map(tuple, corners)), atol=1e-6)


def test_several_arms_cannot_be_said_plainly(plain, tmp_path):
    query = next(iter(rp.load_problems("rr1_pair").values()))
    with pytest.raises(rp.InputError, match="2 arms"):
        plain.describe_problem(query, tmp_path)


def test_a_joint_without_end_is_told_as_one_turn_and_so_are_its_ends(plain, tmp_path):
    scene = next(iter(rp.load_problems("planar2r_path").values())).scene
    start, goal = np.array([7.0, -3.0]), np.array([-20.0, np.pi])
    problem = rp.Problem(scene, start, goal)
    told = plain.describe_problem(problem, tmp_path)
    copy = rp.load_robot(told["robot"]["urdf"], srdf=told["robot"]["srdf"])
    np.testing.assert_allclose([copy.limits.lower, copy.limits.upper], [[-np.pi] * 2, [np.pi] * 2])
    assert not copy.continuous.any()
    robot = scene.arm(scene.only_arm()).robot
    for said, meant in ((told["start"], start), (told["goal"], goal)):
        assert (np.abs(said) <= np.pi).all()
        ours, theirs = robot.link_poses(meant), copy.link_poses(said)
        assert all(np.allclose(ours[name], theirs[name], atol=1e-12) for name in robot.link_names)
    assert "turn from -pi to pi" in plain.describe_changes(problem)
    assert plain.describe_changes(next(iter(rp.load_problems("rr1_table").values()))) == ""
