"""Third-party robots and random cluttered scenes: thick, thin, round, flat, hollow, unbounded and attached objects.

Scenes have one arm, or many arms of several robots on grids so narrow that they reach each other's bases; some arms are
stationary.
"""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from concave_shapes import bowl, cup, ring, terrain
from shared import console

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import pose

Draw = Callable[[np.random.Generator, float], Any]
_FOREIGN = "example-robot-data"
_TRIES = 200
_TURNS = 8
# On a grid as narrow as this, free configurations are rare [m].
_DENSE = 0.45
# Objects around many arms are sized for an arm with this reach [m].
_MOST_REACH = 1.0


# ---- robots --------------------------------------------------------------------------------------


def find_urdf(name: str, folder: Path | None) -> Path | None:
    """A URDF of the package example-robot-data, installed here or in a folder by pip."""
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


def _cup(rng: np.random.Generator, reach: float) -> rp.Mesh:
    radius, height = reach * rng.uniform(0.08, 0.2), reach * rng.uniform(0.1, 0.4)
    return cup(radius, height, 0.2 * radius, int(rng.integers(8, 24)), int(rng.integers(2, 8)))


def _ring(rng: np.random.Generator, reach: float) -> rp.Mesh:
    return ring(reach * rng.uniform(0.15, 0.35), reach * rng.uniform(0.01, 0.08), int(rng.integers(12, 30)), 8)


def _bowl(rng: np.random.Generator, reach: float) -> rp.Mesh:
    return bowl(reach * rng.uniform(0.1, 0.3), int(rng.integers(8, 24)), 6)


def _terrain(rng: np.random.Generator, reach: float) -> rp.Mesh:
    return terrain(rng, int(rng.integers(6, 16)), reach * rng.uniform(0.4, 1.0), 0.2 * reach)


_THICK: tuple[Draw, ...] = (_box, _sphere, _cylinder, _capsule)
_CONCAVE: tuple[Draw, ...] = (_cup, _ring, _bowl, _terrain)


# ---- scenes of one arm ---------------------------------------------------------------------------


def cluttered_scenes(robot: rp.Robot, seed: int) -> Iterator[tuple[str, rp.Scene]]:
    """Scenes with one robot, whose home is free in all of them."""
    rng = np.random.default_rng(seed)
    bare = rp.Scene().with_arm("arm", robot)
    places = _places(bare, rng)
    yield "solids", _furnish(bare, rng, places, [*_THICK, *_THICK])
    yield "hulls", _furnish(bare, rng, places, [_hull] * 8)
    yield "plates and needles", _furnish(bare, rng, places, [_plate, _needle] * 6)
    yield "padded", _padded(_furnish(bare, rng, places, [*_THICK, _hull, _plate, _needle]), rng)
    yield "ground and cloud", _furnish(_with_ground(bare, rng), rng, places, [_sphere, _needle, _plate, _cloud])
    yield "holding", _furnish(_holding(bare, "arm", rng, places), rng, places, [*_THICK, _hull, _plate, _needle])
    yield "concave meshes", _furnish(bare, rng, places, [*_CONCAVE, *_CONCAVE])
    padded = _padded(_furnish(_with_ground(bare, rng), rng, places, [*_THICK, _hull, *_CONCAVE, _cloud]), rng)
    yield "all shapes, padded", padded


def _places(scene: rp.Scene, rng: np.random.Generator) -> Array:
    """Where the far half of the arms' links may be, shape (n, 3)."""
    names = []
    for arm, placed in scene.arms.items():
        solid = [link.name for link in placed.robot.links if link.collisions]
        names += [f"{arm}/{link}" for link in (*solid[len(solid) // 2 :], placed.robot.tool)]
    low, high = box_of(scene.limits())
    draws = [scene.link_poses(scene.split(q)) for q in rng.uniform(low, high, (60, len(low)))]
    return np.array([poses[name][:3, 3] for poses in draws for name in names])


def box_of(limits: rp.Limits) -> tuple[Array, Array]:
    """Position limits, at most one turn wide."""
    return np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)


def _furnish(scene: rp.Scene, rng: np.random.Generator, places: Array, draws: list[Draw]) -> rp.Scene:
    """Add an object of each kind in the workspace of the arms, free at their configurations."""
    reach = min(_reach(places), _MOST_REACH)
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
    return checker.static_is_free and checker.is_free(scene.configuration())


def _padded(scene: rp.Scene, rng: np.random.Generator) -> rp.Scene:
    """A distance for each arm to keep from each thing, where that leaves all standing free."""
    for arm in scene.arms:
        for name in scene.obstacles:
            padded = scene.with_padding(rng.uniform(0.005, 0.03), arm, name)
            scene = padded if _stands(padded) else scene
    return scene


def _with_ground(scene: rp.Scene, rng: np.random.Generator) -> rp.Scene:
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


def _holding(scene: rp.Scene, arm: str, rng: np.random.Generator, places: Array) -> rp.Scene:
    """A rod in the hand, long enough to touch the arm itself."""
    robot, reach = scene.arms[arm].robot, min(_reach(places), _MOST_REACH)
    name = f"rod of {arm}"
    for _ in range(_TRIES):
        rod = scene.with_obstacle(name, rp.Capsule(0.01 * reach, 0.4 * reach))
        place = pose(0.1 * reach * rng.normal(size=3), rpy=rng.uniform(-3.0, 3.0, 3))
        held = rod.attach(name, arm, touch=robot.link_names[-3:], pose=place)
        if _stands(held):
            return held
    return scene


# ---- scenes of many arms -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Crowd:
    """A scene of many arms.

    Args:
        name: Description.
        scene: The scene, in which all arms are free.
        arms: The moving arms (None: all).
        margin: Distance to keep in addition to the padding between elements in relative motion [m].
    """

    name: str
    scene: rp.Scene
    arms: tuple[str, ...] | None = None
    margin: float = 0.0


def crowds(robot: rp.Robot, others: Iterable[rp.Robot], seed: int) -> Iterator[Crowd]:
    """Scenes of many arms of a robot, some of them together with other robots.

    Args:
        robot: The robot.
        others: Other robots.
        seed: Seed of all poses and objects.
    """
    rng = np.random.default_rng(seed)
    for count, spacing in ((2, 0.8), (2, 0.35), (4, 0.5), (4, 0.35), (16, 0.8), (16, 0.5), (16, 0.35)):
        scene = _stand([robot] * count, spacing, rng)
        yield Crowd(f"{count} at {spacing} m", scene)
        if count > 2:
            some = tuple(name for i, name in enumerate(scene.arms) if i % 3 != 1)
            yield Crowd(f"{count} at {spacing} m, {len(some)} move", scene, some)
    four = _stand([robot] * 4, 0.5, rng)
    yield Crowd("4, margin of 5 mm", four, margin=0.005)
    yield Crowd("4, padding of 3 mm, 2 move", _where_free(four.with_padding(0.003), four), tuple(four.arms)[::3], 0.002)
    places = _places(four, rng)
    holding = _holding(_holding(four, "arm0", rng, places), "arm1", rng, places)
    yield Crowd("4, two hold rods", _furnish(holding, rng, places, [_box, _hull]))
    full = _furnish(_with_ground(four, rng), rng, places, [*_THICK, _hull, *_CONCAVE, _cloud])
    yield Crowd("4 among all shapes", full)
    yield Crowd("4 among all shapes, padded, 2 move", _padded(full, rng), tuple(four.arms)[1:3], 0.001)
    for other in others:
        mixed = _stand([robot, other, robot], 0.6, rng)
        places = _places(mixed, rng)
        yield Crowd(f"beside {other.name}", mixed)
        filled = _furnish(_holding(mixed, "arm0", rng, places), rng, places, [*_THICK, _hull, _cup, _bowl])
        yield Crowd(f"beside {other.name}, all shapes", filled)
        yield Crowd(f"beside {other.name}, which stands", filled, ("arm0", "arm2"), 0.002)


def _where_free(wanted: rp.Scene, instead: rp.Scene) -> rp.Scene:
    return wanted if _stands(wanted) else instead


def _stand(robots: Sequence[rp.Robot], spacing: float, rng: np.random.Generator) -> rp.Scene:
    """Robots on a grid, each with a random heading and a random configuration that is free of the robots before it.

    Where they are nearer than `_DENSE` all are turned and stand nearly alike, as hardly any others find room. Bases may
    touch each other, as if they were bolted together.
    """
    columns = int(np.ceil(np.sqrt(len(robots))))
    for _ in range(_TRIES):
        scene: rp.Scene | None = rp.Scene()
        facing = rng.uniform(-np.pi, np.pi)
        alike = {robot.name: rng.uniform(*box_of(robot.limits)) for robot in robots}
        for i, robot in enumerate(robots):
            low, high = box_of(robot.limits)
            place, turn = [spacing * (i // columns), spacing * (i % columns), 0.0], np.pi
            if spacing < _DENSE:
                low, high = np.maximum(low, alike[robot.name] - 0.1), np.minimum(high, alike[robot.name] + 0.1)
                turn = 0.2
            bases = [pose(place, rpy=[0.0, 0.0, yaw]) for yaw in facing + rng.uniform(-turn, turn, _TURNS)]
            draws = rng.uniform(low, high, (_TRIES, robot.nq))
            scene = _with_free_arm(scene, f"arm{i}", robot, bases, draws)
            if scene is None:
                break
        else:
            return scene
    raise RuntimeError(f"no room for {len(robots)} arms at {spacing} m")


def _with_free_arm(
    scene: rp.Scene, name: str, robot: rp.Robot, bases: Sequence[Array], draws: Array
) -> rp.Scene | None:
    """Add an arm at the first base and configuration that are free; None if there are none."""
    for base in bases:
        fuller = scene.with_arm(name, robot, base)
        for other in scene.arms:
            fuller = fuller.allow(f"{other}/{scene.arms[other].robot.base}", f"{name}/{robot.base}")
        checker = CollisionChecker(fuller, [name])
        q = next(filter(checker.is_free, draws), None)
        if q is not None:
            return fuller.with_configuration(name, q)
    return None
