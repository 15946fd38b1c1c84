"""Forward kinematics, Jacobians, inverse dynamics and inverse kinematics."""

from rr1plan.model.forward_kinematics import Kinematics
from rr1plan.model.inverse_kinematics import IkResult, solve_ik
from rr1plan.model.joint_turns import copies_within_limits, nearest_copy

__all__ = ["IkResult", "Kinematics", "copies_within_limits", "nearest_copy", "solve_ik"]
