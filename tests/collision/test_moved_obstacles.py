"""A checker with moved obstacles gives the same results as a new one of the changed scene."""

from __future__ import annotations

import pickle
from contextlib import ExitStack

import numpy as np
import pytest
from concave_meshes import terrain, torus

from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.collision.collision_geometry import collision_geometry
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.kernels.wasm_core import memory_image
from rr1plan.robot import Geometry
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere
from rr1plan.transforms import pose

HULL = Mesh(np.vstack([np.zeros(3), 0.2 * np.eye(3)]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], convex=True)


def shapes(rng):
    """An obstacle of every kind, one of several shapes among them."""
    ball = Mesh(rng.normal(size=(40, 3)) * 0.05, [[0, 1, 2], [1, 2, 3]]).vertices
    return {
        "box": Box((0.1, 0.2, 0.3)),
        "ball": Sphere(0.1),
        "stick": Capsule(0.03, 0.3),
        "can": Cylinder(0.08, 0.3),
        "ground": HalfSpace((0.1, 0.0, 1.0), -0.2),
        "hull": HULL,
        "ring": torus(sides=8, around=6),
        "hills": terrain(3, 0.6),
        "cloud": PointCloud(ball + 0.1, 0.03),
        "chair": (
            Geometry("seat", Box((0.3, 0.3, 0.02)), pose([0, 0, 0.2])),
            Geometry("leg", Cylinder(0.02, 0.4), pose([0.1, 0.1, 0.0], rpy=[0.2, 0.1, 0.0])),
            Geometry("back", HULL, pose([0.1, 0.0, 0.3], rpy=[0.2, 0.1, 0.4])),
        ),
    }


def anywhere(rng):
    return pose(rng.uniform(-0.8, 0.8, 3), quaternion=rng.normal(size=4))


def furnished(scene, rng):
    for name, shape in shapes(rng).items():
        at = pose([5.0, 0.0, -3.0]) if name == "ground" else pose(5.0 + rng.uniform(size=3), rpy=rng.normal(size=3))
        scene = scene.with_obstacle(name, shape, at)
    return scene


def same_answers(moved, rng, count=25):
    """Compare results of a checker and of a new one. Returns the number of free edges."""
    anew = CollisionChecker(copy_of(moved.scene), moved.arms, margin=moved.margin)
    assert moved.static_is_free == anew.static_is_free
    assert moved.static_contacts == anew.static_contacts
    assert moved.pairs == anew.pairs
    assert memory_image(scene=moved._kernel._scene) == memory_image(scene=anew._kernel._scene)
    free = 0
    for q in rng.uniform(-2.5, 2.5, (count, moved.nq)):
        end = q + 0.2 * rng.normal(size=moved.nq)
        free += moved.edge_is_free(q, end)
        assert moved.edge_is_free(q, end) == anew.edge_is_free(q, end) == moved.edge_is_free_slowly(q, end)
        assert moved.is_free(q) == anew.is_free(q) == moved.is_free_slowly(q)
        assert moved.clearance(q, 0.3) == anew.clearance(q, 0.3)
        assert [(c.a, c.b) for c in moved.contacts(q)] == [(c.a, c.b) for c in anew.contacts(q)]
        np.testing.assert_array_equal(moved.distances(q), anew.distances(q))
        assert moved.nearest(q).pair == anew.nearest(q).pair
    return free


def copy_of(scene):
    """An equal scene without cached data of the first."""
    fields = (scene.arms, scene.obstacles, scene.attachments, scene.allowed, scene.padding, scene.pair_padding)
    return Scene(*fields)


@pytest.mark.parametrize("kind", sorted(shapes(np.random.default_rng(0))))
def test_every_kind_of_obstacle_can_be_moved(six, kind):
    rng = np.random.default_rng(sum(map(ord, kind)))
    scene = furnished(Scene().with_arm("a", six).with_padding(0.01), rng)
    checker = CollisionChecker(scene, margin=0.002)
    q = rng.uniform(-2.5, 2.5, (2, checker.nq))
    for _ in range(3):
        T = anywhere(rng)
        checker.is_free(q[0])
        checker.move_obstacle(kind, T)
        checker.edge_is_free(*q)
        same_answers(checker, rng, 8)
        np.testing.assert_array_equal(checker.scene.obstacles[kind].pose, T)
        assert scene.obstacles[kind].pose[0, 3] > 1.0


def test_many_moves_one_after_the_other(six, odd):
    rng = np.random.default_rng(3)
    scene = furnished(Scene().with_arm("a", odd).with_arm("b", six, [0.9, 0.2, 0.0]), rng)
    checker, free = CollisionChecker(scene), 0
    for _ in range(12):
        for name in rng.choice(list(scene.obstacles), 3):
            checker.move_obstacle(name, anywhere(rng) if rng.random() < 0.7 else [4.0, 0.0, 0.0])
        free += same_answers(checker, rng, 5)
    assert free > 5


def test_a_pose_may_be_stored_by_columns_as_pinocchio_stores_them(six):
    rng = np.random.default_rng(9)
    scene, there = furnished(Scene().with_arm("a", six), rng), anywhere(rng)
    checker = CollisionChecker(scene)
    checker.move_obstacle("box", np.asfortranarray(there))
    q = np.zeros(checker.nq)
    assert checker.clearance(q) == CollisionChecker(scene.with_obstacle_at("box", there)).clearance(q)


def test_beside_an_arm_that_stands_still(six, odd):
    """Contacts of the moved obstacle with that arm are found, and gone when it is moved away."""
    rng = np.random.default_rng(4)
    scene = furnished(Scene().with_arm("a", six).with_arm("b", odd, [0.9, 0.2, 0.0]), rng)
    checker = CollisionChecker(scene, ["a"])
    seen = set()
    for at in ([0.9, 0.2, 0.3], [3.0, 0.0, 0.0], [0.9, 0.2, 0.4], [0.0, 0.0, 3.0]):
        for name in ("box", "hull"):
            checker.move_obstacle(name, at)
        seen.add(checker.static_is_free)
        same_answers(checker, rng, 5)
    assert seen == {True, False}


def test_among_so_many_that_some_are_left_out(planar):
    rng = np.random.default_rng(5)
    scene = Scene().with_arm("a", planar)
    for i in range(80):
        scene = scene.with_obstacle(f"box {i}", Box((0.1, 0.1, 0.1)), [1.0 + 0.2 * i, 0.5, 0.0])
    checker = CollisionChecker(scene)
    for at in ([1.0, 0.0, 0.0], [70.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        checker.move_obstacle("box 79", at)
        checker.edge_is_free(*rng.uniform(-2.0, 2.0, (2, checker.nq)))
        same_answers(checker, rng)


def test_one_from_the_pool_is_that_of_the_changed_scene_from_then_on(six):
    scene = Scene().with_arm("a", six).with_obstacle("post", Box((0.1, 0.1, 2.0)), [3.0, 0.0, 0.0])
    q, there = np.array([0.0, 0.6, 0.5, 0.0, 0.3, 0.0]), None
    with checker_from_pool(scene) as checker:
        assert checker.is_free(q)
        for angle in np.linspace(0.0, 6.0, 60):
            checker.move_obstacle("post", [0.4 * np.cos(angle), 0.4 * np.sin(angle), 0.5])
            there = checker if not checker.is_free(q) else None
            if there is not None:
                break
    assert there is not None
    with checker_from_pool(scene) as other:
        assert other is not there
        assert other.is_free(q)
    with checker_from_pool(there.scene) as again:
        assert again is there
    copied = pickle.loads(pickle.dumps(there))
    assert not copied.is_free(q)
    assert copied.scene.content_hash == there.scene.content_hash != scene.content_hash


def test_a_moved_checker_keeps_other_margins_too(six):
    rng = np.random.default_rng(7)
    checker = CollisionChecker(furnished(Scene().with_arm("a", six), rng))
    checker.move_obstacle("box", [0.4, 0.2, 0.4])
    checker.keep_margin(0.02)
    same_answers(checker, rng)
    checker.move_obstacle("can", [0.4, -0.2, 0.4])
    same_answers(checker, rng)


def test_what_cannot_be_moved(six):
    checker = CollisionChecker(Scene().with_arm("a", six).with_obstacle("box", Box((1, 1, 1)), [3, 0, 0]))
    with pytest.raises(UnknownNameError, match=r"'bock'.*'box'"):
        checker.move_obstacle("bock", [0, 0, 0])
    for wrong in ([0, 0], [np.nan, 0, 0], np.zeros((4, 4)), "there"):
        with pytest.raises(InputError):
            checker.move_obstacle("box", wrong)
    assert checker.scene.obstacles["box"].pose[0, 3] == 3.0


def test_a_complete_checker_leaves_nothing_out_however_many_there_are(rr1):
    rng = np.random.default_rng(12)
    scene = Scene().with_arm("arm", rr1)
    for i in range(70):
        scene = scene.with_obstacle(f"ball{i}", Sphere(0.03), [0.5 * (i % 10), 0.5 + 0.5 * (i // 10), 0.3])
    checker = CollisionChecker(scene, margin=0.002)
    complete = checker.complete()
    assert checker.object_numbers == {}
    assert list(complete.object_numbers) == list(scene.obstacles)
    assert {pair[1] for pair in complete.pairs} >= set(scene.obstacles)
    assert len(checker.pairs) < len(complete.pairs)
    assert (complete.arms, complete.margin) == (checker.arms, checker.margin)
    assert np.isinf(complete.omitted_clearance)
    starts, ends = rng.uniform(-1.5, 1.5, (2, 40, checker.nq))
    answers = [complete.edge_is_free(a, b) for a, b in zip(starts, ends, strict=True)]
    assert answers == [checker.edge_is_free(a, b) for a, b in zip(starts, ends, strict=True)]
    assert 0 < sum(answers) < 40


def refurnished(scene, rng):
    """The same obstacles elsewhere, those of closed form of other sizes."""
    size = rng.uniform(0.05, 0.2, 4)
    other = {"box": Box((size[0], 0.2, 0.1)), "ball": Sphere(size[1]), "stick": Capsule(0.02, 2 * size[2])}
    other |= {"can": Cylinder(size[3], 0.2), "ground": HalfSpace((0.0, size[0], 1.0), -0.4)}
    for name, obstacle in list(scene.obstacles.items()):
        at = pose([0.0, 0.0, -0.2]) if name == "ground" else anywhere(rng)
        shape = other.get(name, obstacle.geometries if name == "chair" else obstacle.geometries[0].shape)
        scene = scene.without_obstacle(name).with_obstacle(name, shape, at)
    return scene


def test_a_checker_that_changes_to_another_scene_answers_like_a_new_one(six, odd):
    rng = np.random.default_rng(11)
    scene = furnished(Scene().with_arm("a", six).with_arm("b", odd, [0.9, 0.2, 0.0]).with_padding(0.004), rng)
    checker, free = CollisionChecker(scene, margin=0.002), 0
    checker.warm_up()
    for k in range(6):
        other = refurnished(scene, rng)
        if k == 3:
            checker.move_obstacle("hull", anywhere(rng))
        assert checker.change_to(collision_geometry(other, checker.arms, checker.omission_distance), other)
        assert checker.scene is other
        free += same_answers(checker, rng, 8)
    checker.move_obstacle("box", [3.0, 0.0, 0.0])
    same_answers(checker, rng, 5)
    assert free > 3


@pytest.mark.parametrize("change", ["kind", "corners", "padding", "name"])
def test_a_checker_does_not_change_to_a_scene_with_other_tables(six, change):
    rng = np.random.default_rng(12)
    scene = furnished(Scene().with_arm("a", six), rng)
    checker = CollisionChecker(scene)
    checker.warm_up()
    larger = Mesh(1.5 * HULL.vertices, HULL.faces, convex=True)
    others = {
        "kind": scene.without_obstacle("box").with_obstacle("box", Cylinder(0.1, 0.2)),
        "corners": scene.without_obstacle("hull").with_obstacle("hull", larger),
        "padding": scene.with_padding(0.001),
        "name": scene.without_obstacle("box").with_obstacle("crate", Box((0.1, 0.2, 0.3))),
    }
    other = others[change]
    assert not checker.change_to(collision_geometry(other, checker.arms, checker.omission_distance), other)
    assert checker.scene is scene
    same_answers(checker, rng, 2)


def test_scenes_that_change_share_few_checkers_and_no_scene_in_use_loses_its_own(six):
    rng = np.random.default_rng(13)
    scene = Scene().with_arm("a", six).with_obstacle("post", Box((0.1, 0.1, 2.0)), [3.0, 0.0, 0.0])
    checkers, held = set(), []
    for _ in range(20):
        other = scene.with_obstacle_at("post", anywhere(rng))
        with checker_from_pool(other, margin=0.001) as checker:
            checker.warm_up()
            checkers.add(checker)
            assert checker.scene is other
            same_answers(checker, rng, 2)
            with checker_from_pool(other) as second:
                assert second is not checker
        held.append(other)
    assert len(checkers) < 12
    with ExitStack() as stack:
        taken = [stack.enter_context(checker_from_pool(place)) for place in held]
        assert len(set(taken)) == len(held)
        assert [checker.scene for checker in taken] == held
