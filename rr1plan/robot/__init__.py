"""Robots: immutable descriptions of arms.

Values only: links, joints, shapes, limits, named configurations and the pairs of links that may touch. The models of
Pinocchio, Coal, MuJoCo and the viewer are built from the same description, so they agree. The forward kinematics here
is a reference in NumPy; `rr1plan.model` has the fast one.
"""

from rr1plan.robot.check_robot import check_robot
from rr1plan.robot.robot import Robot
from rr1plan.robot.robot_parts import Geometry, Inertial, Joint, JointKind, Link, Mimic

__all__ = [
    "Geometry",
    "Inertial",
    "Joint",
    "JointKind",
    "Link",
    "Mimic",
    "Robot",
    "check_robot",
]
