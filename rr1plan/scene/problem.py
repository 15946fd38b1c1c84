"""Planning problems: a scene, the moving arms, their start configurations and goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from numbers import Number
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    Value,
    check_text,
    finite_array,
    known_name,
    near_array,
    number_from_zero,
    of_kind,
    positive_number,
    read_only,
    shape_of,
    shown,
)
from rr1plan.errors import InputError
from rr1plan.notebook_view import NotebookView
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.scene_elements import unchecked
from rr1plan.transforms import as_pose, quaternion_from_rotation, rotation_from_quaternion, unit_quaternion

_GOALS = "a goal mapping from arm to goal, such as dict(zip(scene.arms, goals, strict=True)) or scene.split(q)"


@dataclass(frozen=True, eq=False, repr=False)
class JointGoal(Value):
    """Reach a configuration.

    Args:
        q: A configuration's name, or its numbers [rad or m], shape (nq,).
    """

    q: Array

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(self, q: str | ArrayLike) -> None: ...


@dataclass(frozen=True, eq=False, repr=False)
class PoseGoal(Value):
    """Bring a frame to a position or a pose in the world.

    Args:
        frame: A link of the arm, or "tool" for the robot's tool.
        position: Target of the frame's origin [m], shape (3,); or a pose T_world_frame, shape (4, 4).
        quaternion: Target orientation of the frame, wxyz; None leaves the orientation free.
        position_tolerance: Largest distance from the target [m].
        orientation_tolerance: Largest rotation angle from the target [rad].

    After construction `position` is (3,) and `quaternion` a unit quaternion or None.

    Raises:
        InputError: not finite, wrong shape, or the orientation given twice.
    """

    frame: str
    position: Array
    quaternion: Array | None = None
    _: KW_ONLY
    position_tolerance: float = 1e-4
    orientation_tolerance: float = 1e-3

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(
            self,
            frame: str,
            position: ArrayLike,
            quaternion: ArrayLike | None = None,
            *,
            position_tolerance: float = 1e-4,
            orientation_tolerance: float = 1e-3,
        ) -> None: ...

    def __post_init__(self) -> None:
        check_text("frame", self.frame)
        if shape_of(self.position) == (4, 4):
            if self.quaternion is not None:
                raise InputError("PoseGoal got a full pose and a quaternion, expected one of them")
            T = as_pose(self.position, "goal pose")
            quaternion: Array | None = unit_quaternion(quaternion_from_rotation(T[:3, :3]))
            position = T[:3, 3].copy()
        else:
            position = near_array("goal position", self.position, (3,))
            quaternion = None if self.quaternion is None else unit_quaternion(self.quaternion)
        positive_number("position_tolerance", self.position_tolerance)
        positive_number("orientation_tolerance", self.orientation_tolerance)
        object.__setattr__(self, "position", read_only(position))
        object.__setattr__(self, "quaternion", quaternion)

    @property
    def rotation(self) -> Array | None:
        """Target rotation matrix R_world_frame (3, 3), or None if the orientation is free."""
        return None if self.quaternion is None else rotation_from_quaternion(self.quaternion)


@dataclass(frozen=True, eq=False, repr=False)
class RegionGoal(Value):
    """Bring a frame's origin anywhere into a box of the world.

    Args:
        frame: A link of the arm, or "tool" for the robot's tool.
        lower: Lowest corner [m], shape (3,).
        upper: Highest corner [m], shape (3,).
        quaternion: Target orientation of the frame, wxyz; None leaves the orientation free.
        orientation_tolerance: Largest rotation angle from the target [rad].

    Raises:
        InputError: not finite, wrong shape, or lower above upper.
    """

    frame: str
    lower: Array
    upper: Array
    quaternion: Array | None = None
    _: KW_ONLY
    orientation_tolerance: float = 1e-3

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(
            self,
            frame: str,
            lower: ArrayLike,
            upper: ArrayLike,
            quaternion: ArrayLike | None = None,
            *,
            orientation_tolerance: float = 1e-3,
        ) -> None: ...

    def __post_init__(self) -> None:
        lower = near_array("region lower", self.lower, (3,))
        upper = near_array("region upper", self.upper, (3,))
        if (lower > upper).any():
            raise InputError(f"region has lower {lower.tolist()} above upper {upper.tolist()}")
        if self.quaternion is not None:
            object.__setattr__(self, "quaternion", unit_quaternion(self.quaternion))
        positive_number("orientation_tolerance", self.orientation_tolerance)
        object.__setattr__(self, "lower", read_only(lower))
        object.__setattr__(self, "upper", read_only(upper))


Goal = JointGoal | PoseGoal | RegionGoal
"""Any goal of an arm."""
# Accepted goals of an arm: a goal, a configuration's name or numbers, or a list of those.
GoalLike = Goal | ArrayLike | Sequence[Goal | ArrayLike]
# The type of mappings by arm to goals and lists of goals, which a type checker infers where it fails at GoalLike.
GoalsByArm = Mapping[str, Goal | Sequence[Goal | str]]


@dataclass(frozen=True, eq=False, init=False)
class Problem(Value, NotebookView):
    """A planning problem.

    Args:
        scene: The scene. Arms that do not move keep their configuration of the scene.
        start: Start of the moving arms: for one arm a configuration's name or numbers (nq,); for
            several a mapping by arm (a missing arm starts in its configuration of the scene).
            None: the configurations of the scene.
        goal: For one arm a goal, a configuration's name or numbers, or a list of alternatives;
            for several a mapping from arm to one of those.
        arms: The arms that move. Default: the arms of a goal mapping, or the only arm.

    Attributes:
        margin: Distance to keep beyond the scene's padding [m]: 0, or as set by `with_margin`.

    After construction `start` is the composite configuration (nq,), `goal` a mapping from arm to a
    tuple of alternatives, `arms` the moving arms in the order of the scene. The goal of a moving arm
    without an entry in `goal` is its start.

    Raises:
        InputError, UnknownNameError: names, shapes or numbers that do not fit the scene.
    """

    scene: Scene
    start: Array
    goal: Mapping[str, tuple[Goal, ...]]
    arms: tuple[str, ...]
    margin: float = field(default=0.0, init=False)

    # A type checker infers the type of lists of different goals only from a signature that takes few other types.
    @overload
    def __init__(
        self,
        scene: Scene,
        start: ArrayLike | Mapping[str, ArrayLike] | None,
        goal: Sequence[Goal | str] | GoalsByArm,
        *,
        arms: str | Sequence[str] | None = None,
    ) -> None: ...

    @overload
    def __init__(
        self,
        scene: Scene,
        start: ArrayLike | Mapping[str, ArrayLike] | None,
        goal: GoalLike | Mapping[str, GoalLike],
        *,
        arms: str | Sequence[str] | None = None,
    ) -> None: ...

    def __init__(
        self,
        scene: Scene,
        start: ArrayLike | Mapping[str, ArrayLike] | None,
        goal: GoalLike | Mapping[str, GoalLike],
        *,
        arms: str | Sequence[str] | None = None,
    ) -> None:
        of_kind("scene", scene, Scene)
        moving = _moving_arms(scene, goal, arms)
        object.__setattr__(self, "scene", scene)
        object.__setattr__(self, "start", read_only(_start(scene, moving, start)))
        object.__setattr__(self, "goal", MappingProxyType(_goals(scene, moving, self.start, goal)))
        object.__setattr__(self, "arms", moving)
        object.__setattr__(self, "margin", 0.0)

    def __repr__(self) -> str:
        goals = [f"{arm}: {' or '.join(type(g).__name__ for g in goals)}" for arm, goals in self.goal.items()]
        return f"Problem({self.scene.name!r}, {', '.join(goals)})"

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Column names "arm/joint" of the moving arms."""
        return self.scene.joint_names(self.arms)

    @property
    def nq(self) -> int:
        """Number of columns."""
        return len(self.start)

    @cached_property
    def columns(self) -> Mapping[str, slice]:
        """The columns of each moving arm."""
        ends = np.cumsum([self.scene.arms[name].robot.nq for name in self.arms]).tolist()
        parts = (slice(first, end) for first, end in zip([0, *ends], ends, strict=False))
        return MappingProxyType(dict(zip(self.arms, parts, strict=True)))

    def with_margin(self, distance: float) -> Problem:
        """The same problem with a margin of `distance` [m] added to the padding of pairs with relative motion.

        Raises:
            InputError: negative or not finite.
        """
        kept = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return unchecked(Problem, **kept | {"margin": number_from_zero("margin", distance)})

    def in_scene(self, scene: Scene) -> Problem:
        """The same problem in another scene; joint values are matched by joint name.

        Raises:
            UnknownNameError: the scene has no arm or frame of that name.
            InputError: an arm has other joints in `scene`.
        """
        of_kind("scene", scene, Scene)
        start: dict[str, Array] = {}
        goal: dict[str, list[Goal]] = {}
        configurations = self.scene.split(self.start, self.arms)
        for arm in self.arms:
            old, new = self.scene.arms[arm].robot.joint_names, scene.arm(arm).robot.joint_names
            if set(old) != set(new):
                raise InputError(
                    f"the problem moves the joints {', '.join(old)} of arm {arm!r}, which has {', '.join(new)} here"
                )
            order = [old.index(name) for name in new]
            start[arm] = configurations[arm][order]
            goal[arm] = [JointGoal(g.q[order]) if isinstance(g, JointGoal) else g for g in self.goal[arm]]
        return Problem(scene, start, goal, arms=self.arms).with_margin(self.margin)


def subproblem(problem: Problem, arms: tuple[str, ...], scene: Scene) -> Problem:
    """The problem of some of the moving arms, without its margin; what was checked once is not checked again.

    Args:
        problem: The problem.
        arms: Some of its arms, in its order.
        scene: A scene in which these arms are the same.
    """
    start = np.concatenate([problem.start[problem.columns[name]] for name in arms])
    goal = MappingProxyType({name: problem.goal[name] for name in arms})
    return unchecked(Problem, scene=scene, start=read_only(start), goal=goal, arms=arms, margin=0.0)


def _moving_arms(scene: Scene, goal: object, arms: str | Sequence[str] | None) -> tuple[str, ...]:
    """The arms that move, in the order of the scene."""
    if arms is not None:
        return scene.arm_names(arms)
    if isinstance(goal, Mapping):
        if not goal:
            raise InputError("goal is an empty mapping, expected a goal of at least one arm")
        _check_arms("goal", goal, scene)
        return scene.arm_names(list(goal))
    if len(scene.arms) > 1:
        names = ", ".join(scene.arms)
        raise InputError(f"which arm moves? expected {_GOALS}, or arms=[...] of {names}")
    return (scene.only_arm(),)


def _start(scene: Scene, arms: tuple[str, ...], start: Any) -> Array:
    """The composite start configuration (nq,)."""
    robots = {name: scene.arms[name].robot for name in arms}
    if start is None:
        given: Mapping[str, Any] = {}
    elif isinstance(start, Mapping):
        given = start
        _check_arms("start", given, scene)
        _check_moving("start", given, scene, arms)
    elif len(arms) == 1:
        given = {arms[0]: start}
    elif isinstance(start, str):
        given = dict.fromkeys(arms, start)
    else:
        values = finite_array("start", start, (sum(r.nq for r in robots.values()),))
        given = scene.split(values, arms)
    return np.concatenate(
        [robots[n].configuration(given[n], f"start of {n!r}") if n in given else scene.arms[n].q for n in arms]
    )


def _goals(scene: Scene, arms: tuple[str, ...], start: Array, goal: object) -> dict[str, tuple[Goal, ...]]:
    """The alternatives of each arm; its start for an arm without a goal."""
    if isinstance(goal, Mapping):
        given = dict(goal)
        _check_moving("goal", given, scene, arms)
    elif len(arms) == 1:
        given = {arms[0]: goal}
    else:
        raise InputError(f"{len(arms)} arms move ({', '.join(arms)}); expected {_GOALS}")
    starts = scene.split(start, arms)
    return {name: _alternatives(scene.arms[name].robot, name, given.get(name, starts[name])) for name in arms}


def _check_arms(what: str, given: Mapping[str, Any], scene: Scene) -> None:
    """Refuse a start or goal by joint, where one by arm is expected."""
    for arm, placed in scene.arms.items():
        known = placed.robot.joint_names
        joints = [name for name in given if name not in scene.arms and str(name).removeprefix(f"{arm}/") in known]
        if joints:
            raise InputError(
                f"{what} names the joint {joints[0]!r}, expected a mapping from arm to its joint values: "
                f"{{{arm!r}: [...]}}, in the order of robot.joint_names"
            )


def _check_moving(what: str, given: Mapping[str, Any], scene: Scene, arms: tuple[str, ...]) -> None:
    """Refuse a start or goal of an arm that does not move."""
    for name in given:
        if known_name("arm", name, scene.arms) not in arms:
            raise InputError(
                f"{what} names arm {name!r}, which does not move: without a goal an arm moves if arms=[...] names it, "
                "and rests where scene.with_configuration(...) puts it if not"
            )


def goal_alternatives(goal: object) -> tuple[object, ...]:
    """The alternatives of a goal of one arm, as given."""
    if isinstance(goal, Sequence) and not isinstance(goal, str) and not _is_numbers(goal):
        return tuple(goal)
    return (goal,)


def _alternatives(robot: Robot, arm: str, goal: Any) -> tuple[Goal, ...]:
    alternatives = tuple(_one_goal(robot, arm, g) for g in goal_alternatives(goal))
    if not alternatives:
        raise InputError(f"the goal of {arm!r} is an empty list, expected at least one goal")
    return alternatives


def _is_numbers(value: Sequence[object]) -> bool:
    return len(value) > 0 and all(isinstance(v, Number) for v in value)


def _one_goal(robot: Robot, arm: str, goal: Any) -> Goal:
    """Validate a goal given as a goal, a configuration's name or its numbers."""
    if isinstance(goal, PoseGoal | RegionGoal):
        robot.link(frame_link(robot, goal.frame))
        return goal
    if not isinstance(goal, JointGoal | str) and not shape_of(goal):
        raise InputError(
            f"goal of {arm!r} is {shown(goal)}, expected a JointGoal, PoseGoal or RegionGoal, a configuration's name "
            "or its numbers, or a list of these"
        )
    q = goal.q if isinstance(goal, JointGoal) else goal
    shape = shape_of(q)
    if shape in ((3,), (4, 4)) and shape != (robot.nq,):
        raise InputError(
            f"goal of {arm!r} has shape {shape}, expected {robot.nq} joint values; for a position or a pose give "
            "PoseGoal('tool', ...), in a scene file { frame = \"tool\", position = [x, y, z] }"
        )
    return JointGoal(robot.configuration(q, f"goal of {arm!r}"))


def frame_link(robot: Robot, frame: str) -> str:
    """The link of a goal's frame; "tool" is the robot's tool, even if another link has that name.

    Raises:
        UnknownNameError: no such link.
    """
    if frame == "tool":
        return robot.tool
    return known_name("frame", frame, tuple(dict.fromkeys(("tool", *robot.link_names))))
