"""The segments of a sequence: actions that follow each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, Literal, overload

from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    Value,
    check_text,
    finite_number,
    items_of,
    known_name,
    millimeters,
    near_array,
    positive_number,
    shown,
    true_or_false,
)
from rr1plan.errors import InputError
from rr1plan.scene import Pair, pair
from rr1plan.scene.problem import Goal, GoalLike, GoalsByArm, JointGoal, PoseGoal, goal_alternatives

# Longest pause and gripper motion [s].
_LONGEST = 3600.0
_Pairs = Iterable[tuple[str, str]]


@dataclass(frozen=True, eq=False, repr=False)
class FreeMotion(Value):
    """Move to a goal along any free path.

    Among several goals and configurations, the first one is used from which the following segments can be planned.

    Args:
        goal: Like the goal of a `Problem`: a configuration, a pose, a region, or a list of alternatives; for several
            arms that move at once, a mapping by arm. The frame of a `PoseGoal` may be a held object.
        arm: The arm (default: the only one, or those of a mapping).
        allow: Pairs of elements (or arms, for all their links) that may touch during this segment.
        stop: Whether to come to rest at its end. Otherwise the corner to the next segment of the same arms is rounded
            if that is free of collision, so that its end is passed at a small distance.
    """

    goal: GoalLike | Mapping[str, GoalLike]
    _: KW_ONLY
    arm: str | None = None
    allow: frozenset[Pair] = frozenset()
    stop: bool = True

    if TYPE_CHECKING:  # accepted types; the fields above have the stored types

        @overload
        def __init__(
            self,
            goal: Sequence[Goal | str] | GoalsByArm,
            *,
            arm: str | None = None,
            allow: _Pairs = (),
            stop: bool = True,
        ) -> None: ...

        @overload
        def __init__(
            self,
            goal: GoalLike | Mapping[str, GoalLike],
            *,
            arm: str | None = None,
            allow: _Pairs = (),
            stop: bool = True,
        ) -> None: ...

        def __init__(self, goal: Any, *, arm: str | None = None, allow: _Pairs = (), stop: bool = True) -> None: ...

    def __post_init__(self) -> None:
        _check_arm_and_pairs(self)
        true_or_false("stop", self.stop)
        if isinstance(self.goal, Mapping) and self.arm is not None:
            raise InputError("FreeMotion got an arm and goals by arm, expected one of them")

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        if isinstance(self.goal, Mapping):
            return f"free motion of {' and '.join(map(str, self.goal))}"
        goals = goal_alternatives(self.goal)
        return f"free motion to {_place(goals[0])}" if len(goals) == 1 else f"free motion to one of {len(goals)} goals"


@dataclass(frozen=True, eq=False, repr=False)
class StraightLine(Value):
    """Move the tool along a straight line, to a pose or by an offset.

    With a quaternion the orientation is interpolated, without one it is free; with an offset it is kept.

    Args:
        goal: A `PoseGoal` or a list of alternatives; its frame may be a held object. None if an offset is given.
        offset: Displacement of the tool [m], shape (3,).
        axes: The axes of the offset: those of the "world", or of the "tool".
        arm: The arm (default: the only one).
        allow: Pairs of elements that may touch during this segment, such as a held object and its support.
        stop: Whether to come to rest at its end, see `FreeMotion`.
    """

    goal: tuple[PoseGoal, ...] = ()
    _: KW_ONLY
    offset: Array | None = None
    axes: Literal["world", "tool"] = "world"
    arm: str | None = None
    allow: frozenset[Pair] = frozenset()
    stop: bool = True

    if TYPE_CHECKING:  # accepted types; the fields above have the stored types

        def __init__(
            self,
            goal: PoseGoal | Sequence[PoseGoal] | None = None,
            *,
            offset: ArrayLike | None = None,
            axes: Literal["world", "tool"] = "world",
            arm: str | None = None,
            allow: _Pairs = (),
            stop: bool = True,
        ) -> None: ...

    def __post_init__(self) -> None:
        _check_arm_and_pairs(self)
        true_or_false("stop", self.stop)
        goals = () if self.goal is None else goal_alternatives(self.goal)
        if bool(goals) == (self.offset is not None):
            raise InputError("StraightLine takes either a goal or an offset")
        check_text("axes", self.axes)
        known_name("axes", self.axes, ("world", "tool"))
        if self.offset is not None:
            object.__setattr__(self, "offset", near_array("offset", self.offset, (3,)))
        for goal in goals:
            if not isinstance(goal, PoseGoal):
                raise InputError(
                    f"the goal of a straight line is {shown(goal)}, expected a PoseGoal; a displacement is its option "
                    "offset"
                )
        object.__setattr__(self, "goal", goals)

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        if self.offset is not None:
            return f"straight line {_shift(self.offset, self.axes == 'tool')}"
        several = len(self.goal) > 1
        return (
            f"straight line to one of {len(self.goal)} goals" if several else f"straight line to {_place(self.goal[0])}"
        )


@dataclass(frozen=True, eq=False, repr=False)
class MoveGripper(Value):
    """Open or close a gripper while its arm rests.

    Args:
        position: A named state of the robot such as "open", or the gripper's joint value [rad or m].
        width: Alternatively, the thickness of a plate that just fits between the fingers, beyond the tool frame [m].
        around: Alternatively, an object: the fingers close until they touch it, and are commanded closer by `squeeze`.
        squeeze: Distance by which the fingers are commanded beyond contact [m]; this produces the grasp force.
        seconds: Least duration [s].
        arm: The arm (default: the only one).
        allow: Pairs of elements that may touch during this segment; with `around` fingers may touch the object anyway.
    """

    position: str | float | None = None
    _: KW_ONLY
    width: float | None = None
    around: str | None = None
    squeeze: float = 0.004
    seconds: float = 0.4
    arm: str | None = None
    allow: frozenset[Pair] = frozenset()

    if TYPE_CHECKING:  # accepted types; the fields above have the stored types

        def __init__(
            self,
            position: str | float | None = None,
            *,
            width: float | None = None,
            around: str | None = None,
            squeeze: float = 0.004,
            seconds: float = 0.4,
            arm: str | None = None,
            allow: _Pairs = (),
        ) -> None: ...

    def __post_init__(self) -> None:
        _check_arm_and_pairs(self)
        if sum(value is not None for value in (self.position, self.width, self.around)) != 1:
            raise InputError("MoveGripper takes one of a position, a width, and an object to close around")
        if self.position is not None and not isinstance(self.position, str):
            object.__setattr__(self, "position", finite_number("position", self.position))
        if self.width is not None:
            object.__setattr__(self, "width", positive_number("width", self.width))
        if self.around is not None:
            check_text("around", self.around)
        object.__setattr__(self, "squeeze", _not_negative("squeeze", self.squeeze))
        object.__setattr__(self, "seconds", _not_negative("seconds", self.seconds))

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        if self.around is not None:
            return f"gripper around {self.around!r}"
        if self.width is not None:
            return f"gripper to {millimeters(self.width, 4)}"
        if isinstance(self.position, str):
            return f"gripper to {self.position!r}"
        return f"gripper joint to {self.position:.4g}"


@dataclass(frozen=True, eq=False, repr=False)
class Attach(Value):
    """Attach an obstacle to an arm; from here on it moves with the arm.

    Args:
        obstacle: The obstacle.
        arm: The arm (default: the only one).
        link: The link that holds it (default: the robot's tool).
        touch: Links of the arm that it may touch (default: those of the gripper).
    """

    obstacle: str
    _: KW_ONLY
    arm: str | None = None
    link: str | None = None
    touch: tuple[str, ...] | None = None

    if TYPE_CHECKING:  # accepted types; the fields above have the stored types

        def __init__(
            self,
            obstacle: str,
            *,
            arm: str | None = None,
            link: str | None = None,
            touch: Iterable[str] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        check_text("obstacle", self.obstacle)
        for name in ("arm", "link"):
            if getattr(self, name) is not None:
                check_text(name, getattr(self, name))
        if self.touch is not None:
            links = items_of("touch", self.touch, "links")
            for link in links:
                check_text("one of touch", link)
            object.__setattr__(self, "touch", links)

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        return f"attach {self.obstacle!r}"


@dataclass(frozen=True, eq=False, repr=False)
class Detach(Value):
    """Detach a held object; from here on it is an obstacle at its current pose.

    At the end of a sequence, fingers and the rest of the hand may still touch it. Earlier, later segments decide.

    Args:
        name: The held object.
    """

    name: str

    def __post_init__(self) -> None:
        check_text("name", self.name)

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        return f"detach {self.name!r}"


@dataclass(frozen=True, eq=False, repr=False)
class Pause(Value):
    """A pause without motion.

    Args:
        seconds: Duration [s].
    """

    seconds: float

    def __post_init__(self) -> None:
        if positive_number("seconds", self.seconds) > _LONGEST:
            raise InputError(f"a pause of {self.seconds:g} s, expected at most {_LONGEST:g} s")
        object.__setattr__(self, "seconds", float(self.seconds))

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        return f"pause of {self.seconds:g} s"


Segment = FreeMotion | StraightLine | MoveGripper | Attach | Detach | Pause


def _check_arm_and_pairs(segment: Any) -> None:
    if segment.arm is not None:
        check_text("arm", segment.arm)
    pairs = []
    for both in items_of("allow", segment.allow, "pairs of names"):
        names = tuple(items_of("one of allow", both, "names"))
        for name in names:
            check_text("an allowed element", name)
        if len(set(names)) != 2:
            raise InputError(f"one of allow is {shown(names)}, expected two names")
        pairs.append(pair(*names))
    object.__setattr__(segment, "allow", frozenset(pairs))


def _not_negative(name: str, value: object) -> float:
    number = finite_number(name, value)
    if not 0.0 <= number <= _LONGEST:
        raise InputError(f"{name} is {number:g}, expected a number from 0 to {_LONGEST:g}")
    return number


def _place(goal: object) -> str:
    """A goal in a few words."""
    if isinstance(goal, PoseGoal):
        return f"{goal.frame!r} at {_vector(goal.position)} m"
    if isinstance(goal, str):
        return f"{str(goal)!r}"
    return "a configuration" if not isinstance(goal, Goal) or isinstance(goal, JointGoal) else "a region"


def _shift(offset: Array, in_tool: bool) -> str:
    """An offset in a few words."""
    if offset[0] == offset[1] == 0.0:
        ways = ("back", "ahead") if in_tool else ("down", "up")
        return f"{millimeters(abs(float(offset[2])), 4)} {ways[int(offset[2] > 0.0)]}"
    return f"by {_vector(offset)} m{' in the axes of the tool' * in_tool}"


def _vector(values: Array) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in values.tolist()) + "]"
