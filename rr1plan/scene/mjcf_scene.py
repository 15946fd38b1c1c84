"""Scenes from MJCF files: the robot as an arm, and its surroundings as obstacles."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from rr1plan.errors import FormatError, InputError
from rr1plan.robot.robot_builder import Choice, assemble, warn_of_unknown_velocities
from rr1plan.scene import Arm, Obstacle, Scene

if TYPE_CHECKING:
    from rr1plan.robot.mjcf import Surrounding

_log = logging.getLogger(__name__)
# Contacts of each with each stationary link are allowed one by one.
_MOST_SURROUNDINGS = 1000


def read_mjcf_scene(file: Path) -> Scene:
    """Read an MJCF file as a scene with the arm "arm"; bodies with a free joint are loose.

    Raises:
        FormatError: not a valid MJCF file, or too many bodies.
    """
    # Importing MuJoCo takes a fifth of a second.
    from rr1plan.robot.mjcf import read_mjcf

    content = read_mjcf(file)
    if len(content.surroundings) > _MOST_SURROUNDINGS:
        raise FormatError(
            f"has {len(content.surroundings)} things around the robot, expected at most {_MOST_SURROUNDINGS}", file
        )
    arm = Arm(assemble(content.tree, content.semantics, Choice()))
    warn_of_unknown_velocities(arm.robot, arm.robot.joint_names)
    obstacles: dict[str, Obstacle] = {}
    allowed: set[frozenset[str]] = set()
    for thing in content.surroundings:
        name = thing.name.replace("/", "_")
        while name == "arm" or name in obstacles:
            name += "_"
        obstacles[name] = _obstacle(file, thing)
        # Stationary links may rest on what stands.
        links = thing.excluded.union(content.standing if thing.stands else ())
        allowed.update(frozenset((f"arm/{link}", name)) for link in links)
    return Scene({"arm": arm}, obstacles, allowed=frozenset(allowed), name=content.tree.name)


def _obstacle(file: Path, thing: Surrounding) -> Obstacle:
    """A body as an obstacle: loose if it has a mass and shapes that can move."""
    if thing.mass is not None:
        try:
            return Obstacle(thing.geometries, thing.pose, thing.mass, thing.friction)
        except InputError as error:
            _log.warning("%s: body %r is free to move, it is taken as fixed: %s", file, thing.name, error)
    return Obstacle(thing.geometries, thing.pose)
