"""Masses of links that a robot's file gives none: those of their shapes, solid and of one density."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from rr1plan.checks import read_only
from rr1plan.errors import InputError
from rr1plan.formats.convex import convex_hull
from rr1plan.formats.link_contacts import coal_shape
from rr1plan.robot import Geometry, Inertial, Link, Robot
from rr1plan.shapes import Mesh

log = logging.getLogger(__name__)

# Of water; arms of motors, gears and hollow castings are about as dense [kg/m³].
DENSITY = 1000.0


def with_assumed_masses(robot: Robot) -> Robot:
    """The robot with a mass for each body that moves, has a shape and is given no mass; warns of them.

    A body is what fixed joints hold together. Its collision shapes count, or its visuals where it has none; a mere
    frame stays without mass.
    """
    found = {name: inertial for body in robot.bodies[1:] for name, inertial in _assumed(body)}
    if not found:
        return robot
    log.warning(
        "%s: links without a mass, taken as solid with %g kg/m³ (%.3g kg in all), torques are estimates: %s",
        robot.name,
        DENSITY,
        sum(inertial.mass for inertial in found.values()),
        ", ".join(found),
    )
    return replace(robot, links=tuple(replace(k, inertial=found.get(k.name, k.inertial)) for k in robot.links))


def _assumed(body: tuple[Link, ...]) -> Iterator[tuple[str, Inertial]]:
    """The links of a body that get a mass, and what they get."""
    if any(link.inertial is not None for link in body):
        return
    solid = any(link.collisions for link in body)
    for link in body:
        inertial = _inertial_of(link.collisions if solid else link.visuals)
        if inertial is not None:
            yield link.name, inertial


def _inertial_of(geometries: tuple[Geometry, ...]) -> Inertial | None:
    """Mass, center of mass and inertia of solid shapes, None for what has no volume; meshes count as their hulls."""
    total = pin.Inertia.Zero()
    for geometry in geometries:
        shape = geometry.shape
        if isinstance(shape, Mesh) and not shape.convex:
            try:
                shape = convex_hull(shape.vertices)
            except InputError:  # flat
                continue
        solid = coal_shape(shape)
        mass, center = DENSITY * solid.computeVolume(), solid.computeCOM().ravel()
        inertia = pin.Inertia(mass, center, DENSITY * solid.computeMomentofInertiaRelatedToCOM())
        total += inertia.se3Action(pin.SE3(np.array(geometry.pose)))
    if total.mass <= 0.0:
        return None
    return Inertial(
        float(total.mass), read_only(np.array(total.lever)), read_only(np.array(total.inertia)), assumed=True
    )
