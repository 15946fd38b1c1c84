"""MuJoCo replay: the model agrees with Pinocchio, and the report is correct."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from concave_meshes import angle_block, half_shell, soup

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.model.scene_model import SceneModel
from rr1plan.playback.cloud_boxes import cloud_boxes
from rr1plan.playback.simulation import mujoco_geoms
from rr1plan.playback.simulation.joint_map import JointTargets
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.scene.model_library import load_robot, load_scene, robot_names
from rr1plan.transforms import pose


def quintic(scene: rp.Scene, start: np.ndarray, goal: np.ndarray, seconds: float) -> rp.Trajectory:
    """A smooth rest-to-rest move of all arms, straight in joint space."""
    powers = np.array([0, 0, 0, 10 / seconds**3, -15 / seconds**4, 6 / seconds**5])
    coefficients = powers[:, None] * (goal - start)[None, :]
    coefficients[0] = start
    return rp.Trajectory(scene.joint_names(), np.array([0.0, seconds]), coefficients[None])


def random_q(scene: rp.Scene, rng: np.random.Generator) -> np.ndarray:
    limits = scene.limits()
    low, high = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    return rng.uniform(low, high)


@pytest.mark.parametrize("name", robot_names())
def test_mujoco_and_pinocchio_agree_on_every_frame_mass_matrix_and_gravity(name: str) -> None:
    scene = rp.Scene(arms={"arm": rp.Arm(load_robot(name), pose([0.1, -0.2, 0.3], rpy=[0.1, -0.2, 0.7]))})
    world = build_mujoco(scene)
    built = SceneModel(scene)
    order = [world.joint_names.index(joint) for joint in built.model.names[1:]]
    rng = np.random.default_rng(0)
    targets = JointTargets(rp.Trajectory.rest(scene.joint_names(), scene.configuration()), scene)
    assert targets.names == world.joint_names
    for _ in range(20):
        q = random_q(scene, rng)
        full = built.full(q)
        data, reference = mujoco.MjData(world.model), built.model.createData()
        data.qpos[order] = full
        mujoco.mj_forward(world.model, data)
        pin.framesForwardKinematics(built.model, reference, full)
        for link in scene.arms["arm"].robot.link_names:
            T = reference.oMf[built.frame_id(f"arm/{link}")].homogeneous
            body = data.body(f"arm/{link}")
            np.testing.assert_allclose(body.xpos, T[:3, 3], atol=1e-12)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), T[:3, :3], atol=1e-12)
        M = np.zeros((world.model.nv, world.model.nv))
        mujoco.mj_fullM(world.model, data, M)
        M = M[np.ix_(order, order)]
        expected = pin.crba(built.model, reference, full)
        expected = np.triu(expected) + np.triu(expected, 1).T
        np.testing.assert_allclose(M, expected, atol=1e-7)
        gravity = pin.computeGeneralizedGravity(built.model, reference, full)
        np.testing.assert_allclose(data.qfrc_bias[order], gravity, atol=1e-7)


def test_contacts_are_exactly_the_forbidden_pairs_that_coal_finds(rr1_table: rp.Scene) -> None:
    """A third opinion on thousands of contacts; only grazing ones may differ."""
    checker = CollisionChecker(rr1_table)
    rng = np.random.default_rng(1)
    qs = np.array([random_q(rr1_table, rng) for _ in range(300)])
    colliding = 0
    for q in qs:
        contacts = checker.contacts(q)
        expected = {tuple(sorted((c.a, c.b))) for c in contacts if c.depth > 1e-4}
        possible = {tuple(sorted((c.a, c.b))) for c in contacts}
        replay = rp.simulate(rp.Trajectory.rest(rr1_table.joint_names(), q), rr1_table, mode="kinematic")
        found = {c.pair for c in replay.contacts if c.depth > 1e-4}
        near = {tuple(sorted(p)) for p, d in zip(checker.pairs, checker.distances(q), strict=True) if d < 1e-4}
        assert expected <= {c.pair for c in replay.contacts} | (possible - expected)
        assert found <= possible | near
        colliding += bool(found)
    assert 20 < colliding < 290


def test_tracking_of_a_gentle_move_is_within_a_milliradian(rr1_table: rp.Scene) -> None:
    start = rr1_table.configuration()
    goal = start + np.array([0.3, 0.05, -0.2, 0.2, 0.1, 0.3])
    replay = rp.simulate(quintic(rr1_table, start, goal, 2.0), rr1_table)
    assert replay.free
    assert replay.worst_error < 1e-3
    assert 0.0 < replay.peak_effort.max() < 1.0
    assert replay.steps == 1000
    np.testing.assert_allclose(replay.record.actual[-1], goal, atol=1e-3)
    assert "tracking error" in str(replay)
    assert replay.to_dict()["joints"].keys() == set(rr1_table.joint_names())


def test_a_motor_that_is_too_weak_is_told_with_what_to_try(rr1: rp.Robot) -> None:
    joints = tuple(replace(j, effort=0.02) if j.kind == "revolute" else j for j in rr1.joints)
    weak = replace(rr1, joints=joints, limits=replace(rr1.limits, effort=np.full(rr1.nq, 0.02)))
    for robot, told in ((rr1, False), (weak, True)):
        scene = rp.Scene().with_arm("arm", robot)
        q = scene.configuration()
        replay = rp.simulate(quintic(scene, q, q + 0.2, 1.0), scene)
        assert (replay.worst_error > 0.01) == told
        assert bool(replay) == replay.tracked == (not told)
        assert ("option torque_limits" in str(replay)) == told


def test_a_replay_far_off_its_motion_is_no_success(rr1_table: rp.Scene) -> None:
    start = rr1_table.configuration()
    motion = quintic(rr1_table, start, start + np.array([0.3, 0.05, -0.2, 0.2, 0.1, 0.3]), 2.0)
    fine, coarse = rp.simulate(motion, rr1_table), rp.simulate(motion, rr1_table, dt=0.5)
    kinematic = rp.simulate(motion, rr1_table, mode="kinematic", dt=0.5)
    for replay in (fine, kinematic):
        assert replay
        assert replay.to_dict()["tracked"]
        assert "not followed" not in str(replay)
    assert not coarse
    assert not coarse.tracked
    assert not coarse.to_dict()["tracked"]
    count = int((coarse.max_error > 0.01).sum())
    assert f"the motion was not followed: {count} joint" in str(coarse)


@pytest.mark.parametrize("dt", [0.008, 0.01, 0.02])
def test_servos_do_not_oscillate_in_long_steps(dt: float, rr1_table: rp.Scene) -> None:
    sim = rp.Simulation(rr1_table, dt)
    names = rr1_table.joint_names()
    drive = rp.ManualController(names, speed=1.0)
    sim.activate(drive)
    drive.command(rr1_table.configuration() + 0.3)
    sim.run(duration=3.0)
    np.testing.assert_allclose(sim.configuration(), rr1_table.configuration() + 0.3, atol=1e-6)
    assert sim.stiffness == 0.8 / dt
    assert rp.Simulation(rr1_table).stiffness == 160.0
    assert rp.Simulation(rr1_table, dt, stiffness=160.0).stiffness == 160.0


def test_servos_that_may_oscillate_are_a_remark(rr1_table: rp.Scene) -> None:
    rest = rp.Trajectory.rest(rr1_table.joint_names(), rr1_table.configuration(), duration=0.01)
    assert rp.simulate(rest, rr1_table, stiffness=400.0).remarks == ()
    (remark,) = rp.simulate(rest, rr1_table, stiffness=1e4).remarks
    assert "a stiffness above 400 rad/s may oscillate in steps of 2 ms" in remark


def test_an_arm_that_is_driven_into_a_wall_reports_the_contact_with_time_and_pair(rr1: rp.Robot) -> None:
    scene = rp.Scene(arms={"arm": rp.Arm(rr1)})
    tool = scene.link_poses()[f"arm/{rr1.tool}"][:3, 3]
    q = scene.configuration()
    goal = q + np.array([0.8, 0, 0, 0, 0, 0])
    end = scene.link_poses({"arm": goal})[f"arm/{rr1.tool}"][:3, 3]
    scene = scene.with_obstacle("wall", rp.Sphere(0.04), 0.5 * (tool + end))
    replay = rp.simulate(quintic(scene, q, goal, 1.0), scene)
    assert not replay.free
    contact = replay.contacts[0]
    assert "wall" in contact.pair
    assert 0.1 < contact.first < 0.9
    assert contact.depth > 0.0
    assert replay.worst_error > 1e-3, "the wall is in the way, the arm cannot track"
    kinematic = rp.simulate(quintic(scene, q, goal, 1.0), scene, mode="kinematic")
    assert {"wall"} <= {name for c in kinematic.contacts for name in c.pair}
    assert kinematic.worst_error == 0.0


def test_a_resting_arm_is_held_and_a_second_run_is_identical(rr1: rp.Robot) -> None:
    scene = rp.Scene(arms={"left": rp.Arm(rr1, pose([0, 1, 0])), "right": rp.Arm(rr1)})
    q = scene.arms["left"].q
    move = quintic(rp.Scene(arms={"left": scene.arms["left"]}), q, q + 0.1, 1.0)
    first, second = rp.simulate(move, scene), rp.simulate(move, scene)
    assert first.joint_names == move.joint_names
    assert np.array_equal(first.record.actual, second.record.actual)
    assert first.free


def test_attached_objects_and_every_shape_reach_the_simulator(rr1: rp.Robot) -> None:
    cube = np.array([[x, y, z] for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    scene = rp.Scene(arms={"arm": rp.Arm(rr1)})
    tool = scene.link_poses()[f"arm/{rr1.tool}"]
    shapes = {
        "box": rp.Box((0.1, 0.1, 0.1)),
        "ball": rp.Sphere(0.05),
        "can": rp.Cylinder(0.05, 0.1),
        "pill": rp.Capsule(0.05, 0.1),
        "mesh": rp.Mesh(cube, faces, convex=True),
        "cloud": rp.PointCloud(np.zeros((1, 3)), 0.1),
        "ground": rp.HalfSpace((0, 0, 1), 0.0),
    }
    for name, shape in shapes.items():
        touching = scene.with_obstacle(name, shape, tool[:3, 3])
        replay = rp.simulate(rp.Trajectory.rest(scene.joint_names(), scene.configuration()), touching, mode="kinematic")
        assert any(name in c.pair for c in replay.contacts), name
        away = scene.with_obstacle(name, shape, [0.0, 0.0, -1.0])
        replay = rp.simulate(rp.Trajectory.rest(scene.joint_names(), scene.configuration()), away, mode="kinematic")
        assert not any(name in c.pair for c in replay.contacts), name
    held = scene.with_obstacle("stick", rp.Box((0.02, 0.02, 0.3)), tool[:3, 3]).attach("stick", touch=rr1.link_names)
    held = held.with_obstacle("post", rp.Sphere(0.02), tool[:3, 3] + [0, 0, -0.14])
    replay = rp.simulate(rp.Trajectory.rest(held.joint_names(), held.configuration()), held, mode="kinematic")
    assert ("post", "stick") in {c.pair for c in replay.contacts}


def test_bad_arguments_are_named(rr1_table: rp.Scene) -> None:
    rest = rp.Trajectory.rest(rr1_table.joint_names(), rr1_table.configuration())
    with pytest.raises(UnknownNameError, match="replay mode 'dynamical'"):
        rp.simulate(rest, rr1_table, mode="dynamical")
    with pytest.raises(InputError, match="dt is 0"):
        rp.simulate(rest, rr1_table, dt=0.0)
    with pytest.raises(InputError, match="hold is -1"):
        rp.simulate(rest, rr1_table, hold=-1.0)
    for mode in ("dynamic", "kinematic"):
        with pytest.raises(InputError, match="stiffness is -3"):
            rp.simulate(rest, rr1_table, mode=mode, stiffness=-3.0)
    with pytest.raises(UnknownNameError, match="joint 'arm/ghost'"):
        rp.simulate(rp.Trajectory.rest(("arm/ghost",), [0.0]), rr1_table)
    first = rr1_table.joint_names()[:2]
    with pytest.raises(InputError, match="has no column for"):
        rp.simulate(rp.Trajectory.rest(first, [0.0, 0.0]), rr1_table)


@pytest.fixture
def too_fast(rr1_table: rp.Scene) -> rp.Trajectory:
    """A motion whose set-points exceed the range of MuJoCo."""
    q = rr1_table.configuration()
    return quintic(rr1_table, q, q + 1e12, 1.0)


def test_an_unstable_simulation_is_an_error_and_leaves_no_file(
    rr1_table: rp.Scene, too_fast: rp.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(rp.BackendError, match=r"unstable at 0\.\d+ s \(.*CTRL.*\); try a smaller time step or"):
        rp.simulate(too_fast, rr1_table)
    assert list(tmp_path.iterdir()) == []
    assert mujoco.get_mju_user_warning() is None


def test_a_handler_of_mujoco_warnings_that_is_installed_stays(
    rr1_table: rp.Scene, too_fast: rp.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        with pytest.raises(rp.BackendError, match="unstable"):
            rp.simulate(too_fast, rr1_table)
        assert mujoco.get_mju_user_warning() is not None
    finally:
        mujoco.set_mju_user_warning(None)
    assert "CTRL" in warned[0]


def test_joints_that_mimic_others_are_placed_with_them_only(rr1: rp.Robot) -> None:
    sim = rp.Simulation(rp.Scene().with_arm("arm", rr1))
    with pytest.raises(rp.InputError, match="'arm/opposite_finger_joint' mimics 'arm/finger_joint'; place that one"):
        sim.place(["arm/opposite_finger_joint"], [0.5])
    sim.place(["arm/finger_joint"], [0.5])
    opened = sim.positions
    assert opened[-2:].tolist() == [0.5, 0.5]
    sim.reset()
    sim.place(sim.joint_names, opened)
    np.testing.assert_array_equal(sim.positions, opened)


def test_progress_tells_fractions(rr1_table: rp.Scene) -> None:
    told: list[float] = []
    rest = rp.Trajectory.rest(rr1_table.joint_names(), rr1_table.configuration(), duration=20.0)
    rp.simulate(rest, rr1_table, progress=lambda progress: told.append(progress.fraction))
    with pytest.raises(rp.CancelledError, match="'simulate'"):
        rp.simulate(rest, rr1_table, progress=lambda _: False)
    assert all(0.0 <= fraction <= 1.0 for fraction in told)
    assert told == sorted(told)


@pytest.mark.parametrize("scene_name", ["rr1_twelve"])
def test_twelve_arms_are_replayed_together(scene_name: str) -> None:
    scene = load_scene(scene_name)
    rest = rp.Trajectory.rest(scene.joint_names(), scene.configuration(), duration=0.2)
    replay = rp.simulate(rest, scene)
    assert replay.free
    assert replay.worst_error < 1e-4


@pytest.mark.parametrize("seed", range(4))
def test_the_boxes_of_a_cloud_are_its_cells_each_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.integers(-4, 4, (int(rng.integers(1, 400)), 3))
    cloud = rp.PointCloud((cells + rng.uniform(0.05, 0.95, cells.shape)) * 0.1, 0.1)
    covered = []
    for center, half in zip(*cloud_boxes(cloud), strict=True):
        lower, upper = np.rint((center - half) / 0.1).astype(int), np.rint((center + half) / 0.1).astype(int)
        covered += [tuple(c) for c in np.argwhere(np.ones(upper - lower)) + lower]
    assert sorted(covered) == sorted({tuple(c) for c in cells.tolist()})


def test_a_full_cloud_is_a_single_box() -> None:
    centers, halves = cloud_boxes(rp.PointCloud((np.argwhere(np.ones((6, 7, 8))) + 0.5) * 0.1, 0.1))
    assert np.allclose(centers, [[0.3, 0.35, 0.4]])
    assert np.allclose(halves, [[0.3, 0.35, 0.4]])


def test_a_cloud_of_too_many_boxes_is_refused(rr1_table: rp.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_geoms, "_MOST_BOXES", 2)
    scene = rr1_table.with_obstacle("cloud", rp.PointCloud(np.diag([1.0, 2.0, 3.0]), 0.1))
    with pytest.raises(InputError, match="takes 3 boxes"):
        build_mujoco(scene)


@pytest.mark.parametrize("mesh", [half_shell(0.15, 0.02, 18, 6), soup(12, 0.3), angle_block()], ids=repr)
def test_a_replay_touches_the_triangles_of_a_concave_mesh_and_not_its_hull(mesh: rp.Mesh, rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1).with_obstacle("mesh", mesh, pose([-0.4, 0.1, 0.5], rpy=[0.3, 0.2, 0.1]))
    world, checker, rng = build_mujoco(scene), CollisionChecker(scene), np.random.default_rng(0)
    columns = [world.joint_names.index(name) for name in checker.joint_names]
    pairs = [k for k, pair in enumerate(checker.pairs) if "mesh" in pair]
    data, touched = mujoco.MjData(world.model), 0
    for _ in range(150):
        q = random_q(scene, rng)
        data.qpos[columns] = q
        mujoco.mj_forward(world.model, data)
        contacts = zip(data.contact.geom, data.contact.dist, strict=True)
        found = {frozenset(world.geom_elements[g] for g in geoms) for geoms, distance in contacts if distance <= 0.0}
        distances = checker.distances(q)
        for k in pairs:
            if abs(distances[k]) > 2e-5:
                assert (frozenset(checker.pairs[k]) in found) == (distances[k] < 0.0)
                touched += distances[k] < 0.0
    assert touched > 5


def test_too_many_triangles_are_refused_by_the_replay_with_what_to_try(
    rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco_geoms, "_MOST_PLATES", 10)
    with pytest.raises(InputError, match="12 triangles is not convex"):
        build_mujoco(rp.Scene().with_arm("arm", rr1).with_obstacle("mesh", soup(12), [3.0, 0.0, 0.0]))


def test_an_arm_that_its_servos_cannot_hold_is_named(rr1: rp.Robot) -> None:
    for effort, sags in ((2.0, True), (200.0, False)):
        limits = replace(rr1.limits, effort=np.full(rr1.nq, effort))
        sim = rp.Simulation(rp.Scene({"arm": rp.Arm(replace(rr1, limits=limits))}))
        assert sim.warnings == ()
        sim.run(duration=0.5)
        said = "the servo of 'arm/upper_arm_joint' is at its effort limit of 2"
        assert any(said in warning for warning in sim.warnings) == sags
        assert sags or sim.warnings == ()


def test_a_trajectory_that_begins_at_an_absurd_speed_is_refused() -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    jump = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1e-6, 1.0], [[0, 0], [1, 0], [1, 0]])
    with pytest.raises(rp.InputError, match=r"velocities at the start of the trajectory holds 1e\+06, expected"):
        rp.simulate(jump, scene)
