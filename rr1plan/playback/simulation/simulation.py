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
import os
import threading
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, NoReturn, TypeVar, cast

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    check_callback,
    counted,
    finite_number,
    known_name,
    millimeters,
    near_array,
    of_kind,
    positive_number,
    whole_number,
)
from rr1plan.errors import BackendError, InputError
from rr1plan.path import check_joint_names
from rr1plan.playback.simulation.arm_variation import ArmVariation
from rr1plan.playback.simulation.contact_log import ContactLog
from rr1plan.playback.simulation.contact_points import ContactPoint, elements_of
from rr1plan.playback.simulation.controllers import Controller, JointState
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.simulation.mujoco_model import Solver, usual_stiffness
from rr1plan.playback.simulation.replay import ReplayContact
from rr1plan.playback.simulation.run_loop import RunLoop
from rr1plan.playback.simulation.scene_updates import check_same_arms, present_scene, unmoved_bodies
from rr1plan.playback.simulation.set_points import SetPoints, state_of_joints
from rr1plan.playback.simulation.stepped_models import Tile
from rr1plan.playback.simulation.tiled_model import TiledModel
from rr1plan.scene import Scene
from rr1plan.thread_locks import exclusive, per_process
from rr1plan.transforms import as_pose, identity, quaternion_from_rotation, rotation_from_quaternion

_MOST_STIFFNESS = 1e6  # [rad/s]
LONGEST_STEP = 1.0  # [s]
# Largest number of steps in one call; more would take hours, and their replay more memory than there is.
_MOST_STEPS = 5_000_000

# Largest distance of a joint from its set-point while its servo holds it [rad or m].
_OFF = 0.01

StepCallback = Callable[["Simulation"], bool | None]
_Method = TypeVar("_Method", bound=Callable[..., Any])


def _between_steps(method: _Method) -> _Method:
    """A method that other threads can call during a run, but controllers cannot call in their update."""

    @wraps(method)
    def locked(self: Simulation, *args: Any, **kwargs: Any) -> Any:
        with self._lock:
            if self._stepping_process == os.getpid():
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
    them. Position limits are omitted because MuJoCo's are soft constraints; the referee checks them. Obstacles with a
    mass are loose bodies. The scene is not changed. In models of four or more arms, MuJoCo does not search for contacts
    while these are proven impossible (`contact_proof`), which does not change any result.

    Ctrl-C in `run`, or in `step` of several steps, takes effect after the present step and its callbacks, so that one
    can continue from there; a second one takes effect at once.

    Threads may share a simulation: one thread runs it at a time, and other methods take effect between two steps. A
    forked process has a copy of it; if it was forked in the middle of a step of another thread, `reset` it first.

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
        variation: Differences of the arms from their description; None: none.
        joint_names: "arm/joint" of every movable joint, the order of `positions`, `velocities` and `efforts`.
        tiles: The MuJoCo models with their data, to be read between steps.

    Raises:
        InputError: a step or stiffness that is not above zero, a point cloud of too many cells, or more arms or bodies
            than fit into the machine's memory.
        BackendError: MuJoCo rejects the scene.
    """

    scene: Scene
    tiles: list[Tile]
    steps: int

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
        self.dt = positive_number("dt", dt)
        if self.dt > LONGEST_STEP:
            raise InputError(f"dt is {dt:g} s, expected at most {LONGEST_STEP:g} s")
        self.stiffness = usual_stiffness(self.dt) if stiffness is None else positive_number("stiffness", stiffness)
        if self.stiffness > _MOST_STIFFNESS:
            raise InputError(f"stiffness is {stiffness}, expected at most {_MOST_STIFFNESS:g} rad/s")
        threads = whole_number("threads", threads, 1, 256)
        self.variation = None if variation == ArmVariation() else variation
        self._joints = JointMap(scene)
        self.joint_names = self._joints.names
        # Held during a step, and by methods that read or change the state of MuJoCo's data or the controllers.
        self._lock = per_process(self, "_lock", threading.RLock)
        # The process that is in a step; 0: none.
        self._stepping_process = 0
        self._model = TiledModel(
            scene,
            self._joints,
            self.dt,
            stiffness=self.stiffness,
            threads=threads,
            solver=solver,
            variation=self.variation,
        )
        self._set_points = SetPoints(self._joints, self.dt)
        self._loop: RunLoop[Simulation] = RunLoop(self.dt)
        self._contacts = ContactLog(1.5 * self.dt)
        self._set_off()

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
        return self._joints.effort.copy()

    @property
    @exclusive
    def set_points(self) -> Array:
        """Position that every servo follows [rad or m], shape (n,)."""
        return np.array(self._set_points.desired[0])

    @property
    @exclusive
    def contacts(self) -> tuple[ReplayContact, ...]:
        """Contacts since the beginning that the scene does not allow, in order of time."""
        return self._contacts.intervals()

    @exclusive
    def contact_points(self, name: str | None = None) -> tuple[ContactPoint, ...]:
        """Where elements touch in the present state, allowed or not, with the forces between them.

            weight = sum(point.force for point in sim.contact_points("cube"))  # what carries the cube [N]

        The forces are those that follow from the present state and the set-points of the last step.

        Args:
            name: An obstacle, loose body, attached object or link "arm/link", or an arm for all of its links and what
                it holds (default: all contacts). It is the second of each pair, so that forces act on it; pairs that
                belong to it as a whole, and those without a name, are in alphabetical order.

        Raises:
            UnknownNameError: no such element or arm.
        """
        points = [point for tile in self.tiles for point in tile.contact_points()]
        if name is None:
            return tuple(points)
        elements = elements_of(self.scene, name)
        points = [point for point in points if not elements.isdisjoint(point.pair)]
        return tuple(point if point.pair[1] in elements else point.turned() for point in points)

    @property
    @exclusive
    def warnings(self) -> tuple[str, ...]:
        """Differences from reality: of the steps since the beginning, and of the present state.

        Since the beginning: MuJoCo's warnings, each once, and loose bodies too fast for the time step, which may pass
        through others. At present: loose bodies that are deep in another one or in an obstacle, and overloaded servos,
        whose effort is at the limit of the description and whose joint is more than 0.01 rad or m from the set-point:
        the arm sags, or pushes.
        """
        said = dict.fromkeys(f"MuJoCo: {text}" for text in self._model.warnings)
        return (*said, *self._contacts.passages(), *self._overlaps(), *self._overloads())

    def _overlaps(self) -> tuple[str, ...]:
        """The loose bodies that are deep in others at present, in words."""
        depths = {pair: depth for tile in self.tiles for pair, depth in tile.deep_contacts().items()}
        return tuple(
            f"{a!r} and {b!r} overlap by {millimeters(depth)}: they began in each other, or their contact is too soft "
            "for the mass, speed or force of one; move them apart, or take a smaller time step, masses that are "
            "closer, or a weaker grasp"
            for (a, b), depth in depths.items()
        )

    def _overloads(self) -> tuple[str, ...]:
        """The servos that cannot hold their joints at present, in words."""
        off = np.abs(self._set_points.desired[0] - self._now.positions)
        limits, units = self._joints.effort, [("N", "m") if slides else ("Nm", "rad") for slides in self._joints.slides]
        over = (off > _OFF) & (np.abs(self._now.efforts) >= limits * (1.0 - 1e-9)) & np.isfinite(limits)
        return tuple(
            f"the servo of {self.joint_names[i]!r} is at its effort limit of {limits[i]:g} {units[i][0]}, "
            f"{off[i]:.3g} {units[i][1]} from its set-point: check masses and effort limits of the description, and "
            "what the arm pushes against"
            for i in np.flatnonzero(over)
        )

    @property
    def real_time_factor(self) -> float:
        """Simulated time divided by the wall time of the steps."""
        return self.time / self._loop.wall if self._loop.wall > 0.0 else 0.0

    @property
    @exclusive
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model, which may be changed between steps; move obstacles by their bodies.

        MuJoCo does not find contacts of shapes that have been moved out of the box of their body (`geom_pos`).

        From then on steps of many arms take longer: MuJoCo searches for contacts in every step, because proofs that
        there are none only hold for the unchanged model.

        Raises:
            InputError: arms that cannot meet have separate models; see `tiles`.
        """
        return self._only_tile().model

    @property
    @exclusive
    def data(self) -> mujoco.MjData:
        """MuJoCo's data; change it between steps only.

        Positions and contacts in it are those of the present state, forces those of the step that led there; for forces
        of the present contacts see `contact_points`. From then on MuJoCo computes all steps of this model on one
        thread, because forces and states may be changed.

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
        return self.positions[self._joints.indices(names)]

    def state(self, joint_names: Sequence[str]) -> JointState:
        """The state of some joints: a copy of time, positions, velocities and efforts.

        Args:
            joint_names: Names such as "arm/joint".

        Raises:
            UnknownNameError: an unknown joint.
        """
        return state_of_joints(self._now, self._joints.indices(check_joint_names(joint_names)))

    # ---- loose bodies ----------------------------------------------------------------------------

    @property
    def body_names(self) -> tuple[str, ...]:
        """The loose bodies: obstacles with a mass."""
        return self._model.body_names

    @property
    def max_penetration(self) -> float:
        """Deepest penetration since the beginning [m], including allowed contacts of loose bodies."""
        return self._contacts.deepest

    @property
    @exclusive
    def current_scene(self) -> Scene:
        """The scene with the present positions of planned and locked joints and poses of loose bodies, for planning.

        A planned joint up to 0.01 rad or m beyond a limit, as after a sag under an unknown payload, is at the limit.
        """
        positions = dict(zip(self.joint_names, self._now.positions.tolist(), strict=True))
        return present_scene(self.scene, positions, self._body_poses())

    def _body_poses(self) -> dict[str, Array]:
        """T_world_body of every loose body."""
        return {name: self.body_pose(name) for name in self.body_names}

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
        return self._model.tile_of_body(name).body_state(name)[0].copy()

    @exclusive
    def body_velocity(self, name: str) -> Array:
        """Linear velocity of a loose body's origin [m/s] and its angular velocity [rad/s], in world axes, shape (6,).

        Args:
            name: The body.

        Raises:
            UnknownNameError: no such loose body.
        """
        _, velocity = self._model.tile_of_body(name).body_state(name)
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
        tile, T = self._model.tile_of_body(name), as_pose(pose, "pose")
        rates = np.zeros(6) if velocity is None else near_array("velocity", velocity, (6,))
        place, motion = tile.body_state(name)
        place[:3], place[3:] = T[:3, 3], quaternion_from_rotation(T[:3, :3])
        motion[:3], motion[3:] = rates[:3], T[:3, :3].T @ rates[3:]
        with self._model.collect_warnings():
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
        check_same_arms(self.scene, scene)
        self._model.change_scene(scene, unmoved_bodies(self.scene, scene, self._body_poses()))
        self.scene, self.tiles = scene, self._model.tiles

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
        of_kind("controller", controller, Controller, method="attach")
        self._set_points.activate(controller, self._now, replace=replace)

    @exclusive
    def deactivate(self, controller: Controller) -> None:
        """Stop a controller; its joints hold their last set-points.

        Raises:
            InputError: it is not active.
        """
        of_kind("controller", controller, Controller)
        self._set_points.deactivate(controller)

    @exclusive
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
        return self._loop.add_callback(callback)

    # ---- running ---------------------------------------------------------------------------------

    def step(self, count: int = 1) -> None:
        """Take steps as fast as possible, fewer if a callback pauses the simulation.

        Ctrl-C in a loop of single steps may end one in its middle, after which controllers are a step ahead of the
        joints; `run` with `on_step` callbacks holds it back until the step is complete.

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
            if until is None:
                raise InputError(f"duration is {duration:g} s, expected at least 0")
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
        self._loop.pause()

    @_between_steps
    def reset(self) -> None:
        """Return exactly to the initial state and scene; active controllers are activated again."""
        self._model.restore()
        self._set_off()

    @_between_steps
    def place(self, joint_names: Sequence[str], positions: ArrayLike, velocities: ArrayLike | None = None) -> None:
        """Set positions of joints without physics and restart from there at time zero; `reset` returns to this state.

        Args:
            joint_names: The joints, "arm/joint"; the others keep their positions and are at rest. Joints that mimic
                others follow them.
            positions: Positions [rad or m], shape (n,), also beyond the joint's limits.
            velocities: Velocities [rad/s or m/s], shape (n,) (default: at rest).

        Raises:
            InputError: wrong shapes, not finite or above 1e4, or a joint that mimics one that is not placed.
            UnknownNameError: an unknown joint.
        """
        names = check_joint_names(joint_names)
        indices = self._joints.indices(names)
        for name in names:
            leader = self._joints.followers.get(name, name)
            if leader not in names:
                raise InputError(f"joint {name!r} mimics {leader!r}; place that one")
        every = self.positions
        every[indices] = near_array("positions", positions, (len(names),))
        rates = np.zeros(len(every))
        rates[indices] = 0.0 if velocities is None else near_array("velocities", velocities, (len(names),))
        self._model.begin(np.array([self._joints.follow(every), self._joints.follow(rates, rates=True)]))
        self._set_off()

    # ---- inside ----------------------------------------------------------------------------------

    def _set_off(self) -> None:
        """Start the clock, with the present positions as set-points."""
        self._stepping_process = 0
        self.scene, self.tiles = self._model.scene, self._model.tiles
        self.steps = 0
        self._loop.wall = 0.0
        self._contacts.clear()
        self._now = JointState(self.time, *self._model.state)
        self._set_points.hold(self._now.positions)
        self._note_contacts()
        for controller in self.controllers:
            self.activate(controller)

    def _run(self, count: int, speed: float) -> bool:
        with self._loop.turn(), self._model.collect_warnings() as warnings:
            return self._loop.run(self, lambda most: self._advance(most, warnings), count, speed)

    @exclusive
    def _advance(self, most: int, warnings: list[str]) -> int:
        """Take one step or several, and note contacts; returns the number of steps."""
        if self._stepping_process:
            raise InputError("this process was forked in the middle of a step of the simulation; reset it first")
        self._stepping_process = os.getpid()
        try:
            done = self._take_steps(self._loop.begin_steps(most))
        finally:
            self._stepping_process = 0
        if self._model.is_unstable():
            raise BackendError(
                f"MuJoCo's simulation became unstable at {self.time:.3f} s"
                f"{f' ({warnings[-1]})' if warnings else ''}; try a smaller time step or a slower motion"
            )
        self._note_contacts()
        self._loop.end_steps()
        return done

    def _take_steps(self, most: int) -> int:
        """Take one step, or several if controllers preview their set-points; returns how many."""
        most = min(most, self._model.most_steps)
        times = np.asarray(self.dt * np.arange(self.steps, self.steps + most), dtype=np.float64)
        previewed = self._set_points.preview(times) if most > 1 else None
        desired = self._set_points.update(self._now) if previewed is None else previewed
        states = self._model.take_steps(desired)
        taken = len(states) - 1
        self.steps += taken
        self._now = JointState(self.time, *self._model.state)
        if previewed is not None:
            self._set_points.pass_over(times[:taken], desired[:taken], states[:taken, 0])
        return taken

    def _note_contacts(self) -> None:
        for tile in self.tiles:
            tile.log_contacts(self._contacts, self.time)

    def _only_tile(self) -> Tile:
        if len(self.tiles) > 1:
            raise InputError(f"this simulation has {len(self.tiles)} MuJoCo models; see Simulation.tiles")
        return self.tiles[0]
