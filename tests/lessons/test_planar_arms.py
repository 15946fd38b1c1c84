"""Planar arms made from a few numbers, their closed kinematics, and obstacles over polygons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.lessons.planar_outlines import view_data
from rr1plan.model.flat_arm import flat_arm

KINDS = ["RR", "RP", "PR", "PP"]
BASES = [
    rp.transforms.identity(),
    rp.transforms.pose([0.3, -0.2, 0.1], rpy=[0.0, 0.0, 0.7]),
    rp.transforms.pose([0.1, 0.4, 0.0], rpy=[np.pi, 0.0, -1.1]),
]


@pytest.mark.parametrize("base", BASES, ids=["origin", "turned", "upside-down"])
@pytest.mark.parametrize("kinds", KINDS)
def test_closed_kinematics_are_those_of_the_robot(kinds: str, base: np.ndarray) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm(kinds, (0.9, 0.7)), base)
    flat = flat_arm(scene.arms["arm"])
    assert flat is not None
    assert flat.kinds == kinds
    kinematics = rp.Kinematics(scene)
    q = np.random.default_rng(1).uniform(-0.9, 0.9, (40, 2))
    tools = np.array([kinematics.pose(one, "tool")[:2, 3] for one in q])
    np.testing.assert_allclose(flat.points(q)[:, 2], tools, atol=1e-12)
    solutions = flat.solutions(tools)
    again = flat.points(solutions)[..., 2, :]
    known = np.isfinite(solutions).all(axis=-1)
    assert known.sum() == (40 if kinds == "PP" else 80)
    np.testing.assert_allclose(again[known], np.broadcast_to(tools[:, None], again.shape)[known], atol=1e-9)
    off = np.nanmin(np.abs(solutions - q[:, None]).max(axis=-1), axis=1)
    assert off.max() < 1e-9


@pytest.mark.parametrize(("kinds", "point"), [("RR", (1.8, 0.0)), ("RR", (0.1, 0.0)), ("PR", (0.2, 0.9))])
def test_points_out_of_reach_have_no_solution(kinds: str, point: tuple[float, float]) -> None:
    flat = flat_arm(rp.Scene().with_arm("arm", rp.planar_arm(kinds, (1.0, 0.7))).arms["arm"])
    assert flat is not None
    assert np.isnan(flat.solutions(point)).all()


def test_both_solutions_on_the_rim_are_one() -> None:
    flat = flat_arm(rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7))).arms["arm"])
    assert flat is not None
    for radius in (1.7, 0.3):
        first, second = flat.solutions((radius * np.cos(0.4), radius * np.sin(0.4)))
        np.testing.assert_allclose(np.exp(1j * first), np.exp(1j * second), atol=1e-4)


def test_other_arms_are_not_flat(rr1_table: rp.Scene) -> None:
    assert flat_arm(rr1_table.arms["rr1"]) is None
    tilted = rp.Scene().with_arm("arm", rp.planar_arm(), rp.transforms.pose([0, 0, 0], rpy=[1.0, 0, 0]))
    assert flat_arm(tilted.arms["arm"]) is None


@pytest.mark.parametrize("kinds", KINDS)
def test_a_planar_arm_plans_among_obstacles(kinds: str) -> None:
    arm = rp.planar_arm(kinds, (1.0, 0.8), width=0.06)
    assert arm.name == f"planar_{kinds.lower()}"
    scene = rp.Scene().with_arm("arm", arm)
    goal = np.array(arm.home)
    goal[0] += 0.3
    scene = scene.with_obstacle("far", rp.Cylinder(0.05, 0.12), (-1.9, -1.9, 0.0))
    motion = rp.plan_motion(rp.Problem(scene, "home", rp.JointGoal(goal)), rng=0)
    assert motion.valid
    assert motion.report.certified
    assert not arm.unchecked_links
    assert not arm.links_of_assumed_mass
    kind_of = {"R": "continuous", "P": "prismatic"}
    assert [arm.joint(name).kind for name in arm.joint_names] == [kind_of[kind] for kind in kinds]


@pytest.mark.parametrize("kinds", KINDS)
def test_an_arm_alone_has_a_page(kinds: str, tmp_path: Path) -> None:
    """If no pair can touch, no pair of solids is checked, and the tables of the page are empty."""
    scene = rp.Scene().with_arm("arm", rp.planar_arm(kinds))
    assert rp.save_html(tmp_path / "a.html", scene).stat().st_size > 100_000
    assert rp.cspace(scene, resolution=16).save_html(tmp_path / "b.html").stat().st_size > 100_000


def test_the_gantry_sees_the_workspace_grown_by_its_rod() -> None:
    """The configuration space of PP is the plane: a disc's image is the disc, wider by the radius of the rod."""
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (1.0, 1.0), width=0.1))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.2, 0.1), (0.5, 0.6, 0.0))
    grid = rp.cspace(scene, resolution=200).grid
    x, y = np.meshgrid(*grid.axes, indexing="ij")
    far = np.hypot(x - 0.5, y - 0.6)
    clear = np.abs(far - 0.25) > 1e-6
    np.testing.assert_array_equal(grid.layers["disc"][clear], far[clear] < 0.25)
    assert grid.layers["disc"].mean() == pytest.approx(np.pi * 0.25**2, rel=0.01)


def test_limits_and_names_are_arguments() -> None:
    arm = rp.planar_arm("RP", (1.0, 0.5), limits=[(-1.0, 1.0), None], name="mine")
    assert arm.name == "mine"
    np.testing.assert_allclose(arm.limits.lower, [-1.0, 0.0])
    np.testing.assert_allclose(arm.limits.upper, [1.0, 0.5])
    assert arm.joint("joint1").kind == "revolute"
    assert ((arm.home >= arm.limits.lower) & (arm.home <= arm.limits.upper)).all()


@pytest.mark.parametrize(
    ("lengths", "width"), [((1.0, 0.8), 0.08), ((5e-3, 4e-3), 4e-4), ((20.0, 14.0), 1.6), ((10.0, 0.5), 0.1)]
)
def test_links_are_as_wide_as_their_lengths_allow(lengths: tuple[float, float], width: float) -> None:
    link = rp.planar_arm("RR", lengths).links[1].collisions[0].shape
    assert isinstance(link, rp.Capsule)
    assert 2.0 * link.radius == pytest.approx(width)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"joints": "RRR"}, "unknown pair of joints 'RRR'"),
        ({"lengths": (1.0, 0.0)}, "length is 0.0"),
        ({"lengths": (1.0,)}, "lengths has 1 number"),
        ({"width": -1.0}, "width is -1.0"),
        ({"limits": [(0.0, 1.0)]}, "limits has 1 entries"),
        ({"limits": (-2.0, 2.0)}, "limits has one such pair for each joint"),
        ({"limits": [(1.0, 0.0), None]}, "limits of joint1 are .* expected a lower and a higher"),
    ],
)
def test_wrong_numbers_are_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        rp.planar_arm(**wrong)


def test_limits_in_degrees_are_told(caplog: pytest.LogCaptureFixture) -> None:
    rp.planar_arm("RP", limits=[(-2.5, 2.5), (-150.0, 150.0)])
    assert not caplog.text
    rp.planar_arm("RR", limits=[(-2.5, 2.5), (-150.0, 150.0)])
    assert "joint2 has limits -150 to 150 rad (angles are in radians: are these degrees?)" in caplog.text


# ---- prisms over polygons ------------------------------------------------------------------------

STAR = [(r * np.cos(a), r * np.sin(a)) for k in range(10) for a in [np.pi * k / 5] for r in [1.0 if k % 2 else 0.4]]
CORNER = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.3), (0.4, 0.3), (0.4, 1.0), (0.0, 1.0)]
COMB = [(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)]


def inside_polygon(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """By the number of edges that a ray to the right crosses."""
    inside = np.zeros(len(points), dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        spans = (y0 > points[:, 1]) != (y1 > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= spans & (points[:, 0] < x0 + (points[:, 1] - y0) * (x1 - x0) / (y1 - y0))
    return inside


@pytest.mark.parametrize("corners", [STAR, CORNER, COMB, STAR[::-1]], ids=["star", "corner", "comb", "clockwise"])
def test_pieces_together_are_the_polygon(corners: list[tuple[float, float]]) -> None:
    pieces = rp.polygon_prism(corners, 0.3)
    assert len(pieces) > 1
    points = np.random.default_rng(0).uniform(np.min(corners, axis=0) - 0.1, np.max(corners, axis=0) + 0.1, (3000, 2))
    hits = np.zeros(len(points), dtype=int)
    for piece in pieces:
        assert isinstance(piece.shape, rp.Mesh)
        assert piece.shape.convex
        np.testing.assert_allclose(np.unique(piece.shape.vertices[:, 2]), [-0.15, 0.15])
        flat = np.unique(piece.shape.vertices[:, :2], axis=0)
        around = flat[np.argsort(np.arctan2(*(flat - flat.mean(axis=0)).T[::-1]))]
        hits += inside_polygon(around, points)
    np.testing.assert_array_equal(hits, inside_polygon(np.array(corners), points).astype(int))


def test_a_convex_polygon_is_one_piece() -> None:
    hexagon = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3]
    (piece,) = rp.polygon_prism(hexagon, color=(1.0, 0.0, 0.0, 1.0))
    assert piece.color == (1.0, 0.0, 0.0, 1.0)
    for repeated in ([*hexagon, hexagon[0]], [*hexagon[:3], hexagon[2], *hexagon[3:]]):
        (same,) = rp.polygon_prism(repeated)
        np.testing.assert_array_equal(same.shape.vertices, piece.shape.vertices)


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([(0, 0), (1, 0)], "2 points"),
        ([(0, 0), (1, 0), (2, 0)], "no area"),
        ([(0, 0), (1, 1), (1, 0), (0, 1.5)], "crosses or touches itself"),
        ([(0, 0), (2, 0), (1, 0), (1, 1)], "crosses or touches itself"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "shape"),
    ],
)
def test_what_is_no_simple_polygon_is_refused(corners: list[tuple[float, ...]], said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        rp.polygon_prism(corners)


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (60.0, -40.0, 0.0)], ids=["origin", "far"])
@pytest.mark.parametrize("kinds", KINDS)
def test_the_view_of_panels_contains_all_that_the_tool_reaches(kinds: str, at: tuple[float, float, float]) -> None:
    robot = rp.planar_arm(kinds, (1.0, 0.8))
    scene = rp.Scene().with_arm("arm", robot, rp.transforms.pose(at))
    arm = flat_arm(scene.arms["arm"])
    assert arm is not None
    low, high = np.array(view_data(scene)["view"])
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    tools = arm.points(np.random.default_rng(3).uniform(lower, upper, (200, 2)))[:, 2]
    assert (low < tools.min(axis=0)).all()
    assert (tools.max(axis=0) < high).all()
    assert (high - low < 4.0).all()
