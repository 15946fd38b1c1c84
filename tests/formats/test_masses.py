"""Links without masses in their file get masses of their shapes, and all reports mention it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp

INERTIAL = '<inertial><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BOX = '<{0}><origin xyz="0.2 0 0" rpy="0 0 1.5707963267948966"/><geometry><box size="0.1 0.4 0.05"/></geometry></{0}>'
SOLID, SEEN = BOX.format("collision"), BOX.format("visual")


def arm(tmp_path: Path, *links: str) -> rp.Robot:
    """An arm of links one after the other on revolute joints about y; the base has a shape and no mass."""
    text = f'<robot name="arm"><link name="base">{SOLID.replace("0.2 0 0", "0 0 -1")}</link>'
    for i, link in enumerate(links):
        parent = f"l{i - 1}" if i else "base"
        text += f'<link name="l{i}">{link}</link><joint name="j{i}" type="revolute"><parent link="{parent}"/>'
        text += f'<child link="l{i}"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="2" effort="20"/></joint>'
    file = tmp_path / "arm.urdf"
    file.write_text(text + "</robot>")
    return rp.load_robot(file)


@pytest.mark.parametrize("given", ["", INERTIAL.format(0, 0), INERTIAL.format(0, 1)])
def test_a_link_without_a_mass_gets_that_of_its_shapes(
    tmp_path: Path, given: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = arm(tmp_path, given + SOLID, SOLID + INERTIAL.format(3, 1))
    inertial = robot.link("l0").inertial
    assert inertial is not None
    assert inertial.mass == pytest.approx(2.0)
    assert inertial.com == pytest.approx([0.2, 0.0, 0.0])
    # The box is turned by a quarter: 0.4 m along x, 0.1 m along y.
    assert inertial.inertia == pytest.approx(
        2.0 / 12.0 * np.diag([0.1**2 + 0.05**2, 0.4**2 + 0.05**2, 0.4**2 + 0.1**2]), abs=1e-12
    )
    assert robot.links_of_assumed_mass == ("l0",)
    assert robot.link("base").inertial is None
    assert "arm: links without a mass, taken as solid with 1000 kg/m³ (2 kg in all)" in caplog.text


def test_shapes_heavier_than_any_machine_are_refused(tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match=r"link 'l0' would weigh 2e\+09 kg.*are these millimeters\?"):
        arm(tmp_path, SOLID.replace("0.1 0.4 0.05", "100 400 50"))


def test_a_mesh_counts_as_its_hull_and_a_visual_where_nothing_else_is_there(tmp_path: Path) -> None:
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]) * 0.3
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (tmp_path / "wedge.obj").write_text("\n".join(lines))
    mesh = '<visual><geometry><mesh filename="wedge.obj"/></geometry></visual>'
    robot = arm(tmp_path, SOLID, mesh, mesh.replace("visual", "collision") + SEEN)
    for link in ("l1", "l2"):
        inertial = robot.link(link).inertial
        assert inertial is not None
        assert inertial.mass == pytest.approx(1000.0 * 0.3**3 / 6.0)
        assert inertial.com == pytest.approx([0.075] * 3)


def test_what_is_fixed_to_a_mass_or_has_no_shape_gets_none(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    arm(tmp_path, INERTIAL.format(1, 1), "")
    file = tmp_path / "arm.urdf"
    cover = '<joint name="f" type="fixed"><parent link="l0"/><child link="cover"/></joint>'
    file.write_text(file.read_text().replace("</robot>", f'<link name="cover">{SOLID}</link>{cover}</robot>'))
    caplog.clear()
    assert rp.load_robot(file).links_of_assumed_mass == ()
    assert "without a mass" not in caplog.text


def test_gravity_and_the_report_on_torque_know_of_it(tmp_path: Path) -> None:
    robot = arm(tmp_path, SOLID)
    scene = rp.Scene().with_arm("arm", robot)
    rest = np.zeros((1, 1))
    torque = rp.Kinematics(scene).inverse_dynamics(rest, rest, rest)
    assert abs(torque[0, 0]) == pytest.approx(2.0 * 9.81 * 0.2, rel=1e-3)
    report = rp.validate(rp.Trajectory.rest(scene.joint_names(), robot.home), scene, torque_limits=True)
    assert report.not_checked["mass of arm/l0"] == "not given, estimated from its shape"
    assert float(report.margins["torque"]) == pytest.approx(2.0 * 9.81 * 0.2 / 20.0, rel=1e-3)


def test_a_replay_says_that_masses_are_estimated(tmp_path: Path) -> None:
    robot = arm(tmp_path, SOLID, SOLID)
    scene = rp.Scene().with_arm("arm", robot)
    motion = rp.plan_motion(rp.Problem(scene, "home", [0.5, -0.3]), rng=0)
    trajectory = motion.trajectory
    scene = rp.load_motion(motion.save(tmp_path / "motion.json")).scene
    replay = rp.simulate(trajectory, scene)
    assert "masses estimated from shapes: arm/l0, arm/l1" in str(replay)
    assert replay.to_dict()["remarks"] == ["masses estimated from shapes: arm/l0, arm/l1"]
    assert replay.worst_error < 2e-3
    assert "estimated" not in str(rp.simulate(trajectory, scene, mode="kinematic"))


@pytest.mark.parametrize(("ixx", "is_impossible"), [(2.1, True), (2.01, False), (1.0, False)])
def test_a_replay_names_links_with_inertias_that_no_body_has(tmp_path: Path, ixx: float, is_impossible: bool) -> None:
    """The other two moments are 1 kg m²; those of a flat body may be rounded."""
    robot = arm(tmp_path, SOLID + INERTIAL.format(2, 1), SOLID + INERTIAL.format(3, ixx))
    scene = rp.Scene().with_arm("arm", robot)
    trajectory = rp.plan_motion(rp.Problem(scene, "home", [0.2, -0.1]), rng=0).trajectory
    said = "moments of inertia that no body has, one reduced to the sum of the others: arm/l1"
    assert (said in str(rp.simulate(trajectory, scene))) == is_impossible


def test_joints_that_carry_nothing_are_tracked_and_named(tmp_path: Path) -> None:
    robot = arm(tmp_path, SOLID + INERTIAL.format(2, 1), "", "")
    scene = rp.Scene().with_arm("arm", robot)
    trajectory = rp.plan_motion(rp.Problem(scene, "home", [0.5, -0.3, 0.8]), rng=0).trajectory
    replay = rp.simulate(trajectory, scene)
    assert "joints that carry no mass: arm/j1, arm/j2" in str(replay)
    assert replay.worst_error < 2e-3


def test_placeholder_efforts_do_not_hold_an_arm_of_estimated_masses_back(tmp_path: Path) -> None:
    """A file without masses often has efforts of 1 as well: the fraction is reported, and the motion is followed."""
    arm(tmp_path, SOLID, SOLID)
    file = tmp_path / "arm.urdf"
    file.write_text(file.read_text().replace('effort="20"', 'effort="1"'))
    scene = rp.Scene().with_arm("arm", rp.load_robot(file))
    trajectory = rp.plan_motion(rp.Problem(scene, "home", [0.5, -0.3]), rng=0).trajectory
    replay = rp.simulate(trajectory, scene)
    assert replay.worst_error < 2e-3
    assert replay.peak_effort.max() > 2.0
    with pytest.raises(rp.RetimingError, match=r"no timing can help.*masses of arm/l0, arm/l1 are estimates"):
        rp.retime(rp.Path(scene.joint_names(), [[0.0, 0.0], [0.5, -0.3]]), scene, torque_limits=True)


def test_a_replay_whose_steps_are_too_long_says_so(tmp_path: Path) -> None:
    arm(tmp_path, SOLID + INERTIAL.format(2, 1))
    file = tmp_path / "arm.urdf"
    file.write_text(file.read_text().replace('velocity="2" effort="20"', 'velocity="1000"'))
    scene = rp.Scene().with_arm("arm", rp.load_robot(file))
    trajectory = rp.plan_motion(rp.Problem(scene, "home", [0.9]), rng=0).trajectory
    replay = rp.simulate(trajectory, scene)
    assert "take a smaller time step" in str(replay)
    finer = rp.simulate(trajectory, scene, dt=1e-4)
    assert "time step" not in str(finer)
    assert finer.worst_error < 0.2 * replay.worst_error
