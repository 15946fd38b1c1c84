"""A simulation of a scene in MuJoCo: all arms on one clock, commanded by controllers, step by step.

    sim = rp.Simulation(scene)
    arm = rp.JointTrajectoryController(scene.joint_names(["arm"]))
    sim.activate(arm)
    execution = arm.send(motion.trajectory)
    sim.run(duration=motion.trajectory.duration + 1.0)
    print(execution, sim.contacts)

In each step the controllers read the state at its beginning; servos follow their set-points, with a feed-forward torque
from inverse dynamics at that state (computed torque control). Arms that can never meet are in separate MuJoCo models.
While the arms of a model are not in contact, kernels with MuJoCo's dynamics compute the steps, on several threads, and
several steps in one call if controllers preview their set-points and there are no callbacks. Results depend neither on
threads nor on calls.
"""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import replace
from functools import wraps
from typing import Any, NoReturn, TypeVar, cast

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import (
    Array,
    check_callback,
    counted,
    finite_number,
    known_name,
    near_array,
    of_kind,
    positive_number,
    whole_number,
)
from rr1plan.errors import BackendError, InputError, UnknownNameError
from rr1plan.path import check_joint_names
from rr1plan.playback.simulation.arm_variation import ArmVariation
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.playback.simulation.controllers import Controller, JointInfo, JointState
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.simulation.mujoco_model import Solver, build_mujoco, usual_stiffness
from rr1plan.playback.simulation.replay import ReplayContact
from rr1plan.playback.simulation.set_points import Rows, SetPoints, part_of
from rr1plan.playback.simulation.stepped_models import Tile
from rr1plan.playback.simulation.tiles import check_memory, tile_scenes
from rr1plan.robot import Robot
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.scene import Arm, Scene
from rr1plan.thread_locks import exclusive
from rr1plan.transforms import as_pose, identity, quaternion_from_rotation, rotation_from_quaternion

_MOST_STIFFNESS = 1e6  # [rad/s]
LONGEST_STEP = 1.0  # [s]
# Largest number of steps in one call; more would take hours, and their replay more memory than there is.
_MOST_STEPS = 5_000_000
# Smallest number of steps of single arms without contact for which threads are faster than one.
_SHARED = 1000
# The simulation sleeps if it is ahead of real time by more than this [s].
_AHEAD = 0.002
# Largest distance of a locked joint from its value in the scene that `current_scene` ignores, so that arms keep sharing
# a robot and the tables computed for it [rad or m].
_STILL = 1e-6
# Rounding of poses.
_SAME_POSE = 1e-9

# The simulation of each active controller.
_commanded_by: weakref.WeakKeyDictionary[Controller, weakref.ref[Simulation]] = weakref.WeakKeyDictionary()

StepCallback = Callable[["Simulation"], bool | None]
_Method = TypeVar("_Method", bound=Callable[..., Any])


def _between_steps(method: _Method) -> _Method:
    """A method that other threads can call during a run, but controllers cannot call in their update."""

    @wraps(method)
    def locked(self: Simulation, *args: Any, **kwargs: Any) -> Any:
        with self._lock:
            if self._stepping:
                raise InputError(
                    f"a controller called {method.__name__} during a step; call it between steps, for example in a "
                    "callback of on_step"
                )
            return method(self, *args, **kwargs)

    return cast("_Method", locked)


def step_count(seconds: float, dt: float) -> int:
    """Number of steps of a replay, at least one.

    Args:
        seconds: Minimum duration [s].
        dt: Time of a step [s].

    Raises:
        InputError: too many steps.
    """
    if seconds > _MOST_STEPS * dt:
        raise InputError(f"{seconds:g} s in steps of {dt:g} s are too many; take longer steps")
    return max(1, math.ceil(seconds / dt - 1e-9))


class Simulation:
    """A simulation of a scene in MuJoCo; joints hold their positions unless a controller commands them.

    Joint damping and friction of the description are omitted: they belong to a drive, whose controller compensates
    them. Obstacles with a mass are loose bodies. The scene is not changed. In models of four or more arms, MuJoCo does
    not search for contacts while these are proven impossible (`contact_proof`), which does not change any result.

    Threads may share a simulation: one thread runs it at a time, and other methods take effect between two steps.

    Args:
        scene: The scene; arms start in their configurations.
        dt: Time of a step [s].
        stiffness: Natural frequency of the joint servos [rad/s] (default: 160, or 0.8 / dt if that is lower, because
            stiffer servos oscillate).
        threads: Number of threads for separate models, arms without contact and heaps of loose bodies.
        solver: Solver for contact forces if there are loose bodies: "newton" converges and holds grasped bodies;
            conjugate gradients ("cg") with at most twenty iterations and fewer contact points take a fraction of the
            time for heaps of hundreds of bodies, which penetrate deeper on impact.
        variation: Differences of the arms from their description, on which their servos are based (default: none).

    Attributes:
        scene: The scene, with loose bodies at their initial poses; see `current_scene`.
        dt: Time of a step [s].
        stiffness: Natural frequency of the joint servos [rad/s].
        joint_names: "arm/joint" of every movable joint, the order of `positions`, `velocities` and `efforts`.
        tiles: The MuJoCo models with their data.

    Raises:
        InputError: a step or stiffness that is not above zero, a point cloud of too many cells, or more arms or bodies
            than fit into the machine's memory.
        BackendError: MuJoCo rejects the scene.
    """

    def __init__(
        self,
        scene: Scene,
        dt: float = 0.002,
        *,
        stiffness: float | None = None,
        threads: int = 1,
        solver: Solver = "newton",
        variation: ArmVariation | None = None,
    ) -> None:
        of_kind("scene", scene, Scene)
        of_kind("variation", variation, ArmVariation, optional=True)
        known_name("solver", solver, ("newton", "cg"))
        self._solver: Solver = solver
        self._variation = None if variation == ArmVariation() else variation
        self.scene = scene
        self.dt = positive_number("dt", dt)
        if self.dt > LONGEST_STEP:
            raise InputError(f"dt is {dt:g} s, expected at most {LONGEST_STEP:g} s")
        self.stiffness = usual_stiffness(self.dt) if stiffness is None else positive_number("stiffness", stiffness)
        if self.stiffness > _MOST_STIFFNESS:
            raise InputError(f"stiffness is {stiffness}, expected at most {_MOST_STIFFNESS:g} rad/s")
        self._threads = whole_number("threads", threads, 1, 256)
        self._map = JointMap(scene)
        self.joint_names = self._map.names
        self._state_rows = Rows(3, len(self.joint_names))
        self._warnings: list[str] = []
        self.tiles = self._build(scene)
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self._set_points = SetPoints(self._map)
        # By a key for each registration, because a callback may be registered twice.
        self._callbacks: dict[object, StepCallback] = {}
        self._pause = threading.Event()
        # Held during a step, and by methods that read or change the state of MuJoCo's data or the controllers.
        self._lock = threading.RLock()
        self._stepping = False
        # Held during a run, by the thread `_runner`.
        self._turn = threading.Lock()
        self._runner: int | None = None
        self._contacts = ContactLog(1.5 * self.dt)
        self._deepest = 0.0
        self._wall = 0.0
        start = self._map.expand(scene.configuration())
        self._begin(np.array([start, np.zeros(len(start))]))

    def __repr__(self) -> str:
        models = f", {len(self.tiles)} models" if len(self.tiles) > 1 else ""
        return f"Simulation({counted(len(self.scene.arms), 'arm')}, {self.time:.3f} s{models})"

    def __reduce__(self) -> NoReturn:
        """Refuse to pickle or copy: MuJoCo's models, threads and controllers belong to this process.

        Raises:
            InputError: always.
        """
        raise InputError(
            "a simulation cannot be pickled or copied; keep its current_scene and create a Simulation of that, "
            "or keep Recorder(...).replay()"
        )

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
        """Largest effort of every servo [Nm or N], shape (n,); inf if there is none.

        Servos respect it, except in arms whose masses are estimated.
        """
        return self._map.effort.copy()

    @property
    def set_points(self) -> Array:
        """Position that every servo follows [rad or m], shape (n,)."""
        return np.array(self._set_points.desired[0])

    @property
    def contacts(self) -> tuple[ReplayContact, ...]:
        """Contacts since the beginning that the scene does not allow, in order of time."""
        return self._contacts.intervals()

    @property
    def warnings(self) -> tuple[str, ...]:
        """MuJoCo's warnings, each once."""
        return tuple(dict.fromkeys(self._warnings))

    @property
    def real_time_factor(self) -> float:
        """Simulated time divided by the wall time of the steps."""
        return self.time / self._wall if self._wall > 0.0 else 0.0

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model, which may be changed between steps.

        From then on steps of many arms take longer: MuJoCo searches for contacts in every step, because proofs that
        there are none only hold for the unchanged model.

        Raises:
            InputError: arms that cannot meet have separate models; see `tiles`.
        """
        return self._only_tile().model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data; change it between steps only.

        From then on MuJoCo computes all steps of this model on one thread, because forces and states may be changed.

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
        """The state of some joints: a copy of time, positions, velocities and efforts.

        Args:
            joint_names: Names such as "arm/joint".

        Raises:
            UnknownNameError: an unknown joint.
        """
        return part_of(self._now, self._indices(check_joint_names(joint_names)))

    # ---- loose bodies ----------------------------------------------------------------------------

    @property
    def body_names(self) -> tuple[str, ...]:
        """The loose bodies: obstacles with a mass."""
        return tuple(name for tile in self.tiles for name in tile.bodies)

    @property
    def max_penetration(self) -> float:
        """Deepest penetration since the beginning [m], including allowed contacts of loose bodies."""
        return self._deepest

    @property
    @exclusive
    def current_scene(self) -> Scene:
        """The scene with the present positions of planned and locked joints and poses of loose bodies, for planning."""
        moved = {name: replace(self.scene.obstacles[name], pose=self.body_pose(name)) for name in self.body_names}
        q = self.scene.split(self.configuration())
        arms = {name: Arm(self._relocked(name, arm.robot), arm.base, q[name]) for name, arm in self.scene.arms.items()}
        return replace(self.scene, arms=arms, obstacles={**self.scene.obstacles, **moved})

    def _relocked(self, arm: str, robot: Robot) -> Robot:
        """The robot of an arm, with its locked joints at their present positions, within their limits."""
        values = {}
        for name, value in robot.locked_joints.items():
            joint = robot.joint(name)
            present = float(np.clip(self._now.positions[self._map.index[f"{arm}/{name}"]], joint.lower, joint.upper))
            if abs(present - value) > _STILL:
                values[name] = present
        return robot.with_locked_joints(values) if values else robot

    @exclusive
    def body_pose(self, name: str) -> Array:
        """T_world_body of a loose body, shape (4, 4).

        Args:
            name: The body.

        Raises:
            UnknownNameError: no such loose body.
        """
        position = self.body_coordinates(name)
        pose = identity().copy()
        pose[:3, 3], pose[:3, :3] = position[:3], rotation_from_quaternion(position[3:])
        return pose

    @exclusive
    def body_coordinates(self, name: str) -> Array:
        """Position [m] and quaternion (wxyz) of a loose body, shape (7,).

        Args:
            name: The body.

        Raises:
            UnknownNameError: no such loose body.
        """
        return self._body(name).body_state(name)[0].copy()

    @exclusive
    def body_velocity(self, name: str) -> Array:
        """Linear velocity of a loose body's origin [m/s] and its angular velocity [rad/s], in world axes, shape (6,).

        Args:
            name: The body.

        Raises:
            UnknownNameError: no such loose body.
        """
        _, velocity = self._body(name).body_state(name)
        return np.concatenate([velocity[:3], self.body_pose(name)[:3, :3] @ velocity[3:]])

    @_between_steps
    def place_body(self, name: str, pose: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set the pose of a loose body between two steps; the clock continues.

        Args:
            name: The body.
            pose: T_world_body: (4, 4), or a position (3,) [m].
            velocity: Linear [m/s] and angular velocity [rad/s] in world axes, shape (6,) (default: at rest).

        Raises:
            UnknownNameError: no such loose body.
            InputError: not a pose, or a velocity that is not finite or above 1e4.
        """
        tile, T = self._body(name), as_pose(pose, "pose")
        rates = np.zeros(6) if velocity is None else near_array("velocity", velocity, (6,))
        place, motion = tile.body_state(name)
        place[:3], place[3:] = T[:3, 3], quaternion_from_rotation(T[:3, :3])
        motion[:3], motion[3:] = rates[:3], T[:3, :3].T @ rates[3:]
        with self._collect_warnings():
            tile.refresh()

    @_between_steps
    def update_scene(self, scene: Scene) -> None:
        """Continue in another scene of the same arms, with objects added, moved, removed, grasped or released.

            sim.update_scene(sim.scene.with_obstacle("ball", rp.Sphere(0.05), [0.3, 0.0, 1.0], mass=0.2))

        Arms keep their state, including that of locked joints, and controllers, and the clock continues. Loose bodies
        with the same pose in both scenes, or with their present pose in the new one (`current_scene`), also keep their
        state; everything else gets its pose from the new scene, at rest. `reset` returns to the initial scene.

        Args:
            scene: The other scene.

        Raises:
            InputError: different arms, or arms at other poses.
            BackendError: MuJoCo rejects the scene.
        """
        of_kind("scene", scene, Scene)
        before = self.scene.arms
        for name in (*before, *scene.arms):
            one, other = before.get(name), scene.arms.get(name)
            if one is None or other is None or list(before) != list(scene.arms):
                raise InputError(f"the scenes have different arms ({name!r}), expected the arms of the simulation")
            # Positions of locked joints differ in a scene that is based on `current_scene`.
            same = other.robot
            if same.locked_joints != one.robot.locked_joints:
                same = replace(same, locked_joints=one.robot.locked_joints)
            if one.robot.content_hash != same.content_hash or not np.array_equal(one.base, other.base):
                raise InputError(f"arm {name!r} is another robot or elsewhere, expected the arms of the simulation")
        tiles = self._build(scene)
        stay = {name for name in self.body_names if name in scene.obstacles and self._stays(name, scene)}
        with self._collect_warnings():
            for tile in tiles:
                tile.place(self._measured)
                for name in stay & tile.bodies.keys():
                    for to, of in zip(tile.body_state(name), self._body(name).body_state(name), strict=True):
                        to[:] = of
                tile.refresh()
        self.tiles, self.scene = tiles, scene

    def _stays(self, name: str, scene: Scene) -> bool:
        """Whether a loose body is in another scene where it was at first, or where it is now."""
        before, pose = self.scene.obstacles[name].pose, scene.obstacles[name].pose
        return np.array_equal(before, pose) or bool(np.abs(self.body_pose(name) - pose).max() <= _SAME_POSE)

    # ---- controllers -----------------------------------------------------------------------------

    @property
    def controllers(self) -> tuple[Controller, ...]:
        """The active controllers."""
        return tuple(self._set_points.active)

    @exclusive
    def activate(self, controller: Controller, *, replace: bool = False) -> None:
        """Let a controller command its joints, from the next step on.

        Args:
            controller: The controller.
            replace: Deactivate the controllers that command some of its joints; their other joints hold their last
                set-points. If the activation fails, they stay active.

        Raises:
            InputError: another controller commands one of its joints, a joint mimics another one, or the controller is
                active in another simulation.
            UnknownNameError: an unknown joint.
        """
        of_kind("controller", controller, Controller)
        other_simulation = _commanded_by.get(controller, lambda: None)()
        if other_simulation is not None and other_simulation is not self:
            raise InputError(
                f"the {type(controller).__name__} of {controller.joint_names[0]!r} is active in another simulation; "
                "deactivate it there first, or make another controller"
            )
        indices = self._indices(controller.joint_names)
        for name in controller.joint_names:
            if name in self._map.followers:
                raise InputError(f"joint {name!r} mimics {self._map.followers[name]!r}; command that one")
        replaced = []
        for other in self.controllers:
            shared = set(other.joint_names).intersection(controller.joint_names)
            if not shared or other is controller:
                continue
            if not replace:
                first = min(shared, key=self.joint_names.index)
                raise InputError(
                    f"joint {first!r} is commanded by an active {type(other).__name__}; deactivate it first, or "
                    "activate with replace=True"
                )
            replaced.append(other)
        joints = self._map
        info = JointInfo(
            controller.joint_names, joints.lower[indices], joints.upper[indices], joints.velocity[indices], self.dt
        )
        controller.activate(info, part_of(self._now, indices))
        for other in replaced:
            self._set_points.remove(other)
            del _commanded_by[other]
        self._set_points.active.pop(controller, None)
        self._set_points.add(controller, indices)
        _commanded_by[controller] = weakref.ref(self)
        for other in replaced:
            other.deactivate()

    @exclusive
    def deactivate(self, controller: Controller) -> None:
        """Stop a controller; its joints hold their last set-points.

        Raises:
            InputError: it is not active.
        """
        of_kind("controller", controller, Controller)
        if controller not in self._set_points.active:
            raise InputError("the controller is not active in this simulation")
        self._set_points.remove(controller)
        del _commanded_by[controller]
        controller.deactivate()

    def on_step(self, callback: StepCallback) -> Callable[[], None]:
        """Register a callback that is called after each step.

        Args:
            callback: Called with the simulation; if it returns False, the simulation is paused.

        Returns:
            A function that removes the callback; calling it again has no effect.
        """
        if callback is None:
            raise InputError("callback is None, expected a function of the simulation")
        check_callback("callback", callback)
        key = object()
        self._callbacks[key] = callback

        def remove() -> None:
            self._callbacks.pop(key, None)

        return remove

    # ---- running ---------------------------------------------------------------------------------

    def step(self, count: int = 1) -> None:
        """Take steps as fast as possible, fewer if a callback pauses the simulation.

        Raises:
            InputError: a count below one, or a call from a callback or controller of this simulation.
            ControllerError: a controller raised something or returned no set-points; nothing has moved in that step.
            BackendError: the simulation became unstable.
        """
        self._run(whole_number("count", count, 1, _MOST_STEPS), math.inf)

    def run(self, *, until: float | None = None, duration: float | None = None, speed: float = math.inf) -> bool:
        """Run until a time or for a duration; another thread or a callback may `pause` it.

        Args:
            until: Simulated time at which to stop [s].
            duration: Simulated time to run for instead [s].
            speed: Upper bound on the real-time factor: 1 is real time (default: as fast as possible).

        Returns:
            Whether the end was reached; False if the simulation was paused or restarted.

        Raises:
            InputError: neither or both of `until` and `duration`, a time that has passed, a speed not above zero, or a
                call from a callback or controller of this simulation.
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
        reached = self._run(math.ceil((end - self.time) / self.dt - 1e-9), float(speed))
        return reached and self.time >= end - 0.5 * self.dt

    def pause(self) -> None:
        """End the running `run` or `step` after the current step; for callbacks and other threads.

        Steps that are computed in one call are all completed.
        """
        self._pause.set()

    @_between_steps
    def reset(self) -> None:
        """Return exactly to the initial state and scene; active controllers are activated again."""
        self.scene, self.tiles = self._origin
        with self._collect_warnings():
            for tile, state in zip(self.tiles, self._initial, strict=True):
                tile.restore(state)
        self._set_off()

    @_between_steps
    def place(self, joint_names: Sequence[str], positions: ArrayLike, velocities: ArrayLike | None = None) -> None:
        """Set positions of joints without physics and restart from there at time zero; `reset` returns to this state.

        Args:
            joint_names: The joints, "arm/joint"; the others keep their positions and are at rest.
            positions: Positions [rad or m], shape (n,).
            velocities: Velocities [rad/s or m/s], shape (n,) (default: at rest).

        Raises:
            InputError: wrong shapes, not finite or above 1e4.
            UnknownNameError: an unknown joint.
        """
        names = check_joint_names(joint_names)
        indices = self._indices(names)
        every = self.positions
        every[indices] = near_array("positions", positions, (len(names),))
        rates = np.zeros(len(every))
        rates[indices] = 0.0 if velocities is None else near_array("velocities", velocities, (len(names),))
        self._begin(np.array([self._map.follow(every), self._map.follow(rates, rates=True)]))

    # ---- inside ----------------------------------------------------------------------------------

    @contextmanager
    def _collect_warnings(self) -> Iterator[list[str]]:
        """Add MuJoCo's warnings to `warnings`, instead of a file in the working directory."""
        with mujoco_warnings() as warnings:
            try:
                yield warnings
            finally:
                self._warnings += warnings

    def _build(self, scene: Scene) -> list[Tile]:
        tiles: list[Tile] = []
        with self._collect_warnings():
            parts = tile_scenes(scene)
            check_memory(parts)
            for part in parts:
                world = build_mujoco(part, timestep=self.dt, stiffness=self.stiffness, solver=self._solver)
                columns, worker = self._indices(world.joint_names), len(tiles) % self._threads
                count, threads = len(self.joint_names), self._threads
                tiles.append(Tile(world, columns, count, self._variation, threads=threads, worker=worker))
        return tiles

    def _body(self, name: str) -> Tile:
        """The tile that contains a loose body."""
        known_name("loose body", name, self.body_names)
        return next(tile for tile in self.tiles if name in tile.bodies)

    def _begin(self, state: Array) -> None:
        with self._collect_warnings():
            for tile in self.tiles:
                tile.begin(state)
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
        self._measured = state
        self._now = JointState(self.time, *state)
        self._set_points.hold(self._now.positions)
        self._note_contacts()
        for controller in self.controllers:
            self.activate(controller)

    @contextmanager
    def _running(self) -> Iterator[None]:
        """One thread runs the simulation at a time, and not from within a run."""
        if self._runner == threading.get_ident():
            raise InputError(
                "step or run was called while the simulation runs, by a callback or a controller of it; take more "
                "steps when it has ended"
            )
        with self._turn:
            self._runner, began = threading.get_ident(), time.perf_counter()
            try:
                yield
            finally:
                self._wall += time.perf_counter() - began
                self._runner = None

    def _run(self, count: int, speed: float) -> bool:
        with self._running(), self._collect_warnings() as warnings:
            self._pause.clear()
            began, done = time.perf_counter(), 0
            while done < count:
                # Callbacks and waiting for real time follow each single step.
                alone = bool(self._callbacks) or speed < math.inf
                done += self._advance(1 if alone else count - done, warnings)
                for callback in list(self._callbacks.values()):
                    if callback(self) is False:
                        self._pause.set()
                ahead = done * self.dt / speed - (time.perf_counter() - began)
                if speed < math.inf and ahead > _AHEAD:
                    self._pause.wait(min(ahead, threading.TIMEOUT_MAX))
                if self._pause.is_set():
                    break
        return not self._pause.is_set()

    @exclusive
    def _advance(self, most: int, warnings: list[str]) -> int:
        """Take one step or several, and note contacts; returns the number of steps."""
        self._stepping = True
        try:
            done = self._take_steps(most)
        finally:
            self._stepping = False
        if any(tile.is_unstable() for tile in self.tiles):
            raise BackendError(
                f"MuJoCo's simulation became unstable at {self.time:.3f} s"
                f"{f' ({warnings[-1]})' if warnings else ''}; try a smaller time step or a slower motion"
            )
        self._note_contacts()
        return done

    def _take_steps(self, most: int) -> int:
        """Take one step, or several if controllers preview their set-points; returns how many."""
        most = min(most, *(tile.most_steps for tile in self.tiles))
        times = np.asarray(self.dt * np.arange(self.steps, self.steps + most), dtype=np.float64)
        previewed = self._set_points.preview(times) if most > 1 else None
        desired = self._set_points.update(self._now) if previewed is None else previewed
        states = self._state_rows.take(len(desired) + 1)
        states[0] = self._measured
        tiles = self.tiles

        def advance(worker: int) -> None:
            for tile in tiles:
                tile.advance(worker, desired, states)

        free = sum(tile.free_arms for tile in tiles) * len(desired)
        self._distribute(advance, free >= _SHARED or (len(tiles) > 1 and not all(tile.free_arms for tile in tiles)))
        taken = min(tile.count_valid(states) for tile in tiles)
        valid, valid_states = desired[:taken], states[: taken + 1]

        def settle(worker: int) -> None:
            for tile in tiles:
                if tile.worker == worker:
                    tile.settle(valid, valid_states)

        self._distribute(settle, len(tiles) > 1)
        self.steps += taken
        self._measured = valid_states[-1].copy()
        self._now = JointState(self.time, *self._measured)
        if previewed is not None:
            self._set_points.pass_over(times[:taken], valid, states[:taken, 0])
        return taken

    def _distribute(self, work: Callable[[int], None], shared: bool) -> None:
        """Run the work of every worker, on threads if `shared`."""
        if self._pool is None or not shared:
            for worker in range(self._threads):
                work(worker)
            return
        # With this thread's context, in which MuJoCo's warnings are collected.
        futures = [self._pool.submit(copy_context().run, work, worker) for worker in range(1, self._threads)]
        work(0)
        for future in futures:
            future.result()

    def _note_contacts(self) -> None:
        for tile in self.tiles:
            self._deepest = max(self._deepest, tile.log_contacts(self._contacts, self.time))

    def _indices(self, names: Sequence[str]) -> NDArray[np.int64]:
        for name in names:
            if name not in self._map.index:
                raise UnknownNameError("joint", name, self.joint_names)
        return np.array([self._map.index[name] for name in names], dtype=np.int64)

    def _only_tile(self) -> Tile:
        if len(self.tiles) > 1:
            raise InputError(f"this simulation has {len(self.tiles)} MuJoCo models; see Simulation.tiles")
        return self.tiles[0]
