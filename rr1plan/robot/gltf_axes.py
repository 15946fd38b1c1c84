"""The up axis of a robot's glTF meshes.

In glTF files y is up. SAPIEN ignores this, so the robots of ManiSkill and of other vendors have glTF files with z up:
read by the specification, each mesh of such a robot is turned by 90 degrees about its x axis. The other shapes of the
links and their centers of mass show which of both was meant.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rr1plan.robot import Geometry, Link
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.shapes import Mesh
from rr1plan.shapes.gltf_checks import Z_UP
from rr1plan.transforms import identity

log = logging.getLogger(__name__)

# If the meshes of a robot are turned wrongly, the other way at least halves the misfit.
_BETTER = 0.5


def with_fitting_axes(links: Sequence[Link], gltf: Mapping[str, tuple[float, ...]], source: str) -> Sequence[Link]:
    """The links, with z up in their glTF meshes if these then fit better, which is logged as a warning.

    Args:
        links: The links of one robot, their glTF meshes read with y up.
        gltf: The scale of each shape from a glTF file, by its name.
        source: Origin of the document, for the warning.
    """

    def as_written(geometry: Geometry) -> Geometry:
        shape = geometry.shape
        if geometry.name not in gltf or not isinstance(shape, Mesh):
            return geometry
        scale = np.array(gltf[geometry.name])
        back = scale[:, None] * Z_UP.T / scale
        return replace(geometry, shape=Mesh(shape.vertices @ back.T, shape.faces, shape.convex))

    if not gltf:
        return links
    turned = [
        replace(k, visuals=tuple(map(as_written, k.visuals)), collisions=tuple(map(as_written, k.collisions)))
        for k in links
    ]
    (shapes, masses), (turned_shapes, turned_masses) = _misfit(links), _misfit(turned)
    # If all shapes are glTF meshes, they fit each other either way.
    fit_either_way = np.isclose(shapes, turned_shapes)
    if turned_masses < _BETTER * masses if fit_either_way else turned_shapes < _BETTER * shapes:
        log.warning(
            "%s: its glTF meshes are written with z up, not y as the format has it, to judge by %s; they are taken so",
            source,
            "the centers of mass" if fit_either_way else "the other shapes of its links",
        )
        return turned
    return links


def _misfit(links: Sequence[Link]) -> tuple[float, float]:
    """Misfit of visuals and collision shapes, and of centers of mass and the middle of links, relative to link size."""
    shapes = masses = 0.0
    for link in links:
        boxes = [bounding_box(solids, identity()) for solids in (link.visuals, link.collisions) if solids]
        if len(boxes) == 2:
            shapes += float(np.abs(boxes[0] - boxes[1]).max() / (np.ptp(boxes, axis=(0, 1)).max() or 1.0))
        if boxes and link.inertial is not None:
            box = boxes[0]
            masses += float(np.linalg.norm(link.inertial.com - box.mean(axis=0)) / (np.ptp(box, axis=0).max() or 1.0))
    return shapes, masses
