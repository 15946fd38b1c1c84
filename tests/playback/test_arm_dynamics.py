"""Steps of free arms by the kernels: those of MuJoCo, to the rounding; the same bytes whoever is stepped together."""

from __future__ import annotations

import ctypes

import mujoco
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.kernels import planner_kernels
from rr1plan.playback.simulation.arm_dynamics import ArmDynamics
from rr1plan.playback.simulation.mujoco_model import MujocoScene, build_mujoco
from rr1plan.playback.simulation.stepped_models import SteppedModel
from rr1plan.robot import Inertial, Joint, Link, Robot
from rr1plan.robot.joint_limits import Limits
from rr1plan.transforms import pose


def branched() -> Robot:
    """An arm that turns and slides, with a fixed weight and two fingers, and with one servo that has no limit."""
    rng = np.random.default_rng(1)

    def inertial(mass: float) -> Inertial:
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        return Inertial(mass, rng.normal(size=3) * 0.1, turned @ np.diag([0.02, 0.03, 0.04]) @ turned.T * mass)

    names = ("base", "turret", "carriage", "weight", "hand", "left", "right")
    links = tuple(Link(name, inertial(0.5 + k)) for k, name in enumerate(names))

    def joint(name: str, kind: str, parent: str, child: str, axis: tuple[float, float, float], effort: float) -> Joint:
        origin = pose(rng.normal(size=3) * 0.2, rpy=rng.normal(size=3))
        along = np.array(axis) / np.linalg.norm(axis)
        return Joint(name, kind, parent, child, origin, along, -2.0, 2.0, 3.0, effort)

    joints = (
        joint("turn", "continuous", "base", "turret", (0.0, 0.0, 1.0), 200.0),
        joint("slide", "prismatic", "turret", "carriage", (1.0, 2.0, -1.0), np.inf),
        joint("weld", "fixed", "carriage", "weight", (0.0, 0.0, 1.0), np.inf),
        joint("roll", "revolute", "carriage", "hand", (0.0, -1.0, 0.5), 60.0),
        joint("left", "revolute", "hand", "left", (0.0, 0.0, -1.0), 30.0),
        joint("right", "prismatic", "hand", "right", (1.0, 0.0, 0.0), 40.0),
    )
    moving = tuple(j.name for j in joints if j.kind != "fixed")
    limits = Limits(np.full(5, -2.0), np.full(5, 2.0), *(np.ones(5) for _ in range(4)))
    return Robot("branched", links, joints, moving, limits, {"home": np.zeros(5)}, {}, frozenset(), "hand")


def mixed_scene(rr1: Robot) -> rp.Scene:
    """Arms of two kinds, askew, one of which holds something."""
    rng = np.random.default_rng(2)
    robots = [rr1, branched(), rr1, rr1, branched(), *[rr1] * 9]
    places = [pose([2.0 * i, 0.0, 0.0], rpy=rng.normal(size=3)) for i in range(len(robots))]
    scene = rp.Scene(arms={f"a{i}": rp.Arm(robot, places[i]) for i, robot in enumerate(robots)})
    return scene.with_obstacle("weight", rp.Box((0.1, 0.2, 0.3)), [4.3, 0.1, 1.0], mass=0.7).attach("weight", "a2")


def without_contacts(scene: rp.Scene) -> MujocoScene:
    """A model whose shapes do not touch."""
    world = build_mujoco(scene)
    world.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return world


class Motion:
    """Random states and set-points of all joints, beyond the efforts of some servos."""

    def __init__(self, world: MujocoScene, steps: int, seed: int) -> None:
        rng, n = np.random.default_rng(seed), len(world.joint_names)
        self.columns = np.arange(n)
        self.states = np.zeros((steps + 1, 3, n))
        self.states[0, :2] = rng.normal(size=(2, n))
        self.desired = rng.normal(size=(steps, 4, n)) * np.array([0.0, 0.1, 1.0, 0.5])[:, None]
        self.desired[:, 0] = self.states[0, 0] + 0.02 * rng.normal(size=n)

    def by_mujoco(self, world: MujocoScene) -> Array:
        """States by MuJoCo."""
        model, states = SteppedModel(world, self.columns), self.states.copy()
        model.place(states[0])
        for points, state in zip(self.desired, states[1:], strict=True):
            model.refresh()
            model.advance(points)
            model.observe(state)
        return states

    def by_kernels(self, world: MujocoScene, threads: int = 1, at_once: int | None = None) -> Array:
        """States by the kernels."""
        arms, states = ArmDynamics(world.model, self.columns, len(self.columns), threads), self.states.copy()
        at_once = len(self.desired) if at_once is None else at_once
        for first in range(0, len(self.desired), at_once):
            for worker in range(threads):
                points = self.desired[first : first + at_once]
                arms.take_steps(worker, points, states[first : first + at_once + 1])
        return states


def test_steps_are_those_of_mujoco(rr1: Robot) -> None:
    scene = mixed_scene(rr1)
    assert any(joint.effort == np.inf for joint in branched().joints if joint.kind != "fixed")
    limited = 0.0
    for seed in range(5):
        world = without_contacts(scene)
        motion = Motion(world, 200, seed)
        expected, found = motion.by_mujoco(world), motion.by_kernels(world)
        gaps = np.abs(found - expected).max(axis=(0, 2))
        largest = np.abs(expected).max(axis=(0, 2))
        assert largest[1] > 5.0
        assert (gaps <= 1e-10 * np.maximum(largest, 1.0)).all()
        limited += np.mean(np.abs(expected[1:, 2]) >= world.effort_limits)
    assert limited > 0.05


def test_gravity_may_have_any_direction(rr1: Robot) -> None:
    world = without_contacts(mixed_scene(rr1))
    world.model.opt.gravity[:] = 3.0, -4.0, 5.0
    motion = Motion(world, 50, 7)
    np.testing.assert_allclose(motion.by_kernels(world), motion.by_mujoco(world), rtol=1e-8, atol=1e-9)


def test_one_step_is_the_forward_dynamics_of_mujoco(rr1: Robot) -> None:
    # Without servos an arm falls as MuJoCo's forward dynamics have it.
    world = without_contacts(mixed_scene(rr1))
    model = world.model
    model.actuator_biasprm[:] = 0.0
    motion = Motion(world, 1, 3)
    motion.desired[:, 2] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = motion.states[0, :2]
    mujoco.mj_forward(model, data)
    efforts = np.clip(data.qfrc_bias + motion.desired[0, 3], *model.actuator_forcerange.T)
    unlimited = np.isinf(world.effort_limits)
    efforts[unlimited] = (data.qfrc_bias + motion.desired[0, 3])[unlimited]
    data.qfrc_applied[:] = efforts
    mujoco.mj_forward(model, data)
    found = motion.by_kernels(world)[1]
    accelerations = (found[1] - motion.states[0, 1]) / model.opt.timestep
    np.testing.assert_allclose(found[2], efforts, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(accelerations, data.qacc, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("threads", "at_once"), [(1, 1), (2, 7), (3, 40)])
def test_bytes_depend_neither_on_threads_nor_on_calls(rr1: Robot, threads: int, at_once: int) -> None:
    world = without_contacts(mixed_scene(rr1))
    motion = Motion(world, 40, 11)
    assert motion.by_kernels(world, threads, at_once).tobytes() == motion.by_kernels(world).tobytes()


def test_bytes_depend_neither_on_other_arms_nor_on_the_processor(rr1: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = mixed_scene(rr1)
    world, alone = build_mujoco(scene), build_mujoco(rp.Scene(arms={"a3": scene.arms["a3"]}))
    motion = Motion(world, 40, 12)
    together = motion.by_kernels(world)
    columns = [i for i, name in enumerate(world.joint_names) if name.startswith("a3/")]
    single = Motion(alone, 40, 0)
    single.states, single.desired = motion.states[..., columns].copy(), motion.desired[..., columns].copy()
    assert single.by_kernels(alone).tobytes() == together[..., columns].tobytes()
    library = planner_kernels.LIBRARY
    for variant in library.variants:
        other: ctypes.CDLL = library.load(library.variant_file(variant))
        monkeypatch.setattr("rr1plan.playback.simulation.arm_dynamics.load_library", lambda other=other: other)
        assert motion.by_kernels(world).tobytes() == together.tobytes()
