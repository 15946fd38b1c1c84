"""Arms that follow the seven poses of the thesis: many arms on a grid, or one among stationary boats."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from rr1plan.checks import Array
from rr1plan.experiments.boat_meshes import boat_mesh
from rr1plan.experiments.peak_memory import peak_memory
from rr1plan.experiments.thesis_figures import MOVE_TIME, SEVEN_POSES
from rr1plan.playback.simulation.simulation import Simulation
from rr1plan.playback.simulation.trajectory_controller import Execution, JointTrajectoryController
from rr1plan.robot.robot_parts import Geometry
from rr1plan.scene import Arm, Obstacle, Scene
from rr1plan.scene.model_library import load_robot
from rr1plan.shapes import HalfSpace
from rr1plan.trajectory import Trajectory
from rr1plan.transforms import identity, pose

_BLOCK = 50  # steps that are timed together
_ROW = 20  # boats in a row
_BOAT_CELL = (0.7, 0.4)  # [m]
SEVEN_MOVES = MOVE_TIME * len(SEVEN_POSES)  # [s]


def measure_arms(
    arms: int, *, spacing: float = 1.0, dt: float = 0.002, threads: int = 1, seconds: float = SEVEN_MOVES
) -> dict[str, float]:
    """Simulate RR1 arms on a grid that follow the seven poses, with contacts between them and with the floor.

    Args:
        arms: Number of arms.
        spacing: Spacing of the grid [m].
        dt: Time of a step [s].
        threads: Threads of the simulation.
        seconds: Simulated time [s].

    Returns:
        Measurements by name.
    """
    began = time.perf_counter()
    sim = Simulation(_arm_grid(arms, spacing), dt, threads=threads)
    built = time.perf_counter() - began
    return {"arms": arms, "build_s": built, "models": len(sim.tiles), **_follow_poses(sim, seconds)}


def measure_static_scene(
    boats: int, *, stations: int = 625, around: int = 200, seconds: float = 4.0
) -> dict[str, float]:
    """Simulate an RR1 that follows the seven poses next to stationary boats that share one mesh.

    Args:
        boats: Number of boats.
        stations: Number of cross sections of the mesh, which has 2 * stations * around triangles.
        around: Number of vertices of each cross section.
        seconds: Simulated time [s].

    Returns:
        Measurements by name.
    """
    shape = Geometry("boat", boat_mesh(stations, around), identity())
    obstacles = {}
    for i in range(boats):
        place = [1.5 + _BOAT_CELL[0] * (i % _ROW), _BOAT_CELL[1] * (i // _ROW), 0.5]
        obstacles[f"boat{i + 1}"] = Obstacle((shape,), pose(place))
    began = time.perf_counter()
    sim = Simulation(_arm_grid(1, 1.0).with_obstacles(obstacles))
    built = time.perf_counter() - began
    triangles = 2 * stations * around
    return {"boats": boats, "triangles": triangles, "build_s": built, **_follow_poses(sim, seconds)}


def _arm_grid(count: int, spacing: float) -> Scene:
    side, robot = math.ceil(math.sqrt(count)), load_robot("rr1")
    places = (pose([spacing * (i % side), spacing * (i // side), 0.0]) for i in range(count))
    arms = {f"r{i + 1}": Arm(robot, place, np.array(SEVEN_POSES[-1])) for i, place in enumerate(places)}
    return Scene(arms=arms).with_obstacle("floor", HalfSpace((0.0, 0.0, 1.0), -0.02))


def seven_poses(scene: Scene) -> Trajectory:
    """A motion of all arms of a scene from the last of the seven poses through all of them, with a stop at each."""
    poses = np.tile(np.array((SEVEN_POSES[-1], *SEVEN_POSES)), len(scene.arms))
    rest = np.zeros_like(poses)
    return Trajectory.from_samples(scene.joint_names(), MOVE_TIME * np.arange(len(poses)), poses, rest, rest)


def _follow_poses(sim: Simulation, seconds: float) -> dict[str, float]:
    """Times, tracking error, contacts and memory of a run."""
    execution, departures = _send_poses(sim)
    walls, cpu = [], time.process_time()
    count = max(1, round(seconds / sim.dt / _BLOCK))
    for _ in range(count):
        began = time.perf_counter()
        sim.step(_BLOCK)
        walls.append((time.perf_counter() - began) / _BLOCK)
    cpu = (time.process_time() - cpu) / (count * _BLOCK)
    wall = float(np.mean(walls))
    return {
        "simulated_s": sim.time,
        "real_time_factor": sim.dt / wall,
        "cpu_real_time_factor": sim.dt / cpu,
        "step_us": 1e6 * float(np.median(walls)),
        "step_p95_us": 1e6 * float(np.percentile(walls, 95)),
        "cpu_us": 1e6 * cpu,
        "cores": cpu / wall,
        "tracking_error_rad": float(execution.max_error.max()),
        "contacts": len(sim.contacts),
        "start_skew_s": float(np.ptp(departures)),
        "memory_mb": peak_memory(),
    }


def _send_poses(sim: Simulation) -> tuple[Execution, Array]:
    """Send the seven poses to all arms. Returns the execution and when the set-points of each arm leave its start.

    The simulation fills in these times as it runs.
    """
    trajectory = seven_poses(sim.scene)
    follow = JointTrajectoryController(trajectory.joint_names)
    sim.activate(follow)
    execution = follow.send(trajectory)
    start, departures = sim.set_points, np.full(len(sim.scene.arms), np.inf)
    forget: list[Callable[[], None]] = []

    def watch(sim: Simulation) -> None:
        moved = (sim.set_points != start).reshape(len(departures), -1).any(axis=1)
        departures[moved & np.isinf(departures)] = sim.time
        if np.isfinite(departures).all():
            forget.pop()()

    forget.append(sim.on_step(watch))
    return execution, departures
