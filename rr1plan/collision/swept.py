"""Certified straight edges and parabolas by spheres first, exactly where they leave something open."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rr1plan._kernels.cover import TABLES
from rr1plan._kernels.motion import FREE
from rr1plan._kernels.record import pack
from rr1plan._kernels.swept import CONFIGURATIONS, EDGES, EXACT_EDGES, GAPS
from rr1plan._kernels.swept import sweep_edge as _sweep_edge_untyped
from rr1plan._kernels.swept import sweep_parabola as _sweep_parabola_untyped
from rr1plan.checks import Array
from rr1plan.collision.exact import CollisionChecker
from rr1plan.collision.sphere_tables import build_cover

_sweep_edge: Callable[..., tuple[int, float, int]] = _sweep_edge_untyped
_sweep_parabola: Callable[..., tuple[int, float, int]] = _sweep_parabola_untyped


class SweptEdges:
    """Straight edges and parabolas of a checker's moving arms, proven by spheres where that is possible.

    The answers are those of `MotionChecker`. An instance keeps scratch memory: give each thread its own.

    Args:
        checker: The collision checker.
        tolerance: Motions that pass at less than this beyond the padding are refused [m].

    Attributes:
        tables: What compiled kernels know of the scene; see `rr1plan._kernels.cover`.
        record: A record of it, which the compiled `rr1plan._kernels.swept.sweep_edge` takes after both ends of an edge.

    Raises:
        InputError: a scene that cannot be checked.
    """

    def __init__(self, checker: CollisionChecker, tolerance: float) -> None:
        self._checker = checker
        self._done = np.zeros(4, np.int64)
        self.tables = (*build_cover(checker, checker.tables, tolerance), (tolerance, checker.record), self._done)
        self.record = pack(self.tables, TABLES)

    @property
    def edges_checked(self) -> int:
        """Edges looked at so far."""
        return int(self._done[EDGES])

    @property
    def edges_left(self) -> int:
        """Those of them that spheres could not decide."""
        return int(self._done[EXACT_EDGES])

    @property
    def configurations_checked(self) -> int:
        """Configurations looked at so far."""
        return int(self._done[CONFIGURATIONS])

    @property
    def gaps_checked(self) -> int:
        """Distances of pairs computed finely so far."""
        return int(self._done[GAPS])

    def edge_is_free(self, q0: Any, q1: Any) -> bool:
        """Every configuration on the straight line from q0 to q1 is free.

        Args:
            q0: Begin [rad or m], shape (nq,).
            q1: End [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        return self.look_along(self._checker.checked(q0), self._checker.checked(q1))[0] == FREE

    def look_along(self, q0: Array, q1: Array) -> tuple[int, float, int]:
        """Status, where (0..1), and which pair of solids (-1: one that rests) of an edge that was checked for shape."""
        if not self._checker.resting_is_free:
            return FREE + 1, 0.0, -1
        return _sweep_edge(q0, q1, self.record)

    def look_along_parabola(self, curve: Array, duration: float) -> tuple[int, float, int]:
        """The same of a curve sum_k curve[k] t^k, 0 <= t <= duration, of degree 2 at most."""
        if not self._checker.resting_is_free:
            return FREE + 1, 0.0, -1
        return _sweep_parabola(curve, duration, self.record)
