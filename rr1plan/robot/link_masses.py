"""Estimated masses of links without `<inertial>`, from their shapes with uniform density."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from rr1plan.checks import HEAVIEST, read_only
from rr1plan.errors import InputError
from rr1plan.robot import Geometry, Inertial, Link, Robot
from rr1plan.robot.link_contacts import coal_solid
from rr1plan.shapes import Mesh
from rr1plan.shapes.convex_hulls import convex_hull

log = logging.getLogger(__name__)

# Density of water, similar to that of arms with motors, gears and hollow castings [kg/m³].
DENSITY = 1000.0


def with_assumed_masses(robot: Robot) -> Robot:
    """The robot with an estimated mass for each moving body with a shape but without a mass; logs a warning.

    A body is a group of links connected by fixed joints. The mass is that of its collision shapes, or of its visuals
    if it has none; a frame without shapes stays massless.

    Raises:
        InputError: shapes larger than any machine.
    """
    found = {name: inertial for body in robot.bodies[1:] for name, inertial in _assumed(body)}
    if not found:
        return robot
    for name, inertial in found.items():
        if max(inertial.mass, np.abs(inertial.inertia).max()) > HEAVIEST:
            raise InputError(
                f"{robot.name}: the shapes of link {name!r} would weigh {inertial.mass:.3g} kg, more than any machine "
                "(lengths are in meters: are these millimeters?)"
            )
    log.warning(
        "%s: links without a mass, taken as solid with %g kg/m³ (%.3g kg in all), torques are estimates: %s",
        robot.name,
        DENSITY,
        sum(inertial.mass for inertial in found.values()),
        ", ".join(found),
    )
    return replace(robot, links=tuple(replace(k, inertial=found.get(k.name, k.inertial)) for k in robot.links))


def _assumed(body: tuple[Link, ...]) -> Iterator[tuple[str, Inertial]]:
    """Links of a body without a mass, and their estimated inertials."""
    if any(link.inertial is not None for link in body):
        return
    solid = any(link.collisions for link in body)
    for link in body:
        inertial = solid_inertial(link.collisions if solid else link.visuals)
        if inertial is not None:
            yield link.name, inertial


def solid_inertial(geometries: tuple[Geometry, ...], mass: float | None = None) -> Inertial | None:
    """Mass, center of mass and inertia of solid shapes, with hulls for meshes.

    Args:
        geometries: The shapes; where they overlap, both count.
        mass: Their mass [kg] (default: that of `DENSITY`).

    Returns:
        The inertial, in the frame of the shapes; None without a volume.
    """
    total = pin.Inertia.Zero()
    for geometry in geometries:
        shape = geometry.shape
        if isinstance(shape, Mesh):
            try:  # also for convex meshes, whose faces may be oriented either way
                shape = convex_hull(shape.vertices)
            except InputError:  # flat
                continue
        solid = coal_solid(shape)
        weight, center = DENSITY * solid.computeVolume(), solid.computeCOM().ravel()
        own = pin.Inertia(weight, center, DENSITY * solid.computeMomentofInertiaRelatedToCOM())
        total += own.se3Action(pin.SE3(np.array(geometry.pose)))
    if total.mass <= 0.0:
        return None
    share = 1.0 if mass is None else mass / float(total.mass)
    inertia = read_only(share * np.array(total.inertia))
    return Inertial(share * float(total.mass), read_only(np.array(total.lever)), inertia, assumed=mass is None)
