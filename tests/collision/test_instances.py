"""Equal arms share their tables, and a scene's tables are those of its arms at their poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rr1plan import place_grid
from rr1plan.collision import CollisionChecker
from rr1plan.collision.clearance_maps import instance_maps
from rr1plan.collision.obstacle_geometry import ObstacleGeometry
from rr1plan.collision.tables import arm_tables, link_spheres
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.collision.tables.obstacle_tables import FixedSolids, fixed_links_of
from rr1plan.robot import Geometry
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose


def geometries(scene, arms=None):
    return CollisionChecker(scene, arms).geometry.instances.geometries


def edge_tables(checker):
    return build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)


def test_fixed_links_are_described_once_as_if_they_were_obstacles(six, odd):
    mesh = convex_hull(np.random.default_rng(2).normal(0.0, 0.05, (20, 3)))
    base, *links = odd.links
    meshed = replace(odd, links=(replace(base, collisions=(*base.collisions, Geometry("mesh", mesh))), *links))
    scene = (
        Scene().with_arm("a", six, [0.0, 0.3, 0.1]).with_arm("b", meshed, pose([1.2, 0.0, 0.0], rpy=[0.0, 0.0, 0.4]))
    )
    scene = scene.with_obstacle("ball", Sphere(0.1), [0.5, 0.5, 0.5]).with_obstacle("mesh", mesh, [0.6, -0.5, 0.5])
    geometry = CollisionChecker(scene).geometry
    fixed = CollisionChecker(scene).fixed
    arms = zip(geometry.instances.geometries, geometry.instances.bases, strict=True)
    parts = [fixed_links_of(arm).at(base) for arm, base in arms]
    links = sum(len(part.shapes) for part in parts)
    whole = FixedSolids(ObstacleGeometry.joined([*parts, geometry.obstacles]))
    for part in ("shapes", "frames", "objects"):
        assert fixed.struct.part(part).tobytes() == whole.struct.part(part).tobytes()
    # Object, kind, and whether its own shape decides; links have no bodies and no places for cores.
    assert (fixed.solids[:, [0, 6, 7]] == whole.solids[:, [0, 6, 7]]).all()
    assert links
    assert (fixed.solids[:links, [1, 4]] == -1).all()
    first = len(geometry.instances.groups)
    assert fixed.solids[links:, 1].tolist() == list(range(first, first + fixed.count - links))


# ---- sharing -----------------------------------------------------------------------------------------


def test_equal_robots_share_one_geometry_wherever_they_stand(six, odd):
    scene = Scene()
    for i, robot in enumerate((six, odd, six, odd, six)):
        scene = scene.with_arm(f"arm{i}", robot, pose([0.9 * i, 0.1, 0.0], rpy=[0.1 * i, 0.0, 0.3]))
    scene = scene.with_configuration("arm2", [0.5, 0.1, 0.2, 0.3, 0.4, 0.5])
    made = geometries(scene)
    assert [made.index(one) for one in made] == [0, 1, 0, 1, 0]
    assert geometries(Scene().with_arm("other", six, [9.0, 0, 0]))[0] is made[0]
    assert geometries(scene, ["arm2", "arm3"]) == made[:2]


def test_what_an_arm_holds_makes_its_geometry_and_rules_do_not(six):
    scene = place_grid(six, 1, 3, spacing=1.5)
    names = list(scene.arms)
    held = scene
    for name in names[:2]:
        held = held.with_obstacle(f"box of {name}", Box((0.1, 0.1, 0.1)))
    first = held.attach(f"box of {names[0]}", names[0], pose=pose([0, 0, 0.2]))
    one, *others = geometries(first)
    assert one is not others[0]
    assert others[0] is others[1] is geometries(scene)[0]
    for other in (
        first.with_padding(0.01),
        first.allow(names[0], names[1]),
        first.with_configuration(names[0], np.ones(6)),
    ):
        assert geometries(other)[0] is one
    assert geometries(first.attach(f"box of {names[1]}", names[1], touch=["l5"]))[0] is one
    elsewhere = held.attach(f"box of {names[0]}", names[0], pose=pose([0, 0, 0.3]))
    assert geometries(elsewhere)[0] is not one


def test_a_robot_that_differs_has_a_geometry_of_its_own(odd):
    scene = Scene().with_arm("a", odd)
    assert geometries(scene.with_robot("a", odd.with_locked_joints({"grip": 0.05})))[0] is not geometries(scene)[0]
    assert geometries(scene.with_robot("a", odd.with_locked_joints({"grip": 0.02})))[0] is geometries(scene)[0]


def test_equal_robots_share_their_clearance_maps(odd):
    alone = edge_tables(CollisionChecker(Scene().with_arm("a", odd, pose([2.0, 1.0, 0.0], rpy=[0.2, 0.1, 0.5]))))
    tables = edge_tables(CollisionChecker(place_grid(odd, 2, 3, spacing=1.2)))
    np.testing.assert_array_equal(tables.pairs.maps, alone.pairs.maps)
    # A pair of two arms has no map, one of an arm with itself the same as in every other arm.
    own = len(alone.pairs.body_pairs)
    places = tables.pairs.body_pairs[tables.pairs.body_pairs[:, 4] >= 0]
    assert len(places) == 6 * int((alone.pairs.body_pairs[:, 4] >= 0).sum()) > 0
    assert sorted(set(places[:, 4].tolist())) == sorted(
        set(alone.pairs.body_pairs[alone.pairs.body_pairs[:, 4] >= 0, 4].tolist())
    )
    assert len(tables.pairs.body_pairs) > 6 * own


# ---- tables ------------------------------------------------------------------------------------------


@pytest.fixture
def crowd(six, odd, scara):
    """Five arms of three robots, within reach of each other, one of which holds something."""
    scene = Scene()
    for i, robot in enumerate((six, odd, scara, odd, six)):
        scene = scene.with_arm(f"arm{i}", robot, pose([1.0 * i, 0.2 * i, 0.1 * i], rpy=[0.1, 0.05 * i, 0.7 * i]))
    scene = scene.with_obstacle("rod", Box((0.02, 0.02, 0.3)))
    return scene.attach("rod", "arm3", pose=pose([0.0, -0.1, 0.2]))


def alone(scene, *names):
    """Some arms with their attached objects at their poses, without anything else."""
    held = {n: thing for n, thing in scene.attachments.items() if thing.arm in names}
    return Scene({name: arm for name, arm in scene.arms.items() if name in names}, {}, held)


def test_bodies_of_all_arms_are_those_of_each_alone(crowd):
    whole = CollisionChecker(crowd).tables
    joints, bodies, links = 1, 0, 0
    for name in crowd.arms:
        own = CollisionChecker(alone(crowd, name)).tables
        mine = slice(joints, joints + len(own.joints) - 1)
        np.testing.assert_array_equal(whole.joint_values[mine], own.joint_values[1:])
        np.testing.assert_allclose(whole.joint_poses[mine], own.joint_poses[1:], rtol=0, atol=1e-12)
        np.testing.assert_array_equal(whole.joints[mine, 1], own.joints[1:, 1])
        rows, there = own.bodies, whole.bodies[bodies : bodies + len(own.bodies)]
        np.testing.assert_array_equal(there[:, 0], rows[:, 0])
        np.testing.assert_array_equal(there[:, 1] - np.where(there[:, 1] > 0, joints - 1, 0), rows[:, 1])
        np.testing.assert_array_equal(there[:, 4:] - links, rows[:, 4:])
        np.testing.assert_allclose(whole.body_values[bodies : bodies + len(rows)], own.body_values, rtol=0, atol=1e-12)
        for one, two in zip(there, rows, strict=True):
            np.testing.assert_array_equal(whole.corners[slice(*one[2:4])], own.corners[slice(*two[2:4])])
        chain = slice(links, links + len(own.chain))
        np.testing.assert_array_equal(whole.chain[chain] - joints + 1, own.chain)
        np.testing.assert_allclose(whole.chain_reach[chain], own.chain_reach, rtol=1e-12)
        joints, bodies, links = joints + len(own.joints) - 1, bodies + len(rows), links + len(own.chain)
    assert (joints, bodies, links) == (len(whole.joints), len(whole.bodies), len(whole.chain))


def test_spheres_of_all_arms_are_those_of_each_alone(crowd):
    whole = edge_tables(CollisionChecker(crowd)).arm
    joints, bodies, spheres, groups, links = 1, 0, 0, 0, 0
    for name in crowd.arms:
        own = edge_tables(CollisionChecker(alone(crowd, name))).arm
        mine = slice(joints, joints + len(own.joints) - 1)
        np.testing.assert_allclose(whole.joint_values[mine], own.joint_values[1:], rtol=0, atol=1e-12)
        np.testing.assert_array_equal(whole.spheres[spheres : spheres + len(own.spheres)], own.spheres)
        there = whole.bodies[bodies : bodies + len(own.bodies)]
        np.testing.assert_array_equal(there - [joints - 1, spheres, spheres, groups], own.bodies)
        chain = slice(links, links + len(own.chain))
        np.testing.assert_array_equal(whole.chain[chain] - joints + 1, own.chain)
        np.testing.assert_array_equal(whole.chain_reach[chain], own.chain_reach)
        joints, bodies, spheres = joints + len(own.joints) - 1, bodies + len(own.bodies), spheres + len(own.spheres)
        groups, links = groups + len(own.groups), links + len(own.chain)
    assert (joints, bodies, spheres, groups) == tuple(
        map(len, (whole.joints, whole.bodies, whole.spheres, whole.groups))
    )


def test_answers_about_all_arms_are_the_least_of_each_alone_and_of_every_two(crowd):
    rng, whole = np.random.default_rng(6), CollisionChecker(crowd)
    names, apart = list(crowd.arms), 0
    columns = {n: [i for i, j in enumerate(whole.joint_names) if j.startswith(f"{n}/")] for n in names}
    some = [[n] for n in names] + [[a, b] for i, a in enumerate(names) for b in names[i + 1 :]]
    checkers = [CollisionChecker(alone(crowd, *arms)) for arms in some]
    for q in crowd.configuration() + 0.3 * rng.normal(size=(20, whole.nq)):
        parts = [np.concatenate([q[columns[n]] for n in arms]) for arms in some]
        least = min(checker.clearance(part) for checker, part in zip(checkers, parts, strict=True))
        apart += least > 0.0
        assert whole.clearance(q) == pytest.approx(least, abs=1e-9)
        assert whole.is_free(q) == all(checker.is_free(part) for checker, part in zip(checkers, parts, strict=True))
        # Stationary arms there are obstacles for the moving arm.
        posed = crowd
        for name in names:
            posed = posed.with_configuration(name, q[columns[name]])
        moving, own = names[2], q[columns[names[2]]]
        expected = min(CollisionChecker(alone(posed, moving, name), [moving]).clearance(own) for name in names)
        assert CollisionChecker(posed, [moving]).clearance(own) == pytest.approx(expected, abs=1e-9)
    assert 0 < apart < 20


# ---- one among many ----------------------------------------------------------------------------------


def counted(monkeypatch, module, name):
    """How often a function of a module is called from there, as it goes on."""
    calls, function = [], getattr(module, name)

    def call(*arguments):
        calls.append(arguments)
        return function(*arguments)

    monkeypatch.setattr(module, name, call)
    return calls


def test_one_arm_among_a_hundred_makes_the_tables_of_one(six, monkeypatch):
    # A robot that no other test uses.
    links = list(six.links)
    ball = Geometry("ball", Sphere(0.0517), pose([0, 0, 0.06]))
    links[-1] = type(links[-1])(links[-1].name, collisions=(ball,))
    robot = type(six)(
        "one of many", tuple(links), six.joints, six.joint_names, six.limits, dict(six.configurations), {},
        six.disabled_collisions, six.tool,
    )  # fmt: skip
    scene = place_grid(robot, 10, 10, spacing=0.8)
    made = counted(monkeypatch, arm_tables, "_arm_tables")
    spheres = counted(monkeypatch, link_spheres, "_arm_spheres")
    name = list(scene.arms)[44]
    motion = CollisionChecker(scene, [name])
    motion.warm_up()
    assert motion.edge_is_free(scene.arms[name].q, scene.arms[name].q + 0.01)
    assert len(made) == 1
    assert len(spheres) == 1
    # Those within reach are there, and no others.
    near = {a.split("/")[0] for both in motion.pairs for a in both}
    bases = {n: arm.base[:3, 3] for n, arm in scene.arms.items()}
    apart = {n: float(np.linalg.norm(at - bases[name])) for n, at in bases.items()}
    assert {n for n in apart if apart[n] < 1.0} <= near
    assert 5 <= len(near) < 50
    # Tables for a neighboring arm exist already.
    CollisionChecker(scene, [list(scene.arms)[45]]).warm_up()
    assert len(made) == len(spheres) == 1


def test_maps_of_many_arms_are_made_for_one(six):
    few, many = (CollisionChecker(place_grid(six, 1, n, spacing=0.9)).geometry.instances for n in (2, 7))
    of = []
    for instances in (few, many):
        solids = len(instances.geometries[0].solids)
        pairs = np.array([[first + i, first + j] for first in range(0, solids * len(instances.geometries), solids)
                          for i, j in ((1, 4), (2, 5))])  # fmt: skip
        of.append(instance_maps(instances, pairs, np.full(len(pairs), 0.001), np.zeros((0, 2), np.int64)))
    np.testing.assert_array_equal(of[0].counts, of[1].counts)
    np.testing.assert_array_equal(np.unique(of[0].of_pairs[:, 0]), np.unique(of[1].of_pairs[:, 0]))
