"""The verdict "no path exists" is a proof: no planner finds a path, and certified cells are entirely in contact."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from concave_meshes import angle_block, half_shell, soup, terrain, torus

import rr1plan as rp
from rr1plan import CSpace
from rr1plan.collision import CollisionChecker
from rr1plan.collision.contact_cells import ContactCells
from rr1plan.playback.cspace.cspace_decomposition import decompose
from rr1plan.playback.cspace.cspace_grid import compute_grid
from rr1plan.playback.cspace.cspace_verdict import verdict
from rr1plan.robot import Geometry, Joint, Link, Mimic, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene.model_library import load_problems
from rr1plan.shapes import Shape
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.testing.collision_checkers import ElementChecker
from rr1plan.transforms import pose

BALL = 0.05
SPANS = {"continuous": (-np.inf, np.inf), "revolute": (-2.0, 2.5), "prismatic": (-0.8, 0.9)}


def robot_of(joints: list[Joint], collisions: dict[str, list[Geometry]]) -> Robot:
    """An arm whose planning joints are those that do not mimic others."""
    own = [joint for joint in joints if joint.mimic is None]
    names = ["base", *(joint.child for joint in joints)]
    links = tuple(Link(name, collisions=tuple(collisions.get(name, ()))) for name in names)
    never = frozenset(frozenset((joint.parent, joint.child)) for joint in joints)
    ones, endless = np.ones(2), np.full(2, np.inf)
    lower, upper = (np.array([getattr(joint, end) for joint in own]) for end in ("lower", "upper"))
    limits = Limits(lower, upper, ones, ones, endless, endless)
    home = {"home": np.zeros(2)}
    return Robot("two", links, tuple(joints), tuple(j.name for j in own), limits, home, {}, never, names[-1])


def gantry() -> Robot:
    """A ball that slides along x and y, a meter each way."""
    x, y, _ = np.eye(3)
    joints = [
        Joint("x", "prismatic", "base", "slide", axis=x, lower=-1, upper=1, velocity=1),
        Joint("y", "prismatic", "slide", "hand", axis=y, lower=-1, upper=1, velocity=1),
    ]
    return robot_of(joints, {"hand": [Geometry("ball", rp.Sphere(BALL))]})


def before_a_wall(play: float) -> rp.Problem:
    """The gantry before a wall with a slit that is wider than the ball by `play` [m]."""
    low, high = 0.3 - BALL - 0.5 * play, 0.3 + BALL + 0.5 * play
    scene = rp.Scene().with_arm("arm", gantry())
    scene = scene.with_obstacle("below", rp.Box((0.1, low + 1.2, 0.2)), pose([0.0, 0.5 * (low - 1.2), 0.0]))
    scene = scene.with_obstacle("above", rp.Box((0.1, 1.2 - high, 0.2)), pose([0.0, 0.5 * (1.2 + high), 0.0]))
    return rp.Problem(scene, [-0.8, -0.5], [0.8, 0.5])


def a_shape(rng: np.random.Generator, length: float, kinds: int = 5) -> Shape:
    """A ball, or something long along z; the fifth kind is a mesh."""
    match rng.integers(kinds):
        case 0:
            return rp.Sphere(rng.uniform(0.03, 0.1))
        case 1:
            return rp.Capsule(rng.uniform(0.03, 0.06), length)
        case 2:
            return rp.Cylinder(rng.uniform(0.03, 0.06), length)
        case 3:
            return rp.Box((*rng.uniform(0.04, 0.1, 2), length))
    return convex_hull(rng.normal(size=(12, 3)) * np.array([0.05, 0.05, length / 3]))


def an_arm(rng: np.random.Generator, flat: bool, kinds: int) -> Robot:
    """Two joints of any kind, in the plane or askew, and a flap on the second link that follows one of them."""

    def axis(k: int) -> np.ndarray:
        direction = rng.normal(size=3)
        return np.eye(3)[k] if flat else direction / np.linalg.norm(direction)

    moves = [str(kind) for kind in rng.choice(list(SPANS), 2)]
    joints = []
    for k, (kind, parent, child) in enumerate(zip(moves, ("base", "upper"), ("upper", "lower"), strict=True)):
        lower, upper = SPANS[kind]
        turns = kind != "prismatic"
        at = pose([0.5 * k * (moves[0] != "prismatic"), 0, 0])
        joints.append(
            Joint(f"j{k}", kind, parent, child, at, axis(2 if turns else k), lower=lower, upper=upper, velocity=1)
        )
    follower = Mimic("j1", 0.5 if moves[1] == "revolute" else -1.0)
    joints.append(Joint("j2", moves[1], "lower", "flap", pose([0.4, 0, 0]), axis(2), mimic=follower))
    along = pose([0.25, 0, 0], rpy=[0, np.pi / 2, 0])
    bodies = {name: [Geometry("g", a_shape(rng, 0.4, kinds), along)] for name in ("upper", "lower")}
    bodies["flap"] = [Geometry("f", rp.Box((0.15, 0.03, 0.05)), pose([0.08, 0, 0]))]
    return robot_of(joints, bodies)


def a_scene(seed: int, plain: bool = False) -> tuple[rp.Scene, np.random.Generator]:
    """An arm of two joints among obstacles; if not plain: also meshes, clouds, half-spaces, and padding in some."""
    rng = np.random.default_rng(seed)
    flat, kinds = bool(rng.random() < 0.5), 4 if plain else 5
    scene = rp.Scene().with_arm("arm", an_arm(rng, flat, kinds))
    for k in range(rng.integers(3, 6)):
        shape: Shape = a_shape(rng, 0.5, kinds)
        at = pose(np.append(rng.uniform(-0.9, 0.9, 2), 0.0 if flat else rng.uniform(-0.3, 0.3)), rpy=rng.normal(size=3))
        if not plain and rng.random() < 0.3:
            shape, at = rp.PointCloud(rng.uniform(-0.1, 0.1, (60, 3)), 0.03), at
        if not plain and rng.random() < 0.1:
            shape, at = rp.HalfSpace((0.0, 0.6, 0.8), -0.35), np.eye(4)
        scene = scene.with_obstacle(f"thing{k}", shape, at)
    padded = not plain and rng.random() < 0.4
    return (scene.with_padding(float(rng.uniform(0.005, 0.03))) if padded else scene), rng


def somewhere(scene: rp.Scene, rng: np.random.Generator, count: int) -> np.ndarray:
    limits = scene.limits()
    return rng.uniform(np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi), (count, 2))


# ---- certified cells -------------------------------------------------------------------------


def certified_cells(scene: rp.Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Configurations in cells of a random size that are certified blocked: random ones, corners; and the shares."""
    cells = ContactCells(CollisionChecker(scene), np.zeros(2), (0, 1))
    half = 10.0 ** rng.uniform(-3.0, -0.7, 2)
    centers = somewhere(scene, rng, 400)
    blocked, _ = cells.classify(centers, half, np.ones((len(centers), cells.pairs), dtype=bool))
    corner = np.sign(rng.normal(size=(len(centers), 2)))
    places = np.stack([centers + corner * half, centers + rng.uniform(-1, 1, (len(centers), 2)) * half])
    return places[:, blocked].reshape(-1, 2), blocked


@pytest.mark.parametrize("seed", range(24))
def test_every_configuration_of_a_certified_cell_is_in_contact(seed: int) -> None:
    """By Coal at corners and random places; shapes of all kinds, mimic joints, padding."""
    scene, rng = a_scene(seed)
    checker = CollisionChecker(scene)
    places, blocked = certified_cells(scene, rng)
    assert [q for q in places if checker.is_free(q)] == []
    # A sufficient fraction is certified.
    touching = sum(not checker.is_free(q) for q in somewhere(scene, rng, 200)) / 200
    assert blocked.mean() > 0.2 * touching - 0.1


@pytest.mark.parametrize("seed", range(100, 108))
def test_plain_coal_and_fcl_agree_about_certified_cells(seed: int) -> None:
    scene, rng = a_scene(seed, plain=True)
    places, _ = certified_cells(scene, rng)
    chosen = rng.permutation(places)[:40]
    for found in ElementChecker(scene, scene.joint_names()).contacts(chosen):
        assert set().union(*found.values()) == {"Coal", "FCL"}


def among_meshes(seed: int) -> tuple[rp.Scene, np.random.Generator]:
    """An arm of two joints among meshes that are not convex, closed ones and an open one."""
    rng = np.random.default_rng(seed)
    scene = rp.Scene().with_arm("arm", an_arm(rng, True, 4))
    for k, mesh in enumerate(
        (torus(0.25, 0.12, 16, 8), angle_block(0.5, 0.2), half_shell(0.4, 0.15, 12, 4), soup(8, 0.5))
    ):
        at = pose(np.append(rng.uniform(-0.9, 0.9, 2), 0.0), rpy=rng.normal(size=3))
        scene = scene.with_obstacle(f"thing{k}", mesh, at)
    return scene, rng


def test_cells_certified_in_contact_with_concave_meshes_are_in_contact() -> None:
    """The inside of a closed mesh certifies cells; that of its hull, and an open surface, do not."""
    shares = []
    for seed in range(6):
        scene, rng = among_meshes(seed)
        checker = CollisionChecker(scene)
        places, blocked = certified_cells(scene, rng)
        assert [q for q in places if checker.is_free(q)] == []
        shares.append(blocked.mean())
    assert max(shares) > 0.05
    sheet = rp.Scene().with_arm("arm", gantry()).with_obstacle("sheet", terrain(4, 2.0, 0.0))
    cells = ContactCells(CollisionChecker(sheet), np.zeros(2), (0, 1))
    assert not cells.classify(np.zeros((1, 2)), np.full(2, 0.01), np.ones((1, 1), dtype=bool))[0].any()


# ---- the verdict -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
def test_no_planner_finds_a_path_through_certified_cells_or_against_a_proof(seed: int) -> None:
    scene, rng = a_scene(1000 + seed)
    motions = CollisionChecker(scene)
    free = [q for q in somewhere(scene, rng, 60) if motions.is_free(q)]
    for a, b in zip(free[:4:2], free[1:4:2], strict=True):
        result = rp.RrtConnect().plan(rp.Problem(scene, a, b), budget=rp.Budget(iterations=400), rng=0)
        if result.path is None:
            continue
        cells = decompose(scene, "arm", a, [rp.JointGoal(b)], [b])
        assert cells is not None
        assert not cells.proves_no_path
        dense = np.concatenate([np.linspace(p, q, 200) for p, q in pairwise(result.path.waypoints)])
        index = np.floor((dense - cells.lower) / (cells.upper - cells.lower) * cells.resolution).astype(int)
        n = cells.resolution
        i, j = (np.where(closes, k % n, k.clip(0, n - 1)) for closes, k in zip(cells.periodic, index.T, strict=True))
        assert not cells.full[i, j].any()


@pytest.mark.parametrize("seed", range(8))
def test_every_cell_of_the_picture_agrees_with_coal_for_mimic_joints_and_padding(seed: int) -> None:
    scene, _ = a_scene(2000 + seed)
    grid, checker = compute_grid(scene, resolution=20), CollisionChecker(scene)
    for i, first in enumerate(grid.axes[0]):
        for j, second in enumerate(grid.axes[1]):
            assert grid.free[i, j] == (checker.is_free([first, second]) and checker.within_limits([first, second]))


@pytest.mark.parametrize("play", [0.008, 0.003])
def test_a_slit_narrower_than_a_cell_is_no_proof(play: float) -> None:
    problem = before_a_wall(play)
    picture = rp.cspace(problem.scene, problem, resolution=60)
    assert not any(picture.reachable_goals)
    assert not picture.proves_no_path
    said = verdict(picture)
    assert said.startswith("Open: this grid of 60 × 60 cells does not join start and goal, but that is no proof")
    assert picture.decomposition is not None
    assert f"refined to a grid of {picture.decomposition.resolution} × " in said
    assert "No path exists" not in str(picture)


def test_a_path_that_was_found_is_never_contradicted() -> None:
    problem = before_a_wall(0.008)
    result = rp.plan(problem, rng=0)
    assert result.found
    picture = rp.cspace(problem.scene, problem, result=result, resolution=60)
    assert not picture.proves_no_path
    assert picture.reachable_goals == (True,)
    said = verdict(picture)
    assert said.startswith("Start and goal lie in the same component of free space; ")
    assert "a gap too narrow for this grid of 60 × 60 cells" in said


def test_a_path_counts_as_an_answer_only_if_it_is_one() -> None:
    """A result of another query or scene, or one constructed by hand, proves nothing."""
    problem = before_a_wall(-0.01)
    empty = rp.Scene().with_arm("arm", gantry())
    elsewhere = rp.plan(rp.Problem(empty, problem.start, [0.8, 0.5]), rng=0)
    shorter = rp.plan(rp.Problem(problem.scene, problem.start, [-0.5, 0.5]), rng=0)
    later = rp.plan(rp.Problem(problem.scene, [0.5, 0.5], [0.8, 0.5]), rng=0)
    for result, why in (
        (elsewhere, "it is not free"),
        (shorter, "it does not end at a goal"),
        (later, "it does not begin at the start"),
    ):
        assert result.found
        picture = rp.cspace(problem.scene, problem, result=result, resolution=24)
        assert not picture.found
        assert picture.proves_no_path
        assert picture.reachable_goals == (False,)
        assert verdict(picture).startswith("No path exists")
        assert verdict(picture).endswith(f"The path does not answer the query: {why}.")
    around = np.array([[-0.8, -0.5], [-0.8, 1.6], [0.8, 1.6], [0.8, 0.5]])
    wall = empty.with_obstacle("wall", rp.Box((0.1, 2.4, 0.2)))
    beyond = rp.cspace(wall, rp.Problem(wall, around[0], around[-1]), resolution=24)
    assert replace(beyond, path=around).path_fault == "it leaves the joint limits"
    assert replace(beyond, path=around).proves_no_path


@pytest.mark.parametrize("planner", ["rrt_connect", "anytime", "roadmap", "bit_star"])
def test_the_answers_of_planners_count(planner: str) -> None:
    """Joint goals, whole turns more, poses with a tolerance, several at once."""
    problem = load_problems("planar2r_path")["over_the_seam"]
    where = replace(load_problems("planar2r_path")["to_a_point"].goal["arm"][0], position_tolerance=0.05)
    for goal in (problem.goal["arm"], [2.55 + 2.0 * np.pi, -0.5], where, [where, [2.55, -0.5]]):
        question = rp.Problem(problem.scene, problem.start, goal)
        result = rp.plan(question, planner=planner, budget=rp.Budget(seconds=5.0, iterations=300), rng=0)
        assert result.found
        assert rp.cspace(question.scene, question, result=result, resolution=24).path_fault == ""


def test_a_ball_wider_than_its_slit_by_two_millimeters_is_proven_not_to_pass() -> None:
    """Only cells around the slit are refined, because most others are seen to be free."""
    picture = rp.cspace(before_a_wall(-0.002).scene, before_a_wall(-0.002), resolution=24)
    assert picture.proves_no_path


def test_a_closed_wall_is_a_proof_at_any_resolution() -> None:
    problem = before_a_wall(-0.01)
    for resolution in (8, 60):
        picture = rp.cspace(problem.scene, problem, resolution=resolution)
        assert picture.proves_no_path
        assert verdict(picture).startswith("No path exists: start and goal are free")
    # A thin one that the centers of all cells miss.
    scene = rp.Scene().with_arm("arm", gantry()).with_obstacle("sheet", rp.Box((0.001, 3.0, 0.2)), [0.02, 0, 0])
    thin = rp.cspace(scene, rp.Problem(scene, [-0.8, 0.0], [0.8, 0.0]), resolution=8)
    assert any(thin.reachable_goals)
    assert thin.proves_no_path
    assert thin.grid.components == 1


def test_the_lesson_without_a_path_is_still_proven() -> None:
    problem = load_problems("planar2r_no_path")["no_way"]
    picture = rp.cspace(problem.scene, problem, resolution=48)
    assert picture.proves_no_path
    cells = picture.decomposition
    assert cells is not None
    assert not (cells.reached & (cells.full | cells.goal)).any()
    assert re.search(r"proven by certified cells on a grid of \d+ × \d+\.", verdict(picture))
    same = load_problems("planar2r_no_path")["same_side"]
    assert not rp.cspace(same.scene, same, resolution=48).proves_no_path


# ---- goals -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hopeless() -> rp.Problem:
    return load_problems("planar2r_no_path")["no_way"]


def asked(problem: rp.Problem, goal: Any) -> rp.CSpace:
    return rp.cspace(problem.scene, rp.Problem(problem.scene, problem.start, goal), resolution=48)


def test_a_joint_goal_is_that_configuration_alone(hopeless: rp.Problem) -> None:
    """Its other elbow is in the start's component, which says nothing about the goal."""
    picture = asked(hopeless, [1.804, -1.638])
    (goal,) = picture.goals
    np.testing.assert_allclose(goal, [1.804, -1.638])
    assert picture.goal_names == ("goal",)
    assert picture.proves_no_path
    assert "goal (+1.804, -1.638): cut off from the start" in str(picture)
    elbow = asked(hopeless, rp.PoseGoal("tool", tool_at(hopeless, goal)))
    assert not elbow.proves_no_path
    assert sorted(elbow.reachable_goals) == [False, True]


@pytest.mark.parametrize("limits", [(-3.1, 3.1), (-6.0, 6.0)])
def test_with_limits_beyond_a_turn_a_goal_a_turn_away_is_another_one(limits: tuple[float, float]) -> None:
    """The first link cannot pass the wall; at 2.2 - 2 pi the arm would be in the start's component."""
    arm = rp.planar_arm("RR", lengths=(1.0, 0.7), limits=[limits, (-3.1, 3.1)])
    wall = rp.polygon_prism([(0.6, 0.4), (1.2, 0.4), (1.2, 0.6), (0.6, 0.6)])
    scene = rp.Scene(name="a wall").with_arm("arm", arm).with_obstacle("wall", wall)
    problem = rp.Problem(scene, [-1.0, 0.0], [2.2, 0.5])
    picture = rp.cspace(scene, problem, resolution=48)
    assert rp.plan(problem, rng=0).status is rp.PlanStatus.INFEASIBLE
    assert picture.proves_no_path, picture.verdict
    if limits[0] < 2.2 - 2.0 * np.pi:
        either = rp.cspace(scene, rp.Problem(scene, [-1.0, 0.0], [2.2 - 2.0 * np.pi, 0.5]), resolution=48)
        assert either.reachable_goals == (True,)


def tool_at(problem: rp.Problem, q: np.ndarray) -> np.ndarray:
    return problem.scene.link_poses({"arm": q})["arm/tool"][:3, 3]


def test_solutions_of_a_position_goal_are_marked_as_such(hopeless: rp.Problem) -> None:
    reachable, out_of_reach = rp.PoseGoal("tool", [1.2, -0.5, 0.0]), rp.PoseGoal("tool", [3.0, 0.0, 0.0])
    picture = asked(hopeless, [reachable, [2.1, -0.4]])
    assert picture.goal_names == ("goal 1, IK 1", "goal 1, IK 2", "goal 2")
    for q in picture.goals[:2]:
        np.testing.assert_allclose(tool_at(hopeless, q), reachable.position, atol=2e-4)
    some = asked(hopeless, [out_of_reach, reachable])
    assert not some.proves_no_path
    assert some.goal_names == ("goal 2, IK 1", "goal 2, IK 2")
    assert "Goal 1: the goal is out of reach of arm/tool" in str(some)


def test_a_goal_out_of_reach_is_named_and_proven(hopeless: rp.Problem) -> None:
    for goal in (rp.PoseGoal("tool", [3, 0, 0]), rp.RegionGoal("tool", [1.8, -1, -1], [2, 1, 1])):
        picture = asked(hopeless, goal)
        assert picture.goals == ()
        assert picture.proves_no_path
        assert verdict(picture).startswith("No path exists: no configuration reaches the goal, proven")
        assert "out of reach of arm/tool" in str(picture)
    turned = rp.PoseGoal("tool", [1.2, -0.5, 0.0], rp.transforms.quaternion_from_rotation(np.diag([1.0, -1.0, -1.0])))
    assert asked(hopeless, turned).proves_no_path


def test_a_blocked_goal_and_a_blocked_start_are_judged_by_themselves_not_by_their_cell() -> None:
    problem = before_a_wall(0.008)
    scene = problem.scene
    in_slit, in_wall = [0.0, 0.3], [0.0, 0.0]
    picture = rp.cspace(scene, rp.Problem(scene, in_slit, [-0.8, -0.5]), resolution=8)
    assert picture.start_blocked_by == ()
    assert not picture.proves_no_path
    blocked = rp.cspace(scene, rp.Problem(scene, in_slit, in_wall), resolution=8)
    assert blocked.goals_blocked_by == (("below",),)
    assert verdict(blocked) == "No path exists: no configuration that reaches the goal is free."
    assert verdict(CSpace(blocked.grid, np.array(in_wall), (np.array(in_slit),))) == "The start is not free: below."


def test_a_goal_outside_the_picture_is_not_free_and_the_picture_is_drawn(tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r_limited"))
    picture = rp.cspace(scene, rp.Problem(scene, [0.0, 0.0], [7.0, 1.0]), resolution=24)
    assert picture.goals_blocked_by == (("joint limits",),)
    assert "goal (+7.000, +1.000): not free (joint limits)" in str(picture)
    assert "No path exists: no configuration that reaches the goal is free" in picture.verdict
    for name in ("a.png", "a.html"):
        assert picture.save(tmp_path / name).stat().st_size > 5_000


def test_two_arms_are_told_apart_and_what_one_holds_is_part_of_it() -> None:
    scene = load_problems("planar2r_path")["over_the_seam"].scene.without_obstacle("violet")
    scene = scene.with_arm("other", rp.load_robot("planar2r"), pose([1.2, -1.6, 0.0], rpy=[0, 0, np.pi / 2]))
    scene = scene.with_obstacle("ball", rp.Sphere(0.05), [3.0, 3.0, 0.0]).attach("ball", "other", pose=[0.1, 0, 0])
    grid, checker = compute_grid(scene, "arm", resolution=40), CollisionChecker(scene, ("arm",))
    assert list(grid.layers) == ["other", *(n for n in grid.layers if n in scene.obstacles)]
    assert grid.layers["other"].any()
    for i, j in np.ndindex(grid.free.shape):
        assert grid.free[i, j] == checker.is_free([grid.axes[0][i], grid.axes[1][j]])
    cells = ContactCells(checker, np.zeros(2), (0, 1))
    rng = np.random.default_rng(0)
    centers, half = rng.uniform(-np.pi, np.pi, (800, 2)), np.array([0.01, 0.02])
    blocked, _ = cells.classify(centers, half, np.ones((800, cells.pairs), dtype=bool))
    inside = (centers + rng.uniform(-1.0, 1.0, centers.shape) * half)[blocked]
    assert len(inside) > 100
    assert not any(checker.is_free(q) for q in inside)


def test_a_picture_is_one_line_in_a_list(hopeless: rp.Problem) -> None:
    picture = rp.cspace(hopeless.scene, hopeless, resolution=24)
    assert repr(picture) == "CSpace('planar2r_no_path', joint1 x joint2, 24 x 24 cells, 1 goal)"
    assert "\n" not in repr(picture.grid)
    assert len(repr(picture.grid)) < 120
    assert picture.decomposition is not None
    assert len(repr(picture.decomposition)) < 200
