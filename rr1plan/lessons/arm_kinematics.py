"""Kinematics of an arm as in a lecture: link transforms, DH parameters, Jacobian, ellipses, singularities.

Denavit, Hartenberg, "A kinematic notation for lower-pair mechanisms based on matrices", J. Applied Mechanics 22
(1955). Yoshikawa, "Manipulability of robotic mechanisms", IJRR 4 (1985). Lynch, Park, "Modern Robotics" (2017), 4, 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, Value, finite_array, finite_number, of_kind, read_only
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.srdf import chain_joints

_PARALLEL = 1e-9


class DhRow(NamedTuple):
    """Parameters of one joint: A = Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha).

    Args:
        joint: Name of the joint.
        a: Length of the common normal of this joint's axis and the next one [m].
        alpha: Angle between the two axes about the normal [rad].
        d: Distance of the normals along the axis [m]; the variable of a prismatic joint is added.
        theta: Angle between the normals, about the axis [rad]; the variable of a revolute joint is added.
        slides: Whether the joint is prismatic.
    """

    joint: str
    a: float
    alpha: float
    d: float
    theta: float
    slides: bool

    def matrix(self, value: float) -> Array:
        """The transform to the next frame at a value of the joint [rad or m], shape (4, 4)."""
        value = finite_number("value", value)
        theta, d = self.theta + value * (not self.slides), self.d + value * self.slides
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(self.alpha), np.sin(self.alpha)
        return np.array(
            [
                [c, -s * ca, s * sa, self.a * c],
                [s, c * ca, -c * sa, self.a * s],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )


@dataclass(frozen=True, eq=False, repr=False)
class DhTable(Value):
    """Standard DH parameters of a chain: T_base_tool = base · A₁(q₁) · … · Aₙ(qₙ) · tool.

    Args:
        rows: One for each joint.
        base: From the robot's base to frame 0, whose z axis is that of joint 1, shape (4, 4).
        tool: From frame n to the tool, shape (4, 4).
    """

    rows: tuple[DhRow, ...]
    base: Array
    tool: Array

    def frames(self, q: ArrayLike) -> Array:
        """T_base_frame of the frames 0 to n.

        Args:
            q: Configuration of the planning joints [rad or m], shape (n,).

        Returns:
            Transforms, shape (n + 1, 4, 4).

        Raises:
            InputError: wrong shape or not finite.
        """
        values = finite_array("q", q, (len(self.rows),))
        frames = [self.base]
        for row, value in zip(self.rows, values, strict=True):
            frames.append(frames[-1] @ row.matrix(float(value)))
        return np.array(frames)

    def pose(self, q: ArrayLike) -> Array:
        """T_base_tool.

        Args:
            q: Configuration of the planning joints [rad or m], shape (n,).

        Returns:
            Transform, shape (4, 4).

        Raises:
            InputError: wrong shape or not finite.
        """
        return np.asarray(self.frames(q)[-1] @ self.tool)

    def __repr__(self) -> str:
        return f"DhTable({', '.join(row.joint for row in self.rows)})"

    def __str__(self) -> str:
        width = max(12, *(len(row.joint) for row in self.rows))
        lines = [f"{'joint':{width}} {'a [m]':>9} {'α [°]':>9} {'d [m]':>11} {'θ [°]':>11}"]
        for row in self.rows:
            d = f"{row.d:z.4f}" + " + q" * row.slides
            theta = f"{np.degrees(row.theta):z.2f}" + " + q" * (not row.slides)
            lines.append(f"{row.joint:{width}} {row.a:z9.4f} {np.degrees(row.alpha):z9.2f} {d:>11} {theta:>11}")
        return "\n".join(lines)


def dh_table(robot: Robot) -> DhTable:
    """Standard DH parameters of a serial arm, from the axes of its planning joints.

    For parallel axes, the normal through the origin of the previous frame is used, so that d is zero. The last frame
    has its origin in the tool, or above it on the last axis.

    Args:
        robot: A chain of revolute, continuous and prismatic joints.

    Raises:
        InputError: a planning joint that does not move the tool, one on the way to it that mimics another one, or
            planning joints in another order than in the arm.
    """
    of_kind("robot", robot, Robot)
    chain = chain_joints(robot.joints, robot.base, robot.tool)
    for name in chain:
        if robot.joint(name).mimic is not None:
            raise InputError(f"joint {name!r} mimics another one, expected a serial arm")
    for name in robot.joint_names:
        if name not in chain:
            raise InputError(f"joint {name!r} does not move the tool {robot.tool!r}; leave it out with option groups")
    ordered = [name for name in chain if name in robot.joint_names]
    if list(robot.joint_names) != ordered:
        raise InputError(f"joints are {', '.join(robot.joint_names)}, expected the order in the arm, joints={ordered}")
    poses = robot.link_poses(np.zeros(robot.nq))
    joints = [robot.joint(name) for name in robot.joint_names]
    # Axes at the zero configuration, each as a point and a direction; last the tool with the direction of the last
    # axis.
    axes = [(poses[j.child][:3, 3], poses[j.child][:3, :3] @ np.asarray(j.axis)) for j in joints]
    tool = poses[robot.tool]
    axes.append((tool[:3, 3], axes[-1][1]))
    z, x, origin = axes[0][1], _any_normal(axes[0][1]), axes[0][0]
    base, rows = _frame(x, z, origin), []
    for joint, (_, own), (point, following) in zip(joints, axes, axes[1:], strict=False):
        foot, end, normal = _common_normal(origin, own, point, following, x)
        d, theta = float((foot - origin) @ own), _angle(x, normal, own)
        a, alpha = float((end - foot) @ normal), _angle(own, following, normal)
        rows.append(DhRow(joint.name, a, alpha, d, theta, joint.kind == "prismatic"))
        x, origin = normal, end
    last = _frame(x, axes[-1][1], origin)
    return DhTable(tuple(rows), read_only(base), read_only(np.linalg.inv(last) @ tool))


def _frame(x: Array, z: Array, origin: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = np.column_stack([x, np.cross(z, x), z]), origin
    return frame


def _any_normal(z: Array) -> Array:
    """A unit vector perpendicular to z: the x axis if possible."""
    seed = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = seed - (seed @ z) * z
    return np.asarray(x / np.linalg.norm(x))


def _common_normal(origin: Array, z: Array, point: Array, following: Array, x: Array) -> tuple[Array, Array, Array]:
    """Feet of the common normal on the axis through `origin` and on the next one, and its direction."""
    across = np.cross(z, following)
    size = float(np.linalg.norm(across))
    if size < _PARALLEL:
        foot = origin if np.linalg.norm(_off_axis(point - origin, z)) > _PARALLEL else point
        # The last row contains the tool's offset along the axis of the last joint.
        end = foot + _off_axis(point - foot, z)
        way = end - foot
        length = float(np.linalg.norm(way))
        return foot, end, (way / length if length > _PARALLEL else x)
    normal = across / size
    # Two lines, origin + s z and point + t following, connected along the normal.
    s, t, _ = np.linalg.solve(np.column_stack([z, -following, normal]), point - origin)
    foot, end = origin + s * z, point + t * following
    if (end - foot) @ normal < -_PARALLEL or (np.linalg.norm(end - foot) <= _PARALLEL and normal @ x < -_PARALLEL):
        normal = -normal
    return foot, end, normal


def _off_axis(vector: Array, z: Array) -> Array:
    return np.asarray(vector - (vector @ z) * z)


def _angle(a: Array, b: Array, axis: Array) -> float:
    """The angle from a to b about an axis perpendicular to both [rad], rounding removed."""
    angle = float(np.arctan2(np.cross(a, b) @ axis, a @ b))
    return 0.0 if abs(angle) < 1e-12 else angle


# ---- the Jacobian ------------------------------------------------------------------------------


def tool_jacobian(robot: Robot, q: ArrayLike) -> Array:
    """Jacobian of the tool's origin in the robot's base frame, shape (3, nq).

    The column of a revolute joint is axis × (tool - joint), that of a prismatic one its axis.

    Args:
        robot: The robot.
        q: Configuration [rad or m], shape (nq,).
    """
    of_kind("robot", robot, Robot)
    poses = robot.link_poses(robot.configuration(q, "q"))
    columns, tip = [], poses[robot.tool][:3, 3]
    for name in robot.joint_names:
        joint = robot.joint(name)
        axis = poses[joint.child][:3, :3] @ np.asarray(joint.axis)
        slides = joint.kind == "prismatic"
        columns.append(axis if slides else np.cross(axis, tip - poses[joint.child][:3, 3]))
    return np.column_stack(columns)


class Ellipse(NamedTuple):
    """The velocities of the tool for joint velocities of length one, and the forces for torques of length one.

    Args:
        directions: Axes of the ellipse as columns, the longest first, shape (2, 2).
        velocity: Semi-axes of the velocity ellipse, shape (2,).
        force: Semi-axes of the force ellipse along the same directions, the reciprocals; infinite in a singularity.
        manipulability: Product of the semi-axes, |det J|.
    """

    directions: Array
    velocity: Array
    force: Array
    manipulability: float


def ellipses(jacobian: ArrayLike) -> Ellipse:
    """Velocity and force ellipses of a planar Jacobian.

    Args:
        jacobian: Shape (2, 2).

    Raises:
        InputError: another shape.
    """
    matrix = finite_array("jacobian", jacobian, (2, 2))
    directions, sizes, _ = np.linalg.svd(matrix)
    with np.errstate(divide="ignore"):
        force = np.where(sizes > 1e-12, 1.0 / np.maximum(sizes, 1e-300), np.inf)
    return Ellipse(directions, sizes, force, float(abs(np.linalg.det(matrix))))
