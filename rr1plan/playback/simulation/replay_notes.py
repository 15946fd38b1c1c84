"""Settings of a simulation for its replays, and remarks on their accuracy."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import mujoco

from rr1plan.playback.simulation.mujoco_model import is_possible, usual_stiffness
from rr1plan.playback.simulation.simulation import Simulation


def replay_settings(sim: Simulation) -> dict[str, Any]:
    """Version and options of a simulation, for reproduction."""
    settings = {"mujoco": mujoco.__version__, "integrator": "implicitfast", "stiffness": sim.stiffness}
    return settings | ({} if sim.variation is None else asdict(sim.variation))


def replay_remarks(sim: Simulation) -> tuple[str, ...]:
    """Remarks on inaccuracies: estimated masses, impossible inertias, massless joints, stiff servos, warnings."""
    massless = [name for tile in sim.tiles for name in tile.world.massless_joints]
    links = [f"{name}/{link}" for name, arm in sim.scene.arms.items() for link in arm.robot.links_of_assumed_mass]
    reduced = [
        f"{name}/{link.name}"
        for name, arm in sim.scene.arms.items()
        for link in arm.robot.links
        if link.inertial is not None and not is_possible(link.inertial)
    ]
    found = []
    if links:
        found.append(f"masses estimated from shapes: {', '.join(links)}")
    if reduced:
        found.append(f"moments of inertia that no body has, one reduced to the sum of the others: {', '.join(reduced)}")
    if massless:
        found.append(f"joints that carry no mass: {', '.join(massless)}")
    stiffest = usual_stiffness(sim.dt, sim.stiffness)
    if stiffest < sim.stiffness:
        found.append(
            f"servos of a stiffness above {stiffest:g} rad/s may oscillate in steps of {1e3 * sim.dt:g} ms: take less "
            "stiffness or a smaller time step"
        )
    return (*found, *sim.warnings)
