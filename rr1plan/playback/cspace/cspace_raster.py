"""The image of each obstacle in the plane of two joints, on a grid of cells: `kernels/raster.c` and its tables.

Every cell stands for one configuration, its center; it belongs to an image if the compiled kernel finds a pair of
solids in contact there (Lozano-Perez 1983 for the picture). Pages rasterize with the same kernel and the same tables.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library
from rr1plan.kernels.wasm_core import memory_image
from rr1plan.playback.cspace.cspace_cells import Mask
from rr1plan.scene import Scene

SELF = "self-collision"
_STRIP = 32  # rows between reports of progress


class CSpaceRaster:
    """Computes the image of every obstacle. Threads may share it: each waits while another one uses its checker.

    Args:
        checker: Checker of the arm whose two joints move.
        configuration: The arm's configuration, shape (nq,) [rad or m]; two of its columns are replaced.
        columns: These two columns.
        axes: Values at the cell centers of each of them, shapes (n,) and (m,).

    Attributes:
        ranges: For each obstacle, other arm and `SELF` that the arm may touch, the range of its pairs.
        struct: The `RasterTables`.

    Raises:
        InputError: a half-space or a point cloud that would be checked against another one.
    """

    def __init__(
        self, checker: CollisionChecker, configuration: Array, columns: tuple[int, int], axes: tuple[Array, Array]
    ) -> None:
        self.checker = checker
        self._axes = axes
        self.shape = (len(axes[0]), len(axes[1]))
        pairs = checker.pair_tables
        # Pairs without relative motion are in contact in all cells or in none.
        fixed = np.flatnonzero(~pairs.surfaceless[pairs.static].all(axis=1))
        rows = np.concatenate([pairs.moving_rows, pairs.static_rows[fixed]])
        owners = np.concatenate([pairs.moving_owner, pairs.static_owner[fixed]])
        padding = np.concatenate([checker.solid_padding, checker.padding[pairs.static_owner[fixed]]])
        arm = checker.arms[0]
        layer_of_pair = [layer_of(checker.scene, pair, arm) for pair in checker.pairs]
        names = list(dict.fromkeys(layer_of_pair))
        layers = np.array([names.index(name) for name in layer_of_pair], np.int64)[owners]
        order = np.argsort(layers, kind="stable")
        ends = np.searchsorted(layers[order], np.arange(len(names) + 1)).tolist()
        self.ranges = {name: (first, last) for name, first, last in zip(names, ends, ends[1:], strict=False)}
        self.struct = CStruct(
            "RasterTables",
            pair_count=len(rows),
            first=np.array(axes[0]),
            second=np.array(axes[1]),
            configuration=np.array(configuration, dtype=np.float64),
            pairs=np.ascontiguousarray(rows[order]),
            padding=np.ascontiguousarray(padding[order]),
        )
        self.struct.value.columns[:] = columns
        self.struct.value.counts[:] = self.shape
        self.struct.give_room(directions=len(rows), open=constants()["RASTER_LEVELS"] * len(rows))

    def image(self, layer: str, report: Callable[[float], None] | None = None, *, whole: bool = False) -> Mask:
        """The cells in which the arm touches an obstacle, shape (n, m).

        Args:
            layer: A key of `ranges`.
            report: Called periodically with the fraction done, 0 to 1.
            whole: Only cells proven to be in contact in all of their configurations, not just at their centers.
        """
        half = np.array([0.5 * (axis[1] - axis[0]) if whole else 0.0 for axis in self._axes])
        cells = np.zeros(self.shape, np.uint8)
        for first in range(0, self.shape[0], _STRIP):
            if report is not None:
                report(first / self.shape[0])
            last = min(first + _STRIP, self.shape[0])
            given = self.struct, *self.ranges[layer], first, last, half, cells
            self.checker.run_exact_kernel(load_library().rr1_raster_pairs, *given)
        return cells.view(np.bool_)

    def memory_image(self) -> bytes:
        """The tables for `core.wasm`, named `raster`; the tables of the bodies are in the image of the checker."""
        return memory_image(raster=self.struct)

    def images(self, progress: Callable[[float], None] | None = None) -> dict[str, Mask]:
        """The cells that each obstacle (and `SELF`, if it occurs) blocks, shape (n, m).

        Args:
            progress: Called periodically with the fraction done, 0 to 1.
        """
        found: dict[str, Mask] = {}
        for done, name in enumerate(self.ranges):

            def report(part: float, done: int = done) -> None:
                if progress is not None:
                    progress((done + part) / len(self.ranges))

            found[name] = self.image(name, report)
        for pair in self.checker.static_contacts:
            found[layer_of(self.checker.scene, pair, self.checker.arms[0])] = np.ones(self.shape, np.bool_)
        return {name: mask for name, mask in found.items() if mask.any() or name != SELF}


def layer_of(scene: Scene, pair: tuple[str, str], arm: str) -> str:
    """The layer that a contact of an arm belongs to: the obstacle, the other arm, or self-collision."""
    for name in pair:
        if name in scene.obstacles:
            return name
    others = [owner for owner in map(scene.owner, pair) if owner != arm]
    return f"{others[-1]}" if others else SELF
