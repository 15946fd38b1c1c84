"""Tables shared between scenes equal those of a scene built from scratch, after any change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rr1plan.collision import (
    CollisionChecker,
    arm_geometry,
    collision_geometry,
)
from rr1plan.collision.edge_kernel import ExactKernel
from rr1plan.collision.tables import arm_tables, body_tables, exact_tables, link_spheres
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.collision.tables.exact_tables import exact_scratch
from rr1plan.errors import InputError
from rr1plan.model.arm_model import _arm_model
from rr1plan.model.scene_model import SceneModel
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.contact_rules import rules_of
from rr1plan.scene.model_library import load_scene
from rr1plan.shapes import Box, Capsule, HalfSpace, Mesh, PointCloud, Sphere
from rr1plan.transforms import pose

HULL = Mesh(np.vstack([np.zeros(3), 0.1 * np.eye(3)]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], convex=True)


def forget() -> None:
    # All else is kept by these.
    arms = _arm_model, arm_geometry._arm_geometry, arm_geometry.arm_instances
    pairs = collision_geometry._layout, collision_geometry._large_layout, rules_of
    for kept in (*arms, body_tables.body_core, *pairs):
        kept.cache_clear()


def copied(scene: Scene) -> Scene:
    """An equal scene without cached data of the first."""
    fields = (scene.arms, scene.obstacles, scene.attachments, scene.allowed, scene.padding, scene.pair_padding)
    return Scene(*fields)


def arrays_of(scene: Scene, arms: list[str] | None) -> list[np.ndarray]:
    checker = CollisionChecker(scene, arms)
    exact, pairs = checker.tables, checker.pair_tables
    static = exact_tables.build_static_tables(exact, pairs, checker.padding[pairs.static_owner]) or ()
    edges = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)
    own = (checker.solid_pairs, checker.solid_owner, checker.solid_padding, checker.pairs, checker.static_contacts)
    arm, pairs_of_kernel = vars(edges.arm).values(), vars(edges.pairs).values()
    tables = (*arm, *edges.cores, *edges.obstacles.targets.values(), *pairs_of_kernel, edges.rest, *exact, *static)
    return [*map(np.asarray, own), *(np.asarray(a) for a in tables if isinstance(a, np.ndarray | float))]


def same_as_anew(scene: Scene, arms: list[str] | None = None) -> None:
    shared = arrays_of(scene, arms)
    forget()
    anew = arrays_of(copied(scene), arms)
    assert len(shared) == len(anew)
    for one, two in zip(shared, anew, strict=True):
        np.testing.assert_array_equal(one, two)


def changes(scene: Scene, arm: str) -> dict[str, Scene]:
    """Scenes a step away from one with obstacles "one" and "two"."""
    held = scene.attach("one", arm)
    return {
        "moved": scene.with_obstacle("one", Box((0.1, 0.2, 0.3)), pose([0.5, 0.6, 0.7], rpy=[0.1, 0.2, 0.3])),
        "reshaped": scene.with_obstacle("one", Capsule(0.1, 0.2), [0.5, 0.6, 0.7]),
        "removed": scene.without_obstacle("one"),
        "added": scene.with_obstacle("three", Sphere(0.1), [0.9, 0.1, 0.2]),
        "ground": scene.with_obstacle("three", HalfSpace((0, 0, 1), -0.5)),
        "hull": scene.with_obstacle("three", HULL, pose([0.9, 0.1, 0.2], rpy=[0.1, 0.2, 0.3])),
        "cloud": scene.with_obstacle("three", PointCloud(np.array([[0.9, 0.9, 0.9], [1.0, 0.9, 0.9]]))),
        "attached": held,
        "held otherwise": scene.attach("one", arm, pose=pose([0, 0, 0.2])),
        "detached": held.detach("one"),
        "allowed": scene.allow(arm, "two"),
        "padded": scene.with_padding(0.01),
        "padded for one": scene.with_padding(0.01, arm, "two"),
        "with a margin": scene.with_padding(0.01, arm, "two").with_margin(0.002),
        "moved, then padded": scene.with_obstacle("one", Sphere(0.1), [0.5, 0.5, 0.5]).with_margin(0.001),
        "another configuration": scene.with_configuration(arm, 0.5 * scene.arms[arm].q + 0.1),
        "another base": scene.with_arm(arm, scene.arms[arm].robot, pose([0.1, 0, 0], rpy=[0, 0, 0.3])),
    }


CHANGES = (
    *(
        "moved",
        "reshaped",
        "removed",
        "added",
        "ground",
        "hull",
        "cloud",
        "attached",
        "held otherwise",
        "detached",
        "allowed",
    ),
    *("padded", "padded for one", "with a margin", "moved, then padded", "another configuration", "another base"),
)


def furnished(scene: Scene) -> Scene:
    return scene.with_obstacle("one", Box((0.1, 0.2, 0.3)), [0.7, 0.3, 0.8]).with_obstacle(
        "two", Sphere(0.1), [-0.7, 0.3, 0.4]
    )


@pytest.mark.parametrize("change", CHANGES)
def test_what_was_kept_is_what_is_made_anew(odd, change):
    scene = furnished(Scene().with_arm("a", odd))
    arrays_of(scene, None)
    same_as_anew(changes(scene, "a")[change])


@pytest.mark.parametrize("change", CHANGES)
def test_with_an_arm_that_stands_still_too(six, planar, change):
    scene = furnished(Scene().with_arm("a", six).with_arm("b", planar, [1.5, 0, 0]))
    arrays_of(scene, ["b"])
    same_as_anew(changes(scene, "a")[change], ["b"])


def test_the_robot_with_another_gripper_has_tables_of_its_own(odd):
    scene = furnished(Scene().with_arm("a", odd))
    before = arrays_of(scene, None)
    open_hand = scene.with_robot("a", odd.with_locked_joints({"grip": 0.05}))
    same_as_anew(open_hand)
    after = arrays_of(open_hand, None)
    assert any(x.shape != y.shape or (x != y).any() for x, y in zip(before, after, strict=True))


def test_scenes_with_equal_arms_share_what_the_arms_carry(odd):
    scene = furnished(Scene().with_arm("a", odd))
    same = [scene.with_obstacle("one", Sphere(0.3)), scene.with_configuration("a", [0.1, 0.2, 0.3]), copied(scene)]
    first = CollisionChecker(scene)
    for other in same:
        checker = CollisionChecker(other)
        assert checker.model.model is first.model.model
        assert checker.geometry.instances is first.geometry.instances
    assert CollisionChecker(scene.with_margin(0.04)).geometry is first.geometry
    assert CollisionChecker(scene, margin=0.04).geometry is first.geometry
    assert CollisionChecker(scene.with_margin(3.0)).geometry.instances is first.geometry.instances
    assert SceneModel(scene.with_arm("b", odd)).model is not first.model.model


def test_an_obstacle_that_moved_leaves_all_else_as_it_was(odd, monkeypatch):
    scene = furnished(Scene().with_arm("a", odd)).with_obstacle("three", Sphere(0.1), [0.9, 0.1, 0.2])
    scene = scene.with_obstacle("four", HULL, [1.5, 0.1, 0.2])
    first, before = CollisionChecker(scene), arrays_of(scene, None)

    def made_again(*_):
        raise AssertionError("tables of the arm were made again")

    monkeypatch.setattr(link_spheres, "cover", made_again)
    monkeypatch.setattr(arm_tables, "_joint_tables", made_again)
    moved = scene.with_obstacle("two", Sphere(0.1), [-0.7, 0.35, 0.4])
    after = CollisionChecker(moved)
    assert after.geometry.instances is first.geometry.instances
    assert after.geometry.pairs is first.geometry.pairs
    changed = [x.shape == y.shape and (x != y).any() for x, y in zip(before, arrays_of(moved, None), strict=True)]
    assert 0 < sum(changed) < 10


def test_equal_scenes_made_apart_share_their_pairs(odd):
    one, two = (furnished(Scene().with_arm("a", odd)) for _ in range(2))
    assert CollisionChecker(one).geometry.pairs is CollisionChecker(two).geometry.pairs


def test_scenes_whose_obstacles_have_other_rules_have_other_pairs(odd):
    scene = furnished(Scene().with_arm("a", odd))
    first = CollisionChecker(scene).geometry.pairs
    for other in (scene.allow("a", "two"), scene.without_obstacle("two"), scene.with_obstacle("two", HULL)):
        same = len(other.checked_pairs) == len(scene.checked_pairs)
        assert (CollisionChecker(other).geometry.pairs is first) == same
    ground = scene.with_obstacle("two", HalfSpace((0, 0, 1), -0.5))
    assert CollisionChecker(ground).geometry.pairs is not first


def test_scratch_memory_is_nobody_elses(odd):
    scene = furnished(Scene().with_arm("a", odd))
    checkers = [CollisionChecker(s) for s in (scene, scene.with_margin(0.1))]
    one, two = (list(exact_scratch(checker.tables, checker.nq).targets.values()) for checker in checkers)
    assert len(one) == len(two) > 5
    kept = [array for checker in checkers for array in checker.tables]
    for i, mine in enumerate(one):
        assert mine.flags.writeable
        assert not any(np.shares_memory(mine, other) for other in (*one[:i], *one[i + 1 :], *two, *kept))


def test_kernels_of_other_pairs_share_memory_and_answer_as_their_own(odd):
    checker = CollisionChecker(furnished(Scene().with_arm("a", odd)))
    every, rng = checker.tables, np.random.default_rng(5)
    for part in (slice(0, 1), slice(1, 4)):
        tables = every._replace(pairs=every.pairs[part].copy(), padding=every.padding[part].copy())
        few = ExactKernel(tables, checker.nq, pairs=len(every.pairs))
        many = few.of_pairs(every)
        assert many.scratch is few.scratch
        for q in rng.uniform(-1.0, 1.0, (20, checker.nq)):
            for kernel, own in ((many, every), (few, tables)):
                assert kernel.least_clearance(q, 0.3) == ExactKernel(own, checker.nq).least_clearance(q, 0.3)


# ---- without Coal ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rr1_cluttered", "rr1_pair", "planar2r_path"])
def test_clearance_is_coals_least_distance_beyond_the_padding(name):
    scene = load_scene(name).with_padding(0.01)
    checker, rng = CollisionChecker(scene), np.random.default_rng(3)
    apart = 0
    for q in rng.uniform(-1.5, 1.5, (60, checker.nq)):
        expected = float((checker.distances(q) - checker.padding).min())
        found = checker.clearance(q)
        if expected > -0.01 + 1e-6:
            apart += 1
            assert found == pytest.approx(expected, abs=2e-5)
            assert checker.clearance(q, 0.03) == pytest.approx(min(expected, 0.03), abs=2e-5)
        else:
            assert found <= -0.01 + 1e-6
    assert apart > 5


@pytest.mark.parametrize("away", [1.9, 3.0])
def test_clearance_is_that_of_moving_arms_and_what_stands_still_counts_for_itself(planar, away):
    scene = Scene().with_arm("l", planar).with_arm("r", planar, [away, 0, 0])
    scene = scene.with_obstacle("b", Sphere(0.1), [away + 0.25, 0.15, 0])
    checker = CollisionChecker(scene, ["l"])
    assert checker.clearance([0, 0]) == pytest.approx(away - 0.94, abs=1e-9)
    assert checker.static_is_free
    assert checker.static_contacts == ()
    padded = CollisionChecker(scene.with_padding(0.04), ["l"])
    assert padded.clearance([0, 0]) == pytest.approx(away - 0.98, abs=1e-9)
    assert not padded.static_is_free
    assert padded.static_contacts == (("r/upper", "b"),)
    assert CollisionChecker(scene.with_padding(0.04), ["r"]).static_is_free


def test_a_link_that_no_joint_moves_counts_with_its_arm(odd):
    # The lift is held, so that nothing moves the link that slides.
    limits = Limits(np.full(2, -3.2), np.full(2, 3.2), *(np.ones(2) for _ in range(4)))
    names, home = ("turn", "bend"), {"home": np.zeros(2)}
    robot = replace(
        odd, joint_names=names, locked_joints={**odd.locked_joints, "lift": 0.0}, limits=limits, configurations=home
    )
    scene = Scene().with_arm("a", robot).with_obstacle("wall", Box((0.1, 0.1, 0.1)), [0.12, 0.12, 0.35])
    checker = CollisionChecker(scene)
    gap = float(np.hypot(0.07, 0.07)) - 0.06
    assert checker.clearance([-2.36, 0.2]) == pytest.approx(gap, abs=1e-6)
    assert checker.nearest([-2.36, 0.2]).pair == ("a/slide", "wall")
    assert checker.static_is_free
    padded = CollisionChecker(scene.with_padding(gap + 0.01, "a/slide", "wall"))
    assert padded.clearance([-2.36, 0.2]) == pytest.approx(-0.01, abs=1e-6)
    assert padded.static_contacts == (("a/slide", "wall"),)
    assert not padded.static_is_free
    assert [(c.a, c.b) for c in padded.contacts([-2.36, 0.2])] == [("a/slide", "wall")]


def test_clearance_of_a_lone_arm_is_what_was_asked_for(planar):
    assert CollisionChecker(Scene().with_arm("p", planar)).clearance([0, 0]) == np.inf
    assert CollisionChecker(Scene().with_arm("p", planar)).clearance([0, 0], 0.5) == 0.5


def test_clearance_refuses_what_is_no_configuration(planar):
    with pytest.raises(InputError):
        CollisionChecker(Scene().with_arm("p", planar)).clearance([0, np.nan])


def test_motions_are_proven_without_a_word_from_coal(cluttered, monkeypatch):
    def asked(*_):
        raise AssertionError("Coal was asked")

    monkeypatch.setattr("rr1plan.collision.coal_checker.CoalPairs", asked)
    motions = CollisionChecker(cluttered)
    q = np.array([0.0, 0.4, 0.8, 0.0, 0.5, 0.0])
    assert motions.edge_is_free(q, q)
    assert motions.clearance(q, 0.001) == 0.001
    with pytest.raises(AssertionError, match="Coal was asked"):
        motions.is_free_slowly(q)
