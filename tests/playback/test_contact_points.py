"""Contact points of a simulation: weights, friction, squeezing fingers; MuJoCo's own step as a reference."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

import rr1plan as rp
from rr1plan.transforms import pose

G = 9.81
FLOOR = rp.Scene().with_obstacle("floor", rp.HalfSpace())


def with_box(scene: rp.Scene, name: str, at: ArrayLike, friction: float = 1.0) -> rp.Scene:
    return scene.with_obstacle(name, rp.Box((0.1, 0.1, 0.1)), at, mass=1.0, friction=friction)


def force_on(sim: rp.Simulation, name: str) -> np.ndarray:
    return sum((point.force for point in sim.contact_points(name)), np.zeros(3))


def test_each_box_of_a_stack_carries_those_above_it() -> None:
    shifts = [(0.0, 0.0), (0.004, -0.003), (-0.002, 0.003), (0.003, 0.001), (-0.001, -0.004)]
    scene = FLOOR
    for k, shift in enumerate(shifts):
        scene = with_box(scene, f"box{k}", [*shift, 0.05 + 0.1 * k])
    sim = rp.Simulation(scene)
    sim.run(duration=1.5)
    below = ("floor", *sim.body_names)
    for k, name in enumerate(sim.body_names):
        assert np.abs(sim.body_velocity(name)).max() < 1e-4
        carried = [point for point in sim.contact_points(name) if point.pair[0] == below[k]]
        assert len(carried) == 4
        for point in carried:
            np.testing.assert_allclose(point.normal, [0, 0, 1], atol=1e-3)
            assert 0.0 <= point.depth < 1e-3
            assert point.position[2] == pytest.approx(0.1 * k, abs=1e-3)
            assert point.normal_force == pytest.approx(point.force[2], rel=1e-3)
            assert not point.torque.any()
        assert sum(point.normal_force for point in carried) == pytest.approx((5 - k) * G, rel=1e-4)
        np.testing.assert_allclose(force_on(sim, name), [0, 0, G], atol=1e-3)
    # Without a name, each contact once, in alphabetical order.
    pairs = {point.pair for point in sim.contact_points()}
    assert pairs == {("box0", "floor"), *((f"box{k}", f"box{k + 1}") for k in range(4))}
    first = next(point for point in sim.contact_points() if point.pair == ("box0", "floor"))
    assert first.normal[2] == pytest.approx(-1.0)
    assert first.force[2] < 0.0
    np.testing.assert_allclose(force_on(sim, "floor"), [0, 0, -5 * G], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_friction_holds_a_box_on_a_slope_or_slows_it_down(friction: float) -> None:
    angle = 0.35  # tan 0.365
    T = pose(rpy=[0.0, angle, 0.0])
    scene = rp.Scene().with_obstacle("slope", rp.Box((4.0, 1.0, 0.2)), T @ pose([0, 0, -0.1]))
    sim = rp.Simulation(with_box(scene, "box", T @ pose([0, 0, 0.05]), friction))
    sim.run(duration=0.2)
    forces: list[np.ndarray] = []
    sim.on_step(lambda sim: forces.append(force_on(sim, "box")))
    sim.run(duration=0.3)
    down, up, force = T[:3, 0], T[:3, 2], np.mean(forces, axis=0)  # a box that slides chatters
    normal = G * np.cos(angle)
    assert force @ up == pytest.approx(normal, rel=0.05)
    expected = min(G * np.sin(angle), friction * normal)
    assert force @ down == pytest.approx(-expected, rel=0.05)


def test_forces_are_those_of_the_next_step_and_reading_them_changes_nothing() -> None:
    scene = with_box(FLOOR, "a", pose([0.0, 0.0, 0.08], rpy=[0.3, 0.2, 0.1]))
    scene = with_box(scene, "b", [0.03, 0.02, 0.3])
    asked, other = rp.Simulation(scene), rp.Simulation(scene)
    for _ in range(200):
        points = asked.contact_points()
        before = [asked.body_velocity(name)[:3] for name in ("a", "b")]
        asked.step()
        other.step()
        for name, old in zip(("a", "b"), before, strict=True):
            sign = [(1.0 if p.pair[1] == name else -1.0) * p.force for p in points if name in p.pair]
            impulse = asked.body_velocity(name)[:3] - old  # the mass is 1 kg
            np.testing.assert_allclose(impulse / asked.dt, np.sum([[0, 0, -G], *sign], axis=0), atol=1e-5)
            np.testing.assert_array_equal(asked.body_coordinates(name), other.body_coordinates(name))
    assert asked.contact_points()


def test_names_are_elements_or_arms() -> None:
    robot = rp.load_robot("planar2r")
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, [5.0, 0.0, 0.0])
    wall = rp.Box((0.1, 0.1, 0.5))
    scene = scene.with_obstacle("wall", wall, [0.9, 0.12, 0.0]).with_obstacle("far", wall, [0.0, 3.0, 0.0])
    sim = rp.Simulation(scene)
    assert sim.contact_points() == sim.contact_points("left") == sim.contact_points("right") == ()
    sim.place(["left/joint1"], [0.0])
    arm = rp.ForwardPositionController(["left/joint1"])
    sim.activate(arm)
    arm.command([0.6])
    sim.run(duration=1.0)
    points = sim.contact_points("left")
    assert points
    assert {point.pair[0] for point in points} == {"wall"}
    link = points[0].pair[1]
    assert scene.owner(link) == "left"
    assert len(sim.contact_points(link)) <= len(points)
    np.testing.assert_allclose(force_on(sim, "left"), -force_on(sim, "wall"))
    assert force_on(sim, "wall")[1] > 0.1  # pushed away from the arm
    assert sim.contact_points("far") == sim.contact_points("right") == ()
    with pytest.raises(rp.UnknownNameError, match="Did you mean 'wall'"):
        sim.contact_points("wal")
    with pytest.raises(rp.UnknownNameError, match="left/link"):
        sim.contact_points("left/link9")
    with pytest.raises(ValueError, match="read-only"):
        points[0].force[0] = 1.0


def test_forces_follow_options_of_the_solver_that_change() -> None:
    sim = rp.Simulation(with_box(FLOOR, "box", [0.0, 0.0, 0.05]))
    sim.run(duration=0.2)
    changes = [("solver", 0), ("jacobian", 1), ("cone", 0), ("solver", 1), ("noslip_iterations", 3), ("solver", 2)]
    for option, value in changes:
        setattr(sim.model.opt, option, value)
        assert force_on(sim, "box")[2] == pytest.approx(G, rel=0.05)
        sim.step()


def test_forces_agree_with_mujoco_s_own_forward_dynamics() -> None:
    scene = FLOOR.with_obstacle("ball", rp.Sphere(0.1), [0.0, 0.0, 0.0995], mass=2.0)
    sim = rp.Simulation(scene)
    reference = mujoco.MjData(sim.model)
    reference.qpos[:] = sim.data.qpos
    mujoco.mj_forward(sim.model, reference)
    wrench = np.zeros(6)
    mujoco.mj_contactForce(sim.model, reference, 0, wrench)
    (point,) = sim.contact_points("ball")
    assert point.normal_force == pytest.approx(wrench[0])
    assert point.normal_force > 1.0
    assert point.depth == pytest.approx(5e-4)
    np.testing.assert_allclose(point.position, [0, 0, -2.5e-4], atol=1e-9)
