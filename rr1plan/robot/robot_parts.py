"""Parts of a robot: links, joints, shapes and masses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, Value, of_kind, read_only
from rr1plan.errors import InputError
from rr1plan.shapes import Color, Shape
from rr1plan.shapes.shapes import as_color
from rr1plan.transforms import as_pose, identity, rotation_about

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]


class _ReadOnlyArrays(Value):
    """Replaces arrays by read-only copies at construction."""

    def __post_init__(self) -> None:
        for name, value in self.__dict__.items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                object.__setattr__(self, name, read_only(value.copy()))


@dataclass(frozen=True, eq=False, repr=False)
class Inertial(_ReadOnlyArrays):
    """Mass properties of a link.

    Args:
        mass: Mass [kg].
        com: Center of mass in the link frame [m], shape (3,).
        inertia: Inertia about the center of mass, in link axes [kg m²], shape (3, 3).
        assumed: Whether it was computed from the link's shapes, not read from the robot's file.
    """

    mass: float
    com: Array
    inertia: Array
    assumed: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Geometry(_ReadOnlyArrays):
    """A shape of a link or an obstacle, at a pose.

    Args:
        name: Name of the shape.
        shape: The shape.
        pose: T_parent_shape, in the frame of its link or obstacle: (4, 4), or a position (3,) [m].
        color: Its color: "#rrggbb", "#rrggbbaa", rgb or rgba (0..1), or None.

    Raises:
        InputError: a name, shape, transform or color of the wrong kind.
    """

    name: str
    shape: Shape
    pose: Array = field(default_factory=identity)
    color: Color | None = None

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(
            self, name: str, shape: Shape, pose: ArrayLike | None = None, color: str | ArrayLike | None = None
        ) -> None: ...

    def __post_init__(self) -> None:
        of_kind("name of a shape", self.name, str)
        if not isinstance(self.shape, Shape):
            raise InputError(f"shape {self.name!r} is of type {type(self.shape).__name__}, expected a shape")
        object.__setattr__(self, "pose", as_pose(self.pose, f"pose of shape {self.name!r}"))
        if self.color is not None:
            object.__setattr__(self, "color", as_color(f"color of shape {self.name!r}", self.color))


@dataclass(frozen=True, eq=False, repr=False)
class Link(Value):
    """A rigid body.

    Args:
        name: Name of the link.
        inertial: Mass properties, or None if the link has no mass.
        visuals: Shapes to draw.
        collisions: Shapes to check for collision.
    """

    name: str
    inertial: Inertial | None = None
    visuals: tuple[Geometry, ...] = ()
    collisions: tuple[Geometry, ...] = ()

    def __repr__(self) -> str:
        mass = "no mass" if self.inertial is None else f"{self.inertial.mass:g} kg"
        return f"Link({self.name!r}, {mass}, {len(self.visuals)} visual, {len(self.collisions)} collision)"


@dataclass(frozen=True)
class Mimic:
    """The relation of a mimic joint to the joint that leads it: multiplier * (value of `joint`) + offset.

    Args:
        joint: Name of the leading joint.
        multiplier: Factor of its value.
        offset: Value of the mimic joint where the leading joint is at zero [rad or m].
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Joint(_ReadOnlyArrays):
    """A joint between a parent and a child link.

    Args:
        name: Joint name.
        kind: Revolute, continuous (no position limits), prismatic or fixed.
        parent: Parent link.
        child: Child link.
        origin: T_parent_joint, shape (4, 4).
        axis: Unit axis in the joint frame, shape (3,).
        lower, upper: Position limits [rad or m]; -inf and inf for a continuous joint.
        velocity: Highest speed [rad/s or m/s].
        effort: Highest torque or force [Nm or N].
        damping: Viscous friction [Nm s/rad or N s/m].
        friction: Coulomb friction [Nm or N].
        mimic: The leading joint and the relation to it, or None.
        acceleration: Highest acceleration [rad/s² or m/s²]; inf if unknown.
        jerk: Highest jerk [rad/s³ or m/s³]; inf if unknown.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Array = field(default_factory=identity)
    axis: Array = field(default_factory=lambda: read_only(np.array([0.0, 0.0, 1.0])))
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf
    damping: float = 0.0
    friction: float = 0.0
    mimic: Mimic | None = None
    acceleration: float = np.inf
    jerk: float = np.inf

    @property
    def unit(self) -> str:
        """Unit of its values, "m" for a prismatic joint and "rad" for others."""
        return "m" if self.kind == "prismatic" else "rad"

    def motion(self, value: float) -> Array:
        """T_joint_child at a joint value [rad or m], shape (4, 4)."""
        T = np.eye(4)
        if self.kind == "prismatic":
            T[:3, 3] = value * self.axis
        elif self.kind != "fixed":
            T[:3, :3] = rotation_about(self.axis, value)
        return T
