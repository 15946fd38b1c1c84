"""The configuration space: every cell agrees with Coal, components wrap around the torus, pictures are written."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import rr1plan as rp
from rr1plan import CSpace
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.playback.cspace.cspace_cells import label_components, widest_spot
from rr1plan.playback.cspace.cspace_colors import HATCHES, pattern_cells
from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid, compute_grid, name_spots
from rr1plan.playback.cspace.cspace_raster import SELF
from rr1plan.playback.cspace.cspace_torus import layer_image, wrapped_pieces
from rr1plan.playback.outlines import silhouette
from rr1plan.scene.model_library import load_problems


@pytest.fixture(scope="module")
def lesson() -> rp.Scene:
    return rp.load_scene("planar2r_path")


@pytest.fixture(scope="module")
def question() -> rp.Problem:
    return next(iter(load_problems("planar2r_path").values()))


@pytest.fixture(scope="module")
def hopeless() -> rp.Problem:
    return next(iter(load_problems("planar2r_no_path").values()))


def test_goals_are_those_of_the_scene_whose_cells_are_drawn(lesson: rp.Scene) -> None:
    arm = lesson.arms["arm"]
    moved = lesson.with_arm("arm", arm.robot, [-0.1, 0.0, 0.0])
    problem = load_problems("planar2r_path")["to_a_point"].with_margin(0.001)
    picture = rp.cspace(moved, problem, resolution=24)
    tools = [rp.Kinematics(moved).pose(q, arm.robot.tool)[:3, 3] for q in picture.goals]
    assert len(tools) == 2
    np.testing.assert_allclose(tools, [problem.goal["arm"][0].position] * 2, atol=1e-3)
    np.testing.assert_array_equal(picture.start, problem.start)


@pytest.mark.parametrize("name", ["planar2r_path", "planar2r_no_path"])
def test_every_cell_of_360_by_360_agrees_with_coal(name: str) -> None:
    """Each cell against Coal on two capsules and the scene's cylinders, built here and checked one by one."""
    scene = rp.load_scene(name)
    grid = compute_grid(scene, resolution=360)
    arm, geometry = _two_bars(scene)
    data, scratch = arm.createData(), geometry.createData()
    for request in scratch.collisionRequests:
        request.enable_contact = True  # without it Coal misses capsules whose core grazes a surface
    for i, first in enumerate(grid.axes[0]):
        for j, second in enumerate(grid.axes[1]):
            touching = pin.computeCollisions(arm, data, geometry, scratch, np.array([first, second]), True)
            assert grid.free[i, j] == (not touching), (first, second)


def _two_bars(scene: rp.Scene) -> tuple[pin.Model, pin.GeometryModel]:
    """The planar arm from the numbers of its description, and round obstacles, as Pinocchio's own models."""
    arm, geometry = pin.Model(), pin.GeometryModel()
    first = arm.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "first")
    second = arm.addJoint(first, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0])), "second")
    along_x = pin.utils.rotate("y", np.pi / 2)
    for joint, length in ((first, 1.0), (second, 0.7)):
        middle = pin.SE3(along_x, np.array([length / 2, 0.0, 0.0]))
        geometry.addGeometryObject(pin.GeometryObject(f"bar {joint}", joint, middle, coal.Capsule(0.04, length)))
    for name, obstacle in scene.obstacles.items():
        (only,) = obstacle.geometries
        assert isinstance(only.shape, rp.Cylinder)
        solid = coal.Cylinder(only.shape.radius, only.shape.length)
        geometry.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3(obstacle.pose @ only.pose), solid))
        for bar in (0, 1):
            geometry.addCollisionPair(pin.CollisionPair(bar, geometry.ngeoms - 1))
    return arm, geometry


def test_every_layer_is_the_image_of_its_own_obstacle(lesson: rp.Scene) -> None:
    grid = compute_grid(lesson, resolution=60)
    for name in lesson.obstacles:
        alone = lesson
        for other in lesson.obstacles:
            if other != name:
                alone = alone.without_obstacle(other)
        checker = CollisionChecker(alone)
        for i, first in enumerate(grid.axes[0]):
            for j, second in enumerate(grid.axes[1]):
                touched = any(name in (c.a, c.b) for c in checker.contacts(np.array([first, second])))
                assert grid.layers[name][i, j] == touched


def test_a_path_scene_has_a_path_and_the_other_proves_that_none_exists(
    question: rp.Problem, hopeless: rp.Problem
) -> None:
    solvable = rp.cspace(question.scene, question, resolution=180)
    assert any(solvable.reachable_goals)
    assert not solvable.proves_no_path
    cut_off = rp.cspace(hopeless.scene, hopeless, resolution=180)
    assert cut_off.proves_no_path
    assert cut_off.grid.component_of(cut_off.start) > 0
    assert any(cut_off.grid.component_of(goal) > 0 for goal in cut_off.goals)
    assert "No path exists" in str(cut_off)
    assert cut_off.grid.shortest_path(cut_off.start, cut_off.goals[0]) is None


def test_both_elbow_solutions_put_the_tool_in_the_same_place(question: rp.Problem) -> None:
    robot = question.scene.arms[question.arms[0]].robot
    tip = robot.link_poses(question.goal["arm"][0].q)[robot.tool][:3, 3]
    problem = rp.Problem(question.scene, question.start, rp.PoseGoal("tool", tip))
    picture = rp.cspace(question.scene, problem, resolution=24)
    assert len(picture.goals) == 2
    tips = [robot.link_poses(q)[robot.tool][:3, 3] for q in picture.goals]
    np.testing.assert_allclose(tips[0], tips[1], atol=2e-4)
    assert np.abs(picture.goals[0] - picture.goals[1]).max() > 0.1


def test_the_grid_path_is_free_and_steps_to_neighbors(question: rp.Problem) -> None:
    picture = rp.cspace(question.scene, question, resolution=120)
    goal = next(g for g, ok in zip(picture.goals, picture.reachable_goals, strict=True) if ok)
    path = picture.grid.shortest_path(picture.start, goal)
    assert path is not None
    step = 2 * np.pi / 120
    assert np.abs(np.diff(path, axis=0)).max() <= step * (1 + 1e-9)
    assert all(picture.grid.component_of(q) > 0 for q in path)
    assert picture.grid.cell(path[0]) == picture.grid.cell(picture.start)
    assert picture.grid.cell(path[-1]) == picture.grid.cell(goal)


@settings(deadline=None, max_examples=60)
@given(arrays(bool, (7, 9)), st.booleans(), st.booleans())
def test_components_are_those_of_a_flood_fill_on_the_torus(free: np.ndarray, closes_i: bool, closes_j: bool) -> None:
    labels = label_components(free, (closes_i, closes_j))
    assert ((labels > 0) == free).all()
    for i in range(7):
        for j in range(9):
            if free[i, j]:
                assert (_flood(free, (closes_i, closes_j), (i, j)) == (labels == labels[i, j])).all()


@settings(deadline=None, max_examples=60)
@given(arrays(bool, (7, 9)), st.booleans(), st.booleans())
def test_the_widest_spot_is_as_far_from_the_outside_as_can_be(mask: np.ndarray, closes_i: bool, closes_j: bool) -> None:
    def distance(i: int, j: int) -> float:
        ways = [
            np.hypot(i - a, j - b)
            for a in range(-7 if closes_i else -1, 14 if closes_i else 8)
            for b in range(-9 if closes_j else -1, 18 if closes_j else 10)
            if not ((closes_i or 0 <= a < 7) and (closes_j or 0 <= b < 9) and mask[a % 7, b % 9])
        ]
        return float(min(ways, default=np.inf))

    i, j, far = widest_spot(mask, (closes_i, closes_j))
    if not mask.any():
        assert far == 0.0
    elif not mask.all():
        assert far == pytest.approx(distance(i, j))
        assert far == pytest.approx(max(distance(a, b) for a, b in np.argwhere(mask).tolist()))


def test_names_stand_on_the_image_they_name_and_not_at_the_rim(lesson: rp.Scene) -> None:
    grid = compute_grid(lesson, resolution=90)
    spots = name_spots(grid)
    assert set(spots) == set(lesson.obstacles)
    for name, spot in spots.items():
        assert abs(spot[0]) < 0.9 * np.pi
        assert [layer for layer, mask in grid.layers.items() if mask[grid.cell(spot)]] == [name]


def _flood(free: np.ndarray, periodic: tuple[bool, bool], seed: tuple[int, int]) -> np.ndarray:
    seen = np.zeros(free.shape, dtype=bool)
    stack = [seed]
    while stack:
        i, j = stack.pop()
        if seen[i, j]:
            continue
        seen[i, j] = True
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            a, b = i + di, j + dj
            if (0 <= a < free.shape[0] or periodic[0]) and (0 <= b < free.shape[1] or periodic[1]):
                a, b = a % free.shape[0], b % free.shape[1]
                if free[a, b]:
                    stack.append((a, b))
    return seen


def test_the_ranges_of_a_grid_are_those_of_its_joints() -> None:
    arm = rp.planar_arm("RP", (0.5, 0.4), limits=[(-1.0, 0.5), (0.1, 0.3)])
    limited = compute_grid(rp.Scene().with_arm("arm", arm), resolution=16)
    np.testing.assert_allclose(limited.ranges, [(-1.0, 0.5), (0.1, 0.3)], rtol=0.0, atol=1e-15)
    whole = compute_grid(rp.Scene().with_arm("arm", rp.planar_arm("RR")), resolution=16)
    np.testing.assert_allclose(whole.ranges, [(-np.pi, np.pi)] * 2, rtol=0.0, atol=1e-15)


def test_limits_have_a_layer_of_their_own_and_close_the_seam() -> None:
    scene = rp.Scene(arms={"arm": rp.Arm(rp.load_robot("planar2r_limited"))})
    grid = compute_grid(scene, resolution=72)
    limits = scene.limits()
    assert grid.periodic == (False, False)
    if LIMITS in grid.layers:
        inside = [(a >= lo) & (a <= hi) for a, lo, hi in zip(grid.axes, limits.lower, limits.upper, strict=True)]
        assert (grid.layers[LIMITS] == ~(inside[0][:, None] & inside[1][None, :])).all()


def test_self_collision_and_two_of_six_joints_are_shown(rr1_table: rp.Scene) -> None:
    grid = compute_grid(rr1_table, joints=("elbow_joint", "forearm_joint"), resolution=40)
    assert grid.layers[SELF].any()
    assert grid.layers[LIMITS].any()
    checker = CollisionChecker(rr1_table)
    q = rr1_table.configuration()
    names = rr1_table.arms[grid.arm].robot.joint_names
    rng = np.random.default_rng(0)
    for _ in range(200):
        i, j = rng.integers(0, 40, 2)
        q[names.index("elbow_joint")] = grid.axes[0][i]
        q[names.index("forearm_joint")] = grid.axes[1][j]
        assert checker.is_free(q) == (not any(m[i, j] for n, m in grid.layers.items() if n != LIMITS))


def test_a_configuration_of_all_joints_is_no_place_in_a_slice(rr1_table: rp.Scene) -> None:
    """It used to count as not free, and as a start without a path."""
    grid = rp.cspace(rr1_table, joints=("shoulder_joint", "elbow_joint"), resolution=16).grid
    home = rr1_table.configuration()
    assert grid.component_of(home[[0, 2]]) > 0
    with pytest.raises(rp.InputError, match=r"q has shape \(6,\), expected \(2,\)"):
        grid.component_of(home)
    with pytest.raises(rp.InputError, match=r"q has shape \(6,\), expected \(2,\)"):
        grid.shortest_path(home, home)


def test_patterns_differ_and_leave_most_of_the_color() -> None:
    inked = [pattern_cells(k, (120, 120)) for k in range(len(HATCHES))]
    assert not inked[0].any()
    assert all(0.05 < cells.mean() < 0.4 for cells in inked[1:])
    assert all((a != b).mean() > 0.05 for a, b in combinations(inked, 2))


def test_overlaps_show_both_colors(lesson: rp.Scene) -> None:
    scene = lesson
    name = next(iter(scene.obstacles))
    thing = scene.obstacles[name]
    scene = scene.with_obstacle("twin", thing.geometries[0].shape, thing.pose, color=(0.0, 0.0, 0.0, 1.0))
    grid = compute_grid(scene, resolution=60)
    both = grid.layers[name] & grid.layers["twin"]
    assert both.any()
    shown = {tuple(c) for c in _pixels_of_cells(grid)[both].reshape(-1, 3)}
    assert len(shown) >= 2


def test_patterns_are_finer_than_the_cells_of_a_coarse_grid(lesson: rp.Scene) -> None:
    grid = compute_grid(lesson, resolution=24)
    pixels = _pixels_of_cells(grid)
    assert (pixels[grid.free] == 1.0).all()
    inked = [len({tuple(c) for c in cell.reshape(-1, 3)}) > 1 for cell in pixels[~grid.free]]
    assert np.mean(inked) > 0.5


def _pixels_of_cells(grid: CSpaceGrid) -> NDArray[np.float64]:
    """The pixels of each cell, shape (n, m, k, k, 3)."""
    n, m = grid.free.shape
    image = layer_image(grid).transpose(1, 0, 2)
    return image.reshape(n, len(image) // n, m, -1, 3).swapaxes(1, 2)


def test_a_line_over_the_seam_is_drawn_in_pieces_inside_the_picture(lesson: rp.Scene) -> None:
    grid = compute_grid(lesson, resolution=24)
    pieces = wrapped_pieces(np.array([[3.0, 0.0], [3.5, 0.5]]), grid)
    assert len(pieces) == 2
    assert all((np.abs(piece) <= np.pi + 1e-9).all() for piece in pieces)


def test_png_and_svg_are_written_and_repeat_to_the_byte(question: rp.Problem, tmp_path: Path) -> None:
    result = rp.plan(question, rng=0)
    picture = rp.cspace(question.scene, question, result=result, resolution=60)
    png = picture.save_png(tmp_path / "a.png", dpi=60)
    assert png.read_bytes().startswith(b"\x89PNG")
    first = picture.save_svg(tmp_path / "a.svg").read_bytes()
    assert first == picture.save_svg(tmp_path / "b.svg").read_bytes()
    assert ET.fromstring(first).tag.endswith("svg")
    assert b"<!-- configuration space -->" in first
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "a.svg", "b.svg"]


@pytest.mark.parametrize("bound", [np.pi, 7.0, 30.0])
def test_ticks_are_few_multiples_of_pi_with_minus_signs(bound: float) -> None:
    arm = rp.planar_arm("RR", limits=[(-bound, bound), (-1.0, 1.0)])
    figure = rp.cspace(rp.Scene().with_arm("arm", arm), resolution=8).figure()
    axis = next(axes for axes in figure.axes if "joint1" in axes.get_xlabel()).xaxis
    values, labels = axis.get_ticklocs(), [label.get_text() for label in axis.get_ticklabels()]
    assert 3 <= len(values) <= 11
    for value, label in zip(values, labels, strict=True):
        assert "-" not in label
        halves = {"0": "0π", "π": "1π", "−π": "-1π", "π/2": "0.5π", "−π/2": "-0.5π"}.get(label, label)
        assert float(halves.replace("−", "-").removesuffix("π")) * np.pi == pytest.approx(value)


def test_the_name_of_a_file_says_its_format(lesson: rp.Scene, tmp_path: Path) -> None:
    picture = rp.cspace(lesson, resolution=24)
    for name, begin in (("a.png", b"\x89PNG"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF"), ("a.html", b"<!doctype")):
        assert picture.save(tmp_path / name).read_bytes()[: len(begin)].lower() == begin.lower()
    assert picture.save_pdf(tmp_path / "b.pdf").read_bytes() == (tmp_path / "a.pdf").read_bytes()
    with pytest.raises(InputError, match=r"a\.jpg', expected a name that ends in \.png or \.svg or \.pdf or \.html"):
        picture.save(tmp_path / "a.jpg")
    with pytest.raises(InputError, match=r"a\.jpg', expected a name that ends in \.png"):
        picture.save_png(tmp_path / "a.jpg")
    assert not (tmp_path / "a.jpg").exists()


def test_a_huge_tree_makes_no_huge_files(question: rp.Problem, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    vertices = rng.uniform(-np.pi, np.pi, (40_000, 2))
    vertices[0] = question.start
    parents = (rng.random(39_999) * np.arange(1, 40_000)).astype(int)
    tree = rp.planning.SearchTree(vertices, np.column_stack([parents, np.arange(1, 40_000)]))
    picture = CSpace(compute_grid(question.scene, resolution=24), question.start, (), None, tree)
    assert picture.save_svg(tmp_path / "a.svg").stat().st_size < 3_000_000
    plain = CSpace(picture.grid, question.start).save_html(tmp_path / "b.html").stat().st_size
    assert picture.save_html(tmp_path / "a.html").stat().st_size - plain < 300_000
    assert "tree of the start, thinned" in (tmp_path / "a.svg").read_text()


def test_a_slice_is_where_it_is_asked_for(rr1_table: rp.Scene) -> None:
    joints = ("shoulder_joint", "elbow_joint")
    q = np.array(rr1_table.configuration())
    q[2:] += 0.3
    given = rp.cspace(rr1_table, joints=joints, at=q, resolution=24)
    stands = rp.cspace(rr1_table.with_configuration("rr1", q), joints=joints, resolution=24)
    here = rp.cspace(rr1_table, joints=joints, resolution=24)
    assert np.array_equal(given.grid.labels, stands.grid.labels)
    assert not np.array_equal(given.grid.labels, here.grid.labels)
    assert str(given) == str(stands) != str(here)
    zero = rp.cspace(rr1_table, joints=joints, at="zero", resolution=24)
    assert "a slice, at upper_arm_joint = 0, forearm_joint = 0, wrist_joint = 0, hand_joint = 0" in str(zero)
    q[3] = -0.25
    title = rp.cspace(rr1_table, joints=joints, at=q, resolution=24).figure().get_suptitle().replace("\n", " ")
    assert "a slice, at upper_arm_joint = 0, forearm_joint = −0.25, wrist_joint = 0.8, hand_joint = 0.3 (" in title
    q[3] = 0.3
    # Values of the two joints themselves are ignored, even beyond their limits.
    q[[0, list(rr1_table.arms["rr1"].robot.joint_names).index("elbow_joint")]] = 9.0
    assert np.array_equal(rp.cspace(rr1_table, joints=joints, at=q, resolution=24).grid.labels, given.grid.labels)


def test_a_slice_that_is_nowhere_is_refused(lesson: rp.Scene, rr1_table: rp.Scene) -> None:
    with pytest.raises(InputError, match="option at has no effect: arm 'arm' has no joints but joint1 and joint2"):
        rp.cspace(lesson, at=[0.0, 0.0], resolution=8)
    with pytest.raises(UnknownNameError, match="configuration 'hom'"):
        rp.cspace(rr1_table, at="hom", resolution=8)
    with pytest.raises(InputError, match="option at has 2 numbers, expected 6"):
        rp.cspace(rr1_table, at=[0.0, 0.0], resolution=8)
    with pytest.raises(InputError, match="option at has joint 'hand_joint' at 100, expected -"):
        rp.cspace(rr1_table, at=[0, 0, 0, 0, 0, 100.0], resolution=8)


def test_progress_moves_on_evenly_and_ends_below_one(rr1_table: rp.Scene) -> None:
    told: list[float] = []
    joints = ("shoulder_joint", "elbow_joint")
    rp.cspace(rr1_table, joints=joints, resolution=64, progress=lambda progress: told.append(progress.fraction))
    with pytest.raises(rp.CancelledError, match="'cspace'"):
        rp.cspace(rr1_table, joints=joints, resolution=64, progress=lambda _: False)
    assert len(told) > 10
    assert told == sorted(told)
    assert 0.5 < told[-1] <= 1.0
    assert np.diff(told).max() < 0.35


def test_bad_arguments_are_named(lesson: rp.Scene, rr1_table: rp.Scene) -> None:
    with pytest.raises(InputError, match="resolution is 4"):
        rp.cspace(lesson, resolution=4)
    with pytest.raises(UnknownNameError, match="joint 'elbow'"):
        rp.cspace(rr1_table, joints=("elbow", "hand_joint"), resolution=8)
    with pytest.raises(InputError, match="two different ones"):
        rp.cspace(rr1_table, joints=("hand_joint", "hand_joint"), resolution=8)
    with pytest.raises(InputError, match="moves 6 joints of 1 arm"):
        rp.cspace(rr1_table, rp.Problem(rr1_table, None, "home"), resolution=8)
    grid = compute_grid(rp.Scene(arms={"arm": rp.Arm(rp.load_robot("planar2r_limited"))}), resolution=8)
    with pytest.raises(InputError, match="outside the picture"):
        grid.cell([10.0, 0.0])


@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_paths_of_small_arms_have_their_corners(size: float) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (size, size)), q=(0.0, 0.0))
    (piece,) = wrapped_pieces(size * np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9]]), compute_grid(scene, resolution=8))
    assert np.linalg.norm(piece - [0.9 * size, 0.1 * size], axis=1).min() < 2e-3 * size


@pytest.mark.parametrize("travel", [0.1, 0.3, 0.7, 1.1, 1.3])
def test_a_joint_at_its_limit_is_inside_the_picture(travel: float) -> None:
    robot = rp.planar_arm("PP", (travel, 0.8), limits=[(0.0, travel), (-0.37 * travel, 0.8)])
    grid = compute_grid(rp.Scene().with_arm("arm", robot, q=robot.limits.upper), resolution=25)
    assert grid.cell(robot.limits.lower) == (0, 0)
    assert grid.cell(robot.limits.upper) == (24, 24)
    for beyond in (robot.limits.lower - 1e-6, robot.limits.upper + 1e-6):
        assert not grid.holds(beyond)


@settings(deadline=None, max_examples=30)
@given(st.floats(0.01, 1.0), st.floats(0.01, 1.0), st.floats(-3, 3), st.floats(-3, 3))
def test_a_shadow_holds_every_sampled_point_of_its_shape(a: float, b: float, roll: float, yaw: float) -> None:
    from rr1plan.transforms import pose

    T = pose([0.1, -0.2, 0.3], rpy=[roll, 0.4, yaw])
    rng = np.random.default_rng(0)
    for shape in (rp.Box((a, b, a)), rp.Cylinder(a, b), rp.Capsule(a, b), rp.Sphere(a)):
        points = _inside(shape, rng)
        flat = (points @ T[:3, :3].T + T[:3, 3])[:, :2]
        corners = silhouette(shape, T)
        edges = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
        outside = np.einsum("ij,ikj->ik", normals, flat[None] - corners[:, None])
        assert outside.max() <= 0.002 * (a + b), type(shape)


def _inside(shape: rp.Box | rp.Cylinder | rp.Capsule | rp.Sphere, rng: np.random.Generator) -> np.ndarray:
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    match shape:
        case rp.Box():
            return rng.uniform(-0.5, 0.5, (200, 3)) * shape.size
        case rp.Sphere():
            return directions * shape.radius
        case rp.Cylinder():
            ring = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1)[:, None] * shape.radius
            return np.column_stack([ring, rng.uniform(-0.5, 0.5, 200) * shape.length])
    return directions * shape.radius + np.outer(rng.uniform(-0.5, 0.5, 200) * shape.length, [0, 0, 1])


def test_a_depth_that_coal_makes_up_does_not_fill_a_block(lesson: rp.Scene) -> None:
    """At (-pi/2, pi/2) the core of the second link touches the violet cylinder's rim, and Coal may say 1e308 m deep."""
    grid = compute_grid(lesson, resolution=60)
    violet = lesson.obstacles["violet"]
    radius = violet.geometries[0].shape.radius
    first, second = np.meshgrid(*grid.axes, indexing="ij")
    elbow = np.stack([np.cos(first), np.sin(first)], axis=-1)
    tool = elbow + 0.7 * np.stack([np.cos(first + second), np.sin(first + second)], axis=-1)
    gap = np.minimum(_gaps(np.zeros(2), elbow, violet.pose[:2, 3]), _gaps(elbow, tool, violet.pose[:2, 3]))
    assert (grid.layers["violet"] == (gap <= radius + 0.04)).all()


def _gaps(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Distances of a point from segments."""
    along = b - a
    share = np.clip(((point - a) * along).sum(axis=-1) / (along**2).sum(axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(a + share[..., None] * along - point, axis=-1))
