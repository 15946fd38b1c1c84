"""The picture of a configuration space against Coal, cell by cell.

    python benchmarks/cspace_against_coal.py [--resolution 360]

The picture is computed block-wise; here Coal alone checks every cell's center and every pair of shapes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import coal
import numpy as np
from shared import Clock, heading, make_parser, number, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser("Cells of the configuration space against Coal", "cspace_against_coal")
    parser.add_argument("--resolution", type=int, default=360, help="cells along each axis")
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    rows, results = [], []
    for name in ("planar2r_path", "planar2r_no_path"):
        clock = Clock()
        with clock.stage("picture"):
            grid = rp.cspace(rp.load_scene(name), resolution=args.resolution).grid
        with clock.stage("every cell"):
            free = _ask_every_cell(name, grid)
        wrong = int((free != grid.free).sum())
        rows.append([name, free.size, grid.components, wrong, *(number(1e3 * s) for s in clock.cpu.values())])
        results.append(
            {"scene": name, "cells": free.size, "wrong": wrong, "components": grid.components, "cpu": clock.cpu}
        )
    header = ["scene", "cells", "components", "cells that differ", "picture [CPU ms]", "every cell by Coal [CPU ms]"]
    text = heading("Cells of the configuration space against Coal", {"resolution": args.resolution})
    save(args.out, "cspace_against_coal", {"scenes": results}, f"{text}\n\n{table(header, rows)}")
    return 0 if all(r["wrong"] == 0 for r in results) else 1


def _ask_every_cell(name: str, grid: CSpaceGrid) -> Array:
    """Whether each cell is free by plain Coal: NumPy kinematics of the robot, every pair of shapes."""
    world = _World(grid.scene)
    free = np.zeros(grid.labels.shape, dtype=bool)
    for i in track(range(len(grid.axes[0])), name):
        for j, second in enumerate(grid.axes[1]):
            free[i, j] = world.is_free(np.array([grid.axes[0][i], second]))
    return free


class _World:
    """A scene's shapes in Coal."""

    def __init__(self, scene: rp.Scene) -> None:
        self.scene = scene
        self.arm = scene.only_arm()
        self.parts = {name: self._shapes(name) for name in scene.element_names}
        self.request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
        limits = scene.limits()
        self.lower, self.upper = limits.lower, limits.upper

    def _shapes(self, name: str) -> list[tuple[Array, object]]:
        if name in self.scene.obstacles:
            thing = self.scene.obstacles[name]
            return [(thing.pose @ g.pose, _coal_shape(g.shape)) for g in thing.geometries]
        link = self.scene.arms[self.arm].robot.link(name.split("/", 1)[1])
        return [(g.pose, _coal_shape(g.shape)) for g in link.collisions]

    def is_free(self, q: Array) -> bool:
        """Whether a configuration is within limits and no forbidden pair of elements touches."""
        if (q < self.lower).any() or (q > self.upper).any():
            return False
        links = self.scene.link_poses({self.arm: q})
        placed = {
            name: [(_transform(links.get(name, np.eye(4)) @ T), shape) for T, shape in parts]
            for name, parts in self.parts.items()
        }
        return not any(
            coal.collide(x, Tx, y, Ty, self.request, coal.CollisionResult())
            for a, b in self.scene.checked_pairs
            for Tx, x in placed[a]
            for Ty, y in placed[b]
        )


def _transform(T: Array) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def _coal_shape(shape: object) -> coal.CollisionGeometry:
    match shape:
        case rp.Box(size):
            return coal.Box(*size)
        case rp.Sphere(radius):
            return coal.Sphere(radius)
        case rp.Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case rp.Capsule(radius, length):
            return coal.Capsule(radius, length)
        case rp.HalfSpace(normal, offset):
            return coal.Halfspace(np.array(normal), offset)
    raise SystemExit(f"no plain Coal shape for a {type(shape).__name__}")


if __name__ == "__main__":
    sys.exit(main())
