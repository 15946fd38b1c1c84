"""MuJoCo models that are stepped: some arms of a simulation with the obstacles, or for a while without shapes.

Where arms are proven to touch nothing, no shape matters and no arm affects another one. They are then stepped in
blocks, on threads: models of the same bodies, joints and servos without shapes, which give the same results to the
byte. While set-points are known ahead, each block takes several steps before the next one does, with its data in the
cache.
"""

from __future__ import annotations

import contextlib
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.playback.simulation.arm_variation import ArmVariation, varied_model
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.playback.simulation.contact_proof import ContactProof
from rr1plan.playback.simulation.mujoco_model import MujocoScene

_UNSTABLE = np.array(
    [getattr(mujoco.mjtWarning, f"mjWARN_BAD{kind}") for kind in ("QPOS", "QVEL", "QACC", "CTRL")], int
)
# Below this number of loose bodies several threads are slower; below this number of arms the search for contacts is
# faster than a proof that there are none.
_A_HEAP, _MANY_ARMS = 50, 4
# What is left out where no contact is possible; arms have no springs and dampers, for which MuJoCo looks in each step.
_DISABLED = mujoco.mjtDisableBit
_NO_CONTACTS = int(_DISABLED.mjDSBL_CONTACT | _DISABLED.mjDSBL_SPRING | _DISABLED.mjDSBL_DAMPER)


def as_slice(indices: NDArray[np.int64]) -> NDArray[np.int64] | slice:
    """Consecutive indices as a slice, with which NumPy reads and writes several times faster; others unchanged."""
    first = int(indices[0]) if len(indices) else 0
    end = first + len(indices)
    return slice(first, end) if np.array_equal(indices, np.arange(first, end)) else indices


class SteppedModel:
    """A MuJoCo model with data and commanded servos.

    Args:
        world: The compiled model.
        columns: Index of each of its joints among those of the simulation.
        variation: How the arms differ from their description, unknown to the feed-forward torque.

    Attributes:
        model: MuJoCo's model, of the arms as they are.
        data: MuJoCo's data.
        joints: Number of its joints.
        columns: Where they are among those of the simulation.
        state: Views of their positions, velocities and efforts, shape (joints,) each.
    """

    def __init__(
        self,
        world: MujocoScene,
        columns: NDArray[np.int64],
        variation: ArmVariation | None = None,
    ) -> None:
        self.columns = as_slice(columns)
        self.joints = count = len(columns)
        # The arms as they are, and as described, which the servos know.
        self.model: mujoco.MjModel = world.model
        self._described_model: mujoco.MjModel = world.model
        if variation is not None:
            self.model = varied_model(world.model, world.scene, world.effort_limits, variation)
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        self._described: mujoco.MjData = self.data
        if variation is not None:
            self._described = mujoco.MjData(world.model)
        # Views of MuJoCo's arrays, which stay where they are: to make one takes as long as a small sum.
        data = self.data
        self.state = data.qpos[:count], data.qvel[:count], data.actuator_force
        self._control = data.ctrl.reshape(count, 3)
        self._bias = self._described.qfrc_bias[:count]
        self._torque, self._accelerations = np.zeros((2, self.model.nv))
        self._alarms = data.warning.number
        self._searching = True

    def place(self, state: Array) -> None:
        """Put its joints where all joints of the simulation are to be: positions and velocities, shape (2 or 3, n)."""
        self.state[0][:] = state[0, self.columns]
        self.state[1][:] = state[1, self.columns]

    def refresh(self) -> None:
        """Compute all that follows from the state: poses, contacts, bias torques."""
        mujoco.mj_step1(self.model, self.data)

    def advance(self, desired: Array) -> None:
        """Take a step from a refreshed state.

        Args:
            desired: Set-points of all joints of the simulation: positions, velocities, accelerations and efforts to
                add, shape (4, n).
        """
        control, joints, columns = self._control, self.joints, self.columns
        if self._described is not self.data:
            self._describe()
        self._accelerations[:joints] = desired[2, columns]
        mujoco.mj_mulM(self._described_model, self._described, self._torque, self._accelerations)
        control[:, 0] = desired[0, columns]
        control[:, 1] = desired[1, columns]
        control[:, 2] = self._torque[:joints] + self._bias + desired[3, columns]
        mujoco.mj_step2(self.model, self.data)

    def take_steps(self, desired: Array, states: Array) -> None:
        """Take some steps.

        Args:
            desired: Set-points for each step, shape (k, 4, n), see `advance`.
            states: Positions, velocities and efforts of all joints of the simulation before the first step, and those
                of this model's joints after each, which are written, shape (k + 1, 3, n).
        """
        self.place(states[0])
        for points, state in zip(desired, states[1:], strict=True):
            self.refresh()
            self.advance(points)
            self.observe(state)

    def _describe(self) -> None:
        """Compute inertia and bias torques of the arms as described, at the present state."""
        data, model = self._described, self._described_model
        data.qpos[:], data.qvel[:] = self.data.qpos, self.data.qvel
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_makeM, mujoco.mj_comVel):
            stage(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)

    def observe(self, state: Array) -> None:
        """Write positions, velocities and efforts of its joints to those of all joints, shape (3, n)."""
        for row, values in zip(state, self.state, strict=True):
            row[self.columns] = values

    def is_unstable(self) -> bool:
        """Whether MuJoCo has warned of values that are not finite or too large."""
        return bool(self._alarms.any() and self._alarms[_UNSTABLE].any())

    def switch_contacts(self, on: bool) -> None:
        """Let MuJoCo search for contacts, or not."""
        if on != self._searching:
            self._searching, flags = on, self.model.opt.disableflags
            self.model.opt.disableflags = flags & ~_NO_CONTACTS if on else flags | _NO_CONTACTS


class Tile:
    """Some arms of a simulation with the obstacles: a MuJoCo model, and its blocks where contacts are impossible.

    Args:
        world: The compiled model.
        columns: Index of each of its joints among those of the simulation.
        variation: How the arms differ from their description, unknown to the feed-forward torque.
        threads: Threads of the simulation.
        worker: Which thread steps it.

    Attributes:
        world: The compiled model.
        worker: Which thread steps it where blocks do not.
        bodies: Index of each of its loose bodies among them.
        proof: What decides whether contacts need to be searched for; None: they are searched for in every state.
        proven: Whether the present state is proven to be free of contact.
        blocks: The arms without shapes, in parts for threads, for steps from such states; none: the whole model takes
            all steps.
    """

    def __init__(
        self,
        world: MujocoScene,
        columns: NDArray[np.int64],
        variation: ArmVariation | None = None,
        *,
        threads: int = 1,
        worker: int = 0,
    ) -> None:
        self.world, self.worker, self._threads = world, worker, threads
        self._whole = SteppedModel(world, columns, variation)
        if threads > 1 and len(world.body_names) >= _A_HEAP:
            mujoco.mju_threadpool(self._whole.data, threads - 1)
        self.bodies = {name: i for i, name in enumerate(world.body_names)}
        self._state_size = mujoco.mj_stateSize(world.model, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.proof: ContactProof | None = None
        if len(world.scene.arms) >= _MANY_ARMS and not world.body_names:
            # Scenes that cannot be checked can still be simulated.
            with contextlib.suppress(InputError):
                self.proof = ContactProof(world)
        self.proven = False
        self.blocks: tuple[SteppedModel, ...] = ()
        # State before the last step and its set-points, if only blocks have taken it.
        self._missed: tuple[Array, Array] | None = None

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data; from now on the whole model takes all steps, as forces and states may be changed in it."""
        self.blocks = ()
        if self._missed is not None:
            self._catch_up()
            self._compute()
        return self._whole.data

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model; from now on contacts are searched for in every state, as it may be changed."""
        if self.proof is not None:
            _ = self.data
            self.proof, self.proven = None, False
            self._whole.switch_contacts(True)
        return self._whole.model

    # ---- steps -----------------------------------------------------------------------------------

    @property
    def most_steps(self) -> int:
        """How many steps `advance` may take from the present state."""
        if not (self.proven and self.blocks):
            return 1
        assert self.proof is not None
        return 1 + self.proof.left

    def advance(self, worker: int, desired: Array, states: Array) -> None:
        """Do a thread's share of some steps; when all have, `settle`.

        Args:
            worker: Index of the thread.
            desired: Set-points of all joints of the simulation for each step: positions, velocities, accelerations and
                efforts to add, shape (k, 4, n) with k up to `most_steps`.
            states: Their positions, velocities and efforts before the first step, and those after each, which are
                written, shape (k + 1, 3, n).
        """
        if self.proven and self.blocks:
            for block in self.blocks[worker :: self._threads]:
                block.take_steps(desired, states)
        elif worker == self.worker:
            self._whole.advance(desired[0])
            self._whole.observe(states[1])

    def count_valid(self, states: Array) -> int:
        """How many of the steps were right: from the first on, those that began in a state without contact.

        Args:
            states: As `advance` has written them.
        """
        if len(states) == 2:
            return 1
        # An unstable block is the concern of single steps.
        if self.proof is None or self._is_block_unstable():
            return 1
        return 1 + self.proof.count_near(states[1:-1, 0, self._whole.columns])

    def settle(self, desired: Array, states: Array) -> None:
        """Compute what follows from the state after the last step; arguments as of `advance`, valid steps only."""
        columns, whole, state = self._whole.columns, self._whole, states[-1]
        blocks = self.blocks if self.proven else ()
        if self.proof is not None:
            self.proof.pass_over(len(desired) - 1)
        unstable = bool(blocks) and self._is_block_unstable()
        self._prove(state[0, columns], state[1, columns], desired[-1, 2, columns], not unstable)
        if blocks:
            for _ in range(len(desired)):  # the sum that as many single steps make
                whole.data.time += whole.model.opt.timestep
            self._missed = states[-2], desired[-1]
            if self.proven:
                return
            self._catch_up()
        self._compute()

    def _is_block_unstable(self) -> bool:
        return any(block.is_unstable() for block in self.blocks)

    def _prove(self, positions: Array, velocities: Array, accelerations: Array, stable: bool = True) -> None:
        """Decide whether a state of its joints is proven to be free of contact."""
        self.proven = self.proof is not None and stable and self.proof.covers(positions, velocities, accelerations)

    def _catch_up(self) -> None:
        """Repeat the last step, which blocks have taken, with the whole model."""
        assert self._missed is not None
        (before, desired), self._missed = self._missed, None
        whole, time = self._whole, self._whole.data.time
        whole.switch_contacts(False)
        whole.place(before)
        whole.refresh()
        whole.advance(desired)
        whole.data.time = time

    def _compute(self) -> None:
        """Compute what follows from the state in the whole model."""
        self._whole.switch_contacts(not self.proven)
        self._whole.refresh()

    def observe(self, state: Array) -> None:
        """Write positions, velocities and efforts of its joints to those of all joints, shape (3, n)."""
        self._whole.observe(state)

    def is_unstable(self) -> bool:
        """Whether MuJoCo has warned of values that are not finite or too large."""
        return self._whole.is_unstable()

    # ---- states ----------------------------------------------------------------------------------

    def place(self, state: Array) -> None:
        """Put its joints at positions and velocities of all joints, shape (2, n), without `refresh`."""
        self._whole.place(state)

    def refresh(self) -> None:
        """Compute what follows from the state that it was put in."""
        positions, velocities, _ = self._whole.state
        self._missed = None
        self._prove(positions, velocities, np.zeros(len(positions)))
        self._compute()

    def begin(self, state: Array) -> None:
        """Begin anew with these positions and velocities of all joints of the simulation, shape (2, n)."""
        self._reset()
        self.place(state)
        self.refresh()

    def save(self) -> Array:
        """The state from which a run can be repeated exactly; right after `begin` only."""
        state = np.zeros(self._state_size)
        mujoco.mj_getState(self._whole.model, self._whole.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state

    def restore(self, state: Array) -> None:
        """Go back to a saved state."""
        self._reset()
        mujoco.mj_setState(self._whole.model, self._whole.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.refresh()

    def _reset(self) -> None:
        for part in (self._whole, *self.blocks):
            mujoco.mj_resetData(part.model, part.data)

    def body_state(self, name: str) -> tuple[Array, Array]:
        """Position and quaternion (7,) of a loose body, and its linear and its own angular velocity (6,), as views."""
        data, joints, i = self._whole.data, self._whole.joints, self.bodies[name]
        return data.qpos[joints + 7 * i :][:7], data.qvel[joints + 6 * i :][:6]

    def log_contacts(self, log: ContactLog, time: float) -> float:
        """Add the contacts of the present state to a log; returns the deepest penetration [m], -inf without any."""
        data = self._whole.data
        depth = -float(data.contact.dist.min()) if not self.proven and data.ncon else -math.inf
        if depth >= 0.0:
            log.add(self.world, data, time)
        return depth
