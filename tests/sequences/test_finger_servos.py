"""Servos of fingers in replays of sequences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.simulation.simulation import Simulation
from rr1plan.sequences import simulate_sequence as module
from rr1plan.sequences.grippers import finger_lever, gripper_links


@pytest.mark.parametrize("lighter", [1.0, 100.0, 1e5])
def test_fingers_of_any_mass_have_the_same_servo(
    moved: rp.SequencePlan, lighter: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also below the inertia on which servos are based at least: those used to press harder and overdamped."""
    fingers = gripper_links(moved.sequence.scene.arms["arm"].robot)
    robot, stiffness = moved.scene.arms["arm"].robot, 150.0
    links = tuple(
        replace(link, inertial=replace(own, mass=own.mass / lighter, inertia=own.inertia / lighter))
        if link.name in fingers and (own := link.inertial) is not None
        else link
        for link in robot.links
    )
    built: list[Simulation] = []

    def build(*args: object, **options: object) -> Simulation:
        built.append(Simulation(*args, **options))
        return built[0]

    monkeypatch.setattr(module, "Simulation", build)
    light = replace(moved, scene=moved.scene.with_robot("arm", replace(robot, links=links)))
    rp.simulate_sequence(light, stiffness=stiffness, hold=0.0)
    (sim,) = built
    column = sim.joint_names.index("arm/finger_joint")
    inertia = sim.model.dof_M0[column]
    _, kp, kv = -sim.model.actuator_biasprm[column, :3]
    assert inertia == pytest.approx(0.25 * finger_lever(robot, "finger_joint") ** 2)
    assert np.sqrt(kp / inertia) == pytest.approx(stiffness)
    assert kv / (2.0 * np.sqrt(kp * inertia)) == pytest.approx(1.0)
