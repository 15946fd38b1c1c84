"""Distances between two solids, by Coal, each proven by a separating plane.

Coal's GJK sometimes stops early: distances 2e-5 m too large were observed. So its result for two
convex solids is only a hint: the returned normal gives a plane, and the gap between
the two solids along it, computed in `certificate_bodies.py` from their support functions, is a proven lower bound.
Half-spaces need the support function only.

Coal's hierarchy of triangles measures the surface of a concave mesh, but reports a body wholly inside as free;
`insides.py` decides whether a point is inside. `cell_blocks.py` measures the cells of a point
cloud; Coal does so if a cell is touched or the other solid is not convex.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rr1plan.checks import Array
from rr1plan.shapes import Box, Mesh, PointCloud
from slow_certificate.cell_blocks import BodyBox
from slow_certificate.solids import Solid, solid, support

_GJK_TOLERANCE = 1e-8
_GJK_ITERATIONS = 1000
# Largest overestimate by Coal if no plane can prove a distance (single triangles and cells) [m].
SLACK = 5e-5


class CoalDistance:
    """Signed distances of two solids; negative values are penetration depths."""

    def __init__(self) -> None:
        import coal

        self._ask = coal.distance
        self.calls = 0
        self._request = coal.DistanceRequest()
        self._request.gjk_tolerance = self._request.epa_tolerance = _GJK_TOLERANCE
        self._request.gjk_max_iterations = self._request.epa_max_iterations = _GJK_ITERATIONS
        self._rough = coal.DistanceRequest()
        self._result = coal.DistanceResult()

    def convex(self, a: Solid, Ta: Any, b: Solid, Tb: Any) -> tuple[float, Array]:
        """Coal's distance [m] of two solids at Coal transforms, and its normal from a to b."""
        self.calls += 1
        result = self._result
        result.clear()
        distance = self._ask(a.geometry, Ta, b.geometry, Tb, self._request, result)
        if not -1e6 < distance < 1e12:
            # With a tight tolerance, the depth of two cylinders is sometimes -1.8e308.
            result.clear()
            distance = self._ask(a.geometry, Ta, b.geometry, Tb, self._rough, result)
            if not -1e6 < distance < 1e12:
                distance = -min(a.radius, b.radius)
        return float(distance), result.normal

    def compound(self, a: Solid, Ta: Any, b: Solid, Tb: Any) -> tuple[float, float]:
        """Distance of two solids of which at least one is a concave mesh or a cloud, and a lower bound of it [m]."""
        if isinstance(b.shape, PointCloud):
            return self._to_cells(a, Ta, b, Tb)
        if isinstance(a.shape, PointCloud):
            return self._to_cells(b, Tb, a, Ta)
        distance = self.convex(a, Ta, b, Tb)[0]
        if distance > 0.0 and (_holds(a, Ta, b, Tb) or _holds(b, Tb, a, Ta)):
            distance = -distance
        return distance, distance - SLACK

    def _to_cells(self, a: Solid, Ta: Any, cloud: Solid, Tc: Any) -> tuple[float, float]:
        """Distance to the nearest cell, and a lower bound of it [m]."""
        distance = self._touched_cells(a, Ta, cloud, Tc)
        return distance, distance - SLACK

    def _touched_cells(self, a: Solid, Ta: Any, cloud: Solid, Tc: Any) -> float:
        """Distance to the nearest cell by Coal, or minus the depth of some cell [m]."""
        import coal

        assert cloud.cells is not None
        side = 2.0 * cloud.cells.half
        cell = solid(Box((side, side, side)))
        Rc, tc = Tc.getRotation(), Tc.getTranslation()
        R, t = Rc.T @ Ta.getRotation(), Rc.T @ (Ta.getTranslation() - tc)

        def ask(center: Array) -> tuple[float, tuple[Array, float] | None]:
            T = coal.Transform3s(Rc, Rc @ center + tc)
            if not a.convex:
                return self.compound(a, Ta, cell, T)[0], None
            distance, normal = self.convex(a, Ta, cell, T)
            length = float(np.linalg.norm(normal))
            if not 0.5 < length < 2.0:
                return distance, None
            local = Rc.T @ normal / length
            return distance, (local, float(support(a, (R.T @ local)[None])[0] + local @ t))

        return cloud.cells.distance(BodyBox(R, R @ a.center + t, a.half), ask)


def _holds(body: Solid, T: Any, other: Solid, To: Any) -> bool:
    """Whether a concave mesh contains a point of another solid."""
    if body.inside is None:
        return False
    inside = other.points[0] if isinstance(other.shape, Mesh) else other.center
    point = T.getRotation().T @ (To.getRotation() @ inside + To.getTranslation() - T.getTranslation())
    return body.inside.holds(point)
