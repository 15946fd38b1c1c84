"""Dynamics of arms without contact in compiled kernels, equal to MuJoCo's except for rounding.

Arms without contact do not affect each other. Eight arms are stepped in parallel (SIMD), and up to 32 steps per call.
Bodies, servos and gravity are those of the scene's MuJoCo model, with bodies merged that are connected by fixed joints.
Results do not depend on the grouping of arms, threads, calls or processors.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library, zeroed
from rr1plan.model.kinematic_chain import turned_to
from rr1plan.transforms import pose, rotation_from_quaternion

_SLIDE = mujoco.mjtJoint.mjJNT_SLIDE


class ArmDynamics:
    """The arms of a model, stepped by the kernels.

    Args:
        model: The model; all its joints belong to arms, and each has a servo.
        columns: Index of each of its joints among those of the simulation.
        column_count: Number of joints of the simulation.
        threads: Number of threads that share the arms.

    Attributes:
        count: Number of arms.
    """

    def __init__(self, model: mujoco.MjModel, columns: NDArray[np.int64], column_count: int, threads: int) -> None:
        lanes = constants()["LANES"]
        roots = model.body_rootid[model.jnt_bodyid]
        firsts = [int(np.flatnonzero(roots == root)[0]) for root in dict.fromkeys(roots.tolist())]
        kinds: dict[bytes, list[int]] = {}
        for joint in firsts:
            kinds.setdefault(_description(model, joint), []).append(joint)
        trees = [_tree(model, joints[0]) for joints in kinds.values()]
        groups: list[list[int]] = []
        servos: list[Array] = []
        gravities: list[Array] = []
        first_joint = 0
        for alike, (tree, _) in zip(kinds.values(), trees, strict=True):
            for k in range(0, len(alike), lanes):
                arms = alike[k : k + lanes]
                filled = arms + [arms[0]] * (lanes - len(arms))
                groups.append([first_joint, len(tree), sum(map(len, servos)), len(arms), *columns[filled].tolist()])
                servos.append(_servos(model, np.add.outer(np.arange(len(tree)), filled)))
                gravities.append(np.array([_gravity(model, joint) for joint in filled]).T)
            first_joint += len(tree)
        self.count = len(firsts)
        self._groups = len(groups)
        most = max(len(tree) for tree, _ in trees)
        self._memory = [(zeroed("JointLanes", most), zeroed("f64x8", most * most)) for _ in range(threads)]
        self._struct = CStruct(
            "ArmDynamics",
            joints=np.concatenate([tree for tree, _ in trees]),
            bodies=np.concatenate([bodies for _, bodies in trees]),
            servos=_aligned("ServoLanes", np.concatenate(servos)),
            bases=_aligned("BaseLanes", np.array(gravities)),
            arms=np.array(groups),
            column_count=column_count,
            dt=float(model.opt.timestep),
        )
        self._step = load_library().rr1_step_arms

    def take_steps(self, worker: int, desired: Array, states: Array) -> None:
        """Compute some steps of a thread's share of the arms.

        Args:
            worker: Index of the thread.
            desired: Set-points of all joints of the simulation for each step: positions, velocities, accelerations and
                efforts to add, shape (k, 4, n).
            states: Positions, velocities and efforts of all joints before the first step (input) and after each step
                (output, for these arms), shape (k + 1, 3, n).
        """
        threads = len(self._memory)
        first, last = (self._groups * i // threads for i in (worker, worker + 1))
        self._step(self._struct, first, last, desired, states, len(desired), *self._memory[worker])


def _bodies(model: mujoco.MjModel, joint: int) -> range:
    """The bodies of the arm with a given first joint, starting with its base."""
    of_arm = np.flatnonzero(model.body_rootid == model.body_rootid[model.jnt_bodyid[joint]])
    return range(int(of_arm[0]), int(of_arm[-1]) + 1)


def _description(model: mujoco.MjModel, joint: int) -> bytes:
    """All data that `_tree` reads for the arm with a given first joint."""
    bodies = _bodies(model, joint)
    of_arm, moved = slice(bodies.start, bodies.stop), slice(bodies.start + 1, bodies.stop)
    joints = slice(joint, joint + int(model.body_jntnum[of_arm].sum()))
    arrays = [getattr(model, f"body_{name}")[of_arm] for name in ("jntnum", "mass", "ipos", "iquat", "inertia")]
    arrays += [model.body_parentid[moved] - bodies.start, model.body_pos[moved], model.body_quat[moved]]
    arrays += [model.jnt_type[joints], model.jnt_axis[joints], model.dof_armature[joints]]
    return b"".join(array.tobytes() for array in arrays)


def _tree(model: mujoco.MjModel, joint: int) -> tuple[NDArray[np.int64], Array]:
    """Joints and bodies of the arm with a given first joint, as rows of DynamicJoint and DynamicBody."""
    joints: list[tuple[int, int]] = []
    rows: list[Array] = []
    # For each body, the joint that carries it and its pose in the frame of this joint.
    frames: dict[int, tuple[int, Array]] = {}
    for body in _bodies(model, joint):
        carrier, T = frames.get(int(model.body_parentid[body]), (-1, np.eye(4)))
        if frames:
            T = T @ pose(model.body_pos[body], quaternion=model.body_quat[body])
        if model.body_jntnum[body]:
            own = int(model.body_jntadr[body])
            turned = turned_to(model.jnt_axis[own])
            T = T @ turned
            row = np.zeros(23)
            row[:9], row[9:12], row[22] = T[:3, :3].ravel(), T[:3, 3], model.dof_armature[own]
            joints.append((carrier, int(model.jnt_type[own] == _SLIDE)))
            rows.append(row)
            carrier, T = len(joints) - 1, turned.T
        frames[body] = carrier, T
        if carrier >= 0:
            rows[carrier][12:22] += _mass_properties(model, body, T)
    return np.array(joints, np.int64), np.array(rows)


def _mass_properties(model: mujoco.MjModel, body: int, T: Array) -> Array:
    """Mass, first moments and inertia of a body with pose T in a frame, about the frame's origin, shape (10,)."""
    mass = float(model.body_mass[body])
    principal = T @ pose(model.body_ipos[body], quaternion=model.body_iquat[body])
    R, c = principal[:3, :3], principal[:3, 3]
    inertia = R * model.body_inertia[body] @ R.T + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([mass, *(mass * c), *np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]])


def _servos(model: mujoco.MjModel, actuators: NDArray[np.int64]) -> Array:
    """Stiffness, damping and largest effort of some servos, shape (*actuators.shape[:-1], 3, actuators.shape[-1])."""
    _, stiffness, damping = -np.moveaxis(model.actuator_biasprm[actuators, :3], -1, 0)
    limited, largest = model.actuator_forcelimited[actuators], model.actuator_forcerange[actuators, 1]
    return np.stack([stiffness, damping, np.where(limited, largest, np.inf)], axis=-2)


def _gravity(model: mujoco.MjModel, joint: int) -> Array:
    """Gravity in the base frame of the arm with a given first joint, shape (3,)."""
    base = model.body_rootid[model.jnt_bodyid[joint]]
    return np.asarray(rotation_from_quaternion(model.body_quat[base]).T @ model.opt.gravity)


def _aligned(kind: str, values: Array) -> NDArray[Any]:
    """An array of structs of vectors, filled with values."""
    structs = zeroed(kind, len(values))
    structs.reshape(-1).view(np.float64)[:] = values.ravel()
    return structs
