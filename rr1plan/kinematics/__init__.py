"""Forward kinematics, Jacobians, inverse dynamics and inverse kinematics."""

from rr1plan.kinematics.forward import Kinematics
from rr1plan.kinematics.inverse import IkResult, solve_ik
from rr1plan.kinematics.turns import copies_within_limits, nearest_copy

__all__ = ["IkResult", "Kinematics", "copies_within_limits", "nearest_copy", "solve_ik"]
