"""Robots of others, and random scenes full of things for them: thick, thin, round, flat, hollow, endless and held."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from shared import console

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.formats.convex import convex_hull
from rr1plan.transforms import pose

Draw = Callable[[np.random.Generator, float], Any]
_FOREIGN = "example-robot-data"
_TRIES = 200


# ---- robots --------------------------------------------------------------------------------------


def find_urdf(name: str, folder: Path | None) -> Path | None:
    """A URDF of the package example-robot-data: installed here, or put into a folder by pip."""
    try:
        files = importlib.metadata.files(_FOREIGN) or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    installed = [Path(str(file.locate())) for file in files if file.name == name]
    if installed or folder is None:
        return installed[0] if installed else None
    if not any(folder.rglob(name)):
        console.print(f"pip puts {_FOREIGN} into {folder}", highlight=False)
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(folder), _FOREIGN]
        subprocess.run(pip, check=True)
    return next(folder.rglob(name), None)


# ---- shapes --------------------------------------------------------------------------------------


def _box(rng: np.random.Generator, reach: float) -> rp.Box:
    return rp.Box(tuple(reach * rng.uniform(0.05, 0.3, 3)))


def _sphere(rng: np.random.Generator, reach: float) -> rp.Sphere:
    return rp.Sphere(reach * rng.uniform(0.03, 0.12))


def _cylinder(rng: np.random.Generator, reach: float) -> rp.Cylinder:
    return rp.Cylinder(reach * rng.uniform(0.02, 0.12), reach * rng.uniform(0.05, 0.4))


def _capsule(rng: np.random.Generator, reach: float) -> rp.Capsule:
    return rp.Capsule(reach * rng.uniform(0.02, 0.08), reach * rng.uniform(0.05, 0.4))


def _hull(rng: np.random.Generator, reach: float) -> rp.Mesh:
    points = rng.normal(size=(int(rng.integers(5, 60)), 3)) * reach * rng.uniform(0.02, 0.1, 3)
    return convex_hull(points + 0.05 * reach * rng.normal(size=3))


def _plate(rng: np.random.Generator, reach: float) -> rp.Box:
    return rp.Box((0.001, *(reach * rng.uniform(0.1, 0.5, 2))))


def _needle(rng: np.random.Generator, reach: float) -> rp.Cylinder | rp.Capsule:
    kind = rp.Cylinder if rng.uniform() < 0.5 else rp.Capsule
    return kind(0.0005, reach * rng.uniform(0.2, 0.8))


_THICK: tuple[Draw, ...] = (_box, _sphere, _cylinder, _capsule)


# ---- scenes --------------------------------------------------------------------------------------


def cluttered_scenes(robot: rp.Robot, seed: int) -> Iterator[tuple[str, rp.Scene]]:
    """Scenes with the one robot, whose home is free in all of them."""
    rng = np.random.default_rng(seed)
    bare = rp.Scene().with_arm("arm", robot)
    places = _places(bare, rng)
    yield "solids", _furnish(bare, rng, places, [*_THICK, *_THICK])
    yield "hulls", _furnish(bare, rng, places, [_hull] * 8)
    yield "plates and needles", _furnish(bare, rng, places, [_plate, _needle] * 6)
    yield "padded", _padded(_furnish(bare, rng, places, [*_THICK, _hull, _plate, _needle]), rng)
    yield "ground and cloud", _furnish(_with_ground(bare, rng, places), rng, places, [_sphere, _needle, _plate, _cloud])
    yield "holding", _furnish(_holding(bare, rng, places), rng, places, [*_THICK, _hull, _plate, _needle])


def _places(scene: rp.Scene, rng: np.random.Generator) -> Array:
    """Where the far half of the arm's links may be, shape (n, 3)."""
    robot = scene.arms["arm"].robot
    names = [f"arm/{link.name}" for link in robot.links if link.collisions]
    low, high = box_of(scene.limits())
    draws = [scene.link_poses({"arm": q}) for q in rng.uniform(low, high, (60, robot.nq))]
    return np.array(
        [poses[name][:3, 3] for poses in draws for name in (*names[len(names) // 2 :], f"arm/{robot.tool}")]
    )


def box_of(limits: rp.Limits) -> tuple[Array, Array]:
    """Position limits, a turn at most."""
    return np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)


def _furnish(scene: rp.Scene, rng: np.random.Generator, places: Array, draws: list[Draw]) -> rp.Scene:
    """Put something of each kind where the arm can be, but not where it is at home."""
    reach = _reach(places)
    for i, draw in enumerate(draws):
        for _ in range(_TRIES):
            at = places[rng.integers(len(places))] + 0.1 * reach * rng.normal(size=3)
            if np.ptp(places[:, 2]) < 1e-6:
                at[2] = places[0, 2]
            fuller = scene.with_obstacle(f"thing{i}", draw(rng, reach), pose(at, rpy=rng.uniform(-3.0, 3.0, 3)))
            if _stands(fuller):
                scene = fuller
                break
    return scene


def _reach(places: Array) -> float:
    return float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())


def _stands(scene: rp.Scene) -> bool:
    checker = CollisionChecker(scene)
    return checker.static_is_free and checker.is_free(scene.arms["arm"].robot.home)


def _padded(scene: rp.Scene, rng: np.random.Generator) -> rp.Scene:
    """A distance to keep from each thing, where that leaves home free."""
    for name in scene.obstacles:
        padded = scene.with_padding(rng.uniform(0.005, 0.03), "arm", name)
        scene = padded if _stands(padded) else scene
    return scene


def _with_ground(scene: rp.Scene, rng: np.random.Generator, places: Array) -> rp.Scene:
    """Below all that stands, and a little aslant."""
    normal = np.array([*rng.uniform(-0.1, 0.1, 2), 1.0])
    normal /= np.linalg.norm(normal)
    for depth in np.arange(0.01, 1.0, 0.02):
        grounded = scene.with_obstacle("ground", rp.HalfSpace(tuple(normal), -float(depth)))
        if _stands(grounded):
            return grounded
    return scene


def _cloud(rng: np.random.Generator, reach: float) -> rp.PointCloud:
    points = rng.normal(size=(80, 3))
    points *= 0.12 * reach / np.linalg.norm(points, axis=1)[:, None]
    return rp.PointCloud(points, 0.03 * reach)


def _holding(scene: rp.Scene, rng: np.random.Generator, places: Array) -> rp.Scene:
    """A rod in the hand, long enough to hit the arm itself."""
    robot, reach = scene.arms["arm"].robot, _reach(places)
    for _ in range(_TRIES):
        rod = scene.with_obstacle("rod", rp.Capsule(0.01 * reach, 0.4 * reach))
        place = pose(0.1 * reach * rng.normal(size=3), rpy=rng.uniform(-3.0, 3.0, 3))
        held = rod.attach("rod", touch=robot.link_names[-3:], pose=place)
        if _stands(held):
            return held
    return scene
