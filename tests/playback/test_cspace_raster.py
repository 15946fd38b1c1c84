"""The compiled raster of configuration spaces: every cell of every image agrees with Coal, whole cells with samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.playback.cspace.cspace_raster import SELF, CSpaceRaster, layer_of
from rr1plan.scene.model_library import load_problems
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

CELLS = 48


def centers_of(cells: int) -> np.ndarray:
    """The middles of the cells of a full turn [rad]."""
    return -np.pi + (np.arange(cells) + 0.5) * (2.0 * np.pi / cells)


def raster_of(scene: rp.Scene, cells: int = CELLS, columns: tuple[int, int] = (0, 1)) -> CSpaceRaster:
    """A raster of full turns, as `compute_grid` makes them for joints without limits."""
    centers = centers_of(cells)
    arm = scene.only_arm()
    return CSpaceRaster(CollisionChecker(scene, (arm,)), scene.arms[arm].q, columns, (centers, centers))


def images_by_coal(scene: rp.Scene, raster: CSpaceRaster, columns: tuple[int, int] = (0, 1)) -> dict[str, np.ndarray]:
    """The image of each layer, every cell and pair of solids by Coal; no kernel takes part."""
    arm = scene.only_arm()
    checker, q = CollisionChecker(scene, (arm,)), np.array(scene.arms[arm].q)
    owners = [layer_of(scene, checker.pairs[owner], arm) for owner in checker.solid_owner.tolist()]
    found = {name: np.zeros(raster.shape, np.bool_) for name in raster.ranges}
    for pair in checker.static_contacts:
        found[layer_of(scene, pair, arm)][:] = True
    for i, first in enumerate(centers_of(raster.shape[0])):
        for j, second in enumerate(centers_of(raster.shape[1])):
            q[list(columns)] = first, second
            for k in np.flatnonzero(checker.solid_distances(q) <= checker.solid_padding).tolist():
                found[owners[k]][i, j] = True
    return found


def polygon(rng: np.random.Generator) -> rp.Mesh:
    """A prism above a convex polygon."""
    angles = np.linspace(0.0, 2.0 * np.pi, int(rng.integers(3, 8)), endpoint=False)
    angles += 0.3 * np.sin(angles)
    corners = rng.uniform(0.1, 0.35) * np.column_stack([np.cos(angles), np.sin(angles)])
    return convex_hull(np.vstack([np.column_stack([corners, np.full(len(corners), z)]) for z in (-0.1, 0.1)]))


SHAPES: tuple[Callable[[np.random.Generator], rp.Shape], ...] = (
    lambda rng: rp.Box(rng.uniform(0.05, 0.5, 3)),
    lambda rng: rp.Cylinder(rng.uniform(0.05, 0.3), rng.uniform(0.05, 0.3)),
    lambda rng: rp.Sphere(rng.uniform(0.05, 0.3)),
    lambda rng: rp.Capsule(rng.uniform(0.02, 0.1), rng.uniform(0.1, 0.4)),
    polygon,
)


def random_scene(seed: int) -> rp.Scene:
    """The planar arm among shapes of all kinds: overlapping, tilted, on the base, out of reach."""
    rng = np.random.default_rng(seed)
    scene = rp.Scene({"arm": rp.Arm(rp.load_robot("planar2r"), q=[0.3, -0.4])})
    for k, shape in enumerate(SHAPES):
        tilt = rng.normal(size=3) * (0.3 if seed % 2 else 0.0)
        T = pose([*rng.uniform(-1.6, 1.6, 2), rng.uniform(-0.05, 0.05)], rpy=[*tilt[:2], rng.uniform(-np.pi, np.pi)])
        scene = scene.with_obstacle(f"thing {k}", shape(rng), T)
    scene = scene.with_obstacle("twin", SHAPES[seed % 5](rng), scene.obstacles["thing 1"].pose)
    scene = scene.with_obstacle("far away", rp.Box((0.2, 0.2, 0.2)), [3.0, 1.0, 0.0])
    return scene.with_padding(0.02) if seed % 3 == 0 else scene


@pytest.mark.parametrize("seed", range(8))
def test_every_cell_of_random_scenes_agrees_with_coal(seed: int) -> None:
    scene = random_scene(seed)
    raster = raster_of(scene)
    found, expected = raster.images(), images_by_coal(scene, raster)
    assert set(found) == {*scene.obstacles}
    for name, mask in found.items():
        assert np.array_equal(mask, expected[name]), name
    assert sum(mask.any() and not mask.all() for mask in found.values()) >= 3
    assert not found["far away"].any()


def test_beside_the_base_an_obstacle_blocks_what_coal_says() -> None:
    scene = rp.Scene({"arm": rp.Arm(rp.load_robot("planar2r"))})
    scene = scene.with_obstacle("lid", rp.Box((0.1, 0.1, 0.1)), [0.0, 0.1, -0.05])
    raster = raster_of(scene)
    assert np.array_equal(raster.image("lid"), images_by_coal(scene, raster)["lid"])
    assert 0.2 < raster.image("lid").mean() < 0.9


@pytest.mark.parametrize("name", ["planar2r_path", "planar2r_no_path"])
def test_the_lessons_agree_with_coal_layer_by_layer(name: str) -> None:
    scene = rp.load_scene(name)
    raster = raster_of(scene, 90)
    expected = images_by_coal(scene, raster)
    for layer, mask in raster.images().items():
        assert np.array_equal(mask, expected[layer])
        assert 0.02 < mask.mean() < 0.3


def test_two_joints_of_rr1_agree_with_coal(rr1_table: rp.Scene) -> None:
    raster = raster_of(rr1_table, 32, (1, 2))
    expected, found = images_by_coal(rr1_table, raster, (1, 2)), raster.images()
    assert found[SELF].any()
    for layer, mask in found.items():
        assert np.array_equal(mask, expected[layer]), layer


@pytest.mark.parametrize("seed", [1, 4])
def test_cells_that_are_whole_are_in_contact_everywhere(seed: int) -> None:
    scene = random_scene(seed)
    raster = raster_of(scene, 180)
    checker, rng, counts = raster.checker, np.random.default_rng(seed), np.zeros(2)
    angles, step = centers_of(180), 2.0 * np.pi / 180
    for name in raster.ranges:
        whole, centers = raster.image(name, whole=True), raster.image(name)
        assert not (whole & ~centers).any()
        cells = np.argwhere(whole)
        counts += len(cells), centers.sum()
        for i, j in cells[rng.permutation(len(cells))[:60]]:
            corner = rng.integers(0, 2, 2) * 0.999 - 0.4995
            for offset in (corner, rng.uniform(-0.5, 0.5, 2)):
                q = angles[[i, j]] + step * offset
                touching = {x for contact in checker.contacts(q) for x in (contact.a, contact.b)}
                assert name in touching
    # The rim is lost, and thin parts, but not more.
    assert counts[0] > 0.3 * counts[1] > 300.0


def test_whole_cells_prove_that_the_second_lesson_has_no_path() -> None:
    from rr1plan.playback.cspace.cspace_cells import label_components

    for name, separated in (("planar2r_no_path", True), ("planar2r_path", False)):
        problem = next(iter(load_problems(name).values()))
        raster = raster_of(problem.scene, 360)
        full = np.any([raster.image(layer, whole=True) for layer in raster.ranges], axis=0)
        labels = label_components(~full, (True, True), diagonal=True)
        (target,) = problem.goal["arm"]
        at = [
            tuple(np.floor((np.asarray(q) + np.pi) / (2.0 * np.pi) * 360).astype(int))
            for q in (problem.start, target.q)
        ]
        assert (labels[at[0]] != labels[at[1]]) == separated
