"""A tower of boats that falls into a heap."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rr1plan.experiments.boat_meshes import boat_mesh
from rr1plan.playback.simulation.mujoco_model import Solver
from rr1plan.playback.simulation.simulation import Simulation
from rr1plan.robot.robot_parts import Geometry
from rr1plan.scene import Obstacle, Scene
from rr1plan.scene.loose_bodies import stack_bodies
from rr1plan.shapes import HalfSpace
from rr1plan.transforms import identity, pose

_WINDOW = 2.0  # [s]
# Columns along each side of the tower by the number of boats; other towers are about as slender.
_COLUMNS = {10: 1, 20: 2, 50: 3, 100: 4, 200: 6, 500: 6}
_LEVEL = 14
_TILT = 0.1  # [rad]


def measure_tower(
    boats: int, *, seed: int = 0, dt: float = 0.008, seconds: float = 6.0, solver: Solver = "cg", threads: int = 1
) -> list[dict[str, float]]:
    """Simulate boats of 1 kg and 256 triangles, stacked in columns and slightly tilted.

    Args:
        boats: Number of boats.
        seed: Seed of their tilt.
        dt: Time of a step [s].
        seconds: Simulated time [s].
        solver: As in `Simulation`.
        threads: Threads of the simulation.

    Returns:
        Measurements of each two simulated seconds, by name. Penetrations are the deepest of any contact.
    """
    mesh = boat_mesh(8, 16)
    body = Obstacle((Geometry("boat", mesh, identity()),), mass=1.0)
    sim = Simulation(_tower(body, boats, seed), dt, solver=solver, threads=threads)
    corners = np.concatenate([mesh.vertices, np.ones((len(mesh.vertices), 1))], axis=1).T
    rows = []
    while sim.time < seconds - 1e-9:
        start, window = sim.time, min(_WINDOW, seconds - sim.time)
        depths: list[float] = []
        forget = sim.on_step(_depths_to(depths.append))
        wall, cpu = time.perf_counter(), time.process_time()
        sim.run(duration=window)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        forget()
        rows.append(
            {
                "boats": boats,
                "from_s": round(start, 9),
                "to_s": round(sim.time, 9),
                "real_time_factor": window / wall,
                "cpu_real_time_factor": window / cpu,
                "penetration_mm": 1e3 * max(depths),
                "penetration_at_end_mm": 1e3 * depths[-1],
                "lowest_point_mm": 1e3
                * min(float((sim.body_pose(name) @ corners)[2].min()) for name in sim.body_names),
                "contacts": int(sim.data.ncon),
                "speed_m_s": max(float(np.abs(sim.body_velocity(name)[:3]).max()) for name in sim.body_names),
            }
        )
    return rows


def _depths_to(keep: Callable[[float], None]) -> Callable[[Simulation], None]:
    """A callback that passes the deepest penetration of each step [m] to `keep`."""
    return lambda sim: keep(max(0.0, -float(sim.data.contact.dist.min())) if sim.data.ncon else 0.0)


def _tower(body: Obstacle, count: int, seed: int) -> Scene:
    rng, columns = np.random.default_rng(seed), _COLUMNS.get(count, max(1, round((count / _LEVEL) ** 0.5)))
    stack = stack_bodies(body, count, columns=(columns, columns), gap=0.03, prefix="boat", pose=[0.0, 0.0, 0.05])
    tilted = {
        name: replace(boat, pose=boat.pose @ pose(rpy=rng.uniform(-_TILT, _TILT, 3))) for name, boat in stack.items()
    }
    return Scene(name="tower").with_obstacle("floor", HalfSpace()).with_obstacles(tilted)
