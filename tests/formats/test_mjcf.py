"""MJCF files, written here: the robot agrees with MuJoCo's own compiler, and bad files are rejected."""

from __future__ import annotations

import logging
import math
import os
import random
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

import rr1plan as rp
from rr1plan.robot.link_contacts import LinkBodies
from rr1plan.robot.mjcf import read_mjcf

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def wedge() -> tuple[np.ndarray, np.ndarray]:
    """A convex solid without any symmetry: its vertices, and faces that are counter-clockwise from outside."""
    vertices = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0.01], [0.02, 0.03, 0.15], [0.15, 0.08, 0.05]])
    faces = ConvexHull(vertices).simplices.copy()
    for face in faces:
        a, b, c = vertices[face]
        if np.cross(b - a, c - a) @ (a - vertices.mean(axis=0)) < 0.0:
            face[:] = face[::-1]
    return vertices, faces


def write_stl(file: Path, scale: float = 1.0) -> None:
    vertices, faces = wedge()
    triangles = b"".join(struct.pack("<12fH", 0, 0, 0, *(vertices[f] * scale).ravel(), 0) for f in faces)
    file.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + triangles)


def write_obj(file: Path) -> None:
    vertices, faces = wedge()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    file.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist())]))


# Nested classes, degrees, a gripper whose finger follows the other one, as many arms have it.
GRIPPER = """
<mujoco model="gripper arm">
  <compiler angle="degree" meshdir="assets" autolimits="true"/>
  <option timestep="0.001"/>
  <default>
    <default class="arm">
      <joint damping="0.5" armature="0.1" frictionloss="0.2" axis="0 0 1" range="-160 160"/>
      <position kp="100" forcerange="-80 80"/>
      <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2" mass="0"/></default>
      <default class="collision"><geom group="3" type="capsule"/></default>
      <default class="finger"><joint type="slide" axis="0 1 0" range="0 0.04" damping="5"/></default>
    </default>
  </default>
  <asset>
    <material name="blue" rgba="0.1 0.2 0.8 1" texture="grid"/>
    <texture name="grid" type="2d" file="missing.png"/>
    <mesh file="part.stl" scale="0.001 0.001 0.001"/>
    <mesh name="solid" file="part.obj" refpos="0.05 0 0" refquat="1 0 0 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="base" childclass="arm" pos="0.1 0 0.2" quat="1 0 0 1">
      <inertial mass="3" pos="0 0 0.05" fullinertia="0.01 0.02 0.015 0.001 -0.002 0.0005"/>
      <geom class="visual" mesh="part" material="blue"/>
      <geom class="collision" size="0.06" fromto="0 0 0 0 0 0.1"/>
      <body name="one" pos="0 0 0.2">
        <inertial mass="2" pos="0 0.1 0" quat="1 2 3 4" diaginertia="0.01 0.02 0.015"/>
        <joint name="first"/>
        <geom class="collision" size="0.05" fromto="0 0 0 0 0.2 0"/>
        <body name="two" pos="0 0.3 0" euler="90 20 -30">
          <inertial mass="1.5" pos="0.02 0 0" diaginertia="0.01 0.01 0.01"/>
          <joint name="second" axis="1 1 0" range="-90 120"/>
          <geom class="collision" type="mesh" mesh="solid" pos="0 0 0.05" axisangle="0 1 0 30"/>
          <body name="hand" pos="0 0 0.25">
            <inertial mass="0.5" pos="0 0 0" diaginertia="0.001 0.001 0.001"/>
            <joint name="third" axis="0 1 0" range="-170 170"/>
            <geom class="collision" type="box" size="0.03 0.05 0.02" zaxis="1 0 1"/>
            <site name="grasp_site" pos="0 0 0.1" xyaxes="0 1 0 -1 0 0"/>
            <body name="left" pos="0 0 0.05">
              <inertial mass="0.02" pos="0 0 0" diaginertia="1e-5 1e-5 1e-5"/>
              <joint name="left_finger" class="finger"/>
              <geom class="collision" type="box" size="0.01 0.005 0.03" pos="0 0.02 0.03"/>
            </body>
            <body name="right" pos="0 0 0.05" quat="0 0 0 1">
              <inertial mass="0.02" pos="0 0 0" diaginertia="1e-5 1e-5 1e-5"/>
              <joint name="right_finger" class="finger"/>
              <geom class="collision" type="box" size="0.01 0.005 0.03" pos="0 0.02 0.03"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="base" body2="two"/></contact>
  <tendon><fixed name="both"><joint joint="left_finger" coef="0.5"/><joint joint="right_finger" coef="0.5"/></fixed>
  </tendon>
  <equality><joint joint1="right_finger" joint2="left_finger" polycoef="0 1 0 0 0"/></equality>
  <actuator>
    <position class="arm" name="p1" joint="first"/>
    <position class="arm" name="p2" joint="second" forcerange="-70 90"/>
    <motor name="p3" joint="third" gear="20" ctrlrange="-1.5 1.5"/>
    <position name="hand" tendon="both" kp="100" ctrlrange="0 0.04"/>
  </actuator>
  <sensor><framepos objtype="site" objname="grasp_site"/></sensor>
  <keyframe>
    <key name="home" qpos="0.1 0.2 -0.3 0.03 0.03" ctrl="0 0 0 0"/>
    <key name="ready" qpos="1 0.5 0 0.04 0.04"/>
    <key name="time only" time="3"/>
  </keyframe>
</mujoco>"""

CASES = {
    "gripper": GRIPPER,
    "joints beside the origin, with references": """
<mujoco><compiler angle="radian"/><worldbody><body name="a" pos="0 0 0.1" euler="0.1 0.2 0.3">
  <joint name="j1" pos="0.1 -0.2 0.05" axis="1 2 3" ref="0.4" range="-1 2"/><geom type="box" size="0.1 0.05 0.03"/>
  <body name="b" pos="0.3 0 0"><joint name="j2" pos="0 0.03 0" axis="0 1 0" ref="-0.3"/><geom size="0.04"
  pos="0.1 0 0"/>
  <body name="c" pos="0.2 0 0"><joint name="j3" type="slide" axis="1 0 1" ref="0.05" range="0 0.2"/>
  <geom type="cylinder" size="0.02 0.05"/></body></body></body></worldbody></mujoco>""",
    "several joints on one body": """
<mujoco model="wrist"><compiler eulerseq="XYZ"/><worldbody><body name="a"><geom size="0.1"/>
  <joint name="x" axis="1 0 0" pos="0 0 0.1"/><joint name="y" axis="0 1 0" pos="0.02 0 0"/>
  <joint name="s" type="slide" axis="0 0 1" range="-0.1 0.1"/><joint name="z" axis="0 0 1"/>
  <body name="b" pos="0 0 0.3" euler="30 40 50"><joint name="last" range="-90 90"/><geom type="ellipsoid"
  size="0.05 0.1 0.03"/>
  </body></body></worldbody></mujoco>""",
    "frames and replicas": """
<mujoco><worldbody><frame pos="1 0 0" euler="0 0 90"><body name="a" pos="0 1 0"><frame euler="45 0 0"><joint name="j"
  axis="0 0 1"/>
  <geom type="capsule" size="0.03 0.1"/></frame><body name="b"><joint name="k" axis="1 0 0"/>
  <replicate count="3" offset="0 0 0.1" euler="0 0 20"><geom type="box" size="0.02 0.01 0.03"/></replicate>
  <site name="tool_frame" pos="0 0 0.4"/></body></body></frame></worldbody></mujoco>""",
    "without names": """
<mujoco><worldbody><body><joint/><geom size="0.1"/><body pos="0 0 0.3"><joint axis="1 0 0"/><geom size="0.1"/><site/>
  </body></body></worldbody></mujoco>""",
    "masses of shapes": """
<mujoco><compiler inertiagrouprange="0 1" boundmass="0.01" boundinertia="1e-5"/><default><geom density="500"/>
  </default><worldbody>
  <body name="a"><joint name="j"/><geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0" mass="2"/>
  <geom type="sphere" size="0.1" group="2"/><body name="b" pos="0 0 0.5"><joint name="k" axis="0 1 0"/>
  <geom type="capsule" size="0.05 0.2"/><geom type="ellipsoid" size="0.1 0.2 0.05" pos="0.1 0.2 0.3"/></body>
  </body></worldbody></mujoco>""",
    "meshes fitted by shapes": """
<mujoco><compiler meshdir="assets" fitaabb="true"/><asset><mesh name="m" file="part.obj" scale="1 -2 1"/></asset>
  <worldbody>
  <body name="a"><joint name="j"/><geom type="box" mesh="m"/><body name="b" pos="0 0 0.3"><joint name="k" axis="1 0 0"/>
  <geom type="capsule" mesh="m" euler="10 20 30"/><geom type="mesh" mesh="m" pos="0.1 0 0" euler="5 0 50"/></body>
  </body>
  </worldbody></mujoco>""",
    "a shape in the file": """
<mujoco><asset><mesh name="m" vertex="0 0 0 0.1 0 0 0 0.2 0 0 0 0.3"/><mesh name="s" builtin="sphere" params="1"
  scale="0.1 0.1 0.2"/>
  </asset><worldbody><body name="a"><joint name="j"/><geom type="mesh" mesh="m"/>
  <body name="b" pos="0 0 0.5"><joint name="k" axis="1 0 0"/><geom type="mesh" mesh="s"/></body></body></worldbody>
  </mujoco>""",
    "a chain of equalities": """
<mujoco><worldbody><body name="a"><joint name="j" axis="0 0 1" range="-1 1"/><geom size="0.1"/><body name="b"
  pos="0.3 0 0">
  <joint name="k" axis="0 0 1" ref="10"/><geom size="0.1"/><body name="c" pos="0.3 0 0"><joint name="l" axis="0 0 1"/>
  <geom size="0.1"/><body name="d" pos="0.3 0 0"><joint name="m" axis="0 0 1"/><geom size="0.1"/></body></body>
  </body></body></worldbody>
  <equality><joint joint1="k" joint2="j" polycoef="0.1 -0.5 0 0 0"/><joint joint1="l" joint2="k" polycoef="0 2 0 0 0"/>
  <joint joint1="m" polycoef="0.25 0 0 0 0"/><joint active="false" joint1="j" joint2="m"/></equality></mujoco>""",
    "two arms and a cube": """
<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="left/base" pos="0 0.5 0.1"><geom size="0.05"/>
  <body name="left/arm">
  <joint name="left/a"/><geom type="capsule" size="0.03" fromto="0 0 0.1 0 0 0.3"/><body name="left/tip" pos="0 0 0.3">
  <joint name="left/b" axis="0 1 0"/><geom size="0.03"/><site name="left/gripper" pos="0 0 0.1"/></body></body></body>
  <body name="right/base" pos="0 -0.5 0.1"><geom size="0.05"/><body name="right/arm"><joint name="right/a"/>
  <geom type="capsule" size="0.03" fromto="0 0 0.1 0 0 0.3"/><body name="right/tip" pos="0 0 0.3">
  <joint name="right/b" axis="0 1 0"/>
  <geom size="0.03"/><site name="right/gripper" pos="0 0 0.1"/></body></body></body>
  <body name="cube" pos="0.5 0 0.02"><freejoint/><geom type="box" size="0.02 0.02 0.02"/></body>
  <body name="table" pos="1 0 0"><geom type="box" size="0.2 0.2 0.1"/></body></worldbody>
  <actuator><motor joint="left/a"/><motor joint="left/b"/><motor joint="right/a"/><motor joint="right/b"/></actuator>
  <keyframe><key name="home" qpos="0.1 0.2 0.3 0.4 0.5 0.1 0.02 1 0 0 0"/></keyframe></mujoco>""",
    "a base that is free": """
<mujoco><worldbody><body name="trunk" pos="0 0 1" euler="0 0 30"><freejoint/><geom size="0.2"/><body name="arm"
  pos="0.3 0 0">
  <joint name="j" axis="0 1 0"/><geom type="capsule" size="0.05 0.1"/></body></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>""",
    "a passive door": """
<mujoco><worldbody><body name="arm"><joint name="j"/><geom size="0.1"/></body><body name="door" pos="1 0 0">
  <joint name="hinge"/>
  <geom type="box" size="0.3 0.02 0.5"/></body></worldbody><actuator><motor joint="j"/></actuator></mujoco>""",
    "masses scaled and balanced": """
<mujoco><compiler balanceinertia="true" fusestatic="true" discardvisual="true"/><worldbody><body name="a">
  <joint name="j"/>
  <inertial mass="1" pos="0 0 0" diaginertia="1 1 5"/><geom size="0.1"/><body name="fused" pos="0.1 0 0">
  <geom size="0.02" contype="0" conaffinity="0"/>
  <body name="b" pos="0.2 0 0"><joint name="k" axis="1 0 0"/><geom size="0.1"/></body></body></body></worldbody>
  </mujoco>""",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "assets").mkdir()
    write_stl(tmp_path / "assets" / "part.stl", 1000.0)
    write_obj(tmp_path / "assets" / "part.obj")
    return tmp_path


def load(folder: Path, text: str, **options: Any) -> rp.Robot:
    file = folder / "robot.xml"
    file.write_text(text)
    return rp.load_robot(file, **options)


def reference(text: str, folder: Path) -> Any:
    """The model that MuJoCo itself compiles, with its bodies apart; textures need not be there."""
    text = text.replace('<texture name="grid" type="2d" file="missing.png"/>', "").replace(' texture="grid"', "")
    text = text.replace('fusestatic="true" discardvisual="true"', "")
    file = folder / "reference.xml"
    file.write_text(text)
    return mujoco.MjModel.from_xml_path(str(file))


class Twin:
    """The same robot in MuJoCo."""

    def __init__(self, robot: rp.Robot, model: Any) -> None:
        self.robot, self.model, self.data = robot, model, mujoco.MjData(model)
        numbers = [j for j in range(model.njnt) if int(model.jnt_type[j]) in (HINGE, SLIDE)]
        # Joints without a name are found by their order.
        moving = [joint.name for joint in robot.joints if joint.kind != "fixed"]
        named = {model.joint(j).name: j for j in numbers if model.joint(j).name}
        self.numbers = {name: named[name] if named else numbers[i] for i, name in enumerate(moving)}
        bodies = [b for b in range(1, model.nbody) if not named or model.body(b).name in robot.link_names]
        self.bodies = {b: model.body(b).name or f"body{b}" for b in bodies}

    def place(self, q: np.ndarray) -> None:
        for name, value in self.robot.joint_values(q).items():
            self.data.qpos[self.model.jnt_qposadr[self.numbers[name]]] = value
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def random(self, rng: np.random.Generator) -> np.ndarray:
        limits = self.robot.limits
        return rng.uniform(np.maximum(limits.lower, -3.0), np.minimum(limits.upper, 3.0))

    def pose(self, body: int) -> np.ndarray:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return T

    def distance(self, a: str, b: str) -> float:
        """Of the geoms that collide on two links, by MuJoCo."""
        model = self.model
        of_a, of_b = (
            [g for g in range(model.ngeom) if self.bodies.get(int(model.geom_bodyid[g])) == link] for link in (a, b)
        )
        pairs = [(g, h) for g in of_a for h in of_b if model.geom_contype[g] and model.geom_contype[h]]
        found = [1.0, *(mujoco.mj_geomDistance(model, self.data, g, h, 1.0, None) for g, h in pairs)]
        return min(found)


@pytest.mark.parametrize("case", CASES)
def test_every_link_is_where_mujoco_and_pinocchio_have_it(case: str, folder: Path) -> None:
    robot = load(folder, CASES[case])
    twin, kinematics, rng = Twin(robot, reference(CASES[case], folder)), rp.Kinematics(robot), np.random.default_rng(0)
    assert len(twin.bodies) >= 1
    sites = {twin.model.site(s).name: s for s in range(twin.model.nsite)}
    for _ in range(20):
        q = twin.random(rng)
        twin.place(q)
        poses = robot.link_poses(q)
        for body, name in twin.bodies.items():
            np.testing.assert_allclose(poses[name], twin.pose(body), atol=1e-9)
        for name, site in sites.items():
            if name in poses:
                np.testing.assert_allclose(poses[name][:3, 3], twin.data.site_xpos[site], atol=1e-9)
                np.testing.assert_allclose(poses[name][:3, :3].ravel(), twin.data.site_xmat[site], atol=1e-9)
        for name, pose in poses.items():
            np.testing.assert_allclose(kinematics.pose(q, f"arm/{name}"), pose, atol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_the_mass_matrix_is_mujocos_without_armature(case: str, folder: Path) -> None:
    robot = load(folder, CASES[case])
    twin, kinematics, rng = Twin(robot, reference(CASES[case], folder)), rp.Kinematics(robot), np.random.default_rng(1)
    model = twin.model
    # Joint velocities from those of the planning joints.
    S = np.zeros((model.nv, robot.nq))
    zero = robot.joint_values(np.zeros(robot.nq))
    for k in range(robot.nq):
        for name, value in robot.joint_values(np.eye(robot.nq)[k]).items():
            S[model.jnt_dofadr[twin.numbers[name]], k] = value - zero[name]
    for _ in range(10):
        q = twin.random(rng)
        twin.place(q)
        mujoco.mj_makeM(model, twin.data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, twin.data, M)
        M -= np.diag(model.dof_armature)
        np.testing.assert_allclose(kinematics.mass_matrix(q), S.T @ M @ S, atol=1e-6, rtol=1e-6)
    total = sum(link.inertial.mass for link in robot.links if link.inertial is not None)
    assert total == pytest.approx(sum(float(model.body_mass[b]) for b in twin.bodies), rel=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_links_touch_where_mujocos_geoms_do(case: str, folder: Path) -> None:
    robot = load(folder, CASES[case])
    twin, rng, bodies = Twin(robot, reference(CASES[case], folder)), np.random.default_rng(2), LinkBodies(robot)
    # The polyhedron around an ellipsoid reaches up to a hundredth of its size beyond.
    around = 0.004 if "ellipsoid" in CASES[case] or "builtin" in CASES[case] else 1e-5
    decided = 0
    for _ in range(60):
        q = twin.random(rng)
        twin.place(q)
        touching = bodies.touching(robot.joint_values(q), bodies.pairs)
        for pair in bodies.pairs:
            distance = twin.distance(*sorted(pair))
            if distance > around or distance < -1e-5:
                decided += 1
                assert (pair in touching) == (distance < 0.0), (pair, distance)
    assert decided or not bodies.pairs


# ---- what else a file says ------------------------------------------------------------------


def test_a_gripper_arm_is_ready_to_plan(folder: Path) -> None:
    robot = load(folder, GRIPPER)
    assert robot.name == "gripper arm"
    assert robot.joint_names == ("first", "second", "third")
    assert robot.tool == "grasp_site"
    assert dict(robot.locked_joints) == {"left_finger": 0.03}
    assert robot.joint("right_finger").mimic == rp.robot.Mimic("left_finger", 1.0, 0.0)
    np.testing.assert_array_equal(robot.home, [0.1, 0.2, -0.3])
    assert set(robot.configurations) == {"home", "ready"}
    assert robot.locked_joint_states["ready"]["left_finger"] == 0.04
    np.testing.assert_allclose(np.degrees(robot.limits.lower), [-160, -90, -170])
    np.testing.assert_allclose(robot.limits.effort, [80.0, 70.0, 30.0])
    assert frozenset(("base", "two")) in robot.disabled_collisions
    joint = robot.joint("first")
    assert (joint.damping, joint.friction) == (0.5, 0.2)
    assert robot.links_of_assumed_mass == ()
    (look,) = robot.link("base").visuals
    assert look.color == (0.1, 0.2, 0.8, 1.0)
    assert robot.link("one").visuals == ()


def test_it_goes_the_whole_line(folder: Path) -> None:
    scene = rp.Scene().with_arm("arm", load(folder, GRIPPER)).with_obstacle("ball", rp.Sphere(0.05), (0.6, 0.6, 0.6))
    motion = rp.plan_motion(rp.Problem(scene, "home", "ready"), rng=0)
    assert motion.valid
    assert rp.simulate(motion.trajectory, scene).free
    again = rp.load_motion(motion.save(folder / "motion.json"))
    assert again.report.valid


def test_chosen_joints_keep_the_tool(folder: Path) -> None:
    robot = load(folder, GRIPPER, joints=["second", "third"])
    assert robot.tool == "grasp_site"
    assert robot.locked_joints["first"] == 0.1
    np.testing.assert_array_equal(robot.home, [0.2, -0.3])


def test_the_way_to_a_chosen_tool_is_planned_for(folder: Path) -> None:
    robot = load(folder, CASES["two arms and a cube"], tool="right/tip")
    assert robot.joint_names == ("right/a", "right/b")
    assert robot.tool == "right/tip"
    with pytest.raises(rp.UnknownNameError, match="right/tip"):
        load(folder, CASES["two arms and a cube"], tool="rigt/tip")


def test_two_arms_are_two_groups(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = load(folder, CASES["two arms and a cube"])
    assert robot.joint_names == ("left/a", "left/b")
    assert robot.tool == "left/gripper"
    assert dict(robot.locked_joints) == {"right/a": 0.3, "right/b": 0.4}
    assert "'left/base' is planned for, not right/base; option groups of load_robot takes several" in caplog.text
    caplog.clear()
    both = load(folder, CASES["two arms and a cube"], groups=["left/base", "right/base"])
    assert both.nq == 4
    np.testing.assert_array_equal(both.home, [0.1, 0.2, 0.3, 0.4])
    assert "is planned for" not in caplog.text
    chain = load(folder, CASES["two arms and a cube"], groups=[("world", "right/tip")])
    assert chain.joint_names == ("right/a", "right/b")
    np.testing.assert_allclose(
        rp.Kinematics(both).pose(both.home, "right/gripper")[2, 3], both.link_poses(both.home)["right/gripper"][2, 3]
    )


def test_links_that_begin_with_the_name_of_the_arm_are_frames(folder: Path, planar2r: rp.Robot) -> None:
    scene = rp.load_scene(rp.save_mjcf(folder / "again.xml", rp.Scene().with_arm("arm", planar2r)))
    kinematics, q = rp.Kinematics(scene), scene.configuration()
    assert kinematics.frame("arm/link2") == kinematics.frame("arm/arm/link2") == "arm/arm/link2"
    assert kinematics.frame("arm/tool") == f"arm/{scene.arms['arm'].robot.tool}"
    np.testing.assert_array_equal(kinematics.pose(q, "arm/link2"), kinematics.pose(q, "arm/arm/link2"))
    with pytest.raises(rp.UnknownNameError, match="unknown frame 'link3'"):
        kinematics.frame("arm/link3")


def test_what_is_not_the_robot_is_said(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = load(folder, CASES["two arms and a cube"])
    assert not {"cube", "table"} & set(robot.link_names)
    assert "left out: geom0, cube, table; rr1plan.load_scene of this file reads them as" in caplog.text
    assert "door" not in load(folder, CASES["a passive door"]).link_names
    load(folder, CASES["a base that is free"])
    assert "'trunk' is free to move, it is taken as fixed" in caplog.text


def test_a_file_is_a_scene_too(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = folder / "scene.xml"
    file.write_text(CASES["two arms and a cube"].replace('size="1 1 1"/>', 'name="ground/plane" size="1 1 1"/>'))
    scene = rp.load_scene(file)
    assert list(scene.arms) == ["arm"]
    assert set(scene.obstacles) == {"ground_plane", "cube", "table"}
    assert isinstance(scene.obstacles["ground_plane"].geometries[0].shape, rp.HalfSpace)
    np.testing.assert_allclose(scene.obstacles["cube"].pose[:3, 3], [0.5, 0.1, 0.02])
    assert frozenset(("arm/left/base", "table")) in scene.allowed
    assert frozenset(("arm/left/base", "cube")) not in scene.allowed
    again = rp.load_scene(rp.save_scene(folder / "saved.toml", scene))
    assert "left out" not in caplog.text
    assert again.content_hash == scene.content_hash
    assert rp.CollisionChecker(scene).is_free(scene.arms["arm"].q)


def test_bodies_with_a_free_joint_are_loose(folder: Path, rr1: rp.Robot, caplog: pytest.LogCaptureFixture) -> None:
    scene = rp.Scene().with_arm("arm", rr1).with_obstacle("post", rp.Sphere(0.1), [1, 0, 0])
    scene = scene.with_obstacle("cup", rp.Cylinder(0.02, 0.06), [-0.3, 0.12, 0.03], mass=0.125, friction=0.5)
    again = rp.load_scene(rp.save_mjcf(folder / "again.xml", scene))
    assert (again.obstacles["cup"].mass, again.obstacles["cup"].friction) == (0.125, 0.5)
    assert again.obstacles["post"].mass is None
    assert "taken as fixed" not in caplog.text
    duo = '<body name="duo" pos="0 0 2"><freejoint/><geom size=".1"/><body><geom size=".1" pos="1 0 0"/></body></body>'
    dent = '<mesh name="dent" vertex="0 0 0 1 0 0 0 1 0 .1 .1 .1 0 0 1" face="0 2 1 0 4 2 0 1 4 1 2 3 2 4 3 4 1 3"/>'
    bowl = '<body name="bowl" pos="0 0 4"><freejoint/><geom type="mesh" mesh="dent"/></body>'
    text = WORKPLACE.replace("</asset><worldbody>", f"{dent}</asset><worldbody>{duo}{bowl}")
    file = folder / "scene.xml"
    file.write_text(text)
    masses = {name: thing.mass for name, thing in rp.load_scene(file).obstacles.items() if thing.mass is not None}
    assert masses == {"ball": pytest.approx(4000.0 / 3.0 * np.pi * 0.08**3)}
    assert "body 'bowl' is free to move, it is taken as fixed: mesh" in caplog.text


def test_pairs_excluded_from_contact_are_allowed(folder: Path) -> None:
    excluded = [("three", "shelf"), ("ball", "two"), ("one", "world")]
    rows = "".join(f'<exclude body1="{a}" body2="{b}"/>' for a, b in excluded)
    file = folder / "scene.xml"
    file.write_text(WORKPLACE.replace("<actuator>", f"<contact>{rows}</contact><actuator>"))
    scene = rp.load_scene(file)
    rests = {frozenset(("arm/arm", name)) for name in ("floor", "wedge", "shelf")}
    pairs = [("three", "shelf"), ("two", "ball"), ("one", "floor"), ("one", "wedge")]
    assert scene.allowed == rests | {frozenset((f"arm/{link}", name)) for link, name in pairs}


WORKPLACE = """
<mujoco><compiler meshdir="assets"/><asset><mesh file="part.obj" scale="2 2 2"/></asset><worldbody>
  <geom name="floor" type="plane" size="1 1 1" pos="0 0 -0.1" euler="5 0 0"/>
  <geom name="wedge" type="mesh" mesh="part" pos="0.3 0.1 0.1" euler="0 0 20"/>
  <body name="shelf" pos="-0.4 0 0.3" euler="0 0 30"><geom type="box" size="0.1 0.2 0.01" pos="0 0 0.1"/>
  <geom type="capsule" size="0.02 0.2"/></body><body name="ball" pos="0 0.4 0.3"><freejoint/><geom size="0.08"/></body>
  <body name="arm"><geom size="0.12"/><body name="one" pos="0 0 0.15"><joint name="j1" axis="0 0 1" range="-170 170"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.2"/><body name="two" pos="0 0 0.25">
  <joint name="j2" axis="0 1 0" range="-150 150"/><geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0"/>
  <body name="three" pos="0.3 0 0"><joint name="j3" axis="0 1 0" range="-150 150"/>
  <geom type="box" size="0.15 0.02 0.02" pos="0.15 0 0"/></body></body></body></body></worldbody>
  <actuator><motor joint="j1"/><motor joint="j2"/><motor joint="j3"/></actuator></mujoco>"""


def test_the_scene_is_free_where_mujocos_is(folder: Path) -> None:
    file = folder / "scene.xml"
    file.write_text(WORKPLACE)
    scene = rp.load_scene(file)
    robot = scene.arms["arm"].robot
    checker, rng = rp.CollisionChecker(scene), np.random.default_rng(3)
    twin = Twin(robot, reference(WORKPLACE, folder))
    own = [p for p in LinkBodies(robot).pairs if p not in robot.disabled_collisions]
    model, outcomes = twin.model, []
    moving = [g for g in range(model.ngeom) if twin.bodies.get(int(model.geom_bodyid[g])) in ("one", "two", "three")]
    around = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) not in twin.bodies]
    assert len(around) == 5
    for _ in range(300):
        q = twin.random(rng)
        twin.place(q)
        found = [mujoco.mj_geomDistance(model, twin.data, g, h, 1.0, None) for g in moving for h in around]
        nearest = min([*found, *(twin.distance(*sorted(pair)) for pair in own)])
        if abs(nearest) > 1e-5:
            outcomes.append(nearest > 0.0)
            assert checker.is_free(q) == (nearest > 0.0), (q, nearest)
    assert 20 < sum(outcomes) < len(outcomes) - 20


def test_the_file_that_we_write_reads_back(rr1: rp.Robot, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    robot = rp.load_robot(rp.save_mjcf(tmp_path / "rr1.xml", scene), groups=[("world", f"arm/{rr1.tool}")])
    assert robot.joint_names == tuple(f"arm/{name}" for name in rr1.joint_names)
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(rr1.limits.lower, rr1.limits.upper)
        ours = robot.with_locked_joints({f"arm/{n}": v for n, v in rr1.locked_joints.items()}).link_poses(q)
        for link, pose in rr1.link_poses(q).items():
            np.testing.assert_allclose(ours[f"arm/{link}"], pose, atol=1e-9)
    mass = {link.name: link.inertial.mass for link in robot.links if link.inertial is not None}
    for link in rr1.links:
        if link.inertial is not None:
            assert mass[f"arm/{link.name}"] == pytest.approx(link.inertial.mass)


def test_the_file_that_we_write_has_the_ranges_and_the_followers_of_joints(tmp_path: Path) -> None:
    panda = rp.load_robot("panda")
    narrow = replace(panda.limits, upper=panda.limits.upper - 0.5)
    scene = rp.Scene().with_arm("a", panda.with_limits(narrow)).with_arm("b", rp.load_robot("planar2r"), [0, 2, 0])
    robot = rp.load_robot(rp.save_mjcf(tmp_path / "two.xml", scene), groups=[("world", f"a/{panda.tool}")])
    np.testing.assert_allclose(robot.limits.lower, narrow.lower, atol=1e-5)
    np.testing.assert_allclose(robot.limits.upper, narrow.upper, atol=1e-5)
    for joint in panda.joints:
        again = robot.joint(f"a/{joint.name}") if joint.kind != "fixed" else joint
        assert again.kind == joint.kind
        if joint.mimic is not None:
            assert again.mimic == replace(joint.mimic, joint=f"a/{joint.mimic.joint}")
            assert (again.lower, again.upper) == (joint.lower, joint.upper)
    free = {joint.name for joint in scene.arms["b"].robot.joints if joint.kind == "continuous"}
    assert {joint.name for joint in robot.joints if joint.kind == "continuous"} == {f"b/{name}" for name in free}


def test_the_same_file_has_the_same_hash_and_another_one_not(folder: Path) -> None:
    first, second = load(folder, GRIPPER), load(folder, GRIPPER)
    assert first.content_hash == second.content_hash
    assert load(folder, GRIPPER.replace('mass="3"', 'mass="3.5"')).content_hash != first.content_hash


def test_masses_of_the_default_density_are_marked(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert load(folder, CASES["masses of shapes"]).links_of_assumed_mass == ()
    assert "without a mass" not in caplog.text
    assert load(folder, CASES["without names"]).links_of_assumed_mass == ("body1", "body2")
    assert "links without a mass, taken as solid with 1000 kg/m³, torques are estimates: body1, body2" in caplog.text


def test_hidden_shapes_collide_though_their_bits_are_off(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = GRIPPER.replace(
        '<geom group="3" type="capsule"/>', '<geom group="3" type="capsule" contype="0" conaffinity="0"/>'
    )
    with caplog.at_level(logging.INFO):
        robot = load(folder, text)
    assert len(robot.link("one").collisions) == 1
    assert "hidden groups" in caplog.text


def test_a_joint_that_an_equality_holds_is_locked(folder: Path) -> None:
    robot = load(folder, GRIPPER.replace("<equality>", '<equality><joint joint1="second" polycoef="0.4 0 0 0 0"/>'))
    assert "second" not in robot.joint_names
    assert robot.locked_joints["second"] == 0.4


def test_a_loop_is_named_and_its_joints_held(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = GRIPPER.replace("<equality>", '<equality><connect name="closed" body1="left" body2="right" anchor="0 0 0"/>')
    assert load(folder, text).nq == 3
    assert (
        "closed loops are not modeled, their joints are held or, if planned for, move independently: closed"
        in caplog.text
    )


@pytest.mark.parametrize(("body", "is_loop"), [("two", True), ("base", False)])
def test_a_loop_through_the_world_is_named(
    folder: Path, caplog: pytest.LogCaptureFixture, body: str, is_loop: bool
) -> None:
    load(folder, GRIPPER.replace("<equality>", f'<equality><weld name="held" body1="{body}"/>'))
    assert ("move independently: held" in caplog.text) == is_loop


def test_a_planned_joint_that_depends_on_another_by_a_polynomial_is_said_to_move(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = GRIPPER.replace("<equality>", '<equality><joint joint1="second" joint2="first" polycoef="0 1 0.5 0 0"/>')
    assert "second" in load(folder, text).joint_names
    assert "not modeled; it is held or, if planned for, moves independently" in caplog.text


def test_tendons_that_couple_joints_of_a_robot_are_named(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    tendons = """<tendon>
      <fixed name="equal"><joint joint="first" coef="1"/><joint joint="second" coef="-1"/></fixed>
      <fixed name="limited" range="0 1"><joint joint="third" coef="1"/><joint joint="second" coef="2"/></fixed>
      <spatial name="rope" range="0 1"><site site="grasp_site"/><site site="hook"/></spatial>
      <spatial name="slack"><site site="grasp_site"/><site site="hook"/></spatial>
      <fixed name="off"><joint joint="first" coef="1"/></fixed>"""
    text = GRIPPER.replace("<tendon>", tendons).replace(
        "<equality>", '<equality><tendon tendon1="equal"/><tendon tendon1="off" active="false"/>'
    )
    load(folder, text.replace("<worldbody>", '<worldbody><site name="hook"/>'))
    assert "their joints move independently: equal, limited, rope\n" in caplog.text
    caplog.clear()
    load(folder, GRIPPER)
    assert "move independently" not in caplog.text


def test_a_joint_that_follows_a_door_is_held(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = CASES["a passive door"].replace(
        "</worldbody>", '</worldbody><equality><joint joint1="k" joint2="hinge"/></equality>'
    )
    text = text.replace(
        '<geom size="0.1"/></body>',
        '<geom size="0.1"/><body name="b"><joint name="k"/><geom size="0.1"/></body></body>',
    )
    assert dict(load(folder, text).locked_joints) == {"k": 0.0}
    assert "joint 'k' follows 'hinge', which no robot has; it is held" in caplog.text


def test_a_slide_without_a_range_stands_still(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = """<mujoco><worldbody><body name="cart"><joint name="rail" type="slide"/><geom size="0.1"/>
  <body name="arm" pos="0 0 1">
    <joint name="j"/><geom size="0.1"/></body></body></worldbody></mujoco>"""
    robot = load(folder, text)
    assert robot.joint_names == ("j",)
    assert robot.joint("rail").kind == "fixed"
    assert "slide joint 'rail' has no range" in caplog.text


@pytest.mark.parametrize("name", ["jaw", "Gripper", "left_finger_joint"])
def test_a_single_jaw_at_the_end_is_not_part_of_the_arm(folder: Path, name: str) -> None:
    text = f"""<mujoco><worldbody><body name="a"><joint name="j"/><geom size="0.1"/>
    <body name="b" pos="0 0 0.3"><joint name="k"/><geom size="0.1"/>
    <body name="c" pos="0 0 0.3"><joint name="{name}" range="10 90"/><geom size="0.1"/></body>
  </body></body>
    </worldbody></mujoco>"""
    robot = load(folder, text)
    assert robot.joint_names == ("j", "k")
    assert robot.tool == "b"
    assert robot.locked_joints[name] == pytest.approx(math.radians(10))


def test_fingers_branch_off_the_hand(folder: Path) -> None:
    finger = '<body name="f{0}"><joint name="{0}" range="-20 20"/><geom size="0.01"/></body>'
    text = f"""<mujoco><worldbody><body name="a"><joint name="j"/><geom size="0.1"/>
    <body name="b" pos="0 0 0.3"><joint name="k"/><geom size="0.1"/>
    <body name="palm" pos="0 0 0.1">{finger.format("p")}{finger.format("q")}</body></body></body>
  </worldbody></mujoco>"""
    robot = load(folder, text)
    assert robot.joint_names == ("j", "k")
    assert robot.tool == "palm"


def test_an_srdf_says_more(folder: Path) -> None:
    (folder / "more.srdf").write_text(
        '<robot name="gripper arm"><group name="two"><chain base_link="base" tip_link="two"/></group>'
        '<disable_collisions link1="one" link2="hand"/></robot>'
    )
    robot = load(folder, GRIPPER, srdf=folder / "more.srdf")
    assert robot.joint_names == ("first", "second")
    assert {frozenset(("one", "hand")), frozenset(("base", "two"))} <= robot.disabled_collisions


def test_a_visual_mesh_that_is_missing_is_a_warning(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    (folder / "assets" / "part.stl").unlink()
    assert load(folder, GRIPPER).link("base").visuals == ()
    assert "part.stl' is not there" in caplog.text
    assert "links are shown without it" in caplog.text
    (folder / "assets" / "part.obj").unlink()
    with pytest.raises(rp.FormatError, match=r"robot\.xml:18: mesh 'part\.obj' is not there; tried .*assets.part\.obj"):
        load(folder, GRIPPER)


def test_meshes_are_looked_for_in_other_folders_too(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("meshes")
    for file in (folder / "assets").iterdir():
        file.rename(elsewhere / file.name)
    assert load(folder, GRIPPER, package_dirs=[elsewhere]).link("two").collisions


def test_pieces_instead_of_a_hull(folder: Path) -> None:
    (geometry,) = load(folder, GRIPPER, convex="pieces").link("two").collisions
    assert geometry.shape.convex


# ---- includes -------------------------------------------------------------------------------


def test_included_files_are_read_where_mujoco_finds_them(folder: Path) -> None:
    (folder / "parts").mkdir()
    arm = '<mujocoinclude><body name="{}"><joint name="j"/><geom size="0.1"/></body></mujocoinclude>'
    (folder / "parts" / "worldbody.xml").write_text('<mujoco><worldbody><include file="arm.xml"/></worldbody></mujoco>')
    (folder / "parts" / "arm.xml").write_text(arm.format("beside"))
    text = '<mujoco model="m"><include file="parts/worldbody.xml"/></mujoco>'
    for name in ("beside", "main"):
        robot = load(folder, text)
        assert robot.link_names[1] == name
        assert reference(text, folder).body(1).name == name
        (folder / "arm.xml").write_text(arm.format("main"))


def test_a_file_is_included_once_and_from_inside(folder: Path) -> None:
    with pytest.raises(rp.FormatError, match=r"robot\.xml:1: includes 'robot\.xml' a second time"):
        load(folder, '<mujoco><include file="robot.xml"/></mujoco>')
    (folder / "a.xml").write_text('<mujoco><include file="a.xml"/></mujoco>')
    with pytest.raises(rp.FormatError, match=r"a\.xml:1: includes 'a\.xml' a second time"):
        load(folder, '<mujoco><include file="a.xml"/></mujoco>')
    os.mkfifo(folder / "pipe.xml")
    for name, why in {
        "/etc/passwd": "is outside the robot's folders",
        "pipe.xml": "is not a regular file",
        "none.xml": "is not there",
        "/dev/zero": "is not a regular file",
        "y" * 300: "longer than 255 bytes",
    }.items():
        with pytest.raises(rp.FormatError, match=f"robot.xml:1: .*{why}"):
            load(folder, f'<mujoco><include file="{name}"/></mujoco>')


def test_a_part_that_others_include_is_refused_as_such(folder: Path) -> None:
    with pytest.raises(rp.FormatError, match="a part that other MJCF files include"):
        load(folder, "<mujocoinclude/>")


# ---- refusals -------------------------------------------------------------------------------


def arm(inside: str = "", after: str = "", joint: str = '<joint name="j"/>') -> str:
    body = f'<body name="a">{joint}\n<geom size="0.1"/>\n{inside}\n</body>'
    return f"<mujoco>\n<worldbody>\n{body}\n</worldbody>\n{after}\n</mujoco>"


BAD = {
    "no robot": (
        '<mujoco><worldbody><geom size="1"/></worldbody></mujoco>',
        r"1: has no body that a hinge or slide joint",
    ),
    "nothing": ("<mujoco/>", r"has no body that a hinge or slide joint moves"),
    "a mass that no body has": (
        arm('<body name="b"><joint name="k"/><inertial mass="1e300" pos="0 0 0" diaginertia="1 1 1"/></body>'),
        r"link 'b' has mass 1e\+300 and an inertia up to 1, which no body has",
    ),
    "a ball joint": (
        arm('<body name="b"><joint name="k" type="ball"/><geom size="1"/></body>'),
        r"5: joint 'k' is a ball joint",
    ),
    "not a number": (arm(joint='<joint name="j" axis="nan 0 1"/>'), r"3: <joint> axis='nan 0 1', expected finite"),
    "infinite": (arm('<site pos="0 -inf 0"/>'), r"5: <site> pos='0 -inf 0', expected finite"),
    "too large": (arm('<site name="s" pos="0 1e400 0"/>'), r"5: MuJoCo does not take it: number is too large"),
    "far away": (
        arm('<body name="b" pos="0 1e300 0"><joint/><geom size="0.1"/></body>'),
        r"body_pos holds 1e\+300, expected at most 10000",
    ),
    "an inverted range": (
        arm(joint='<joint name="j" range="20 10"/>'),
        r"3: joint 'j' has range 20 to 10, expected lower < upper",
    ),
    "an empty range": (arm(joint='<joint name="j" range="10 10"/>'), r"3: joint 'j' has range 10 to 10"),
    "no axis": (arm(joint='<joint name="j" axis="0 0 0"/>'), r"3: MuJoCo does not take it: axis too small"),
    "a misspelt attribute": (
        arm(joint='<joint nam="j"/>'),
        r"3: MuJoCo does not take it: .*unrecognized attribute: 'nam'",
    ),
    "a misspelt element": (arm("<geoms/>"), r"5: MuJoCo does not take it: .*unrecognized element"),
    "a misspelt section": (arm(after="<worldbodies/>"), r"8: MuJoCo does not take it: .*unrecognized element"),
    "a name twice": (arm('<body name="a"><geom size="1"/></body>'), r"5: MuJoCo does not take it: .*repeated name 'a'"),
    "an unknown mesh": (arm('<geom type="mesh" mesh="m"/>'), r"5: MuJoCo does not take it: mesh 'm' not found"),
    "an unknown class": (arm('<geom class="c" size="1"/>'), r"5: MuJoCo does not take it: unknown default class"),
    "an unknown body": (
        arm(after='<contact><exclude body1="a" body2="z"/></contact>'),
        r"8: MuJoCo does not take it: body 'z'",
    ),
    "no mass": (arm('<body name="b"><joint/></body>'), r"5: MuJoCo does not take it: mass and inertia"),
    "an impossible inertia": (
        arm('<inertial pos="0 0 0" mass="1" diaginertia="1 1 9"/>'),
        r"MuJoCo does not take it: .*A \+ B >= C",
    ),
    "a shape of no size": (arm('<geom size="0"/>'), r"5: MuJoCo does not take it: size 0 must be positive"),
    "a keyframe too short": (
        arm(after='<keyframe><key qpos="1 2"/></keyframe>'),
        r"MuJoCo does not take it: .*expected 1, got 2",
    ),
    "another model": (
        arm(after='<asset><model name="m" file="m.xml"/></asset>'),
        r"8: <model> takes a part of another model",
    ),
    "an attached model": (arm('<attach model="m" body="b" prefix="p"/>'), r"5: <attach> takes a part of another model"),
    "a signed distance field": (arm('<geom type="sdf" mesh="m"/>'), r"5: "),
    "a mesh of another kind": (
        arm('<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="m.dae"/></asset>'),
        r"8: mesh 'm\.dae' has an unknown suffix",
    ),
    "a mesh outside": (
        arm('<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="/etc/passwd.stl"/></asset>'),
        r"8: mesh '/etc/passwd\.stl' is not there",
    ),
    "too many replicas": (
        arm('<replicate count="100000"><geom size="1"/></replicate>'),
        r"5: <replicate> count='100000'",
    ),
    "replicas of replicas": (
        arm('<replicate count="1000"><replicate count="1000"><geom size="1"/></replicate></replicate>'),
        r"5: the model has more than 20000",
    ),
    "replicas without a count": (
        arm('<replicate><geom size="1"/></replicate>'),
        r"5: <replicate> has no attribute 'count'",
    ),
    "a bomb": ('<!DOCTYPE m [<!ENTITY a "b">]><mujoco/>', r"DOCTYPE"),
    "unclosed": ("<mujoco>", r"not well-formed"),
    "nested too deep": (arm("<frame>" * 200 + "</frame>" * 200), r"nested deeper than 100"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_with_its_line(case: str, folder: Path) -> None:
    text, why = BAD[case]
    with pytest.raises(rp.InputError, match=why):
        load(folder, text)


def test_a_mesh_that_is_no_file_is_refused(folder: Path) -> None:
    os.mkfifo(folder / "pipe.stl")
    (folder / "link.stl").symlink_to("/etc/passwd")
    text = arm('<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="{}"/></asset>')
    for name, why in {
        "pipe.stl": "not a regular file",
        "link.stl": "outside",
        "x" * 300 + ".stl": "longer than 255",
    }.items():
        with pytest.raises(rp.FormatError, match=rf"robot\.xml:8: .*{why}"):
            load(folder, text.format(name))


def test_very_many_elements_are_refused(folder: Path) -> None:
    with pytest.raises(rp.FormatError, match="more than 20000 elements"):
        load(folder, arm("<site/>" * 20_001))
    with pytest.raises(rp.FormatError, match="expected at most 1000"):
        load(folder, arm("".join(f'<site name="s{i}"/>' for i in range(15_000))))
    with pytest.raises(rp.FormatError, match="expected at most 1000"):
        load(folder, arm('<body><geom size="1"/></body>' * 5_000))
    (folder / "many.xml").write_text(arm().replace("</worldbody>", '<geom size="1"/>' * 3_000 + "</worldbody>"))
    with pytest.raises(rp.FormatError, match="3000 things around the robot, expected at most 1000"):
        rp.load_scene(folder / "many.xml")


def test_options_of_other_formats_are_refused(folder: Path) -> None:
    with pytest.raises(rp.InputError, match="xacro_arguments is for xacro files"):
        load(folder, GRIPPER, xacro_arguments={"a": "1"})
    with pytest.raises(rp.UnknownNameError, match="convex"):
        load(folder, GRIPPER, convex="hul")
    with pytest.raises(rp.UnknownNameError, match="gripper"):
        load(folder, GRIPPER, groups=["gripper"])


def test_other_robots_do_not_import_mujoco() -> None:
    code = "import sys, rr1plan as rp; rp.load_robot('planar2r'); sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0


def test_nothing_is_written_beside_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    monkeypatch.chdir(folder)
    load(folder, CASES["masses scaled and balanced"].replace("<compiler", '<compiler settotalmass="3"'))
    assert sorted(file.name for file in folder.iterdir()) == ["assets", "robot.xml"]
    assert "WARNING" not in capfd.readouterr().err


# ---- changed files --------------------------------------------------------------------------

_WORDS = [
    "",
    "0",
    "-1",
    "1e300",
    "1e-300",
    "nan",
    "x",
    "1 2",
    "1 2 3",
    "0 0 0",
    "0 0 0 0",
    "true",
    "mesh",
    "ball",
    "free",
    "a" * 300,
    "-5 5",
    "left",
    "99999999999",
]


def mutated(text: str, rng: random.Random) -> str:
    """The text with one to three lines or attributes removed, doubled, moved or changed."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        lines = text.splitlines()
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        action = rng.choice(("drop", "double", "swap", "value", "value", "value", "value", "tag"))
        if action == "drop":
            del lines[at]
        elif action == "double":
            lines.insert(other, lines[at])
        elif action == "swap":
            lines[at], lines[other] = lines[other], lines[at]
        elif action == "value" and lines[at].count('"') >= 2:
            parts = lines[at].split('"')
            k = rng.randrange(1, len(parts), 2)
            parts[k] = rng.choice((*_WORDS, parts[rng.randrange(1, len(parts), 2)]))
            lines[at] = '"'.join(parts)
        elif action == "tag":
            lines[at] = lines[at].replace(
                *rng.choice((("body", "frame"), ("joint", "geom"), ("geom", "site"), ("site", "body")))
            )
        text = "\n".join(lines)
    return text


@pytest.mark.parametrize("seed", range(4))
def test_a_changed_file_is_refused_or_is_a_robot(folder: Path, seed: int) -> None:
    rng = random.Random(seed)
    texts = [text.replace("><", ">\n<") for text in CASES.values()]
    loaded = 0
    for _ in range(60):
        file = folder / "robot.xml"
        file.write_text(mutated(rng.choice(texts), rng))
        try:
            content = read_mjcf(file)
        except rp.InputError:
            continue
        loaded += 1
        for joint in content.tree.joints:
            assert np.isfinite(joint.origin).all()
            assert np.linalg.norm(joint.axis) == pytest.approx(1.0)
            assert joint.lower <= joint.upper
    assert 0 < loaded < 60
