"""A MuJoCo model built from a `Scene`, so that simulator and planners use the same robot.

Every link is a body (including frames; none are fused), every collision shape is a geom named after its element, and
every movable joint has a servo. Pairs that may touch are excluded individually and MuJoCo's own parent-child filter is
off, so MuJoCo reports contacts exactly for `Scene.checked_pairs`, except those of a held object and the body that holds
it, which do not move relative to each other. Loose bodies are free and collide with everything, regardless of the pairs
that the scene allows.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import BackendError, InputError
from rr1plan.playback.simulation.collision_bits import OTHERS, collision_bits
from rr1plan.playback.simulation.mujoco_geoms import GeomOptions
from rr1plan.robot import Geometry, Inertial, Joint, Link
from rr1plan.robot.link_masses import solid_inertial
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.scene import Attachment, Obstacle, Scene
from rr1plan.transforms import position_and_quaternion, quaternion_from_rotation

# MuJoCo requires that moving bodies have mass; frames without mass get this mass and inertia [kg, kg m²].
_NO_MASS = 1e-9
# MuJoCo refuses principal moments below 1e-14 [kg m²]. That of a thin rod along its axis is at least this share of the
# others, so that the correction for six digits below does not reverse their order.
_LEAST_MOMENT, _LEAST_SHARE = 1e-12, 4e-5
# Nor a largest moment above the sum of the others, to which that of a flat body is equal; this share of the sum remains
# below it in MJCF files, which have six digits.
_LARGEST_MOMENT = 1.0 - 2e-5
# Moments of flat bodies with few digits may exceed the sum of the others by this factor.
_ROUNDED_MOMENT = 1.01
# Smallest inertia for the gains of a servo, also the motor inertia of massless joints; a joint that carries less than
# the second value counts as massless [kg m² or kg].
_LEAST_CARRIED = 1e-4
_NOTHING_CARRIED = 1e-7
# Usual natural frequency of joint servos [rad/s], and its largest product with the time step: stiffer servos oscillate.
_STIFFNESS, _STEP_STIFFNESS = 160.0, 0.8
# Input signature of the `pid` actuator: position, velocity and feed-forward [MuJoCo's mjtCtrlInput].
_POSITION_VELOCITY_FEEDFORWARD = 7
# Torsional and rolling friction of loose bodies [m], MuJoCo's defaults.
_OTHER_FRICTION = (0.005, 0.0001)
# Time constant of contacts of loose bodies: at most 8 ms and four steps, so that shorter steps give harder contacts,
# and at least two steps, which MuJoCo needs.
_CONTACT_TIME, _MOST_CONTACT_STEPS, _LEAST_CONTACT_STEPS = 0.008, 4.0, 2.0
# Memory of MuJoCo's stack and contacts [bytes]: minimum; per degree of freedom (packed arms with a hundred contacts
# each need 4e4); and per pair of degrees of freedom.
_LEAST_MEMORY, _CONTACT_MEMORY, _PAIR_MEMORY = 2e7, 1e5, 4.0
# Number of arms above which arms are added in groups, because MuJoCo rebuilds the lists of a whole model for each
# addition, and get collision bits.
_MANY = 16


@dataclass(frozen=True, eq=False)
class MujocoScene:
    """A compiled model, with the scene's names of its joints, bodies and geoms.

    Args:
        scene: The scene.
        spec: The editable model.
        model: The compiled model.
        joint_names: "arm/joint" of every movable joint, in the order of actuators and of the first entries of qpos and
            qvel.
        body_names: The loose bodies, in the order of the following entries of qpos (7 each) and qvel (6 each).
        geom_elements: The scene element that each geom belongs to, by geom id.
        effort_limits: Largest effort of each of these joints [Nm or N], inf if there is none. Servos respect it, except
            in arms whose masses are estimated.
        massless_joints: The joints of `joint_names` that carry no mass; each has motor inertia (armature) instead.
    """

    scene: Scene
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    joint_names: tuple[str, ...]
    body_names: tuple[str, ...]
    geom_elements: tuple[str, ...]
    effort_limits: Array
    massless_joints: tuple[str, ...] = ()

    def to_xml(self) -> str:
        """The model as MJCF."""
        with _groups_without_prefix():
            return str(self.spec.to_xml())

    def forbidden(self, geoms: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Which contacts the scene does not allow.

        Args:
            geoms: The two geoms of each contact, shape (n, 2).

        Returns:
            Shape (n,).
        """
        one, two = geoms.T
        if not self.body_names:
            return np.ones(len(geoms), dtype=np.bool_)  # pairs that may touch are excluded from the model
        # Contacts without a loose body are between arms, or with an arm.
        found: NDArray[np.bool_] = self._arm_geoms[one] | self._arm_geoms[two]
        for k in np.flatnonzero(found & (self._loose_geoms[one] | self._loose_geoms[two])).tolist():
            a, b = geoms[k].tolist()
            found[k] = not self.scene.may_touch(self.geom_elements[a], self.geom_elements[b])
        return found

    @cached_property
    def _loose_geoms(self) -> NDArray[np.bool_]:
        loose = frozenset(self.body_names)
        return np.array([name in loose for name in self.geom_elements])

    @cached_property
    def _arm_geoms(self) -> NDArray[np.bool_]:
        return np.array([self.scene.owner(name) is not None for name in self.geom_elements])


Solver = Literal["newton", "cg"]


def build_mujoco(
    scene: Scene,
    *,
    timestep: float = 0.002,
    stiffness: float | None = None,
    solver: Solver = "newton",
) -> MujocoScene:
    """Build and compile a scene's MuJoCo model.

    Args:
        scene: The scene; arms start in their configurations.
        timestep: Step of the integrator [s].
        stiffness: Natural frequency of the joint servos [rad/s] (default: `usual_stiffness`); gains follow from the
            inertia each joint carries in the scene's configuration (kp = stiffness² M_jj), critically damped.
        solver: Solver for contact forces of loose bodies, see `Simulation`.

    Returns:
        The model with one `pid` actuator (position, velocity, feed-forward) for each movable joint.

    Raises:
        BackendError: MuJoCo rejects the scene.
        InputError: a point cloud of too many cells.
    """
    stiffness = usual_stiffness(timestep) if stiffness is None else stiffness
    builder = _Builder(scene, timestep, solver)
    spec, joints, bodies = builder.spec, builder.joints, loose_bodies(scene)
    values = {name: arm.robot.joint_values(arm.q) for name, arm in scene.arms.items()}
    configuration = np.array([values[joint.arm][joint.joint.name] for joint in joints])
    poses = [position_and_quaternion(body.pose) for body in bodies.values()]
    set_points = np.column_stack([configuration, np.zeros((len(joints), 2))])  # positions, velocities, efforts
    spec.add_key(name="configuration", qpos=np.concatenate([configuration, *poses]), ctrl=set_points.ravel())
    spec.memory = stack_memory(len(joints) + 6 * len(bodies))
    model = _compile(spec)
    inertia = _joint_inertia(model)[: len(joints)]
    for i, (servo, carried) in enumerate(zip(builder.servos, inertia.tolist(), strict=True)):
        _set_gains(servo, stiffness, max(carried, _LEAST_CARRIED))
        model.actuator_biasprm[i] = servo.biasprm
    massless = tuple(j.name for j, carried in zip(joints, inertia, strict=True) if carried < _NOTHING_CARRIED)
    for name in massless:
        spec.joint(name).armature = _LEAST_CARRIED
    if massless:
        model = _compile(spec)
    elements = tuple(builder.elements[model.geom(i).name] for i in range(model.ngeom))
    efforts = np.array([joint.joint.effort for joint in joints])
    names = tuple(joint.name for joint in joints)
    return MujocoScene(scene, spec, model, names, tuple(bodies), elements, efforts, massless)


def usual_stiffness(dt: float, most: float = _STIFFNESS) -> float:
    """Natural frequency of servos that do not oscillate in steps of `dt` [s], at most `most` [rad/s]."""
    return min(most, _STEP_STIFFNESS / dt)


def stack_memory(degrees_of_freedom: int) -> int:
    """Memory for MuJoCo's stack and contacts [bytes]; for many arms, a tenth of MuJoCo's default."""
    return int(_LEAST_MEMORY + _PAIR_MEMORY * degrees_of_freedom**2 + _CONTACT_MEMORY * degrees_of_freedom)


def _compile(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        with _groups_without_prefix():
            return spec.compile()
    except ValueError as error:
        raise BackendError(f"MuJoCo does not take the scene: {error}") from error


@contextmanager
def _groups_without_prefix() -> Iterator[None]:
    """Ignore a MuJoCo warning that does not apply to groups with unique names of default classes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Attaching a spec with an empty prefix")
        yield


@dataclass(frozen=True, eq=False)
class _PlacedJoint:
    """A movable joint under its scene name."""

    name: str
    arm: str
    joint: Joint


class _Builder:
    """Fills an MjSpec from a scene."""

    def __init__(self, scene: Scene, timestep: float, solver: Solver) -> None:
        self.scene = scene
        self.spec = mujoco.MjSpec()
        self._geom_options = GeomOptions(self.spec)
        self.spec.modelname = scene.name
        self.spec.option.timestep = timestep
        self.spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
        self._loose = loose_bodies(scene)
        if self._loose:
            self._set_solver(solver)
        contact_time = min(_CONTACT_TIME, _MOST_CONTACT_STEPS * timestep)
        self._surface = {"priority": 1, "solref": [max(contact_time, _LEAST_CONTACT_STEPS * timestep), 1.0]}
        self._bits = collision_bits(scene) if len(scene.arms) > _MANY else {}
        self.joints: list[_PlacedJoint] = []
        self.servos: list[mujoco.MjsActuator] = []
        self.elements: dict[str, str] = {}
        # Held objects by arm.
        self._held: dict[str, dict[str, Attachment]] = {}
        for name, held in scene.attachments.items():
            self._held.setdefault(held.arm, {})[name] = held
        self._add_arms()
        for name, obstacle in scene.obstacles.items():
            body = self._add_object(self.spec.worldbody, name, obstacle)
            if obstacle.mass is not None:
                body.add_freejoint(name=_body_name(name))
        self._add_servos()
        for a, b in _excluded_pairs(scene, self._bits):
            self.spec.add_exclude(bodyname1=_body_name(a), bodyname2=_body_name(b))

    def _add_arms(self) -> None:
        """Add the arms with their held objects."""
        arms = list(self.scene.arms)
        if len(arms) <= _MANY:
            for arm in arms:
                self._add_arm(self.spec.worldbody, arm)
            return
        size = 2 * math.isqrt(len(arms))
        for start in range(0, len(arms), size):
            group = mujoco.MjSpec()
            group.default.name = f"arms{start}"
            for arm in arms[start : start + size]:
                self._add_arm(group.worldbody, arm)
            self._attach(group)

    def _attach(self, group: mujoco.MjSpec) -> None:
        """Add a group of arms, without the MuJoCo warning that `_groups_without_prefix` ignores."""
        with mujoco_warnings():
            self.spec.attach(group, prefix="", frame=self.spec.worldbody.add_frame())

    def _add_arm(self, world: mujoco.MjsBody, arm: str) -> None:
        robot, base = self.scene.arms[arm].robot, self.scene.arms[arm].base
        held = self._held.get(arm, {})
        bodies = {robot.links[0].name: self._add_link(world, arm, robot.links[0], base)}
        for joint in robot.limited_joints:
            body = self._add_link(bodies[joint.parent], arm, robot.link(joint.child), joint.origin)
            bodies[joint.child] = body
            if joint.kind != "fixed":
                self._add_joint(body, arm, joint)
        for name, thing in held.items():
            self._add_object(bodies[thing.link], name, thing)

    def _add_link(self, parent: mujoco.MjsBody, arm: str, link: Link, pose: Array) -> mujoco.MjsBody:
        body = self._add_body(parent, f"{arm}/{link.name}", pose)
        if link.inertial is not None and link.inertial.mass > 0.0:
            _set_inertial(body, link.inertial)
        else:
            body.explicitinertial = True
            body.mass = _NO_MASS
            body.ipos = [0.0, 0.0, 0.0]  # the default would be the position in the parent body
            body.inertia = [_NO_MASS] * 3
        self._add_geoms(body, f"{arm}/{link.name}", link.collisions)
        return body

    def _add_object(self, parent: mujoco.MjsBody, name: str, thing: Obstacle | Attachment) -> mujoco.MjsBody:
        body = self._add_body(parent, _body_name(name), thing.pose)
        if thing.mass is None:
            self._add_geoms(body, name, thing.geometries)
            return body
        inertial = solid_inertial(thing.geometries, thing.mass)
        if inertial is None:
            raise InputError(f"{name!r} has a mass, but its shapes have no volume")
        _set_inertial(body, inertial)
        # Its priority makes its friction apply to contacts with objects without mass, even if theirs is larger.
        friction = [thing.friction, *_OTHER_FRICTION]
        self._add_geoms(body, name, thing.geometries, friction=friction, **self._surface)
        return body

    def _set_solver(self, solver: Solver) -> None:
        option = self.spec.option
        # With MuJoCo's default, pyramidal cones, bodies held by friction creep, and contacts get softer with the square
        # of the friction coefficient: at 10 boxes sink into each other.
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        # With MuJoCo's default, 1e-6 m, contact points are 0.1 mm off, and a cylinder that lies on a level table rolls.
        option.ccd_tolerance = 1e-10
        if solver == "newton":
            option.impratio = 10.0  # with few iterations of "cg", it would cost penetration
        else:
            option.solver = mujoco.mjtSolver.mjSOL_CG
            option.iterations, option.tolerance = 20, 1e-5
            option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD

    def _add_body(self, parent: mujoco.MjsBody, name: str, pose: Array) -> mujoco.MjsBody:
        return parent.add_body(name=name, pos=pose[:3, 3], quat=quaternion_from_rotation(pose[:3, :3]))

    def _add_joint(self, body: mujoco.MjsBody, arm: str, joint: Joint) -> None:
        slides = joint.kind == "prismatic"
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        name = f"{arm}/{joint.name}"
        # Limits are checked by the referee; in MuJoCo they would be soft constraints.
        body.add_joint(name=name, type=kind, axis=joint.axis, limited=mujoco.mjtLimited.mjLIMITED_FALSE)
        self.joints.append(_PlacedJoint(name, arm, joint))

    def _add_servos(self) -> None:
        """Add a servo for each joint; gains follow later, from the inertia that it carries."""
        for placed in self.joints:
            name, effort = placed.name, placed.joint.effort
            servo = self.spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            _set_gains(servo, 1.0, 1.0)
            if np.isfinite(effort) and not self.scene.arms[placed.arm].robot.links_of_assumed_mass:
                servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
                servo.forcerange = [-effort, effort]
            self.servos.append(servo)

    def _add_geoms(self, body: mujoco.MjsBody, element: str, geometries: tuple[Geometry, ...], **surface: Any) -> None:
        bits = self._bits.get(element, (OTHERS, OTHERS))
        surface |= {"contype": bits[0], "conaffinity": bits[1]}
        for index, geometry in enumerate(geometries):
            for part, options in enumerate(self._geom_options.of(geometry)):
                name = f"{element}#{index}.{part}"
                body.add_geom(name=name, mass=0.0, **options, **surface)
                self.elements[name] = element


def _excluded_pairs(scene: Scene, coded: Container[str]) -> Iterator[tuple[str, str]]:
    """Pairs of bodies that may touch: links of one arm, and pairs of arms and fixed objects that the scene allows.

    Args:
        scene: The scene.
        coded: Elements of arms whose collision bits already exclude pairs within the arm.
    """
    loose = loose_bodies(scene)
    owned: dict[str | None, list[str]] = {}
    for element in scene.element_names:
        owned.setdefault(scene.owner(element), []).append(element)
    for arm in scene.arms:
        own = combinations((element for element in owned.get(arm, ()) if element not in coded), 2)
        yield from ((a, b) for a, b in own if scene.may_touch(a, b))
    seen = set()
    for rule in scene.allowed:
        first, second = (owned.get(name, [name]) if name in scene.arms else [name] for name in (min(rule), max(rule)))
        for a in first:
            for b in second:
                same_arm = scene.owner(a) is not None and scene.owner(a) == scene.owner(b)
                if a != b and not same_arm and not {a, b} & loose.keys() and frozenset((a, b)) not in seen:
                    seen.add(frozenset((a, b)))
                    yield a, b


def _body_name(element: str) -> str:
    """Name of an element's body; MuJoCo reserves the name "world"."""
    return f"{element}#" if element.rstrip("#") == "world" else element


def loose_bodies(scene: Scene) -> dict[str, Obstacle]:
    """The obstacles with a mass, by name."""
    return {name: thing for name, thing in scene.obstacles.items() if thing.mass is not None}


def is_possible(inertial: Inertial) -> bool:
    """Whether some body has its moments of inertia: none exceeds the sum of the others by more than rounding."""
    moments = np.linalg.eigvalsh(inertial.inertia)
    return bool(moments[2] <= _ROUNDED_MOMENT * (moments[0] + moments[1]))


def _set_inertial(body: mujoco.MjsBody, inertial: Inertial) -> None:
    moments, axes = np.linalg.eigh(inertial.inertia)
    inertia = inertial.inertia
    least = max(_LEAST_MOMENT, _LEAST_SHARE * float(moments[2]))
    if moments[0] < least:  # a point, a thin rod or nearly one
        inertia, moments = inertia + least * np.eye(3), moments + least
    excess = moments[2] - _LARGEST_MOMENT * (moments[0] + moments[1])
    if excess > 0.0:  # flat, or of moments that no body has
        inertia = inertia - excess * np.outer(axes[:, 2], axes[:, 2])
    body.explicitinertial = True
    body.mass = inertial.mass
    body.ipos = inertial.com
    body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]


def _joint_inertia(model: mujoco.MjModel) -> Array:
    """Inertia that each joint carries in the keyframe, i.e. the diagonal of the mass matrix, shape (nv,)."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_makeM(model, data)
    # The last entry of each row of the sparse lower triangle is the diagonal element.
    return np.asarray(data.M[model.M_rowadr + model.M_rownnz - 1])


def _set_gains(servo: mujoco.MjsActuator, stiffness: float, inertia: float) -> None:
    kp, kv = stiffness**2 * inertia, 2.0 * stiffness * inertia
    servo.set_to_pid(kp=kp, kv=kv, ctrlspec=_POSITION_VELOCITY_FEEDFORWARD)
