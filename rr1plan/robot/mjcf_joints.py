"""The joints of a compiled MJCF model: kinds, limits, efforts, actuators and couplings."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from rr1plan.checks import Array, read_only
from rr1plan.robot import Joint, Mimic
from rr1plan.robot.mjcf_model import CompiledDocument
from rr1plan.transforms import pose, rotation_about

log = logging.getLogger(__name__)

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_OF_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_OF_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
_WRAPS_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_COUPLES_JOINTS = int(mujoco.mjtEq.mjEQ_JOINT)


@dataclass(frozen=True)
class _Equation:
    """A joint's value as a linear function of another's: value = multiplier * (value of leader) + offset."""

    follower: int
    leader: int
    multiplier: float
    offset: float

    def inverted(self) -> _Equation:
        return _Equation(self.leader, self.follower, 1.0 / self.multiplier, -self.offset / self.multiplier)


class JointReader:
    """Reads the hinges and slides of a compiled model.

    Args:
        compiled: The model.
        rest: Configuration of the whole model that provides the values of locked joints, shape (nq,).

    """

    def __init__(self, compiled: CompiledDocument, rest: Array) -> None:
        self.compiled = compiled
        self.model = compiled.model
        self.rest = rest
        self.actuated, self.by_tendon = self._actuated()
        self.names = self._names()
        self.equations, self.constants = self._equations()

    # ---- names, values -------------------------------------------------------------------

    def _names(self) -> dict[int, str]:
        """A name for each joint; joints without one are named after their body."""
        model = self.model
        given = {model.joint(j).name for j in range(model.njnt)}
        names: dict[int, str] = {}
        for j in range(model.njnt):
            body = int(model.jnt_bodyid[j])
            made = f"{model.body(body).name or f'body{body}'}_joint{j - int(model.body_jntadr[body])}"
            while made in given:
                made += "_"
            names[j] = model.joint(j).name or made
        return names

    def value(self, joint: int, qpos: Array) -> float:
        """A joint's value in a configuration of the model."""
        return float(qpos[self.model.jnt_qposadr[joint]])

    def rest_value(self, joint: int) -> float:
        """The value at which a joint is locked, within its limits."""
        value = self.constants.get(joint, self.value(joint, self.rest))
        lower, upper = self._limits(joint)
        return min(max(value, lower), upper)

    def is_driven(self, joint: int) -> bool:
        """Whether an actuator drives a joint, directly or through a tendon."""
        return joint in self.actuated or joint in self.by_tendon

    # ---- joints --------------------------------------------------------------------------

    def joint(self, index: int, parent: str, child: str, before: Array) -> Joint:
        """A joint; a slide without a range becomes a fixed joint, with a warning.

        Args:
            index: Its number in the model.
            parent: The link above it.
            child: The link below it, whose frame is at the joint's anchor.
            before: T_parent_body with all of the body's earlier joints at zero, shape (4, 4).
        """
        model, name = self.model, self.names[index]
        slides = int(model.jnt_type[index]) == SLIDE
        axis = np.array(model.jnt_axis[index])
        # In MuJoCo, bodies have the poses of the file when a joint is at its reference value.
        zero = _motion(slides, axis, -float(model.qpos0[model.jnt_qposadr[index]]))
        origin = before @ pose(model.jnt_pos[index]) @ zero
        lower, upper = self._limits(index)
        if slides and not np.isfinite(upper - lower):
            log.warning(
                "%s: slide joint %r has no range, it is taken as fixed: bases stand still here",
                self.compiled.document.file,
                name,
            )
            origin = origin @ _motion(slides, axis, self.rest_value(index))
            return Joint(name, "fixed", parent, child, read_only(origin))
        dof = int(model.jnt_dofadr[index])
        joint = Joint(
            name=name,
            kind="prismatic" if slides else "revolute" if np.isfinite(upper) else "continuous",
            parent=parent,
            child=child,
            origin=read_only(origin),
            axis=read_only(axis),
            lower=lower,
            upper=upper,
            effort=self._effort(index),
            damping=float(model.dof_damping[dof]),
            friction=float(model.dof_frictionloss[dof]),
        )
        equation = self.equations.get(index)
        if equation is None:
            return joint
        mimic = Mimic(self.names[equation.leader], equation.multiplier, equation.offset)
        return replace(joint, mimic=mimic)

    def _limits(self, joint: int) -> tuple[float, float]:
        if not self.model.jnt_limited[joint]:
            return -np.inf, np.inf
        lower, upper = self.model.jnt_range[joint]
        return float(lower), float(upper)

    # ---- actuators -----------------------------------------------------------------------

    def _actuated(self) -> tuple[dict[int, list[int]], set[int]]:
        """The actuators of each joint, and the joints that actuators move through fixed tendons."""
        model = self.model
        direct: dict[int, list[int]] = {}
        over: set[int] = set()
        for actuator, (kind, target) in enumerate(
            zip(model.actuator_trntype.tolist(), model.actuator_trnid[:, 0].tolist(), strict=True)
        ):
            if kind in _OF_JOINT:
                direct.setdefault(target, []).append(actuator)
            elif kind == _OF_TENDON:
                start, count = int(model.tendon_adr[target]), int(model.tendon_num[target])
                wraps = range(start, start + count)
                over.update(int(model.wrap_objid[w]) for w in wraps if int(model.wrap_type[w]) == _WRAPS_JOINT)
        return direct, over

    def _effort(self, joint: int) -> float:
        """The largest torque or force of a joint's actuators, inf if it is unlimited [Nm or N]."""
        model = self.model
        efforts = [self._actuator_effort(actuator) for actuator in self.actuated.get(joint, ())]
        effort = sum(efforts) if efforts else np.inf
        if model.jnt_actfrclimited[joint]:
            effort = min(effort, _smaller_side(*model.jnt_actfrcrange[joint]))
        return float(effort)

    def _actuator_effort(self, actuator: int) -> float:
        model = self.model
        gear = abs(float(model.actuator_gear[model.actuator_outadr[actuator], 0]))
        if gear == 0.0:
            return np.inf
        effort = np.inf
        if model.actuator_forcelimited[actuator]:
            effort = gear * _smaller_side(*model.actuator_forcerange[actuator])
        # A motor's force is its control times a constant.
        is_motor = (
            int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_NONE)
            and int(model.actuator_gaintype[actuator]) == int(mujoco.mjtGain.mjGAIN_FIXED)
            and int(model.actuator_dyntype[actuator]) == int(mujoco.mjtDyn.mjDYN_NONE)
        )
        control = int(model.actuator_ctrladr[actuator])
        if is_motor and model.actuator_ctrlnum[actuator] == 1 and model.actuator_ctrllimited[control]:
            gain = gear * abs(float(model.actuator_gainprm[actuator, 0]))
            effort = min(effort, gain * _smaller_side(*model.actuator_ctrlrange[control]))
        return effort if effort > 0.0 else np.inf

    # ---- equality constraints ------------------------------------------------------------

    def _equations(self) -> tuple[dict[int, _Equation], dict[int, float]]:
        """The couplings that can be modeled, by the joint that follows, and values at which joints are fixed."""
        taken: dict[int, _Equation] = {}
        constants: dict[int, float] = {}
        for number, equation in self._coupled():
            if isinstance(equation, float):
                constants[number] = equation
                continue
            if equation.leader in self.actuated or equation.follower not in self.actuated or not equation.multiplier:
                candidates = (equation, equation.inverted()) if equation.multiplier else (equation,)
            else:
                candidates = (equation.inverted(), equation)
            fitting = [c for c in candidates if self._can_follow(c, taken)]
            if fitting:
                taken[fitting[0].follower] = fitting[0]
            else:
                log.warning(
                    "%s: joints %r and %r are coupled more than once, the later equality is left out",
                    self.compiled.document.file,
                    self.names[equation.follower],
                    self.names[equation.leader],
                )
        return taken, constants

    def _coupled(self) -> Iterator[tuple[int, _Equation | float]]:
        """For each active coupling, the number of the joint and its equation or fixed value."""
        model = self.model
        for e in range(model.neq):
            if int(model.eq_type[e]) != _COUPLES_JOINTS or not model.eq_active0[e]:
                continue
            follower, leader = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
            a0, a1, *higher = model.eq_data[e, :5].tolist()
            y0 = float(model.qpos0[model.jnt_qposadr[follower]])
            if leader < 0:
                yield follower, y0 + a0
            elif any(higher):
                log.warning(
                    "%s: joint %r depends on joint %r by a polynomial, which is not modeled; it is held or, if planned "
                    "for, moves independently",
                    self.compiled.document.file,
                    self.names[follower],
                    self.names[leader],
                )
            else:
                x0 = float(model.qpos0[model.jnt_qposadr[leader]])
                yield follower, _Equation(follower, leader, a1, y0 + a0 - a1 * x0)

    def _can_follow(self, equation: _Equation, taken: Mapping[int, _Equation]) -> bool:
        """Whether a joint is not coupled yet, and its leader does not follow it."""
        if equation.follower in taken or not self._moves(equation.leader) or not self._moves(equation.follower):
            return False
        at = equation.leader
        while at != equation.follower and at in taken:
            at = taken[at].leader
        return at != equation.follower

    def _moves(self, joint: int) -> bool:
        kind = int(self.model.jnt_type[joint])
        return kind == HINGE or (kind == SLIDE and bool(self.model.jnt_limited[joint]))


def _smaller_side(lower: float, upper: float) -> float:
    """The largest effort available in both directions; inf if a range excludes one of them."""
    return min(-float(lower), float(upper)) if lower < 0.0 < upper else np.inf


def _motion(slides: bool, axis: Array, value: float) -> Array:
    T = np.eye(4)
    if slides:
        T[:3, 3] = value * axis
    else:
        T[:3, :3] = rotation_about(axis, value)
    return T
