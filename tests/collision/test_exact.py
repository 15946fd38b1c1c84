from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.collision.convex.convex_bodies import occupied_cells
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.robot import Geometry, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere
from rr1plan.testing.collision_checkers import ElementChecker
from rr1plan.transforms import identity, pose

CORNERS = np.random.default_rng(1).normal(size=(12, 3)) * 0.15


def hull_mesh():
    from rr1plan.shapes.convex_hulls import convex_hull

    return convex_hull(CORNERS)


SOLIDS = {
    "box": Box((0.2, 0.3, 0.4)),
    "sphere": Sphere(0.15),
    "cylinder": Cylinder(0.1, 0.4),
    "capsule": Capsule(0.1, 0.3),
    "mesh": hull_mesh(),
}
OTHERS = {
    **SOLIDS,
    "half-space": HalfSpace((0.3, -0.2, 1.0), 0.05),
    "cloud": PointCloud(np.random.default_rng(2).uniform(-0.15, 0.15, (25, 3)), 0.04),
}


def farthest(shape, direction):
    """The point of a shape farthest in a direction of its own frame, from its definition."""
    sign = np.where(direction >= 0, 1.0, -1.0)
    match shape:
        case Box(size):
            return sign * np.array(size) / 2
        case Sphere(radius):
            return radius * direction / np.linalg.norm(direction)
        case Cylinder(radius, length):
            across = direction[:2] / max(np.hypot(*direction[:2]), 1e-300)
            return np.array([*(radius * across), sign[2] * length / 2])
        case Capsule(radius, length):
            return radius * direction / np.linalg.norm(direction) + [0, 0, sign[2] * length / 2]
        case Mesh():
            return shape.vertices[np.argmax(shape.vertices @ direction)]


def probe(shape, T=None):
    """One body that slides along z."""
    links = (Link("base"), Link("tip", collisions=(Geometry("tip", shape, identity() if T is None else T),)))
    joint = Joint("slide", "prismatic", "base", "tip", lower=-1, upper=1)
    limits = Limits(np.array([-1.0]), np.array([1.0]), *(np.ones(1) for _ in range(4)))
    return Robot("probe", links, (joint,), ("slide",), limits, {"home": np.zeros(1)}, {}, frozenset(), "tip")


def random_pose(rng, spread):
    return pose(rng.normal(size=3) * spread, quaternion=rng.normal(size=4))


def probe_scene(shape, other, A, B):
    return Scene().with_arm("p", probe(shape, A)).with_obstacle("thing", other, B)


@pytest.mark.parametrize("one", SOLIDS)
@pytest.mark.parametrize("two", OTHERS)
def test_distances_lie_between_a_separating_plane_and_the_nearest_points(one, two):
    rng = np.random.default_rng(3)
    shape, other = SOLIDS[one], OTHERS[two]
    apart = 0
    for _ in range(15):
        A, B = random_pose(rng, 0.25), random_pose(rng, 0.25)
        checker = CollisionChecker(probe_scene(shape, other, A, B))
        near = checker.nearest([0.0])
        assert checker.is_free_slowly([0.0]) == (near.distance > 0)
        if two == "half-space":
            n = B[:3, :3] @ other.normal
            low = A[:3, :3] @ farthest(shape, -A[:3, :3].T @ n) + A[:3, 3]
            assert near.distance == pytest.approx(n @ (low - B[:3, 3]) - other.offset, abs=1e-9)
        if near.distance <= 1e-6:
            assert checker.clearance([0.0]) <= 1e-6
            continue
        apart += 1
        assert checker.clearance([0.0]) == pytest.approx(near.distance, abs=2e-6)
        assert np.linalg.norm(near.point_b - near.point_a) == pytest.approx(near.distance, abs=1e-6)
        if two in SOLIDS:
            n = (near.point_b - near.point_a) / near.distance
            top = A[:3, :3] @ farthest(shape, A[:3, :3].T @ n) + A[:3, 3]
            low = B[:3, :3] @ farthest(other, -B[:3, :3].T @ n) + B[:3, 3]
            assert n @ (low - top) == pytest.approx(near.distance, abs=2e-6)
    assert apart >= 3


@pytest.mark.parametrize("one", SOLIDS)
def test_a_point_cloud_is_its_occupied_cells(one):
    rng = np.random.default_rng(4)
    cloud = OTHERS["cloud"]
    cells = [Geometry(f"{i}", Box((0.04, 0.04, 0.04)), pose(c)) for i, c in enumerate(occupied_cells(cloud))]
    for _ in range(10):
        A, B = random_pose(rng, 0.3), random_pose(rng, 0.1)
        as_cloud = CollisionChecker(probe_scene(SOLIDS[one], cloud, A, B))
        as_boxes = CollisionChecker(probe_scene(SOLIDS[one], cells, A, B))
        assert as_cloud.is_free_slowly([0.0]) == as_boxes.is_free([0.0])
        if as_boxes.is_free_slowly([0.0]):
            assert as_cloud.nearest([0.0]).distance == pytest.approx(as_boxes.nearest([0.0]).distance, abs=2e-6)


@pytest.mark.parametrize("one", SOLIDS)
@pytest.mark.parametrize("two", OTHERS)
def test_padding_is_a_distance_for_every_pair_of_shapes(one, two):
    rng = np.random.default_rng(5)
    padding = 0.05
    for _ in range(12):
        scene = probe_scene(SOLIDS[one], OTHERS[two], random_pose(rng, 0.25), random_pose(rng, 0.25))
        plain, padded = CollisionChecker(scene), CollisionChecker(scene.with_padding(padding))
        distance = plain.distances([0.0])[0]
        assert padded.distances([0.0])[0] == distance
        assert padded.is_free_slowly([0.0]) == (distance > padding)
        if 0.0 < distance < padding:
            (contact,) = padded.contacts([0.0])
            assert contact.depth == pytest.approx(padding - distance, abs=1e-6)


def test_other_checkers_and_plain_kinematics_give_the_same_answer(cluttered):
    checker = CollisionChecker(cluttered)
    others = ElementChecker(cluttered, cluttered.joint_names())
    rng = np.random.default_rng(6)
    free = 0
    configurations = rng.uniform(-2.5, 2.5, (150, 6))
    for q, touching in zip(configurations, others.contacts(configurations), strict=True):
        assert touching == {(c.a, c.b): {"FCL", "Coal"} for c in checker.contacts(q)}
        assert checker.is_free_slowly(q) == (not touching)
        free += not touching
    assert 20 < free < 130


def test_distances_and_contacts_tell_the_same_story(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("ground", HalfSpace((0, 0, 1), 0.3))
    checker = CollisionChecker(scene)
    for q in np.random.default_rng(7).uniform(-1, 1, (100, 3)):
        distances = dict(zip(checker.pairs, checker.distances(q), strict=True))
        contacts = checker.contacts(q)
        assert {(c.a, c.b) for c in contacts} == {p for p, d in distances.items() if d <= 0}
        assert [c.depth for c in contacts] == sorted((c.depth for c in contacts), reverse=True)
        assert all(c.depth == pytest.approx(-distances[c.a, c.b], abs=1e-6) for c in contacts)
        near = checker.nearest(q)
        assert near.distance == pytest.approx(min(distances.values()), abs=1e-12)
        assert distances[near.pair] == pytest.approx(near.distance, abs=1e-12)


def test_a_body_wholly_inside_a_mesh_collides():
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    from rr1plan.shapes.convex_hulls import convex_hull

    checker = CollisionChecker(Scene().with_arm("p", probe(Sphere(0.05))).with_obstacle("m", convex_hull(corners)))
    assert not checker.is_free_slowly([0.2])


def trough():
    """A closed U of square bars along y, as one mesh that is not convex."""
    outline = np.array(
        [[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [0.2, 0.3], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.3], [-0.3, 0.3]]
    )
    front = np.insert(outline, 1, -0.3, axis=1)
    back = np.insert(outline, 1, 0.3, axis=1)
    n = len(outline)
    caps = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)]
    faces = [*caps, *[(a + n, c + n, b + n) for a, b, c in caps]]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, i + n, j), (j, i + n, j + n)]
    return Mesh(np.concatenate([front, back]), np.array(faces))


def test_a_mesh_that_is_not_convex_is_solid_in_its_walls_and_empty_in_its_hollow():
    scene = Scene().with_arm("p", probe(Sphere(0.02), pose([0.0, 0.0, 0.0]))).with_obstacle("u", trough())
    assert CollisionChecker(scene).is_free_slowly([0.0])
    assert not CollisionChecker(scene).is_free_slowly([-0.25])


def test_never_colliding_and_allowed_pairs_are_not_checked(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("wall", Box((0.1, 2, 2)), [0.35, 0, 0.6])
    checker = CollisionChecker(scene)
    assert ("a/left", "a/right") not in checker.pairs
    assert ("a/base", "wall") not in checker.pairs
    q = [0.0, 0.0, 0.0]
    assert {c.b for c in checker.contacts(q)} == {"wall"}
    assert CollisionChecker(scene.allow("a", "wall")).is_free_slowly(q)


def test_distances_of_some_pairs_are_those_of_all_wherever_the_arms_were_before(planar):
    scene = Scene().with_obstacle("ball", Sphere(0.1), [0.5, 0.5, 0.0])
    for k in range(3):
        scene = scene.with_arm(f"arm{k}", planar, pose([0.4 * k, 0.0, 0.0]))
    checker, rng = CollisionChecker(scene), np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(-3.0, 3.0, checker.nq)
        some = rng.choice(len(checker.solid_pairs), 3, replace=False)
        distances = checker.solid_distances(q, some)
        np.testing.assert_array_equal(distances, CollisionChecker(scene).solid_distances(q)[some])
        other = rng.uniform(-3.0, 3.0, checker.nq)
        np.testing.assert_array_equal(checker.solid_distances(other), CollisionChecker(scene).solid_distances(other))


def test_padding_of_one_pair_leaves_the_others(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("near", Sphere(0.05), [0.0, 0.2, 0.3])
    gap = CollisionChecker(scene).nearest(np.zeros(3)).distance
    assert gap > 0
    padded = CollisionChecker(scene.with_padding(gap + 0.3, "a/slide", "near"))
    assert [(c.a, c.b) for c in padded.contacts(np.zeros(3))] == [("a/slide", "near")]


def test_an_attached_object_moves_with_its_link_and_may_touch_it(planar):
    scene = Scene().with_arm("p", planar).with_obstacle("box", Box((0.1, 0.1, 0.1)), [1.0, 0, 0])
    scene = scene.with_obstacle("post", Box((0.1, 0.1, 0.1)), [0.0, 1.0, 0])
    held = CollisionChecker(scene.attach("box", "p"))
    assert ("post", "box") in held.pairs
    assert held.is_free_slowly([0.0, 0.0])
    assert [c.b for c in held.contacts([np.pi / 2, 0.0]) if "post" in (c.a, c.b)]
    assert {"post", "box"} in [{c.a, c.b} for c in held.contacts([np.pi / 2, 0.0])]


def test_an_arm_that_stands_still_is_where_the_scene_has_it(planar):
    scene = Scene().with_arm("l", planar).with_arm("r", planar, [1.4, 0, 0], q=[np.pi / 2, 0])
    checker = CollisionChecker(scene, ["l"])
    assert checker.joint_names == ("l/shoulder", "l/elbow")
    assert checker.is_free_slowly([0.0, 0.0])
    turned = CollisionChecker(scene.with_configuration("r", [np.pi, 0.0]), ["l"])
    assert not turned.is_free_slowly([0.0, 0.0])


@pytest.mark.parametrize("away", [1.9, 3.0])
def test_contacts_that_no_joint_can_undo_are_found_and_named(planar, away):
    scene = Scene().with_arm("l", planar).with_arm("r", planar, [away, 0, 0])
    scene = scene.with_obstacle("b", Sphere(0.1), [away + 0.4, 0, 0])
    checker = CollisionChecker(scene, ["l"])
    assert not checker.is_free_slowly([0.0, 0.0])
    assert not checker.static_is_free
    assert checker.static_contacts == (("r/upper", "b"),)
    (contact,) = checker.contacts([0.0, 0.0])
    assert (contact.a, contact.b) == ("r/upper", "b")
    assert contact.depth > 0.02
    # What is nearest is about the arms that move, those out of reach included.
    nearest = checker.nearest([0.0, 0.0])
    assert nearest.pair == ("l/lower", "r/upper")
    assert nearest.distance == pytest.approx(away - 0.94, abs=1e-6)


def test_without_anything_to_touch_everything_is_free(planar):
    checker = CollisionChecker(Scene().with_arm("p", planar))
    assert checker.is_free_slowly([1.0, 2.0])
    assert checker.contacts([1.0, 2.0]) == ()
    assert checker.distances([1.0, 2.0]).shape == (0,)
    assert checker.nearest([1.0, 2.0]).distance == np.inf


@pytest.mark.parametrize("wrong", [[np.nan, 0.0], [0.0, np.inf], [0.0], [0.0, 0.0, 0.0], "home", [[0.0, 0.0]]])
@pytest.mark.parametrize("question", ["is_free", "contacts", "nearest", "distances", "limit_violations"])
def test_a_configuration_that_is_none_is_refused(planar, wrong, question):
    checker = CollisionChecker(Scene().with_arm("p", planar))
    with pytest.raises(InputError):
        getattr(checker, question)(wrong)


def test_limits_are_their_own_question(planar):
    checker = CollisionChecker(Scene().with_arm("p", planar))
    assert checker.is_free_slowly([3.5, 0.0])
    assert not checker.within_limits([3.5, 0.0])
    ((joint, excess),) = checker.limit_violations([0.0, -3.5])
    assert joint == "p/elbow"
    assert excess == pytest.approx(0.3)
    assert checker.within_limits([3.2, -3.2])


def test_an_unknown_arm_is_refused(planar):
    with pytest.raises(UnknownNameError):
        CollisionChecker(Scene().with_arm("p", planar), ["q"])


def test_a_cloud_too_far_out_for_an_octree_is_refused(planar):
    scene = Scene().with_arm("p", planar).with_obstacle("cloud", PointCloud(np.array([[100.0, 0, 0]]), 0.001))
    with pytest.raises(InputError, match="coarser"):
        CollisionChecker(scene)


def test_a_checker_survives_pickling(cluttered):
    checker = CollisionChecker(cluttered)
    again = pickle.loads(pickle.dumps(checker))
    q = cluttered.configuration()
    assert np.array_equal(again.distances(q), checker.distances(q))


def test_what_rests_is_told_as_exactly_as_what_moves(rr1):
    scene = Scene().with_arm("near", rr1).with_arm("far", rr1, [2.0, 0.0, 0.0])
    above = scene.link_poses()["near/elbow_link"][:3, 3] + [0.0, 0.0, 0.4]
    scene = scene.with_obstacle("ball", Sphere(0.05), above).with_padding(0.5, "ball", "near")
    expected = CollisionChecker(scene)
    for moving in ("near", "far"):
        checker, q = CollisionChecker(scene, [moving]), scene.configuration([moving])
        near = checker.nearest(q)
        assert near.distance == pytest.approx(expected.nearest(scene.configuration()).distance, abs=1e-9)
        assert near.distance == pytest.approx(np.linalg.norm(near.point_a - near.point_b), abs=1e-9)
        assert not checker.is_free_slowly(q)
        depths = {(c.a, c.b): [c.depth, *c.point] for c in expected.contacts(scene.configuration())}
        found = {(c.a, c.b): [c.depth, *c.point] for c in checker.contacts(q)}
        assert found.keys() == depths.keys()
        for pair, values in found.items():
            assert values == pytest.approx(depths[pair], abs=1e-6)


def test_the_kernel_keeps_the_hulls_of_moving_links_beside_those_of_the_base():
    large = Mesh(3.0 * hull_mesh().vertices, hull_mesh().faces, convex=True)
    links = (
        Link("base", collisions=(Geometry("foot", large),)),
        Link("tip", collisions=(Geometry("tip", hull_mesh()),)),
    )
    arm = dataclasses.replace(
        probe(hull_mesh()), links=links, disabled_collisions=frozenset({frozenset({"base", "tip"})})
    )
    scene = Scene().with_arm("p", arm).with_obstacle("thing", Box((0.2, 0.3, 0.4)), [0.0, 0.0, 2.0])
    checker = CollisionChecker(scene)
    for z in np.linspace(-1.0, 1.0, 9):
        assert checker.clearance([z]) == pytest.approx(checker.distances([z]).min(), abs=1e-6)
