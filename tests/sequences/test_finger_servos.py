"""Servos of fingers in replays of sequences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.simulation.simulation import Simulation
from rr1plan.sequences import simulate_sequence as module
from rr1plan.sequences.grippers import finger_lever, gripper_links


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[Simulation]:
    """The simulations of replays."""
    simulations: list[Simulation] = []

    def build(*args: object, **options: object) -> Simulation:
        simulations.append(Simulation(*args, **options))
        return simulations[-1]

    monkeypatch.setattr(module, "Simulation", build)
    return simulations


@pytest.mark.parametrize("lighter", [1.0, 100.0, 1e5])
def test_fingers_of_any_mass_have_the_same_servo(
    moved: rp.SequencePlan, lighter: float, built: list[Simulation]
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
    light = replace(moved, scene=moved.scene.with_robot("arm", replace(robot, links=links)))
    rp.simulate_sequence(light, stiffness=stiffness, hold=0.0)
    (sim,) = built
    column = sim.joint_names.index("arm/finger_joint")
    inertia = sim.model.dof_M0[column]
    _, kp, kv = -sim.model.actuator_biasprm[column, :3]
    assert inertia == pytest.approx(0.25 * finger_lever(robot, "finger_joint") ** 2)
    assert np.sqrt(kp / inertia) == pytest.approx(stiffness)
    assert kv / (2.0 * np.sqrt(kp * inertia)) == pytest.approx(1.0)


def test_fingers_that_follow_a_motor_have_the_servo_of_a_drive(tmp_path: Path, built: list[Simulation]) -> None:
    """Through a chain of mimic joints, and as levers whose angle is 25 rad for a meter of the motor."""
    parts = [
        ("column", "base", "prismatic", 0.02, ""),
        ("motor", "column", "prismatic", 0.02, ""),
        ("idler", "column", "prismatic", 0.02, '<mimic joint="motor"/>'),
        ("slider", "column", "prismatic", 0.02, '<mimic joint="idler" multiplier="-1"/>'),
        ("lever", "column", "revolute", 0.5, '<mimic joint="motor" multiplier="25"/>'),
    ]
    shape = '<collision><origin xyz="0 0 0.05"/><geometry><box size="0.01 0.01 0.1"/></geometry></collision>'
    links = "".join(f'<link name="{name}_link">{shape}</link>' for name in ("base", *(part[0] for part in parts)))
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}_link"/><child link="{name}_link"/>{mimic}'
        f'<origin xyz="0 {0.1 * k} 0"/><axis xyz="1 0 0"/>'
        f'<limit lower="{-limit}" upper="{limit}" velocity="1" effort="100"/></joint>'
        for k, (name, parent, kind, limit, mimic) in enumerate(parts, 1)
    )
    (tmp_path / "hand.urdf").write_text(f'<robot name="hand">{links}{joints}</robot>')
    robot = rp.load_robot(tmp_path / "hand.urdf", joints=["column"])
    scene = rp.Scene().with_arm("arm", robot)
    plan = rp.plan_sequence(rp.Sequence(scene, [rp.MoveGripper(0.01)]), rng=0)
    assert plan.found, plan
    rp.simulate_sequence(plan, hold=0.0)
    model, names = built[0].model, built[0].joint_names
    inertia = {name.split("/")[1]: model.dof_M0[names.index(name)] for name in names}
    # The tip of a lever of 0.1 m, whose center is half as far from its joint, turns by 25 * 0.04 rad.
    lever = finger_lever(plan.scene.arms["arm"].robot, "motor") / 25.0
    assert inertia["slider"] == pytest.approx(0.25)
    assert inertia["idler"] == pytest.approx(0.25)
    assert inertia["lever"] == pytest.approx(0.25 * lever**2)
    assert lever == pytest.approx(0.05, rel=0.05)
