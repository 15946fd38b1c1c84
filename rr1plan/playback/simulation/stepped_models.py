"""Stepping of MuJoCo models, each with some arms of a simulation and the obstacles.

Without loose bodies and variations, steps from states without contact are computed by the kernels of `arm_dynamics`;
MuJoCo computes all others. If set-points are known in advance, several steps are computed in one call, and those after
a state with contact are discarded. MuJoCo does not search for contacts in states that are proven to have none. Results
depend on contacts, not on proofs.
"""

from __future__ import annotations

import contextlib

import mujoco
import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import InputError
from rr1plan.playback.simulation.arm_dynamics import ArmDynamics
from rr1plan.playback.simulation.arm_variation import ArmVariation, varied_model
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.playback.simulation.contact_points import ContactPoint, contact_points
from rr1plan.playback.simulation.contact_proof import ContactProof
from rr1plan.playback.simulation.fast_bodies import FastBodies
from rr1plan.playback.simulation.mujoco_geoms import shrink_bounding_spheres
from rr1plan.playback.simulation.mujoco_model import MujocoScene
from rr1plan.playback.simulation.set_points import as_slice
from rr1plan.thread_locks import per_process

_UNSTABLE = np.array(
    [getattr(mujoco.mjtWarning, f"mjWARN_BAD{kind}") for kind in ("QPOS", "QVEL", "QACC", "CTRL")], int
)
# Number of loose bodies below which several threads are slower, and number of arms below which the search for contacts
# takes less time than the tables for a proof that there are none.
_A_HEAP, _MANY_ARMS = 50, 4
# A contact is deep if its depth exceeds this part of the radius of the smaller shape.
_DEEP = 0.075
# Largest positions for which the kernels compute steps [rad or m], and number of steps per call without a proof.
_FARTHEST, _AT_ONCE = 1e3, 32
# Stages to omit where contact is impossible; arms have no springs or dampers, which MuJoCo would check in each step.
_DISABLED = mujoco.mjtDisableBit
_NO_CONTACTS = int(_DISABLED.mjDSBL_CONTACT | _DISABLED.mjDSBL_SPRING | _DISABLED.mjDSBL_DAMPER)


class SteppedModel:
    """A MuJoCo model with data and commanded servos.

    Args:
        world: The compiled model.
        columns: Index of each of its joints among those of the simulation.
        variation: Differences of the arms from their description, ignored by the feed-forward torque.

    Attributes:
        model: MuJoCo's model, with the variation.
        data: MuJoCo's data.
        joints: Number of its joints.
        columns: The indices of its joints, as a slice if they are consecutive.
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
        # The arms with their variation, and as described, for the feed-forward torque.
        self.model: mujoco.MjModel = world.model
        self._described_model: mujoco.MjModel = world.model
        if variation is not None:
            self.model = varied_model(world.model, world.scene, world.effort_limits, variation)
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        self._described: mujoco.MjData = self.data
        if variation is not None:
            self._described = mujoco.MjData(world.model)
        # Views of MuJoCo's arrays, whose addresses do not change; creating one takes as long as a small sum.
        data = self.data
        self.state = data.qpos[:count], data.qvel[:count], data.actuator_force
        self._control = data.ctrl.reshape(count, 3)
        self._bias = self._described.qfrc_bias[:count]
        self._torque, self._accelerations = np.zeros((2, self.model.nv))
        self._alarms = data.warning.number
        self._searching = True
        self._forward: mujoco.MjData | None = None
        self._option = self.model.opt
        self._solver_options = self._read_solver_options()

    def place(self, state: Array) -> None:
        """Set its joints from positions and velocities of all joints of the simulation, shape (2 or 3, n)."""
        self.state[0][:] = state[0, self.columns]
        self.state[1][:] = state[1, self.columns]

    def refresh(self) -> None:
        """Compute the quantities that depend on the state: poses, contacts, bias torques."""
        self._solver_options = self._read_solver_options()
        mujoco.mj_step1(self.model, self.data)

    def forward(self) -> mujoco.MjData:
        """A copy of the data with the accelerations and forces of the present state, valid until the next call."""
        self._follow_solver_options()
        if self._forward is None:
            self._forward = mujoco.MjData(self.model)
        mujoco.mj_copyData(self._forward, self.model, self.data)
        mujoco.mj_forwardSkip(self.model, self._forward, mujoco.mjtStage.mjSTAGE_VEL, 1)
        return self._forward

    def _read_solver_options(self) -> tuple[int, ...]:
        """The options that determine which matrices of contacts MuJoCo computes, and how it stores them."""
        option = self._option
        return option.solver, option.noslip_iterations, option.jacobian, option.cone

    def _follow_solver_options(self) -> None:
        """Refresh after a change of these options: MuJoCo terminates the process if one of the matrices is missing."""
        if self._read_solver_options() != self._solver_options:
            self.refresh()

    def advance(self, desired: Array) -> None:
        """Take a step from a refreshed state.

        Args:
            desired: Set-points of all joints of the simulation: positions, velocities, accelerations and efforts to
                add, shape (4, n).
        """
        control, joints, columns = self._control, self.joints, self.columns
        self._follow_solver_options()
        if self._described is not self.data:
            self._describe()
        self._accelerations[:joints] = desired[2, columns]
        mujoco.mj_mulM(self._described_model, self._described, self._torque, self._accelerations)
        control[:, 0] = desired[0, columns]
        control[:, 1] = desired[1, columns]
        control[:, 2] = self._torque[:joints] + self._bias + desired[3, columns]
        mujoco.mj_step2(self.model, self.data)

    def count_free(self, positions: Array) -> int:
        """Number of leading states without contact; changes the state of the model.

        Args:
            positions: Positions of its joints in these states, shape (k, joints).
        """
        for count, values in enumerate(positions):
            if not np.abs(values).max(initial=0.0) <= _FARTHEST:  # also true for nan
                return count
            self.state[0][:] = values
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_collision(self.model, self.data)
            if self.data.ncon:
                return count
        return len(positions)

    def _describe(self) -> None:
        """Compute inertia and bias torques of the described arms at the present state."""
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
    """A part of a simulation: some arms and the obstacles.

    Args:
        world: The compiled model.
        columns: Index of each of its joints among those of the simulation.
        column_count: Number of joints of the simulation.
        variation: Differences of the arms from their description, ignored by the feed-forward torque.
        threads: Number of threads of the simulation.
        worker: Index of the thread that computes MuJoCo's steps.

    Attributes:
        world: The compiled model.
        worker: Index of the thread that computes MuJoCo's steps.
        bodies: Index of each loose body in this model.
        proof: Decides whether to search for contacts; None: MuJoCo searches in every state.
        proven: Whether the present state is proven to be free of contact.
        arms: Computes steps from states without contact; None: MuJoCo does.
    """

    def __init__(
        self,
        world: MujocoScene,
        columns: NDArray[np.int64],
        column_count: int,
        variation: ArmVariation | None = None,
        *,
        threads: int = 1,
        worker: int = 0,
    ) -> None:
        self.world, self.worker = world, worker
        shrink_bounding_spheres(world.model)
        self._mujoco = SteppedModel(world, columns, variation)
        # MuJoCo's threads for heaps of bodies. In a forked process it would wait for those of the first one for ever.
        self._more_threads = threads - 1 if len(world.body_names) >= _A_HEAP else 0
        per_process(self._mujoco.data, "threadpool", int)
        self.bodies = {name: i for i, name in enumerate(world.body_names)}
        self._fast_bodies = FastBodies(world, self._mujoco.data) if world.body_names else None
        self._state_size = mujoco.mj_stateSize(world.model, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.proof: ContactProof | None = None
        self.arms: ArmDynamics | None = None
        if not world.body_names and len(columns):
            if len(world.scene.arms) >= _MANY_ARMS:
                # Scenes that cannot be checked can still be simulated.
                with contextlib.suppress(InputError):
                    self.proof = ContactProof(world)
            if variation is None:
                self.arms = ArmDynamics(world.model, columns, column_count, threads)
        self.proven = False
        # Whether the present state has no contact.
        self._free = False
        # State before the last step, its set-points and the state after it; None if MuJoCo computed this step.
        self._missed: tuple[Array, Array, Array] | None = None

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data; from now on MuJoCo computes all steps, because forces and states may be changed in it."""
        self.arms = None
        if self._missed is not None:
            self._catch_up()
            self._compute()
        return self._mujoco.data

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model; from now on MuJoCo searches for contacts in every state, because it may be changed."""
        _ = self.data
        if self.proof is not None:
            self.proof, self.proven = None, False
            self._mujoco.switch_contacts(True)
        return self._mujoco.model

    # ---- steps -----------------------------------------------------------------------------------

    @property
    def free_arms(self) -> int:
        """Number of arms that `advance` steps without MuJoCo: all or none."""
        return self.arms.count if self.arms is not None and self._free else 0

    @property
    def most_steps(self) -> int:
        """Largest number of steps that `advance` may take from the present state."""
        if not self.free_arms:
            return 1
        if self.proof is None:
            return _AT_ONCE
        return 1 + self.proof.left if self.proven else 1

    def advance(self, worker: int, desired: Array, states: Array) -> None:
        """Do a thread's share of some steps; after all threads, call `settle`.

        Args:
            worker: Index of the thread.
            desired: Set-points of all joints of the simulation for each step: positions, velocities, accelerations and
                efforts to add, shape (k, 4, n) with k up to `most_steps`.
            states: Positions, velocities and efforts of these joints before the first step (input) and after each step
                (output), shape (k + 1, 3, n).
        """
        if self.arms is not None and self._free:
            self.arms.take_steps(worker, desired, states)
        elif worker == self.worker:
            self._start_threads()
            self._mujoco.advance(desired[0])
            self._mujoco.observe(states[1])

    def count_valid(self, states: Array) -> int:
        """Number of leading steps that are valid: those that began in a state without contact.

        Args:
            states: The states from `advance`.
        """
        if len(states) == 2:
            return 1
        between = states[1:-1, 0, self._mujoco.columns]
        return 1 + (self._mujoco.count_free(between) if self.proof is None else self.proof.count_near(between))

    def settle(self, desired: Array, states: Array) -> None:
        """Update derived quantities after the last step; arguments as for `advance`, valid steps only."""
        mine, columns, state = self._mujoco, self._mujoco.columns, states[-1]
        if self.proof is not None:
            self.proof.pass_over(len(desired) - 1)
        self._prove(state[0, columns], state[1, columns], desired[-1, 2, columns])
        self._missed = None
        if self.free_arms:
            time, dt = mine.data.time, mine.model.opt.timestep
            for _ in range(len(desired)):  # rounds like single steps
                time += dt
            mine.data.time = time
            self._missed = states[-2].copy(), desired[-1].copy(), state.copy()
            if self.proven:
                return
            mine.place(state)
        self._compute()

    def _prove(self, positions: Array, velocities: Array, accelerations: Array) -> None:
        """Update `proven` for a state of its joints."""
        self.proven = self.proof is not None and self.proof.covers(positions, velocities, accelerations)

    def _catch_up(self) -> None:
        """Repeat the last step, computed by the kernels, in MuJoCo's data."""
        assert self._missed is not None
        (before, desired, after), self._missed = self._missed, None
        mine, time = self._mujoco, self._mujoco.data.time
        mine.switch_contacts(False)
        mine.place(before)
        mine.refresh()
        mine.advance(desired)
        mine.place(after)
        mine.data.time = time

    def _compute(self) -> None:
        """Compute derived quantities in MuJoCo's data, including contacts if these are possible."""
        mine = self._mujoco
        self._start_threads()
        mine.switch_contacts(not self.proven)
        mine.refresh()
        self._free = not mine.data.ncon and bool(np.abs(mine.state[0]).max(initial=0.0) <= _FARTHEST)
        if self._missed is not None and not self._free:
            # The contact solver is warm-started with the accelerations of the last step.
            self._catch_up()
            mine.switch_contacts(True)
            mine.refresh()

    def _start_threads(self) -> None:
        """Create MuJoCo's threads, unless this process has them."""
        if self._more_threads and not self._mujoco.data.threadpool:
            mujoco.mju_threadpool(self._mujoco.data, self._more_threads)

    def observe(self, state: Array) -> None:
        """Write positions, velocities and efforts of its joints to those of all joints, shape (3, n)."""
        self._mujoco.observe(state)

    def is_unstable(self) -> bool:
        """Whether MuJoCo has warned of values that are not finite or too large."""
        return self._mujoco.is_unstable()

    # ---- states ----------------------------------------------------------------------------------

    def place(self, state: Array) -> None:
        """Set its joints from positions and velocities of all joints, shape (2, n), without `refresh`."""
        self._mujoco.place(state)

    def refresh(self) -> None:
        """Compute derived quantities after a change of the state."""
        positions, velocities, _ = self._mujoco.state
        self._missed = None
        self._prove(positions, velocities, np.zeros(len(positions)))
        self._compute()

    def begin(self, state: Array) -> None:
        """Restart with positions and velocities of all joints of the simulation, shape (2, n)."""
        self._reset()
        self.place(state)
        self.refresh()

    def save(self) -> Array:
        """The state for an exact repetition of a run; only valid directly after `begin`."""
        state = np.zeros(self._state_size)
        mujoco.mj_getState(self._mujoco.model, self._mujoco.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state

    def restore(self, state: Array) -> None:
        """Return to a saved state."""
        self._reset()
        mujoco.mj_setState(self._mujoco.model, self._mujoco.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.refresh()

    def _reset(self) -> None:
        mujoco.mj_resetData(self._mujoco.model, self._mujoco.data)

    def body_state(self, name: str) -> tuple[Array, Array]:
        """Position and quaternion (7,) and velocities (6,) of a loose body, views; angular velocity in body axes."""
        data, joints, i = self._mujoco.data, self._mujoco.joints, self.bodies[name]
        return data.qpos[joints + 7 * i :][:7], data.qvel[joints + 6 * i :][:6]

    def contact_points(self) -> list[ContactPoint]:
        """The contacts of the present state."""
        mine = self._mujoco
        return contact_points(self.world, mine.model, mine.forward()) if mine.data.ncon and not self.proven else []

    def log_contacts(self, log: ContactLog, time: float) -> None:
        """Add the contacts of the present state, and passages of loose bodies in the last step, to a log."""
        data = self._mujoco.data
        if self._fast_bodies is not None:
            log.add_passages(self._fast_bodies.passages(self._mujoco.model, data), time)
        if not self.proven and data.ncon and data.contact.dist.min() <= 0.0:
            log.add(self.world, data, time)

    def deep_contacts(self) -> dict[tuple[str, str], float]:
        """Depth of the present contacts of loose bodies that are deep for the size of the shapes [m], by elements."""
        data, radii, found = self._mujoco.data, self.world.model.geom_rbound, dict[tuple[str, str], float]()
        contacts = zip(data.contact.geom.tolist(), data.contact.dist.tolist(), strict=True) if self.bodies else ()
        for geoms, distance in contacts:
            least = min(radius for radius in radii[geoms].tolist() if radius > 0.0)  # 0: a plane
            one, two = sorted(self.world.geom_elements[geom] for geom in geoms)
            if not {one, two}.isdisjoint(self.bodies) and -distance > _DEEP * least:
                found[one, two] = max(-distance, found.get((one, two), 0.0))
        return found
