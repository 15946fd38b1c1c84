"""Elements of a scene: placed arms, obstacles, attached objects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeVar

from numpy.typing import ArrayLike

from rr1plan.checks import (
    HEAVIEST,
    Array,
    Value,
    items_of,
    number_from_zero,
    of_kind,
    positive_number,
    shape_of,
    shown,
)
from rr1plan.errors import InputError
from rr1plan.robot import Geometry, Robot
from rr1plan.shapes import HalfSpace, Mesh, PointCloud
from rr1plan.shapes.convex_hulls import is_own_hull
from rr1plan.transforms import as_pose, identity

Pair = frozenset[str]
_Kind = TypeVar("_Kind")
# Largest friction coefficient; rubber has about one, and MuJoCo's squares of much larger ones overflow.
_MOST_FRICTION = 1e6


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Arm(Value):
    """A robot at a base pose, in a configuration.

    Args:
        robot: The robot.
        base: T_world_base, shape (4, 4).
        q: Values of its planning joints [rad or m], shape (nq,) (default: home).
    """

    robot: Robot
    base: Array
    q: Array

    def __init__(self, robot: Robot, base: ArrayLike | None = None, q: str | ArrayLike = "home") -> None:
        of_kind("robot", robot, Robot)
        object.__setattr__(self, "robot", robot)
        object.__setattr__(self, "base", as_pose(base, "arm base"))
        object.__setattr__(self, "q", robot.configuration(q, "arm configuration"))


def unchecked(kind: type[_Kind], **fields: Any) -> _Kind:
    """An immutable value of fields that are known to be valid, without the checks of its class."""
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def moved_arm(arm: Arm, q: str | ArrayLike) -> Arm:
    """The arm in another configuration: its name, or numbers [rad or m], shape (nq,).

    Raises:
        UnknownNameError: no configuration of that name.
        InputError: numbers that do not fit the arm.
    """
    return unchecked(Arm, robot=arm.robot, base=arm.base, q=arm.robot.configuration(q, "arm configuration"))


@dataclass(frozen=True, eq=False, repr=False)
class Obstacle(Value):
    """A rigid object in the world, with one shape or several.

    An obstacle with a mass is a loose body in simulations: it falls, is pushed and can be grasped. For planners it is
    fixed at its pose.

    Args:
        geometries: Its shapes, posed in the object's frame; convex ones for a loose body.
        pose: T_world_object, shape (4, 4).
        mass: Mass of a loose body [kg], distributed evenly in its shapes; None: fixed.
        friction: Coulomb friction coefficient of a loose body, also of an object that only `simulate_sequence` makes
            loose; of two loose bodies that touch, the larger one counts, and that of a fixed obstacle never does.

    Raises:
        InputError: no shape, a mass that is not positive, a negative friction or one above 1e6, or a mass and a
            shape that cannot move.
    """

    geometries: tuple[Geometry, ...]
    pose: Array = field(default_factory=identity)
    mass: float | None = None
    friction: float = 1.0

    if TYPE_CHECKING:  # accepted types; the fields above have the stored ones

        def __init__(
            self,
            geometries: Iterable[Geometry],
            pose: ArrayLike | None = None,
            mass: float | None = None,
            friction: float = 1.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "geometries", _posed_shapes(self.geometries))
        object.__setattr__(self, "pose", as_pose(self.pose, "obstacle pose"))
        _check_loose_body(self)


def _check_loose_body(thing: Obstacle | Attachment) -> None:
    """Check mass and friction, and convert them to floats."""
    object.__setattr__(thing, "friction", number_from_zero("friction", thing.friction))
    if thing.friction > _MOST_FRICTION:
        raise InputError(f"friction is {thing.friction:g}, expected a coefficient of at most {_MOST_FRICTION:g}")
    if thing.mass is None:
        return
    object.__setattr__(thing, "mass", positive_number("mass", thing.mass))
    if thing.mass > HEAVIEST:
        raise InputError(f"mass is {thing.mass:g} kg, expected at most {HEAVIEST:g} kg")
    for geometry in thing.geometries:
        shape = geometry.shape
        if isinstance(shape, HalfSpace | PointCloud):
            raise InputError(f"shape {geometry.name!r} is a {type(shape).__name__}, which cannot have a mass")
        if isinstance(shape, Mesh) and not shape.convex and not is_own_hull(shape):
            raise InputError(
                f"mesh {geometry.name!r} of an object with a mass is not convex; take its hull "
                "(load_mesh(..., hull=True)), or load_body(..., convex='pieces'); in a scene file "
                "mesh = { file = ..., convex = 'hull' } or 'pieces'"
            )


def _posed_shapes(values: Any) -> tuple[Geometry, ...]:
    """Posed shapes, at least one.

    Raises:
        InputError: not shapes, or none.
    """
    try:
        geometries = tuple(values)
    except TypeError:
        geometries = (values,)
    if not all(isinstance(one, Geometry) for one in geometries):
        advice = "; load_mesh reads a mesh file" if isinstance(values, str | PathLike) else ""
        if len(shape_of(values)) == 2:
            advice = "; PointCloud(points, resolution) and Mesh(vertices, faces) are shapes from arrays"
        if isinstance(values, Obstacle):
            advice = "; with_obstacles({name: obstacle}) adds an Obstacle, such as that of load_body"
        raise InputError(
            f"got {shown(values)} as an object's shape, expected a shape such as Box((1, 1, 1)) in "
            f"with_obstacle, or a list of Geometry(name, shape, pose){advice}"
        )
    if not geometries:
        raise InputError("an object of a scene has at least one shape, got none")
    return geometries


@dataclass(frozen=True, eq=False, repr=False)
class Attachment(Value):
    """An object that moves with a link.

    Args:
        geometries: Its shapes, posed in the object's frame, at least one.
        arm: The arm that holds it.
        link: The link it is fixed to.
        pose: T_link_object, shape (4, 4).
        touch: Links of that arm it may touch (always its own link).
        mass: Its mass, which counts in simulations and torques [kg]; None: unknown, treated as weightless.
        friction: Its Coulomb friction coefficient, as in `Obstacle`.
    """

    geometries: tuple[Geometry, ...]
    arm: str
    link: str
    pose: Array
    touch: frozenset[str] = frozenset()
    mass: float | None = None
    friction: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "geometries", _posed_shapes(self.geometries))
        object.__setattr__(self, "pose", as_pose(self.pose, "pose of the held object"))
        object.__setattr__(self, "touch", frozenset(items_of("touch", self.touch, "links")))
        _check_loose_body(self)


def pair(a: str, b: str) -> Pair:
    """The unordered pair of two element names."""
    return frozenset((a, b))


def names_of_pair(both: Pair) -> list[str]:
    """The two names of a pair, in order; twice the same for a pair of one element with itself."""
    return sorted(both) * (2 if len(both) == 1 else 1)
