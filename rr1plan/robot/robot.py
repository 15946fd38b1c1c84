"""Description of an arm, with reference kinematics in NumPy."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    FARTHEST,
    Array,
    Value,
    counted,
    finite_array,
    finite_number,
    is_near,
    known_name,
    of_kind,
    read_only,
    shape_of,
    shown,
)
from rr1plan.errors import InputError
from rr1plan.notebook_view import NotebookView
from rr1plan.robot.joint_limits import LIMIT_NAMES, Limits
from rr1plan.robot.robot_parts import Joint, Link
from rr1plan.shapes import Mesh
from rr1plan.shapes.content_digest import feed_digest

# Of a planning joint they are in the robot's limits; hashes of files from before joints had them stay valid.
_IN_LIMITS = ("acceleration", "jerk")
_ROUNDING = 1e-9  # joints may exceed their limits by this much [rad or m]


@dataclass(frozen=True, eq=False)
class Robot(Value, NotebookView):
    """Description of an arm. Build it with `rr1plan.load_robot`.

    Args:
        name: Name of the robot.
        links: All links, the base first.
        joints: All joints, each after the joint that moves its parent link.
        joint_names: The planning joints: the columns of q, in order.
        limits: Limits of the planning joints, in that order.
        configurations: Named configurations of the planning joints, each (nq,); has "home".
        locked_joints: Values of the actuated joints that are not planned for (a gripper), by name.
        disabled_collisions: Pairs of links that may touch or never can (SRDF `disable_collisions`).
        tool: The link whose frame is used for pose goals that do not name one.
        presets: Other limits by name, e.g. "sim" and "hardware".
        locked_joint_states: Named values of locked joints, e.g. {"open": {"finger_joint": 0.0}}.
        source: Origin of the description, for messages.
        load_options: Options with which `load_robot` read the source, for scene files: `srdf`, `package_dirs`,
            `convex`, `groups` and `xacro_arguments`, each unless it is the default.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    joint_names: tuple[str, ...]
    limits: Limits
    configurations: Mapping[str, Array]
    locked_joints: Mapping[str, float]
    disabled_collisions: frozenset[frozenset[str]]
    tool: str
    presets: Mapping[str, Limits] = field(default_factory=dict)
    locked_joint_states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    source: str = ""
    load_options: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("configurations", "locked_joints", "presets", "locked_joint_states", "load_options"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        configurations = {
            name: read_only(finite_array(f"configuration {name!r}", q, (self.nq,)))
            for name, q in self.configurations.items()
        }
        object.__setattr__(self, "configurations", MappingProxyType(configurations))
        if "home" not in self.configurations:
            raise InputError(f"robot {self.name!r} has no configuration 'home'")
        if len(self.limits) != self.nq:
            raise InputError(f"robot {self.name!r} has limits for {len(self.limits)} of {self.nq} joints")
        known_name("link", self.tool, self.link_names)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, joints=[{', '.join(self.joint_names)}])"

    # ---- reading -----------------------------------------------------------------------

    @property
    def nq(self) -> int:
        """Number of planning joints."""
        return len(self.joint_names)

    @property
    def home(self) -> Array:
        """The configuration named "home", shape (nq,)."""
        return self.configurations["home"]

    @property
    def base(self) -> str:
        """Name of the base link."""
        return self.links[0].name

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of all links (every one is a frame)."""
        return tuple(link.name for link in self.links)

    @cached_property
    def solid_links(self) -> tuple[str, ...]:
        """Names of the links with a collision shape."""
        return tuple(link.name for link in self.links if link.collisions)

    @cached_property
    def concave_meshes(self) -> tuple[tuple[str, Mesh], ...]:
        """The collision meshes that are not convex, each after the name of its link."""
        shapes = ((link.name, geometry.shape) for link in self.links for geometry in link.collisions)
        return tuple((link, shape) for link, shape in shapes if isinstance(shape, Mesh) and not shape.convex)

    @cached_property
    def bodies(self) -> tuple[tuple[Link, ...], ...]:
        """Groups of links connected by fixed joints, each one rigid body; the base's group is the first."""
        found = {self.base: [self.links[0]]}
        for joint in self.joints:
            body = found[joint.parent] if joint.kind == "fixed" else []
            body.append(self.link(joint.child))
            found[joint.child] = body
        return tuple(tuple(body) for body in {id(body): body for body in found.values()}.values())

    @cached_property
    def unchecked_links(self) -> tuple[str, ...]:
        """Links that are never checked for collision: links with a visual in a body without a collision shape.

        A link fixed to one with a collision shape, and a frame without a visual, do not count. If the robot has no
        collision shape, all links count.
        """
        if not self.solid_links:
            return self.link_names
        bare = (body for body in self.bodies if not any(link.collisions for link in body))
        return tuple(link.name for body in bare for link in body if link.visuals)

    @cached_property
    def links_of_assumed_mass(self) -> tuple[str, ...]:
        """Links whose mass was computed from their shapes because the robot's file has none."""
        return tuple(link.name for link in self.links if link.inertial is not None and link.inertial.assumed)

    @cached_property
    def continuous(self) -> Array:
        """Mask of turning planning joints without position limits (they wrap around), shape (nq,) of 0 and 1."""
        turning = np.array([self.joint(n).kind != "prismatic" for n in self.joint_names], dtype=np.bool_)
        endless = np.isinf(self.limits.lower) & np.isinf(self.limits.upper)
        return read_only((turning & endless).astype(np.float64))

    @cached_property
    def limited_joints(self) -> tuple[Joint, ...]:
        """All joints in the order of `joints`, planning joints with the limits of `limits`."""
        limited = {}
        for j, name in enumerate(self.joint_names):
            own: dict[str, Any] = {limit: float(getattr(self.limits, limit)[j]) for limit in LIMIT_NAMES}
            limited[name] = replace(self.joint(name), **own)
        return tuple(limited.get(joint.name, joint) for joint in self.joints)

    def joint(self, name: str) -> Joint:
        """A joint by name.

        Raises:
            UnknownNameError: no such joint.
        """
        return self._joints[known_name("joint", name, self._joints)]

    def link(self, name: str) -> Link:
        """A link by name.

        Raises:
            UnknownNameError: no such link.
        """
        return self._links[known_name("link", name, self._links)]

    def configuration(self, value: str | ArrayLike, name: str = "configuration") -> Array:
        """A configuration from its name or its numbers, shape (nq,), read-only.

        Args:
            value: Its name, or its numbers [rad or m], shape (nq,).
            name: Name of the argument, for messages.

        Raises:
            UnknownNameError: no configuration of that name.
            InputError: wrong shape, not finite, or too large.
        """
        if isinstance(value, str):
            return self.configurations[known_name("configuration", value, self.configurations)]
        if is_near(value, (self.nq,)):
            return read_only(value.copy())
        shape = shape_of(value)
        if shape != (self.nq,):
            got = f"has shape {shape}" if shape else f"is {shown(value)}"
            got = f"has {counted(shape[0], 'number')}" if len(shape) == 1 else got
            joints = ", ".join(self.joint_names)
            raise InputError(f"{name} {got}, expected {self.nq}: one for each of {joints}")
        entries: Any = value  # of that shape
        joints = ", ".join(n for n, v in zip(self.joint_names, entries, strict=True) if not _is_joint_value(v))
        if joints:
            got = shown(entries.tolist() if isinstance(entries, np.ndarray) else entries)
            raise InputError(f"{name} is {got}, expected finite numbers within ±{FARTHEST:g} (joint {joints})")
        return read_only(finite_array(name, value, (self.nq,)))

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of everything that affects plans: joints, limits, shapes, masses (hex)."""
        digest = hashlib.sha256()
        feed_digest(
            digest,
            (
                self.name,
                self.joint_names,
                dict(self.locked_joints),
                sorted(sorted(p) for p in self.disabled_collisions),
            ),
        )
        feed_digest(digest, [[getattr(self.limits, n) for n in LIMIT_NAMES]])
        for joint in self.joints:
            feed_digest(digest, [getattr(joint, n) for n in joint.__dataclass_fields__ if n not in _IN_LIMITS])
        for link in self.links:
            inertial = link.inertial
            feed_digest(
                digest, (link.name, () if inertial is None else (inertial.mass, inertial.com, inertial.inertia))
            )
            for g in link.collisions:
                feed_digest(digest, (g.name, g.pose, g.shape))
        return digest.hexdigest()

    # ---- other values of the same robot -------------------------------------------------

    def with_limits(self, limits: Limits | str) -> Robot:
        """The same robot under other limits: a `Limits`, or the name of a preset.

        Raises:
            UnknownNameError: no preset of that name.
            InputError: neither of them, limits for another number of joints, or wider positions than those at which a
                joint that mimics others keeps its own limits.
        """
        if not isinstance(limits, Limits | str):
            raise InputError(f"limits is {shown(limits)}, expected Limits or the name of a preset")
        if isinstance(limits, str):
            limits = self.presets[known_name("limit preset", limits, self.presets)]
        limited = replace(self, limits=limits)
        before = self._followers_beyond_limits
        for name, value in limited._followers_beyond_limits.items():
            if name not in before:
                joint = self.joint(name)
                raise InputError(
                    f"limits: they let {name!r}, which follows other joints, reach {value:.6g} {joint.unit}, outside "
                    f"its own limits [{joint.lower:.6g}, {joint.upper:.6g}]"
                )
        return limited

    @cached_property
    def _followers_beyond_limits(self) -> dict[str, float]:
        """Mimic joints that leave their limits at the limits of the planning joints, with their values [rad or m]."""
        found: dict[str, float] = {}
        for ends in (self.limits.lower, self.limits.upper):
            values = dict(zip(self.joint_names, ends.tolist(), strict=True)) | dict(self.locked_joints)
            for joint in self.joints:
                if joint.mimic is not None:
                    value = self._resolve(joint, values)
                    if value < joint.lower - _ROUNDING or value > joint.upper + _ROUNDING:
                        found[joint.name] = value
        return found

    def with_locked_joints(self, values: Mapping[str, float] | str) -> Robot:
        """The same robot with other values of its locked joints.

        Args:
            values: Values [rad or m] by joint; or the name of a state in `locked_joint_states`, e.g. "open".

        Raises:
            UnknownNameError: no such state or no such locked joint.
            InputError: a value that is not finite or out of the joint's limits.
        """
        if isinstance(values, str):
            values = self.locked_joint_states[known_name("gripper state", values, self.locked_joint_states)]
        of_kind("values", values, Mapping)
        locked = dict(self.locked_joints)
        for name, value in values.items():
            joint = self.joint(known_name("locked joint", name, self.locked_joints))
            number = finite_number(f"joint {name!r}", value)
            if not joint.lower - _ROUNDING <= number <= joint.upper + _ROUNDING:
                raise InputError(f"joint {name!r} is {number}, outside [{joint.lower}, {joint.upper}]")
            locked[name] = number
        return replace(self, locked_joints=locked)

    # ---- plain kinematics ---------------------------------------------------------------

    def joint_values(self, q: Array) -> dict[str, float]:
        """The value of every movable joint [rad or m] by name: of planning joints, locked joints and mimic joints.

        Args:
            q: A configuration [rad or m], shape (nq,).

        Raises:
            InputError: wrong shape or not finite.
        """
        values = dict(zip(self.joint_names, finite_array("q", q, (self.nq,)).tolist(), strict=True)) | dict(
            self.locked_joints
        )
        for joint in self.joints:
            if joint.kind != "fixed" and joint.name not in values:
                values[joint.name] = self._resolve(joint, values)
        return values

    def _resolve(self, joint: Joint, values: Mapping[str, float], depth: int = 0) -> float:
        """The value of a mimic joint, through a chain of mimic joints."""
        if joint.name in values:
            return values[joint.name]
        if joint.mimic is None or depth > len(self.joints):
            raise InputError(
                f"joint {joint.name!r} of robot {self.name!r} has no value and mimics no joint that has one"
            )
        leader = self._resolve(self.joint(joint.mimic.joint), values, depth + 1)
        return joint.mimic.multiplier * leader + joint.mimic.offset

    def link_poses(self, q: str | ArrayLike) -> dict[str, Array]:
        """T_base_link of every link by name, each (4, 4), computed in plain NumPy.

        Args:
            q: A configuration: its name, or its numbers [rad or m], shape (nq,).

        Raises:
            UnknownNameError: no configuration of that name.
            InputError: wrong shape or not finite.
        """
        return poses_at(self, self.joint_values(self.configuration(q)))

    @cached_property
    def _joints(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def _links(self) -> dict[str, Link]:
        return {link.name: link for link in self.links}


def poses_at(robot: Robot, values: Mapping[str, float], links: Set[str] | None = None) -> dict[str, Array]:
    """T_base_link of links by name, each (4, 4), in plain NumPy.

    Args:
        robot: The robot.
        values: The value of every movable joint [rad or m] by name, as of `Robot.joint_values`.
        links: The links and all their ancestors (default: all links).
    """
    poses = {robot.base: np.eye(4)}
    for joint in robot.joints:
        if links is None or joint.child in links:
            poses[joint.child] = poses[joint.parent] @ joint.origin @ joint.motion(values.get(joint.name, 0.0))
    return poses


def independent_joint(robot: Robot, joint: Joint) -> tuple[Joint, float, float]:
    """The joint that a joint follows through a chain of mimics, with factor and offset; itself if it follows none."""
    factor, offset = 1.0, 0.0
    ends = {*robot.joint_names, *robot.locked_joints}
    while joint.mimic is not None and joint.name not in ends:
        ends.add(joint.name)  # in a robot that was not checked joints may mimic each other in a circle
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = robot.joint(joint.mimic.joint)
    return joint, factor, offset


def affine_value(robot: Robot, joint: Joint) -> tuple[int, float, float]:
    """A movable joint's value as factor * q[column] + offset; column -1 means the offset alone.

    Raises:
        InputError: a joint that is neither planned, locked nor mimics one that is.
    """
    source, factor, offset = independent_joint(robot, joint)
    if source.name in robot.joint_names:
        return robot.joint_names.index(source.name), factor, offset
    if source.name in robot.locked_joints:
        return -1, 0.0, offset + factor * robot.locked_joints[source.name]
    raise InputError(
        f"joint {joint.name!r} of robot {robot.name!r} is neither planned nor locked, and mimics no such joint"
    )


def _is_joint_value(value: object) -> bool:
    try:
        # Rows of tensors have elements that are arrays without dimensions.
        number = value if isinstance(value, float) else finite_number("joint value", value)
        return abs(float(number)) <= FARTHEST
    except (InputError, OverflowError):
        return False
