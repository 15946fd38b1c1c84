"""The default arms and obstacles of the lessons, and requirements for a teacher's own scene."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10, pi

from rr1plan.checks import counted
from rr1plan.errors import InputError
from rr1plan.model.flat_arm import FlatArm, flat_arm
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid
from rr1plan.robot.planar_arm import planar_arm
from rr1plan.scene import Scene
from rr1plan.scene.polygon_prism import polygon_prism
from rr1plan.scene.problem import JointGoal, Problem
from rr1plan.shapes import Box, Cylinder
from rr1plan.transforms import as_pose, rotation_about


def two_link_scene() -> Scene:
    """A 2R arm whose joints have limits, near a disc and a plate."""
    robot = planar_arm("RR", (1.0, 0.7), limits=((-2.5, 2.5), (-2.3, 2.3)))
    return (
        Scene(name="two links")
        .with_arm("arm", robot, q=(0.5, 0.9))
        .with_obstacle("disc", Cylinder(0.16, 0.2), (1.0, -0.75, 0.0), color=(0.71, 0.33, 0.29, 1.0))
        .with_obstacle("plate", Box((0.5, 0.16, 0.2)), (-0.35, 1.1, 0.0), color=(0.29, 0.48, 0.65, 1.0))
    )


def polygon_scene() -> Scene:
    """A 2R arm without joint limits, among a disc, a rotated box, a triangle and a concave polygon."""
    box = as_pose((-0.62, 0.82, 0.0)).copy()
    box[:3, :3] = rotation_about([0.0, 0.0, 1.0], 0.6)
    corner = [(-1.2, -0.5), (-0.85, -0.5), (-0.85, -0.62), (-1.08, -0.62), (-1.08, -0.9), (-1.2, -0.9)]
    return (
        Scene(name="polygons")
        .with_arm("arm", planar_arm("RR", (1.0, 0.7)), q=(0.3, 0.8))
        .with_obstacle("disc", Cylinder(0.15, 0.2), (0.25, 0.72, 0.0), color=(0.71, 0.33, 0.29, 1.0))
        .with_obstacle("box", Box((0.36, 0.2, 0.2)), box, color=(0.29, 0.48, 0.65, 1.0))
        .with_obstacle(
            "triangle", polygon_prism([(0.75, -1.2), (1.2, -1.05), (0.85, -0.75)], color=(0.49, 0.42, 0.62, 1.0))
        )
        .with_obstacle("corner", polygon_prism(corner, color=(0.85, 0.71, 0.29, 1.0)))
    )


def require_flat_arm(lesson: str, scene: Scene) -> tuple[str, FlatArm]:
    """The only arm of a scene, and its model as two joints in the plane.

    Raises:
        InputError: several arms, or one that is not two joints in a horizontal plane.
    """
    if len(scene.arms) != 1:
        raise InputError(f"lesson {lesson!r} needs a scene with one arm, and this one has {len(scene.arms)}")
    (name,) = scene.arms
    found = flat_arm(scene.arms[name])
    if found is None:
        raise InputError(
            f"lesson {lesson!r} needs an arm of two joints in a horizontal plane, and arm {name!r} is none; "
            "planar_arm makes such arms"
        )
    return name, found


def length_unit(turns: Sequence[bool]) -> str:
    """The unit of lengths in a configuration space, with a space before it; none for joints of both kinds."""
    return " rad" if all(turns) else "" if any(turns) else " m"


def length_scale(grid: CSpaceGrid) -> float:
    """The scale of lengths in a configuration space, 1 if both joints turn [rad or m].

    It is the widest travel over 2π, so that a step of this many rad and the same step times the scale are equal shares
    of their ranges; at least 1 if one joint turns.
    """
    return max(
        1.0 if turns else (high - low) / (2.0 * pi) for turns, (low, high) in zip(grid.turns, grid.ranges, strict=True)
    )


def length_digits(scale: float, digits: int = 2) -> int:
    """Decimals of lengths in a configuration space: more for a smaller scale of lengths."""
    return max(digits, digits - floor(log10(scale)))


def require_query(lesson: str, scene: Scene | None, problem: Problem | None) -> Problem | None:
    """A teacher's own query of one arm of two joints with a joint goal; None stands for the lesson's default.

    Raises:
        InputError: a scene without a query, another arm, or another goal.
    """
    if problem is None:
        if scene is not None:
            raise InputError(f"lesson {lesson!r} is about a query; pass problem=..., with a start and a joint goal")
        return None
    if len(problem.arms) != 1 or problem.nq != 2:
        raise InputError(
            f"lesson {lesson!r} needs an arm of two joints, the problem has {counted(problem.nq, 'joint')}"
        )
    if not isinstance(problem.goal[problem.arms[0]][0], JointGoal):
        raise InputError(f"lesson {lesson!r} needs a joint goal; solve_ik gives one for a position")
    return problem


def refuse_problem(lesson: str, problem: Problem | None) -> None:
    """Reject a query in a lesson that takes none.

    Raises:
        InputError: there is one.
    """
    if problem is not None:
        raise InputError(f"lesson {lesson!r} has no query; give it the scene alone")
