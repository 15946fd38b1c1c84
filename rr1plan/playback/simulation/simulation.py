"""A simulation of a scene in MuJoCo: all arms on one clock, commanded by controllers, step by step.

    sim = rp.Simulation(scene)
    arm = rp.JointTrajectoryController(scene.joint_names(["arm"]))
    sim.activate(arm)
    execution = arm.send(motion.trajectory)
    sim.run(duration=motion.trajectory.duration + 1.0)
    print(execution, sim.contacts)

In each step the controllers see the state at its beginning; their set-points go to servos with a feed-forward torque
from inverse dynamics at that state (computed torque control). Arms that can never meet are in separate MuJoCo models,
which are stepped side by side on threads; the numbers do not depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import (
    Array,
    check_callback,
    counted,
    finite_array,
    finite_number,
    known_name,
    of_kind,
    positive_number,
    whole_number,
)
from rr1plan.errors import BackendError, ControllerError, InputError, UnknownNameError
from rr1plan.path import check_joint_names
from rr1plan.playback.simulation.arm_variation import ArmVariation, varied_model
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.playback.simulation.contact_proof import ContactProof
from rr1plan.playback.simulation.controllers import Controller, JointInfo, JointState, SetPoint
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.simulation.mujoco_model import MujocoScene, Solver, build_mujoco
from rr1plan.playback.simulation.replay import ReplayContact
from rr1plan.playback.simulation.tiles import check_memory, tile_scenes
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.scene import Arm, Scene
from rr1plan.transforms import as_pose, identity, quaternion_from_rotation, rotation_from_quaternion

_UNSTABLE = np.array(
    [getattr(mujoco.mjtWarning, f"mjWARN_BAD{kind}") for kind in ("QPOS", "QVEL", "QACC", "CTRL")], int
)
_MOST_STIFFNESS = 1e6  # [rad/s]
_LONGEST_STEP = 1.0  # [s]
# Fewer loose bodies are slower on several threads, and of fewer arms contacts are found sooner than excluded.
_A_HEAP, _MANY_ARMS = 50, 4
# What is left out where no contact is possible; arms have no springs and dampers, for which MuJoCo looks in each step.
_DISABLED = mujoco.mjtDisableBit
_NO_CONTACTS = int(_DISABLED.mjDSBL_CONTACT | _DISABLED.mjDSBL_SPRING | _DISABLED.mjDSBL_DAMPER)
# Steps of one call; more take hours, and a replay of them more memory than there is.
_MOST_STEPS = 5_000_000
# Real time is waited for when the simulation is ahead of it by more than this [s].
_AHEAD = 0.002

StepCallback = Callable[["Simulation"], bool | None]


def step_count(seconds: float, dt: float) -> int:
    """Number of steps of a replay, at least one.

    Args:
        seconds: How long it lasts at least [s].
        dt: Time of a step [s].

    Raises:
        InputError: too many steps.
    """
    if seconds > _MOST_STEPS * dt:
        raise InputError(f"{seconds:g} s in steps of {dt:g} s are too many; take longer steps")
    return max(1, math.ceil(seconds / dt - 1e-9))


def _as_slice(indices: NDArray[np.int64]) -> NDArray[np.int64] | slice:
    """Indices in a row as a slice, by which arrays are read and written several times faster; others as they are."""
    first = int(indices[0]) if len(indices) else 0
    end = first + len(indices)
    return slice(first, end) if np.array_equal(indices, np.arange(first, end)) else indices


class Tile:
    """One MuJoCo model of a simulation: some of its arms with the obstacles.

    Args:
        world: The compiled model.
        columns: Index of each of its joints among those of the simulation.
        threads: Threads for contacts of many loose bodies.
        variation: How the arms differ from their description, unknown to the feed-forward torque.

    Attributes:
        data: MuJoCo's data.
        proof: What decides whether contacts need to be searched for; None: they are searched for in every state.
        joints: Number of its joints.
        state: Views of their positions, velocities and efforts, shape (joints,) each.
        bodies: Index of each of its loose bodies among them.
    """

    def __init__(
        self, world: MujocoScene, columns: NDArray[np.int64], threads: int, variation: ArmVariation | None = None
    ) -> None:
        self.world = world
        self.columns = _as_slice(columns)
        self.joints = count = len(columns)
        self._model: mujoco.MjModel = world.model
        if variation is not None:
            self._model = varied_model(world.model, world.scene, world.effort_limits, variation)
        self.data: mujoco.MjData = mujoco.MjData(self._model)
        if threads > 1 and len(world.body_names) >= _A_HEAP:
            mujoco.mju_threadpool(self.data, threads - 1)
        # Views of MuJoCo's arrays, which stay where they are: to make one takes as long as a small sum.
        data = self.data
        self.state = data.qpos[:count], data.qvel[:count], data.actuator_force
        self._control = data.ctrl.reshape(count, 3)
        # The arms as described, where they are others: of them the servos know.
        self._described = data if variation is None else mujoco.MjData(world.model)
        self._bias = self._described.qfrc_bias[:count]
        self.bodies = {name: i for i, name in enumerate(world.body_names)}
        self._torque, self._accelerations = np.zeros((2, self._model.nv))
        self._alarms = data.warning.number
        self._state_size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.proof: ContactProof | None = None
        self._searching = True
        if len(world.scene.arms) >= _MANY_ARMS and not world.body_names:
            # Scenes that cannot be checked can still be simulated.
            with contextlib.suppress(InputError):
                self.proof = ContactProof(world)

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model; from now on contacts are searched for in every state, as it may be changed."""
        if self.proof is not None:
            self.proof = None
            self._search(True)
        return self._model

    def _search(self, contacts: bool) -> None:
        """Let MuJoCo search for contacts, or not."""
        if contacts == self._searching:
            return
        self._searching = contacts
        flags = self._model.opt.disableflags
        self._model.opt.disableflags = flags & ~_NO_CONTACTS if contacts else flags | _NO_CONTACTS

    def refresh(self) -> None:
        """Compute all that follows from the state: poses, contacts, bias torques."""
        if self.proof is not None:
            self._search(not self.proof.covers(self.state[0], self.state[1], self._accelerations[: self.joints]))
        mujoco.mj_step1(self._model, self.data)

    def place(self, positions: Array, velocities: Array) -> None:
        """Put its joints where all joints of the simulation are to be, without `refresh`."""
        self.state[0][:] = positions[self.columns]
        self.state[1][:] = velocities[self.columns]

    def begin(self, positions: Array, velocities: Array) -> None:
        """Begin anew with these positions and velocities of all joints of the simulation."""
        mujoco.mj_resetData(self._model, self.data)
        self.place(positions, velocities)
        self.refresh()

    def _command(self, positions: Array, velocities: Array, accelerations: Array, efforts: Array) -> None:
        """Set-points of all joints of the simulation for the next step, with the feed-forward torque."""
        control, joints = self._control, self.joints
        self._accelerations[:joints] = accelerations[self.columns]
        if self._described is not self.data:
            self._describe()
        mujoco.mj_mulM(self.world.model, self._described, self._torque, self._accelerations)
        control[:, 0] = positions[self.columns]
        control[:, 1] = velocities[self.columns]
        control[:, 2] = self._torque[:joints] + self._bias + efforts[self.columns]

    def _describe(self) -> None:
        """Compute inertia and bias torques of the arms as described, at the present state."""
        data, model = self._described, self.world.model
        data.qpos[:], data.qvel[:] = self.data.qpos, self.data.qvel
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_makeM, mujoco.mj_comVel):
            stage(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)

    def advance(self, desired: Array, state: Array) -> None:
        """Take a step from the present state, and refresh what follows from the new one.

        Args:
            desired: Set-points of all joints of the simulation: positions, velocities, accelerations and efforts to
                add, shape (4, n).
            state: Gets positions, velocities and efforts of the joints of this model, shape (3, n).
        """
        self._command(*desired)
        mujoco.mj_step2(self._model, self.data)
        self.refresh()
        self.observe(state)

    def observe(self, state: Array) -> None:
        """Write positions, velocities and efforts of its joints to those of all joints, shape (3, n)."""
        for row, values in zip(state, self.state, strict=True):
            row[self.columns] = values

    def is_unstable(self) -> bool:
        """Whether MuJoCo has warned of values that are not finite or too large."""
        return bool(self._alarms.any() and self._alarms[_UNSTABLE].any())

    def body_state(self, name: str) -> tuple[Array, Array]:
        """Position and quaternion (7,) of a loose body, and its linear and its own angular velocity (6,), as views."""
        joints, i = self.joints, self.bodies[name]
        qpos, qvel = self.data.qpos[joints + 7 * i :], self.data.qvel[joints + 6 * i :]
        return qpos[:7], qvel[:6]

    def save(self) -> Array:
        """The state from which a run can be repeated exactly."""
        state = np.zeros(self._state_size)
        mujoco.mj_getState(self._model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state

    def restore(self, state: Array) -> None:
        """Go back to a saved state."""
        mujoco.mj_resetData(self._model, self.data)
        mujoco.mj_setState(self._model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.refresh()


class Simulation:
    """A scene in MuJoCo, to be stepped; nothing moves that no controller commands.

    Joint damping and friction of the description are left out: they belong to a drive, whose controller compensates
    them. Obstacles with a mass are loose bodies. The scene is not changed. Where four or more arms are proven to touch
    nothing (`contact_proof`), MuJoCo does not search for contacts, which changes no result.

    Args:
        scene: The scene; arms start in their configurations.
        dt: Time of a step [s].
        stiffness: Natural frequency of the joint servos [rad/s].
        threads: Threads for arms that can never meet, and for heaps of loose bodies.
        solver: What computes the forces of contacts where there are loose bodies: "newton" to convergence, which holds
            grasped bodies; or conjugate gradients ("cg") in at most twenty iterations, with fewer points of contact,
            which take a fraction of the time for heaps of hundreds of bodies; these sink deeper into each other when
            they crash.
        variation: How the arms differ from their description, which their servos rely on (default: not at all).

    Attributes:
        scene: The scene; its loose bodies where they began, see `current_scene`.
        dt: Time of a step [s].
        joint_names: "arm/joint" of every movable joint, the order of `positions`, `velocities` and `efforts`.
        tiles: The MuJoCo models with their data.

    Raises:
        InputError: a step or stiffness that is not above zero, a point cloud of too many cells, or more arms or bodies
            than the machine has memory for.
        BackendError: MuJoCo does not take the scene.
    """

    def __init__(
        self,
        scene: Scene,
        dt: float = 0.002,
        *,
        stiffness: float = 160.0,
        threads: int = 1,
        solver: Solver = "newton",
        variation: ArmVariation | None = None,
    ) -> None:
        of_kind("scene", scene, Scene)
        of_kind("variation", variation, ArmVariation, optional=True)
        known_name("solver", solver, ("newton", "cg"))
        self._solver: Solver = solver
        self._variation = variation
        self.scene = scene
        self.dt = positive_number("dt", dt)
        if self.dt > _LONGEST_STEP:
            raise InputError(f"dt is {dt:g} s, expected at most {_LONGEST_STEP:g} s")
        if positive_number("stiffness", stiffness) > _MOST_STIFFNESS:
            raise InputError(f"stiffness is {stiffness}, expected at most {_MOST_STIFFNESS:g} rad/s")
        self._stiffness = float(stiffness)
        self._threads = whole_number("threads", threads, 1, 256)
        self._map = JointMap(scene)
        self.joint_names = self._map.names
        self._warnings: list[str] = []
        self.tiles = self._build(scene)
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 and len(self.tiles) > 1 else None
        self._active: dict[Controller, NDArray[np.int64] | slice] = {}
        # Whether joints that others mimic have been commanded.
        self._leading = False
        self._callbacks: list[StepCallback] = []
        self._pause = threading.Event()
        self._contacts = ContactLog(1.5 * self.dt)
        self._deepest = 0.0
        self._wall = 0.0
        self._begin(self._map.expand(scene.configuration()), np.zeros(len(self.joint_names)))

    def __repr__(self) -> str:
        models = f", {len(self.tiles)} models" if len(self.tiles) > 1 else ""
        return f"Simulation({counted(len(self.scene.arms), 'arm')}, {self.time:.3f} s{models})"

    # ---- state -----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.dt

    @property
    def positions(self) -> Array:
        """Position of every joint [rad or m], shape (n,)."""
        return self._now.positions.copy()

    @property
    def velocities(self) -> Array:
        """Velocity of every joint [rad/s or m/s], shape (n,)."""
        return self._now.velocities.copy()

    @property
    def efforts(self) -> Array:
        """Effort of every servo in the last step [Nm or N], shape (n,)."""
        return self._now.efforts.copy()

    @property
    def effort_limits(self) -> Array:
        """Largest effort of every servo [Nm or N], shape (n,); inf where there is none.

        Servos keep it, except in arms whose masses are estimated.
        """
        return self._map.effort.copy()

    @property
    def set_points(self) -> Array:
        """Position that every servo follows [rad or m], shape (n,)."""
        return np.array(self._desired[0])

    @property
    def contacts(self) -> tuple[ReplayContact, ...]:
        """Contacts that the scene forbids, since the beginning, in order of time."""
        return self._contacts.intervals()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What MuJoCo has warned of."""
        return tuple(dict.fromkeys(self._warnings))

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds for each second that steps have taken."""
        return self.time / self._wall if self._wall > 0.0 else 0.0

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model, which may be changed between steps.

        Steps of many arms take longer from then on: MuJoCo searches for contacts in all of them, as the proofs that
        there are none hold for the scene as it was.

        Raises:
            InputError: arms that cannot meet have separate models; see `tiles`.
        """
        return self._only_tile().model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data; change it between steps only.

        Raises:
            InputError: arms that cannot meet have separate models; see `tiles`.
        """
        return self._only_tile().data

    def configuration(self, arms: Sequence[str] | None = None) -> Array:
        """Positions of the planning joints of some arms (default: all), as in `Scene.configuration`, shape (nq,).

        Raises:
            UnknownNameError: an unknown arm.
        """
        names = self.scene.joint_names(arms)
        return self.positions[self._indices(names)]

    def state(self, joint_names: Sequence[str]) -> JointState:
        """The state of some joints.

        Raises:
            UnknownNameError: an unknown joint.
        """
        return self._state(self._indices(check_joint_names(joint_names)))

    # ---- loose bodies ----------------------------------------------------------------------------

    @property
    def body_names(self) -> tuple[str, ...]:
        """The loose bodies: obstacles with a mass."""
        return tuple(name for tile in self.tiles for name in tile.bodies)

    @property
    def max_penetration(self) -> float:
        """Deepest penetration of any contact since the beginning [m], allowed ones of loose bodies included."""
        return self._deepest

    @property
    def current_scene(self) -> Scene:
        """The scene as it is now, for planning: arms in their configurations, loose bodies at their poses."""
        moved = {name: replace(self.scene.obstacles[name], pose=self.body_pose(name)) for name in self.body_names}
        q = self.scene.split(self.configuration())
        arms = {name: Arm(arm.robot, arm.base, q[name]) for name, arm in self.scene.arms.items()}
        return replace(self.scene, arms=arms, obstacles={**self.scene.obstacles, **moved})

    def body_pose(self, name: str) -> Array:
        """T_world_body of a loose body, shape (4, 4).

        Raises:
            UnknownNameError: no such loose body.
        """
        position = self.body_coordinates(name)
        pose = identity().copy()
        pose[:3, 3], pose[:3, :3] = position[:3], rotation_from_quaternion(position[3:])
        return pose

    def body_coordinates(self, name: str) -> Array:
        """Position [m] and quaternion (wxyz) of a loose body, shape (7,).

        Raises:
            UnknownNameError: no such loose body.
        """
        return self._body(name).body_state(name)[0].copy()

    def body_velocity(self, name: str) -> Array:
        """Linear velocity of a loose body's origin [m/s] and its angular velocity [rad/s], in world axes, shape (6,).

        Raises:
            UnknownNameError: no such loose body.
        """
        _, velocity = self._body(name).body_state(name)
        return np.concatenate([velocity[:3], self.body_pose(name)[:3, :3] @ velocity[3:]])

    def place_body(self, name: str, pose: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Put a loose body somewhere, between two steps; the clock goes on.

        Args:
            name: The body.
            pose: T_world_body: (4, 4), or a position (3,) [m].
            velocity: Linear [m/s] and angular velocity [rad/s] in world axes, shape (6,) (default: at rest).

        Raises:
            UnknownNameError: no such loose body.
            InputError: no pose, or a velocity that is not finite.
        """
        tile, T = self._body(name), as_pose(pose, "pose")
        rates = np.zeros(6) if velocity is None else finite_array("velocity", velocity, (6,))
        place, motion = tile.body_state(name)
        place[:3], place[3:] = T[:3, 3], quaternion_from_rotation(T[:3, :3])
        motion[:3], motion[3:] = rates[:3], T[:3, :3].T @ rates[3:]
        tile.refresh()

    def update_scene(self, scene: Scene) -> None:
        """Go on in another scene of the same arms: things added, moved or removed, grasped or released.

            sim.update_scene(sim.scene.with_obstacle("ball", rp.Sphere(0.05), [0.3, 0.0, 1.0], mass=0.2))

        Arms keep their state and their controllers, the clock goes on. Loose bodies that are at the same pose in both
        scenes keep their state, too; everything else is where the new scene has it. `reset` comes back to the
        scene of the beginning.

        Args:
            scene: The other scene.

        Raises:
            InputError: other arms, or arms elsewhere.
            BackendError: MuJoCo does not take the scene.
        """
        of_kind("scene", scene, Scene)
        before = self.scene.arms
        for name in (*before, *scene.arms):
            one, other = before.get(name), scene.arms.get(name)
            if one is None or other is None or list(before) != list(scene.arms):
                raise InputError(f"the scenes have different arms ({name!r}), expected the arms of the simulation")
            if one.robot.content_hash != other.robot.content_hash or not np.array_equal(one.base, other.base):
                raise InputError(f"arm {name!r} is another robot or elsewhere, expected the arms of the simulation")
        tiles = self._build(scene)
        old, new = self.scene.obstacles, scene.obstacles
        stay = {name for name in self.body_names if name in new and np.array_equal(old[name].pose, new[name].pose)}
        for tile in tiles:
            tile.place(self._now.positions, self._now.velocities)
            for name in stay & tile.bodies.keys():
                for to, of in zip(tile.body_state(name), self._body(name).body_state(name), strict=True):
                    to[:] = of
            tile.refresh()
        self.tiles, self.scene = tiles, scene

    # ---- controllers -----------------------------------------------------------------------------

    @property
    def controllers(self) -> tuple[Controller, ...]:
        """The active controllers."""
        return tuple(self._active)

    def activate(self, controller: Controller, *, replace: bool = False) -> None:
        """Let a controller command its joints, from the next step on.

        Args:
            controller: The controller.
            replace: Deactivate those that command some of its joints.

        Raises:
            InputError: another controller commands one of its joints, or a joint mimics another one.
            UnknownNameError: an unknown joint.
        """
        of_kind("controller", controller, Controller)
        indices = self._indices(controller.joint_names)
        for name in controller.joint_names:
            if name in self._map.followers:
                raise InputError(f"joint {name!r} mimics {self._map.followers[name]!r}; command that one")
        for other in list(self._active):
            shared = set(other.joint_names).intersection(controller.joint_names)
            if not shared or other is controller:
                continue
            if not replace:
                first = min(shared, key=self.joint_names.index)
                raise InputError(
                    f"joint {first!r} is commanded by an active {type(other).__name__}; deactivate it first, or "
                    "activate with replace=True"
                )
            del self._active[other]
            other.deactivate()
        self._active.pop(controller, None)
        joints = self._map
        info = JointInfo(
            controller.joint_names, joints.lower[indices], joints.upper[indices], joints.velocity[indices], self.dt
        )
        controller.activate(info, self._state(indices))
        self._active[controller] = _as_slice(indices)
        self._leading = self._leading or self._map.leads(indices)

    def deactivate(self, controller: Controller) -> None:
        """Stop a controller; its joints hold their last set-points.

        Raises:
            InputError: it is not active.
        """
        of_kind("controller", controller, Controller)
        if controller not in self._active:
            raise InputError("the controller is not active in this simulation")
        indices = self._active.pop(controller)
        controller.deactivate()
        for rates in self._desired[1:]:
            rates[indices] = 0.0

    def on_step(self, callback: StepCallback) -> Callable[[], None]:
        """Call something after each step.

        Args:
            callback: Gets the simulation; False pauses it.

        Returns:
            What ends the calls.
        """
        if callback is None:
            raise InputError("callback is None, expected a function of the simulation")
        check_callback("callback", callback)
        self._callbacks.append(callback)
        return lambda: self._callbacks.remove(callback)

    # ---- running ---------------------------------------------------------------------------------

    def step(self, count: int = 1) -> None:
        """Take some steps, as fast as possible; ends early if a callback pauses the simulation.

        Raises:
            InputError: a count below one.
            ControllerError: a controller raised something or returned no set-points; nothing has moved in that step.
            BackendError: the simulation became unstable.
        """
        self._run(whole_number("count", count, 1, _MOST_STEPS), math.inf)

    def run(self, *, until: float | None = None, duration: float | None = None, speed: float = math.inf) -> bool:
        """Run to a time or for a time; another thread or a callback may `pause` it.

        Args:
            until: Simulated time at which to stop [s].
            duration: How long to run instead [s, simulated].
            speed: Simulated seconds for a second at the most: 1 is real time (default: as fast as possible).

        Returns:
            Whether it got there; False if it was paused.

        Raises:
            InputError: neither or both of `until` and `duration`, a time that has passed, a speed not above zero.
            ControllerError: a controller raised something or returned no set-points; nothing has moved in that step.
            BackendError: the simulation became unstable.
        """
        if (until is None) == (duration is None):
            raise InputError("run takes either until or duration")
        if until is not None:
            end = finite_number("until", until)
        else:
            end = self.time + finite_number("duration", duration if duration is not None else 0.0)
        if end < self.time - 1e-9:
            raise InputError(f"the simulation is at {self.time:g} s, it cannot run to {end:g} s; reset it first")
        if not (isinstance(speed, float) and speed == math.inf):
            speed = positive_number("speed", speed)
        if end - self.time > _MOST_STEPS * self.dt:
            raise InputError(f"{end - self.time:g} s are more than {_MOST_STEPS} steps; run it in parts")
        return self._run(math.ceil((end - self.time) / self.dt - 1e-9), float(speed))

    def pause(self) -> None:
        """End the present `run` or `step` after its step; from a callback or another thread."""
        self._pause.set()

    def reset(self) -> None:
        """Go back to the beginning and its scene exactly; active controllers are activated again."""
        self.scene, self.tiles = self._origin
        for tile, state in zip(self.tiles, self._initial, strict=True):
            tile.restore(state)
        self._set_off()

    def place(self, joint_names: Sequence[str], positions: ArrayLike, velocities: ArrayLike | None = None) -> None:
        """Put joints somewhere without physics and begin anew there, at time zero; `reset` comes back to it.

        Args:
            joint_names: The joints, "arm/joint"; the others stay where they are.
            positions: Where [rad or m], shape (n,).
            velocities: How fast [rad/s or m/s], shape (n,) (default: at rest).

        Raises:
            InputError: wrong shapes or not finite.
            UnknownNameError: an unknown joint.
        """
        names = check_joint_names(joint_names)
        indices = self._indices(names)
        every = self.positions
        every[indices] = finite_array("positions", positions, (len(names),))
        rates = np.zeros(len(every))
        rates[indices] = 0.0 if velocities is None else finite_array("velocities", velocities, (len(names),))
        self._begin(self._map.follow(every), self._map.follow(rates, rates=True))

    # ---- inside ----------------------------------------------------------------------------------

    def _build(self, scene: Scene) -> list[Tile]:
        tiles = []
        with mujoco_warnings() as warnings:
            parts = tile_scenes(scene)
            check_memory(parts)
            for part in parts:
                world = build_mujoco(part, timestep=self.dt, stiffness=self._stiffness, solver=self._solver)
                tiles.append(Tile(world, self._indices(world.joint_names), self._threads, self._variation))
        self._warnings += warnings
        return tiles

    def _body(self, name: str) -> Tile:
        """The model with a loose body."""
        known_name("loose body", name, self.body_names)
        return next(tile for tile in self.tiles if name in tile.bodies)

    def _begin(self, positions: Array, velocities: Array) -> None:
        for tile in self.tiles:
            tile.begin(positions, velocities)
        self._origin = self.scene, self.tiles
        self._initial = [tile.save() for tile in self.tiles]
        self._set_off()

    def _set_off(self) -> None:
        """Start the clock, with the present positions as set-points."""
        self.steps = 0
        self._wall = 0.0
        self._contacts.clear()
        self._deepest = 0.0
        state = np.empty((3, len(self.joint_names)))
        for tile in self.tiles:
            tile.observe(state)
        self._now = JointState(self.time, *state)
        self._desired = np.zeros((4, len(self.joint_names)))
        self._desired[0] = self._now.positions
        self._note_contacts()
        self._leading = False
        for controller in list(self._active):
            self.activate(controller)

    def _run(self, count: int, speed: float) -> bool:
        self._pause.clear()
        began = time.perf_counter()
        with mujoco_warnings() as warnings:
            try:
                for k in range(count):
                    self._step()
                    if any(tile.is_unstable() for tile in self.tiles):
                        raise BackendError(
                            f"MuJoCo's simulation became unstable at {self.time:.3f} s"
                            f"{f' ({warnings[-1]})' if warnings else ''}; try a smaller time step or a slower motion"
                        )
                    self._note_contacts()
                    for callback in list(self._callbacks):
                        if callback(self) is False:
                            self._pause.set()
                    ahead = (k + 1) * self.dt / speed - (time.perf_counter() - began)
                    if speed < math.inf and ahead > _AHEAD:
                        time.sleep(ahead)
                    if self._pause.is_set():
                        break
            finally:
                self._warnings += warnings
                self._wall += time.perf_counter() - began
        return not self._pause.is_set()

    def _step(self) -> None:
        for controller, indices in list(self._active.items()):
            self._take(controller, indices)
        if self._leading:
            self._map.follow_all(self._desired)
        state = np.empty((3, len(self.joint_names)))

        def advance(first: int) -> None:
            for tile in self.tiles[first :: self._threads] if self._pool else self.tiles:
                tile.advance(self._desired, state)

        others = [self._pool.submit(advance, first) for first in range(1, self._threads)] if self._pool else []
        advance(0)
        for other in others:
            other.result()
        self.steps += 1
        self._now = JointState(self.time, *state)

    def _take(self, controller: Controller, indices: NDArray[np.int64] | slice) -> None:
        """Get the set-points of a controller."""
        name, shape = type(controller).__name__, (len(controller.joint_names),)
        try:
            point = controller.update(self._state(indices))
        except Exception as error:
            raise ControllerError(f"{name} raised {type(error).__name__} at {self.time:.3f} s: {error}") from error
        if not isinstance(point, SetPoint):
            raise ControllerError(f"{name} returned a {type(point).__name__} at {self.time:.3f} s, expected a SetPoint")
        wanted: list[Array | float] = []
        for field, values in zip(SetPoint._fields, point, strict=True):
            if values is None:
                wanted.append(0.0)
                continue
            try:
                row = np.asarray(values, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise ControllerError(f"{name} returned {field} that are no numbers at {self.time:.3f} s") from error
            if row.shape != shape:
                raise ControllerError(
                    f"{name} returned {field} of shape {row.shape} at {self.time:.3f} s, expected {shape}"
                )
            if not np.isfinite(row).all():
                raise ControllerError(f"{name} returned {field} that are not finite at {self.time:.3f} s")
            wanted.append(row)
        for desired, row_or_zero in zip(self._desired, wanted, strict=True):
            desired[indices] = row_or_zero

    def _note_contacts(self) -> None:
        for tile in self.tiles:
            depth = -float(tile.data.contact.dist.min()) if tile.data.ncon else -math.inf
            if depth >= 0.0:
                self._contacts.add(tile.world, tile.data, self.time)
                self._deepest = max(self._deepest, depth)

    def _state(self, indices: NDArray[np.int64] | slice) -> JointState:
        """The state of some joints, a copy that controllers may change."""
        now = self._now
        rows = (row[indices] for row in (now.positions, now.velocities, now.efforts))
        return JointState(now.time, *(row.copy() if isinstance(indices, slice) else row for row in rows))

    def _indices(self, names: Sequence[str]) -> NDArray[np.int64]:
        for name in names:
            if name not in self._map.index:
                raise UnknownNameError("joint", name, self.joint_names)
        return np.array([self._map.index[name] for name in names], dtype=np.int64)

    def _only_tile(self) -> Tile:
        if len(self.tiles) > 1:
            raise InputError(f"this simulation has {len(self.tiles)} MuJoCo models; see Simulation.tiles")
        return self.tiles[0]
