"""The initial camera of the page: the arms are visible, and a view can be given."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.camera import behind_obstacles, check_view, choose_camera

TURNS = np.linspace(0.0, 2.0 * np.pi, 7, endpoint=False)


def plate(form: str) -> Any:
    """A wall of 0.04 m x 2 m x 1.4 m in several forms."""
    box = rp.Box((0.04, 2.0, 1.4))
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij")).reshape(3, -1).T * box.size
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
        [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    grid = np.stack(np.meshgrid([0.0], np.arange(-1.0, 1.0, 0.04), np.arange(-0.7, 0.7, 0.04)), axis=-1)
    return {"box": box, "mesh": rp.Mesh(corners, faces), "cloud": rp.PointCloud(grid.reshape(-1, 3), 0.04)}[form]


def turned(angle: float, distance: float) -> np.ndarray:
    """A pose at a distance in a direction, its x axis pointing away."""
    xyz = [distance * math.cos(angle), distance * math.sin(angle), 0.7]
    return rp.transforms.pose(xyz, rpy=[0.0, 0.0, angle])


@pytest.mark.parametrize("form", ["box", "mesh", "cloud"])
@pytest.mark.parametrize("angle", TURNS)
def test_an_arm_beside_a_wall_is_looked_at_from_the_free_side(rr1: rp.Robot, form: str, angle: float) -> None:
    shape = plate(form)
    scene = rp.Scene().with_arm("arm", rr1).with_obstacle("wall", shape, turned(angle, 0.9))
    goal = rr1.home.copy()
    goal[0] += 1.0
    motion = rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0]), np.stack([rr1.home, goal - rr1.home])[None])
    view = np.array(choose_camera(scene, motion).direction)
    assert np.linalg.norm(view) == pytest.approx(1.0)
    assert view[2] > 0.3
    # The rays from all links to a camera there pass beside the wall or over it, or lead away from it.
    normal = np.array([math.cos(angle), math.sin(angle), 0.0])
    for t in (0.0, 0.5, 1.0):
        tool = scene.link_poses(scene.split(motion(t)))[f"arm/{rr1.tool}"][:3, 3]
        along = view @ normal
        if along > 1e-9:
            hit = tool + (0.9 - tool @ normal) / along * view
            across = hit @ [-math.sin(angle), math.cos(angle), 0.0]
            assert abs(across) > 0.9 or hit[2] > 1.3


def test_a_panda_behind_a_wall_is_looked_at_from_where_it_is_seen(
    panda_and_wall: tuple[rp.Scene, rp.Trajectory, tuple[float, float, float]],
) -> None:
    scene, motion, before = panda_and_wall
    robot, wall = scene.arms["panda"].robot, scene.obstacles["wall"]
    corners = [
        (T := scene.link_poses(scene.split(motion(t)))[f"panda/{link.name}"] @ g.pose)[:3, 3] + v @ T[:3, :3].T
        for t in (0.0, 0.5, 1.0)
        for link in robot.links
        for g in link.visuals
        for v in g.shape.vertices[::50]
    ]

    def hidden(direction: Any) -> float:
        """The fraction of the arm's surface that the wall hides from a camera in a direction."""
        steps = np.linspace(0.0, 6.0, 600)[:, None] * direction
        at = (np.array(corners)[:, None] + steps - wall.pose[:3, 3]) @ wall.pose[:3, :3]
        return float(inside(wall.geometries[0].shape, at).any(axis=1).mean())

    assert hidden(before) == 1.0
    assert hidden(choose_camera(scene, motion).direction) < 0.05


def test_a_transparent_wall_hides_nothing(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    free = choose_camera(scene).direction
    wall = turned(math.atan2(free[1], free[0]), 0.6)
    assert choose_camera(scene.with_obstacle("wall", plate("box"), wall, color=(0.5, 0.6, 0.7, 0.2))).direction == free
    assert choose_camera(scene.with_obstacle("wall", plate("box"), wall, color=(0.5, 0.6, 0.7, 0.9))).direction != free


def inside(shape: Any, at: np.ndarray) -> np.ndarray:
    """Whether points (..., 3), in the shape's coordinates, are inside it."""
    match shape:
        case rp.Box():
            return (np.abs(at) <= 0.5 * np.array(shape.size)).all(axis=-1)
        case rp.Sphere():
            return np.linalg.norm(at, axis=-1) <= shape.radius
        case rp.Cylinder():
            return (np.hypot(at[..., 0], at[..., 1]) <= shape.radius) & (np.abs(at[..., 2]) <= 0.5 * shape.length)
        case _:
            reach = 0.5 * shape.length
            return np.linalg.norm(at - np.clip(at, [0, 0, -reach], [0, 0, reach]), axis=-1) <= shape.radius


@pytest.mark.parametrize(
    "shape", [rp.Box((0.4, 0.7, 0.2)), rp.Sphere(0.3), rp.Cylinder(0.2, 0.8), rp.Capsule(0.15, 0.6)]
)
def test_hidden_is_what_steps_along_the_ray_find(shape: Any) -> None:
    rng = np.random.default_rng(3)
    T = rp.transforms.pose([0.1, -0.2, 0.3], rpy=[0.4, -0.7, 1.1])
    scene = rp.Scene().with_obstacle("thing", shape, T)
    points, eyes = rng.uniform(-1.0, 1.0, (40, 3)), rng.uniform(-2.0, 2.0, (12, 3))
    found = behind_obstacles(scene, points, eyes)
    steps = np.linspace(0.0, 1.0, 1500)[:, None]
    for eye, row in zip(eyes, found, strict=True):
        for point, hidden in zip(points, row, strict=True):
            ray = (point + steps * (eye - point) - T[:3, 3]) @ T[:3, :3]
            grown = (point + steps * (eye - point) - T[:3, 3]) @ T[:3, :3] * 0.99
            # Between two steps a ray may graze the shape.
            assert hidden if inside(shape, ray).any() else not hidden or inside(shape, grown).any()
    assert 0.05 < found.mean() < 0.7


def test_meshes_and_clouds_hide_nearly_what_a_box_does() -> None:
    rng = np.random.default_rng(4)
    points, eyes = rng.uniform(-0.5, 0.5, (60, 3)), 4.0 * rng.normal(size=(10, 3))
    points[:, 2] += 0.7
    shares = {}
    for form in ("box", "mesh", "cloud"):
        scene = rp.Scene().with_obstacle("wall", plate(form), turned(0.3, 0.6))
        shares[form] = behind_obstacles(scene, points, eyes)
    assert shares["box"].mean() > 0.1
    for form in ("mesh", "cloud"):
        assert (shares[form] != shares["box"]).mean() < 0.03


@pytest.mark.parametrize("scene", [rp.Scene(), rp.Scene().with_obstacle("box", rp.Box((1.0, 1.0, 1.0)))])
def test_scenes_without_arms_have_a_view(scene: rp.Scene) -> None:
    assert np.isfinite(view_document(scene)["camera"]["direction"]).all()


def test_arms_in_a_closed_room_have_a_view(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    for k, angle in enumerate(TURNS):
        scene = scene.with_obstacle(f"wall{k}", plate("box"), turned(angle, 0.8))
    assert choose_camera(scene.with_obstacle("lid", rp.Box((3.0, 3.0, 0.1)), [0.0, 0.0, 1.5])).direction[2] > 0.0


@pytest.mark.parametrize(
    ("view", "direction"),
    [
        ("top", (0.0, 0.0, 1.0)),
        ("right", (1.0, 0.0, 0.0)),
        ("front", (0.0, -1.0, 0.0)),
        ((0.0, 0.0), (1.0, 0.0, 0.0)),
        ((math.pi / 2, 0.0), (0.0, 1.0, 0.0)),
        ((math.pi, math.pi / 6), (-math.sqrt(0.75), 0.0, 0.5)),
        (np.array([0.0, -2.0, 1.0]), (0.0, -2.0, 1.0)),
    ],
)
def test_views_are_names_angles_or_directions(view: Any, direction: Any) -> None:
    assert check_view(view) == pytest.approx(direction, abs=1e-12)
    assert check_view(None) is None


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ("frnt", "front"),
        ((45.0, 30.0), r"\[rad\].*0.785 and 0.524"),
        ((0.0, 2.0), "elevation"),
        ((0.0, 0.0, 0.0), "not zero"),
        ((1.0, float("nan"), 0.0), "view"),
        ([1.0], "view"),
        (3, "view"),
    ],
)
def test_a_view_that_is_none_is_named(view: Any, message: str, rr1: rp.Robot, tmp_path: Any) -> None:
    with pytest.raises(rp.InputError, match=message):
        rp.save_html(tmp_path / "page.html", rp.Scene().with_arm("arm", rr1), options=rp.ViewOptions(view=view))
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize(("name", "things"), [("rr1_pair", ("", "crate_")), ("rr1_bin", ("bin_",))])
def test_what_is_called_left_is_on_the_left(name: str, things: tuple[str, ...]) -> None:
    scene = rp.load_scene(name)
    motions = [rp.plan_motion(problem, rng=0).trajectory for problem in rp.load_problems(name).values()]
    for motion in (None, *motions):
        x, y, _ = choose_camera(scene, motion).direction
        for thing in things:
            left, right = (
                scene.arms[side].base if side in scene.arms else scene.obstacles[f"{thing}{side}"].pose
                for side in ("left", "right")
            )
            assert np.dot((right - left)[:2, 3], [-y, x]) > 0.1
