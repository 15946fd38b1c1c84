"""The arms and obstacles of the lessons, and what a lesson requires of a teacher's own."""

from __future__ import annotations

from rr1plan.errors import InputError
from rr1plan.model.flat_arm import FlatArm, flat_arm
from rr1plan.robot.planar_arm import planar_arm
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.shapes import Box, Cylinder


def two_link_scene() -> Scene:
    """A 2R arm whose joints have limits, beside a disc and a plate."""
    robot = planar_arm("RR", (1.0, 0.7), limits=((-2.5, 2.5), (-2.3, 2.3)))
    return (
        Scene(name="two links")
        .with_arm("arm", robot, q=(0.5, 0.9))
        .with_obstacle("disc", Cylinder(0.16, 0.2), (1.0, -0.75, 0.0), color=(0.71, 0.33, 0.29, 1.0))
        .with_obstacle("plate", Box((0.5, 0.16, 0.2)), (-0.35, 1.1, 0.0), color=(0.29, 0.48, 0.65, 1.0))
    )


def require_flat_arm(lesson: str, scene: Scene) -> tuple[str, FlatArm]:
    """The only arm of a scene, and the arm as two joints in the plane.

    Raises:
        InputError: several arms, or one that is not two joints in a horizontal plane.
    """
    name = scene.only_arm(None)
    found = flat_arm(scene.arms[name])
    if found is None:
        raise InputError(
            f"lesson {lesson!r} needs an arm of two joints in a horizontal plane, and arm {name!r} is none; "
            "planar_arm makes such arms"
        )
    return name, found


def refuse_problem(lesson: str, problem: Problem | None) -> None:
    """Refuse a query in a lesson that has none.

    Raises:
        InputError: there is one.
    """
    if problem is not None:
        raise InputError(f"lesson {lesson!r} has no query; give it the scene alone")
