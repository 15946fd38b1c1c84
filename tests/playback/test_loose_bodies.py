"""Loose bodies: free fall, friction, stacks, momentum; MuJoCo's own model as a reference; changes in a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

import rr1plan as rp
from rr1plan.playback.viewer import view_document
from rr1plan.scene.loose_bodies import bounding_box
from rr1plan.transforms import pose

G = 9.81
FLOOR = rp.Scene().with_obstacle("floor", rp.HalfSpace())


def box(edge: float = 0.1) -> rp.Obstacle:
    return rp.Obstacle([rp.Geometry("box", rp.Box((edge, edge, edge)), np.eye(4))], mass=1.0)


# ---- physics ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shape", [rp.Box((0.1, 0.2, 0.3)), rp.Sphere(0.1), rp.Cylinder(0.1, 0.2), rp.Capsule(0.1, 0.2)], ids=repr
)
def test_bodies_fall_freely_and_keep_their_momentum(shape: rp.Shape) -> None:
    scene = rp.Scene().with_obstacle("body", shape, [0.1, 0.2, 5.0], mass=2.0)
    sim = rp.Simulation(scene, 0.001)
    # About a principal axis of largest or smallest inertia, where the rotation is steady.
    sim.place_body("body", [0.1, 0.2, 5.0], [0.3, -0.2, 1.0, 0.0, 0.0, 2.0])
    sim.run(duration=0.8)
    t, T = sim.time, sim.body_pose("body")
    # The integrator is exact up to half a step of speed.
    np.testing.assert_allclose(T[:3, 3], [0.1 + 0.3 * t, 0.2 - 0.2 * t, 5.0 + t - G / 2 * t * (t + sim.dt)], atol=1e-9)
    np.testing.assert_allclose(T[:3, :3], pose(rpy=(0, 0, 2.0 * t))[:3, :3], atol=1e-9)
    np.testing.assert_allclose(sim.body_velocity("body"), [0.3, -0.2, 1.0 - G * t, 0, 0, 2.0], atol=1e-9)


PLATE = rp.Scene().with_obstacle("floor", rp.Box((1.0, 1.0, 0.01)), [0.0, 0.0, -0.005])


@pytest.mark.parametrize("shape", [rp.Box((0.1, 0.1, 0.01)), rp.Sphere(0.005)], ids=repr)
def test_a_body_that_is_too_fast_for_the_steps_is_named(shape: rp.Shape) -> None:
    """From 0.3 m it moves 2.4 cm in a step of 10 ms, through a floor of 1 cm."""
    scene = PLATE.with_obstacle("body", shape, [0.0, 0.0, 0.3], mass=0.1)
    for dt, falls in ((0.01, True), (0.001, False)):
        sim = rp.Simulation(scene, dt)
        with rp.Recorder(sim) as recorder:
            sim.run(duration=0.5)
        assert (sim.body_pose("body")[2, 3] < -0.01) == falls
        remarks = sim.warnings
        assert len(remarks) == falls
        assert recorder.replay().remarks == remarks
        assert all("'body' moved by 2" in said and "into or through 'floor': take a" in said for said in remarks)
        sim.reset()
        assert sim.warnings == ()


def test_a_heavy_body_that_sinks_into_a_light_one_is_named() -> None:
    light = FLOOR.with_obstacle("light", rp.Box((0.1, 0.1, 0.1)), [0.0, 0.0, 0.05], mass=0.1)
    for mass, sinks in ((1.0, False), (200.0, True)):
        sim = rp.Simulation(light.with_obstacle("heavy", rp.Box((0.1, 0.1, 0.1)), [0.0, 0.0, 0.15], mass=mass))
        sim.run(duration=0.3)
        assert (sim.body_pose("heavy")[2, 3] < 0.14) == sinks
        assert any("'heavy' and 'light' overlap by 1" in said for said in sim.warnings) == sinks


def test_bodies_that_begin_in_each_other_are_named_as_such() -> None:
    """Their masses are equal, so that the advice for heavy bodies on light ones does not suffice."""
    box = rp.Box((0.06, 0.06, 0.06))
    scene = FLOOR.with_obstacle("low", box, [0.0, 0.0, 0.03], mass=1.0)
    (said,) = rp.Simulation(scene.with_obstacle("high", box, [0.0, 0.0, 0.06], mass=1.0)).warnings
    assert said.startswith("'high' and 'low' overlap by 30 mm: they began in each other")
    assert "move them apart" in said


def test_contacts_are_harder_in_shorter_steps() -> None:
    """A flat box from 1 m: it used to penetrate by its thickness in short steps as well, and to fall through."""
    scene = PLATE.with_obstacle("body", rp.Box((0.1, 0.1, 0.01)), [0.0, 0.0, 1.0], mass=0.1)
    for dt in (0.001, 0.0005):
        sim = rp.Simulation(scene, dt)
        sim.run(duration=0.7)
        assert sim.body_pose("body")[2, 3] == pytest.approx(0.005, abs=1e-3)
        assert sim.max_penetration < 0.005


def test_contacts_in_long_steps_are_as_hard_as_mujoco_allows() -> None:
    """Boxes from 1.0 to 1.2 m in steps of 8 ms penetrate by 17 mm on average; in softer contacts by 27."""
    depths = []
    for height in np.linspace(1.0, 1.2, 15).tolist():
        sim = rp.Simulation(FLOOR.with_obstacle("body", rp.Box((0.2, 0.2, 0.2)), [0.0, 0.0, height], mass=1.0), 0.008)
        sim.run(duration=1.5)
        assert sim.body_pose("body")[2, 3] == pytest.approx(0.1, abs=1e-3)
        depths.append(sim.max_penetration)
    assert np.mean(depths) < 0.02


def test_a_fast_body_that_meets_nothing_is_not_named() -> None:
    sim = rp.Simulation(PLATE.with_obstacles({"ball": rp.Obstacle([rp.Geometry("b", rp.Sphere(0.01))], mass=0.1)}))
    sim.place_body("ball", [0.0, 0.0, 0.5], [20.0, 0.0, 0.0, 0.0, 0.0, 30.0])
    sim.run(duration=0.1)
    assert sim.warnings == ()


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_a_box_on_a_slope_slides_beyond_its_friction_angle_only(friction: float, turn: float) -> None:
    for angle in (np.arctan(friction) - 0.03, np.arctan(friction) + 0.03):
        tilt = pose(rpy=(0.0, angle, 0.0))
        slope = rp.Scene().with_obstacle("slope", rp.Box((9.0, 2.0, 0.1)), tilt @ pose([0, 0, -0.05]))
        at = tilt @ pose([0, 0, 0.01], rpy=(0, 0, turn))
        sim = rp.Simulation(slope.with_obstacle("box", rp.Box((0.1, 0.1, 0.02)), at, mass=0.3, friction=friction))
        sim.run(duration=0.2)
        begin, speed = sim.body_pose("box")[:3, 3], np.linalg.norm(sim.body_velocity("box")[:3])
        sim.run(duration=0.5)
        way = np.linalg.norm(sim.body_pose("box")[:3, 3] - begin)
        if angle < np.arctan(friction):
            assert way < 1e-4
        else:
            expected = G * (np.sin(angle) - friction * np.cos(angle))
            assert way == pytest.approx(0.5 * speed + 0.5 * expected * 0.25, rel=0.12)  # its edges bite a little


@pytest.mark.parametrize("size", [(2.4, 1.6, 0.04), (1.0, 1.0, 1.0)])
def test_a_cylinder_that_lies_on_a_level_table_does_not_roll(size: tuple[float, float, float]) -> None:
    scene = rp.Scene().with_obstacle("table", rp.Box(size), [0.4, 0.0, -size[2] / 2])
    for k, yaw in enumerate((0.0, 0.3, 1.0)):
        T = pose([0.4, 0.3 * k - 0.25, 0.015], rpy=[0.0, np.pi / 2, yaw])
        scene = scene.with_obstacle(f"rod{k}", rp.Cylinder(0.015, 0.3), T, mass=0.15)
    sim = rp.Simulation(scene)
    sim.run(duration=1.5)
    for name in sim.body_names:
        np.testing.assert_allclose(sim.body_pose(name)[:2, 3], scene.obstacles[name].pose[:2, 3], atol=1e-4)


def test_a_stack_of_boxes_stays() -> None:
    scene = FLOOR.with_obstacles(rp.stack_bodies(box(), 6, gap=0.0))
    sim = rp.Simulation(scene)
    sim.run(duration=2.0)
    for k, name in enumerate(sim.body_names):
        np.testing.assert_allclose(sim.body_pose(name)[:3, 3], [0, 0, 0.05 + 0.1 * k], atol=2e-3)
        # With edges exactly above each other, the number of contacts changes, so the boxes never rest completely; how
        # much they move depends on MuJoCo's version. No corner moves faster:
        velocity = sim.body_velocity(name)
        assert np.linalg.norm(velocity[:3]) + np.linalg.norm(velocity[3:]) * np.sqrt(3) * 0.05 < 4e-3
    assert sim.contacts == ()
    assert 0.0 < sim.max_penetration < 2e-3


@pytest.mark.parametrize("solver", ["newton", "cg"])
@pytest.mark.parametrize("friction", [0.5, 10.0, 1e6])
def test_bodies_do_not_sink_at_any_friction(solver: str, friction: float) -> None:
    stack = rp.stack_bodies(replace(box(), friction=friction), 3, gap=0.0)
    sim = rp.Simulation(FLOOR.with_obstacles(stack), solver=solver)
    sim.run(duration=0.5)
    heights = [sim.body_pose(name)[2, 3] for name in sim.body_names]
    np.testing.assert_allclose(heights, [0.05, 0.15, 0.25], atol=1e-3)
    with pytest.raises(rp.InputError, match="friction is 1e\\+300, expected a coefficient of at most 1e\\+06"):
        replace(box(), friction=1e300)


def test_faces_of_a_convex_mesh_may_be_oriented_either_way() -> None:
    hull = rp.Mesh([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.3]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    models = []
    for flipped in ([], [0, 2], [0, 1, 2, 3]):
        faces = np.array(hull.faces)
        faces[flipped] = faces[flipped][:, ::-1]
        scene = rp.Scene().with_obstacle("body", rp.Mesh(hull.vertices, faces, convex=True), mass=1.0)
        models.append(rp.Simulation(scene).model)
    for model in models:
        np.testing.assert_allclose(model.body_inertia[1], models[0].body_inertia[1], rtol=1e-9)
        np.testing.assert_allclose(model.body_ipos[1], models[0].body_ipos[1], atol=1e-12)


def test_colliding_bodies_keep_their_momentum() -> None:
    ball = rp.Obstacle([rp.Geometry("ball", rp.Sphere(0.1), np.eye(4))], mass=1.0)
    heavy = replace(ball, mass=3.0, pose=pose([0.5, 0.02, 0.0]))
    sim = rp.Simulation(rp.Scene().with_obstacles({"a": ball, "b": heavy}))
    sim.model.opt.gravity[:] = 0.0
    sim.place_body("a", [0, 0, 0], [2.0, 0, 0, 0, 0, 0])
    sim.run(duration=0.5)
    a, b = sim.body_velocity("a"), sim.body_velocity("b")
    np.testing.assert_allclose(a[:3] + 3.0 * b[:3], [2.0, 0.0, 0.0], atol=1e-6)
    assert b[0] > 0.3
    assert sim.max_penetration > 0.0


def test_the_model_has_the_inertia_that_mujoco_gives_the_same_bodies() -> None:
    """A body in plain MJCF, with mass and geoms, as a second opinion; a mesh as its vertices."""
    hull = rp.Mesh([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.3]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    parts = {
        rp.Box((0.1, 0.2, 0.3)): 'type="box" size="0.05 0.1 0.15"',
        rp.Sphere(0.1): 'type="sphere" size="0.1"',
        rp.Cylinder(0.1, 0.2): 'type="cylinder" size="0.1 0.1"',
        rp.Capsule(0.1, 0.2): 'type="capsule" size="0.1 0.1"',
        hull: 'type="mesh" mesh="hull"',
    }
    place = pose([0.3, 0.1, -0.2], rpy=(0.3, -0.2, 0.5))
    quaternion = " ".join(map(str, rp.transforms.quaternion_from_rotation(place[:3, :3])))
    vertices = " ".join(str(v) for v in hull.vertices.ravel())
    for shape, attributes in parts.items():
        geoms = f'<geom {attributes}/><geom type="sphere" size="0.1" pos="0.3 0.1 -0.2" quat="{quaternion}"/>'
        text = (
            f'<mujoco><asset><mesh name="hull" vertex="{vertices}"/></asset><worldbody>'
            f'<body name="body"><freejoint/>{geoms}</body></worldbody></mujoco>'
        )
        reference = mujoco.MjModel.from_xml_string(text)
        mass = float(reference.body_mass[1])
        geometries = (rp.Geometry("a", shape, np.eye(4)), rp.Geometry("b", rp.Sphere(0.1), place))
        sim = rp.Simulation(rp.Scene().with_obstacles({"body": rp.Obstacle(geometries, mass=mass)}))
        found = sim.model
        np.testing.assert_allclose(found.body_ipos[1], reference.body_ipos[1], atol=1e-9)
        np.testing.assert_allclose(np.sort(found.body_inertia[1]), np.sort(reference.body_inertia[1]), rtol=1e-6)


# ---- arms and bodies ------------------------------------------------------------------------------


def test_an_arm_pushes_a_block_and_only_forbidden_contacts_are_listed() -> None:
    block = rp.Obstacle([rp.Geometry("block", rp.Box((0.07, 0.07, 0.4)), np.eye(4))], pose([-0.36, 0.0, 0.201]), 0.5)
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1")).with_obstacle("floor", rp.HalfSpace())
    scene = scene.with_obstacles({"block": block})
    names, ends = scene.joint_names(), np.outer([-1.0, 0.6], np.eye(6)[0])
    swing = rp.Trajectory.from_samples(names, [0.0, 1.0], ends, np.zeros((2, 6)), np.zeros((2, 6)))
    for expected in (False, True):
        replay = rp.simulate(swing, scene.allow("rr1", "block") if expected else scene)
        assert np.linalg.norm(replay.record.bodies.poses[-1, 0, :2] - [-0.36, 0.0]) > 0.1  # it was hit, allowed or not
        assert replay.free is expected
        if not expected:
            assert {"block"} == {name for contact in replay.contacts for name in contact.pair if "/" not in name}
    assert not rp.CollisionChecker(scene).edge_is_free(*ends)  # for a planner it stands there


def test_a_held_object_weighs_on_its_arm() -> None:
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    held = scene.with_obstacle("weight", rp.Box((0.05, 0.05, 0.05)), [-0.4, 0.06, 0.4], mass=1.0)
    held = held.attach("weight", touch=[link.name for link in scene.arms["rr1"].robot.links])
    assert held.attachments["weight"].mass == 1.0
    assert held.detach("weight").obstacles["weight"].mass == 1.0
    bare, loaded = (rp.Simulation(s) for s in (scene, held))
    assert loaded.model.body_mass.sum() == pytest.approx(bare.model.body_mass.sum() + 1.0)
    for sim in (bare, loaded):
        sim.run(duration=0.5)
    np.testing.assert_allclose(loaded.positions, bare.positions, atol=1e-4)  # feed-forward carries it
    assert np.abs(loaded.efforts - bare.efforts).max() > 2.0


# ---- runs ------------------------------------------------------------------------------------------


def falling(solver: str = "newton", threads: int = 1) -> rp.Simulation:
    rng = np.random.default_rng(3)
    tower = rp.stack_bodies(box(), 60, columns=(2, 2), gap=0.03, pose=[0, 0, 0.02])
    tower = {name: replace(body, pose=body.pose @ pose(rpy=rng.uniform(-0.1, 0.1, 3))) for name, body in tower.items()}
    return rp.Simulation(FLOOR.with_obstacles(tower), 0.004, solver=solver, threads=threads)


@pytest.mark.parametrize("solver", ["newton", "cg"])
def test_a_falling_tower_repeats_to_the_bit_and_nothing_falls_through(solver: str) -> None:
    ends = []
    for threads in (1, 2):
        sim = falling(solver, threads)
        for _ in range(2):
            sim.run(duration=0.8)
            ends.append(sim.data.qpos.tobytes())
            assert min(sim.body_pose(name)[2, 3] for name in sim.body_names) > 0.0
            assert sim.max_penetration < (0.03 if solver == "newton" else 0.09)  # of an edge of 0.1
            sim.reset()
        assert sim.time == 0.0
        assert sim.max_penetration == 0.0
        np.testing.assert_allclose(sim.body_pose("body60"), sim.scene.obstacles["body60"].pose, atol=1e-12)
    assert len(set(ends)) == 1


@pytest.mark.parametrize("arms", [0, 1])
def test_bodies_fall_while_no_arm_moves(arms: int) -> None:
    scene = rp.Scene().with_obstacle("ball", rp.Sphere(0.05), [3.0, 0.0, 1.0], mass=1.0)
    scene = scene.with_arm("arm", rp.planar_arm("RR")) if arms else scene
    still = rp.Trajectory.rest([], [], duration=0.2)
    replay = rp.simulate(still, scene)
    bodies = replay.record.bodies
    assert replay
    assert bodies is not None
    assert bodies.poses[-1, 0, 2] == pytest.approx(1.0 - 0.5 * 9.81 * 0.2**2, abs=3e-3)
    assert rp.simulate(still, scene, mode="kinematic")
    assert rp.second_opinion(still, scene)


def test_things_come_move_and_go_in_a_run() -> None:
    scene = FLOOR.with_arm("arm", rp.load_robot("rr1"), [2.0, 0.0, 0.0]).with_obstacles({"a": box()})
    sim = rp.Simulation(scene)
    sim.place_body("a", [0, 0, 1.0])
    sim.run(duration=0.2)
    height, speed = sim.body_pose("a")[2, 3], sim.body_velocity("a")[2]
    sim.update_scene(sim.scene.with_obstacles({"b": replace(box(0.2), pose=pose([0, 1.0, 0.5]))}))
    assert sim.body_names == ("a", "b")
    assert sim.time == pytest.approx(0.2)
    assert (sim.body_pose("a")[2, 3], sim.body_velocity("a")[2]) == (height, speed)
    assert sim.body_pose("b")[2, 3] == 0.5
    assert sim.current_scene.obstacles["a"].pose[2, 3] == height
    assert scene.obstacles["a"].pose[2, 3] == 0.0
    sim.run(duration=0.5)
    sim.update_scene(sim.scene.with_obstacle_at("b", [0, 1.0, 2.0]).without_obstacle("a"))
    assert sim.body_names == ("b",)
    assert sim.body_pose("b")[2, 3] == 2.0
    sim.run(duration=0.1)
    sim.reset()
    assert sim.scene is scene
    assert sim.body_names == ("a",)
    with pytest.raises(rp.UnknownNameError, match=r"unknown loose body 'b'. Known: a.* with a mass is"):
        sim.body_pose("b")
    with pytest.raises(rp.InputError, match="arm 'arm' is another robot or elsewhere"):
        sim.update_scene(scene.with_arm("arm", rp.load_robot("rr1"), [1.0, 0.0, 0.0]))
    with pytest.raises(rp.InputError, match=r"has the arms \['arm', 'b'\], expected those of the simulation"):
        sim.update_scene(scene.with_arm("b", rp.load_robot("rr1"), [1.0, 0.0, 0.0]))
    with pytest.raises(rp.InputError, match=r"has the arms \[\], expected those of the simulation: \['arm'\]"):
        sim.update_scene(FLOOR)


def test_bodies_in_flight_keep_their_velocity_in_a_scene_that_is_based_on_the_current_one() -> None:
    sim = rp.Simulation(FLOOR.with_obstacles({"a": box()}))
    sim.place_body("a", pose([0, 0, 1.0], rpy=(0.3, 0.4, 0.5)), [1.0, 0, 0, 0, 2.0, 0])
    sim.run(duration=0.2)
    state = [sim.body_coordinates("a"), sim.body_velocity("a")]
    for name in ("b", "c"):
        sim.update_scene(sim.current_scene.with_obstacles({name: replace(box(), pose=pose([0, 1.0, 0.5]))}))
        np.testing.assert_array_equal([*state[0], *state[1]], [*sim.body_coordinates("a"), *sim.body_velocity("a")])
    sim.update_scene(sim.current_scene.with_obstacle_at("a", [0, 0, 0.9]))
    assert not sim.body_velocity("a").any()


def test_a_record_has_what_bodies_did_and_a_page_shows_it() -> None:
    scene = FLOOR.with_obstacles({"a": replace(box(), pose=pose([0, 0, 0.5]))})
    sim = rp.Simulation(scene)
    with rp.Recorder(sim, 0.01) as recorder:
        sim.run(duration=0.1)
        sim.update_scene(scene.with_obstacles({"b": replace(box(), pose=pose([1.0, 0, 0.5]))}))
        sim.run(duration=0.1)
    sim.run(duration=0.1)
    replay = recorder.replay()
    assert str(replay).endswith("  contacts: none")
    assert list(replay.record.bodies.bodies) == ["a", "b"]
    assert replay.record.bodies.poses.shape == (21, 2, 7)
    assert np.isnan(replay.record.bodies.poses[:11, 1]).all()
    assert np.isfinite(replay.record.bodies.poses[11:]).all()
    fallen = 0.5 - G / 2 * replay.record.times * (replay.record.times + sim.dt)
    np.testing.assert_allclose(replay.record.bodies.poses[:, 0, 2], fallen, atol=1e-9)
    document = view_document(scene, replay=replay)
    assert [row["name"] for row in document["obstacles"]] == ["floor"]
    assert [row["name"] for row in document["bodies"]["objects"]] == ["a", "b"]
    assert document["bodies"]["poses"]["shape"] == [21, 2, 7]
    assert document["track"] is not None


# ---- files and helpers --------------------------------------------------------------------------


def test_mass_and_friction_are_in_scene_files_motion_files_and_mjcf(tmp_path: Path) -> None:
    scene = rp.load_scene("rr1_table").with_obstacle("cube", rp.Box((0.1, 0.1, 0.1)), mass=0.25, friction=0.4)
    scene = scene.with_obstacle("tool", rp.Box((0.02, 0.02, 0.02)), mass=0.1).attach("tool")
    rp.save_scene(tmp_path / "s.toml", scene)
    rest = rp.Trajectory.rest(scene.joint_names(), scene.configuration())
    rp.save_motion(tmp_path / "m.json", scene, trajectory=rest)
    for again in (rp.load_scene(tmp_path / "s.toml"), rp.load_motion(tmp_path / "m.json").scene):
        assert (again.obstacles["cube"].mass, again.obstacles["cube"].friction) == (0.25, 0.4)
        assert again.obstacles["bottle"].mass is None
        assert again.attachments["tool"].mass == 0.1
    model = mujoco.MjModel.from_xml_path(str(rp.save_mjcf(tmp_path / "s.xml", scene)))
    cube = model.body("cube")
    assert model.body_mass[cube.id] == 0.25
    assert model.jnt_type[model.body_jntadr[cube.id]] == mujoco.mjtJoint.mjJNT_FREE
    assert model.geom_friction[model.body_geomadr[cube.id]][0] == 0.4
    for mass in (-1, "1e300"):
        (tmp_path / "bad.toml").write_text(f"[obstacles.a]\nbox = [1, 1, 1]\nmass = {mass}\n")
        with pytest.raises(rp.FormatError, match=r"(?s)obstacles.a.*mass"):
            rp.load_scene(tmp_path / "bad.toml")


def test_a_mesh_file_becomes_a_body_of_its_volume(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    trimesh.creation.box((100, 200, 300)).export(tmp_path / "brick.stl")
    body = rp.load_body(tmp_path / "brick.stl", scale=0.001, density=2000.0, pose=[0, 0, 1])
    assert body.mass == pytest.approx(12.0)
    assert body.pose[2, 3] == 1.0
    assert body.geometries[0].shape.convex
    assert rp.load_body(tmp_path / "brick.stl", scale=0.001, mass=1.0).mass == 1.0
    assert caplog.messages == []
    rp.load_body(tmp_path / "brick.stl")
    rp.load_body(tmp_path / "brick.stl", scale=0.1)
    wide, long = caplog.messages
    assert "brick.stl: the mesh is 300 m wide; if it is in millimeters, scale it by 0.001" in wide
    assert "brick.stl is 30 m long; a file in millimeters needs scale=0.001" in long
    both = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1), pose([1.1, 0.0, 1.0]))]
    trimesh.util.concatenate(both).export(tmp_path / "two.obj")
    pieces = rp.load_body(tmp_path / "two.obj", scale=0.1, convex="pieces")
    assert len(pieces.geometries) == 2
    assert pieces.mass == pytest.approx(2.0)


def test_a_mesh_that_is_open_or_flat_is_named(tmp_path: Path) -> None:
    cube = trimesh.creation.box((1, 1, 1))
    trimesh.Trimesh(cube.vertices, cube.faces[:-1]).export(tmp_path / "open.stl")
    with pytest.raises(rp.InputError, match=r"open\.stl: the mesh is not closed.*give its mass"):
        rp.load_body(tmp_path / "open.stl")
    assert rp.load_body(tmp_path / "open.stl", mass=2.0).mass == 2.0
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    two_sided = [[0, 1, 2], [0, 2, 1], [0, 2, 3], [0, 3, 2]]
    trimesh.Trimesh(corners, two_sided, process=False).export(tmp_path / "flat.stl")
    for options in ({}, {"mass": 1.0}):
        with pytest.raises(rp.InputError, match=r"flat\.stl: the mesh .*(volume|flat)"):
            rp.load_body(tmp_path / "flat.stl", **options)


@pytest.mark.parametrize(
    ("geometry", "options", "said"),
    [
        (rp.Box((1, 1, 1)), {"mass": 0.0}, "mass"),
        (rp.Box((1, 1, 1)), {"mass": float("nan")}, "mass"),
        (rp.Box((1, 1, 1)), {"mass": 1.0, "friction": -0.1}, "friction is -0.1"),
        (rp.HalfSpace(), {"mass": 1.0}, "'it' is a HalfSpace, which cannot have a mass"),
        (rp.PointCloud([[0, 0, 0]]), {"mass": 1.0}, "'it' is a PointCloud, which cannot have a mass"),
        (
            rp.Mesh(np.eye(4, 3), [[0, 1, 2], [0, 1, 3]]),
            {"mass": 1.0},
            "mesh 'it' of an object with a mass is not convex; .*in a scene file mesh = { file",
        ),
    ],
)
def test_what_cannot_be_a_body_is_refused(geometry: rp.Shape, options: dict[str, float], said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        FLOOR.with_obstacle("it", geometry, **options)


WEDGE = trimesh.Trimesh(
    [[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
)


@pytest.mark.parametrize(
    ("shape", "fine"),
    [
        (rp.Box((0.1, 0.2, 0.3)), trimesh.creation.box((0.1, 0.2, 0.3))),
        (rp.Sphere(0.1), trimesh.creation.uv_sphere(0.1, count=(128, 128))),
        (rp.Cylinder(0.1, 0.2), trimesh.creation.cylinder(0.1, 0.2, sections=512)),
        (rp.Capsule(0.1, 0.2), trimesh.creation.capsule(0.2, 0.1, count=(128, 128))),
        (rp.Mesh(WEDGE.vertices, WEDGE.faces), WEDGE),
    ],
    ids=["box", "sphere", "cylinder", "capsule", "mesh"],
)
def test_bounding_boxes_are_those_of_fine_meshes(shape: rp.Shape, fine: trimesh.Trimesh) -> None:
    rng = np.random.default_rng(2)
    points = np.asarray(fine.vertices)
    if isinstance(shape, rp.Capsule):  # wherever trimesh puts it
        points = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    for _ in range(10):
        own, placed = (pose(rng.normal(size=3), rpy=rng.uniform(-3.0, 3.0, 3)) for _ in range(2))
        T = placed @ own
        seen = points @ T[:3, :3].T + T[:3, 3]
        box = bounding_box((rp.Geometry("it", shape, own),), placed)
        np.testing.assert_allclose(box, [seen.min(axis=0), seen.max(axis=0)], atol=1e-4)


def test_bodies_are_stacked_without_overlap() -> None:
    turned = replace(box(), pose=pose([5, 5, 5], rpy=(0, 0, np.pi / 4)))
    stack = rp.stack_bodies(turned, 7, columns=(2, 3), gap=(0.01, 0.02, 0.03), pose=[1, 2, 3], prefix="c")
    assert list(stack) == [f"c0{k}" for k in range(1, 8)]
    places = np.array([body.pose[:3, 3] for body in stack.values()])
    wide = 0.1 * np.sqrt(2)
    np.testing.assert_allclose(places[:6].mean(axis=0), [1, 2, 3.05], atol=1e-9)
    np.testing.assert_allclose(np.ptp(places, axis=0), [wide + 0.01, 2 * (wide + 0.02), 0.13], atol=1e-9)
    assert all(body.mass == 1.0 for body in stack.values())
    np.testing.assert_allclose(stack["c01"].pose[:3, :3], turned.pose[:3, :3])


def test_more_bodies_than_the_memory_holds_are_refused_before_it_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 4_000_000}.__getitem__)
    scene = FLOOR.with_obstacles(rp.stack_bodies(box(), 10_000, columns=(100, 100)))
    with pytest.raises(rp.InputError, match=r"10000 loose bodies takes about 20\.4 GB .* has 16.4 GB"):
        rp.Simulation(scene)
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 1, "SC_PHYS_PAGES": 10**5}.__getitem__)
    arm = rp.Scene().with_arm("rr1", rp.load_robot("rr1"))
    with pytest.raises(rp.InputError, match=r"1 arm and 0 loose bodies takes about 0.0238 GB .* has 0.0001 GB"):
        rp.Simulation(arm)


def test_other_users_of_the_model_take_loose_bodies_as_fixed_and_say_what_is_forbidden() -> None:
    """A body on the floor, or touched by an arm that may touch it, is not a fault; a forbidden contact is."""
    scene = rp.Scene().with_arm("rr1", rp.load_robot("rr1")).with_obstacle("floor", rp.HalfSpace())
    tool = scene.link_poses()["rr1/hand_link"][:3, 3]
    loose = scene.with_obstacle("held", rp.Box((0.1, 0.1, 0.1)), tool, mass=1.0)
    loose = loose.with_obstacle("stands", rp.Box((0.1, 0.1, 0.1)), [1.0, 0.0, 0.05], mass=1.0)
    still = rp.Trajectory.rest(scene.joint_names(), scene.configuration(), duration=0.02)
    for one, expected in ((loose, False), (loose.allow("rr1", "held"), True)):
        opinion = rp.second_opinion(still, one, step=0.01)
        assert opinion.free is expected, opinion
        assert not opinion.disagreements
        with rp.Mirror(one) as mirror:
            state = mirror.receive(rp.StateMessage(0.0, scene.joint_names(), scene.configuration()))
        assert state is not None
        assert (state.contacts == ()) is expected


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("noslip_iterations", 5),
        ("solver", mujoco.mjtSolver.mjSOL_PGS),
        ("jacobian", mujoco.mjtJacobian.mjJAC_SPARSE),
        ("cone", mujoco.mjtCone.mjCONE_PYRAMIDAL),
    ],
)
def test_the_solver_may_be_changed_while_bodies_touch(option: str, value: int) -> None:
    """MuJoCo would end the process: the solver needs matrices that are computed with the contacts."""
    scene = rp.Scene().with_obstacle("floor", rp.HalfSpace((0, 0, 1), 0.0))
    sim = rp.Simulation(scene.with_obstacle("box", rp.Box((0.1, 0.1, 0.1)), [0, 0, 0.05], mass=0.2))
    sim.step(20)
    setattr(sim.model.opt, option, value)
    sim.step(20)
    assert sim.body_pose("box")[2, 3] == pytest.approx(0.05, abs=1e-3)
