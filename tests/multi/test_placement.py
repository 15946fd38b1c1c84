"""Placement helpers: positions and headings of arms."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.errors import InputError, UnknownNameError
from rr1plan.robot import Robot
from rr1plan.scene.model_library import load_scene
from rr1plan.scene.placement import place_grid, place_ring
from rr1plan.transforms import pose


def test_a_grid_is_centerd_and_spaced(rr1: Robot) -> None:
    scene = place_grid(rr1, 2, 3, spacing=(0.8, 0.5), pose=(1.0, 2.0, 0.1))
    places = np.array([arm.base[:3, 3] for arm in scene.arms.values()])
    assert list(scene.arms) == [f"arm{k:02d}" for k in range(1, 7)]
    assert np.allclose(places.mean(axis=0), (1.0, 2.0, 0.1))
    assert np.allclose(np.unique(places[:, 0].round(9)), (0.6, 1.4))
    assert np.allclose(np.unique(places[:, 1].round(9)), (1.5, 2.0, 2.5))


def test_a_grid_and_a_ring_are_turned_as_a_whole(rr1: Robot) -> None:
    T = pose([1.0, 2.0, 0.1], rpy=[0.0, 0.3, 0.4])
    for place in (lambda pose: place_grid(rr1, 2, 3, pose=pose), lambda pose: place_ring(rr1, 3, 0.9, pose=pose)):
        for arm, plain in zip(place(T).arms.values(), place(None).arms.values(), strict=True):
            np.testing.assert_allclose(arm.base, T @ plain.base, atol=1e-15)


def test_all_arms_of_a_grid_share_one_robot(rr1: Robot) -> None:
    assert all(arm.robot is rr1 for arm in place_grid(rr1, 3, 4).arms.values())


@pytest.mark.parametrize(("facing", "sign"), [("center", -1.0), ("outward", 1.0)])
def test_ring_fronts_point_to_or_from_the_center(rr1: Robot, facing: str, sign: float) -> None:
    scene = place_ring(rr1, 5, 0.9, facing=facing, front=(-1, 0, 0), pose=pose([0.3, -0.2, 0.0], rpy=[0.0, 0.0, 0.4]))
    for arm in scene.arms.values():
        outward = (arm.base[:3, 3] - (0.3, -0.2, 0.0)) / 0.9
        assert np.allclose(arm.base[:3, :3] @ (-1.0, 0.0, 0.0), sign * outward)
        assert np.isclose(np.linalg.norm(outward), 1.0)


def test_a_ring_facing_the_center_brings_the_tools_nearer_to_it(rr1: Robot) -> None:
    scene = place_ring(rr1, 4, 1.2, front=(-1, 0, 0))
    poses = scene.link_poses()
    for name, arm in scene.arms.items():
        assert np.linalg.norm(poses[f"{name}/tool"][:2, 3]) < np.linalg.norm(arm.base[:2, 3])


def test_fronts_along_the_ring_are_square_to_the_radius(rr1: Robot) -> None:
    for arm in place_ring(rr1, 3, 1.0, facing="along").arms.values():
        assert abs(arm.base[:3, 0] @ arm.base[:3, 3]) < 1e-12


def test_arms_are_added_to_a_scene_under_new_names(rr1: Robot) -> None:
    scene = load_scene("rr1_table")
    more = place_grid(rr1, 1, 2, spacing=0.7, pose=(3, 0, 0), scene=scene, prefix="more")
    assert list(more.arms) == ["rr1", "more01", "more02"]
    assert more.obstacles == scene.obstacles
    with pytest.raises(InputError, match=r"'more01' already.*prefix"):
        place_grid(rr1, 1, 1, scene=more, prefix="more")


def test_more_than_ninety_nine_arms_sort_by_name(rr1: Robot) -> None:
    names = list(place_grid(rr1, 10, 12).arms)
    assert names == sorted(names)
    assert names[0] == "arm001"


@pytest.mark.parametrize(
    ("rows", "columns", "spacing", "message"),
    [
        (0, 2, 1.0, "rows"),
        (2, -1, 1.0, "columns"),
        (1.5, 2, 1.0, "rows"),
        (True, 2, 1.0, "rows"),
        (1, 2, 0.0, "spacing"),
        (1, 2, float("nan"), "spacing"),
        (1, 2, (1.0, 2.0, 3.0), "spacing"),
    ],
)
def test_grids_that_make_no_sense_are_refused(
    rr1: Robot, rows: int, columns: int, spacing: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        place_grid(rr1, rows, columns, spacing=spacing)


def test_rings_that_make_no_sense_are_refused(rr1: Robot) -> None:
    with pytest.raises(InputError, match="count"):
        place_ring(rr1, 0, 1.0)
    with pytest.raises(InputError, match="radius"):
        place_ring(rr1, 2, -1.0)
    with pytest.raises(InputError, match="not vertical"):
        place_ring(rr1, 2, 1.0, front=(0, 0, 1))
    with pytest.raises(UnknownNameError, match="Did you mean 'center'"):
        place_ring(rr1, 2, 1.0, facing="centre")
