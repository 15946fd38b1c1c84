"""Animated 3-D models: a player of the file has the links at the poses of Pinocchio."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation, Slerp

import rr1plan as rp
from rr1plan.export.glb_meshes import shape_triangles
from rr1plan.playback.viewer.page_shapes import ShapeTable

pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed")

# From the file's y up to the world's z up.
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


class Player:
    """Plays a file according to the specification of glTF 2.0, with pygltflib's reader and SciPy's slerp."""

    def __init__(self, file: Path) -> None:
        self.content = pygltflib.GLTF2().load(str(file))
        self.parents = {c: i for i, node in enumerate(self.content.nodes) for c in node.children or ()}
        self.named = {node.name: i for i, node in enumerate(self.content.nodes)}
        self.tracks = {}
        for animation in self.content.animations:
            for channel in animation.channels:
                sampler = animation.samplers[channel.sampler]
                curve = (self.array(sampler.input), self.array(sampler.output), sampler.interpolation)
                self.tracks[channel.target.node, channel.target.path] = curve

    def array(self, index: int) -> np.ndarray:
        accessor = self.content.accessors[index]
        view = self.content.bufferViews[accessor.bufferView]
        columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        dtype = {5126: "<f4", 5125: "<u4"}[accessor.componentType]
        flat = np.frombuffer(self.content.binary_blob(), dtype, accessor.count * columns, view.byteOffset)
        return flat.astype(float) if columns == 1 else flat.reshape(-1, columns).astype(float)

    def value(self, node: int, path: str, t: float) -> np.ndarray:
        rest = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}[path]
        if (node, path) not in self.tracks:
            return np.array(getattr(self.content.nodes[node], path) or rest, dtype=float)
        times, values, kind = self.tracks[node, path]
        t = float(np.clip(t, times[0], times[-1]))
        if kind == "STEP":
            return np.asarray(values[np.searchsorted(times, t, side="right") - 1])
        if path == "rotation":
            return np.asarray(Slerp(times, Rotation.from_quat(values))(t).as_quat())
        return np.array([np.interp(t, times, column) for column in values.T])

    def pose(self, name: str, t: float = 0.0) -> np.ndarray:
        """T_world_node, z up."""
        T, node = np.eye(4), self.named[name]
        while True:
            own = np.eye(4)
            own[:3, :3] = Rotation.from_quat(self.value(node, "rotation", t)).as_matrix() @ np.diag(
                self.value(node, "scale", t)
            )
            own[:3, 3] = self.value(node, "translation", t)
            T = own @ T
            if node not in self.parents:
                return np.asarray(Z_UP @ T)
            node = self.parents[node]


@pytest.fixture(scope="module")
def pair(rr1: rp.Robot) -> rp.Scene:
    """Two RR1; one holds a box."""
    scene = rp.Scene(name="pair").with_arm("left", rr1, [0.0, 0.4, 0.1])
    turned = rp.transforms.pose([0.3, -0.4, 0.0], rpy=[0.2, -0.1, 1.3])
    scene = scene.with_arm("right", rr1, turned).with_obstacle("crate", rp.Box((0.1, 0.2, 0.3)), [0.5, 0.1, 0.2])
    scene = scene.with_obstacle("held", rp.Box((0.02, 0.03, 0.04)), [0, 0, 0])
    return scene.attach("held", "left", pose=[0.0, 0.0, 0.02])


@pytest.fixture(scope="module")
def motion(pair: rp.Scene) -> rp.Trajectory:
    """All joints of both arms move, evenly between instants that are 2/11 s apart."""
    rng = np.random.default_rng(4)
    columns = pair.joint_names()
    targets = np.cumsum(rng.uniform(-0.4, 0.4, (12, len(columns))), axis=0)
    return rp.Trajectory.from_samples(columns, np.linspace(1.0, 3.0, 12), targets)


def test_links_are_where_pinocchio_has_them(pair: rp.Scene, motion: rp.Trajectory, tmp_path: Path) -> None:
    player = Player(rp.save_glb(tmp_path / "pair.glb", pair, trajectory=motion, rate=50.0))
    model = rp.Kinematics(pair)
    names = [f"{arm}/{link}" for arm in pair.arms for link in pair.arms[arm].robot.link_names]
    # At samples and between them, where joints turn evenly.
    for t in (0.0, 0.5, 1.24, 2.0, 0.777, 1.9931):
        for name in names:
            T = model.pose(motion(1.0 + t), name)
            np.testing.assert_allclose(player.pose(name, t), T, atol=3e-6, err_msg=f"{name} at {t}")
    assert (
        np.ptp([player.pose("left/" + pair.arms["left"].robot.tool, t)[:3, 3] for t in (0, 0.5, 1)], axis=0).max()
        > 0.02
    )


def test_held_objects_follow_their_link_and_others_stay(pair: rp.Scene, motion: rp.Trajectory, tmp_path: Path) -> None:
    player = Player(rp.save_glb(tmp_path / "pair.glb", pair, trajectory=motion))
    for t in (0.0, 1.0):
        tool = rp.Kinematics(pair).pose(motion(1.0 + t), "left/tool")
        np.testing.assert_allclose(player.pose("held", t), tool @ pair.attachments["held"].pose, atol=3e-6)
        np.testing.assert_allclose(player.pose("crate", t), pair.obstacles["crate"].pose, atol=3e-6)


def test_equal_arms_share_their_meshes(pair: rp.Scene, tmp_path: Path) -> None:
    player = Player(rp.save_glb(tmp_path / "pair.glb", pair))
    links = pair.arms["left"].robot.link_names
    meshes = {arm: [player.content.nodes[player.named[f"{arm}/{link}"]].mesh for link in links] for arm in pair.arms}
    assert meshes["left"] == meshes["right"]
    drawn = [mesh for mesh in meshes["left"] if mesh is not None]
    assert len(drawn) == len(set(drawn)) > 5
    assert not player.content.animations


def test_trimesh_reads_the_scene_where_it_stands(planar2r: rp.Robot, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", planar2r).with_obstacle("crate", rp.Box((0.1, 0.2, 0.3)), [3.0, 1.0, 2.0])
    whole = trimesh.load(rp.save_glb(tmp_path / "scene.glb", scene))
    (crate,) = [g for g in whole.geometry.values() if np.allclose(np.ptp(g.bounds, axis=0), [0.1, 0.2, 0.3])]
    assert crate.area == pytest.approx(0.22)
    upright = whole.copy().apply_transform(Z_UP)
    np.testing.assert_allclose(upright.bounds[1][[0, 2]], [3.05, 2.15], atol=1e-6)


def test_mimic_joints_follow_theirs(tmp_path: Path) -> None:
    file = tmp_path / "hand.urdf"
    joint = """<joint name="{0}" type="prismatic"><parent link="palm"/><child link="{0}_finger"/><axis xyz="0 {1} 0"/>
      <origin xyz="0 0 0.1"/><limit lower="0" upper="1" velocity="1" effort="1"/>{2}</joint>"""
    links = "".join(
        f'<link name="{name}"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>'
        for name in ("palm", "one_finger", "two_finger")
    )
    mimic = '<mimic joint="one" multiplier="-0.5" offset="0.1"/>'
    file.write_text(f'<robot name="hand">{links}{joint.format("one", 1, "")}{joint.format("two", 1, mimic)}</robot>')
    scene = rp.Scene().with_arm("hand", rp.load_robot(file))
    motion = rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0]), np.array([[[0.0], [0.6]]]))
    player = Player(rp.save_glb(tmp_path / "hand.glb", scene, trajectory=motion))
    for t in (0.0, 0.5, 1.0):
        for link, T in scene.with_configuration("hand", motion(t)).link_poses().items():
            np.testing.assert_allclose(player.pose(link, t), T, atol=1e-6)
    assert player.pose("hand/two_finger", 1.0)[1, 3] == pytest.approx(-0.2, abs=1e-6)


SHAPES = (
    (rp.Box((0.1, 0.2, 0.3)), 0.006),
    (rp.Sphere(0.2), 4 / 3 * np.pi * 0.008),
    (rp.Cylinder(0.2, 0.5), np.pi * 0.04 * 0.5),
    (rp.Capsule(0.2, 0.5), np.pi * 0.04 * 0.5 + 4 / 3 * np.pi * 0.008),
    (
        rp.Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
        1 / 6,
    ),
    (rp.PointCloud(np.array([[0.0, 0, 0], [1, 1, 1]]), 0.1), 0.002),
)


@pytest.mark.parametrize(("shape", "volume"), SHAPES)
def test_surfaces_enclose_their_shapes(shape: Any, volume: float) -> None:
    table = ShapeTable()
    body = shape_triangles(table.rows[table.index(shape)])
    corners = body.vertices[body.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (corners[:, 0] * across).sum() / 6 == pytest.approx(volume, rel=0.03)
    np.testing.assert_allclose(np.linalg.norm(body.normals, axis=1), 1.0, atol=1e-5)
    outwards = (body.normals[body.faces] * across[:, None]).sum(axis=2)
    assert outwards.min() > -1e-12


def test_corners_are_sharp_and_round_things_are_round() -> None:
    table = ShapeTable()
    box = shape_triangles(table.rows[table.index(rp.Box((1.0, 1.0, 1.0)))])
    assert len(box.vertices) == 24
    assert np.isclose(np.abs(box.normals).max(axis=1), 1.0).all()
    can = shape_triangles(table.rows[table.index(rp.Cylinder(1.0, 1.0))])
    side = np.abs(can.normals[:, 2]) < 0.5
    radial = can.vertices[side, :2] / np.linalg.norm(can.vertices[side, :2], axis=1)[:, None]
    np.testing.assert_allclose(can.normals[side, :2], radial, atol=0.02)


def test_the_file_is_well_formed(pair: rp.Scene, motion: rp.Trajectory, tmp_path: Path) -> None:
    data = rp.save_glb(tmp_path / "pair.glb", pair, trajectory=motion).read_bytes()
    magic, version, length, size, kind = struct.unpack("<5I", data[:20])
    assert (magic, version, length, kind) == (0x46546C67, 2, len(data), 0x4E4F534A)
    content = json.loads(data[20 : 20 + size])
    rest, binary = struct.unpack("<2I", data[20 + size : 28 + size])
    assert (binary, 28 + size + rest) == (0x004E4942, len(data))
    assert content["buffers"][0]["byteLength"] == rest
    for accessor in content["accessors"]:
        view = content["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        assert view["byteLength"] == 4 * width * accessor["count"]
        assert view["byteOffset"] % 4 == 0
    for sampler in content["animations"][0]["samplers"]:
        one, other = content["accessors"][sampler["input"]], content["accessors"][sampler["output"]]
        assert one["count"] == other["count"]
        assert (one["min"], one["max"]) == ([0.0], [2.0])


def test_times_increase_in_the_precision_of_the_file(planar2r: rp.Robot, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    # The end is 1e-8 s after the last sample, which vanishes in single precision.
    motion = rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0 + 1e-8]), np.array([[[0.0, 0.0], [1.0, 1.0]]]))
    player = Player(rp.save_glb(tmp_path / "arm.glb", scene, trajectory=motion, rate=10.0))
    assert len(player.tracks) == 2
    for times, values, _ in player.tracks.values():
        assert (np.diff(times) > 0).all()
        assert len(times) == len(values) == 11


def test_short_motions_are_not_only_their_ends(planar2r: rp.Robot, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    coefficients = np.array([[[0.0, 0.0], [0.0, 0.0], [3e4, 3e4], [-2e6, -2e6]]])  # from rest to rest by 1 rad
    motion = rp.Trajectory(scene.joint_names(), np.array([0.0, 0.01]), coefficients)
    player = Player(rp.save_glb(tmp_path / "arm.glb", scene, trajectory=motion))
    model = rp.Kinematics(scene)
    tool = f"arm/{planar2r.tool}"
    for t in np.linspace(0.0, 0.01, 23):
        np.testing.assert_allclose(player.pose(tool, t), model.pose(motion(t), tool), atol=0.02)


def test_a_long_pause_takes_no_samples(planar2r: rp.Robot, tmp_path: Path) -> None:
    names, move = ("arm/joint1", "arm/joint2"), np.array([[[0.0, 0.2], [0.0, 0.0], [1.5, 0.3], [-1.0, -0.2]]])
    there = rp.Trajectory(names, [0.0, 1.0], move)
    moves = there.cut(0.0, 3601.0), rp.Trajectory(("arm2/joint1", "arm2/joint2"), [3600.0, 3601.0], move)
    motion = rp.Trajectory.merge(*moves)
    scene = rp.Scene().with_arm("arm", planar2r).with_arm("arm2", planar2r, [5.0, 0.0, 0.0])
    player = Player(rp.save_glb(tmp_path / "arm.glb", scene, trajectory=motion, rate=20.0))
    assert {len(times) for times, _, _ in player.tracks.values()} == {42}
    for t in (0.0, 0.5, 1.0, 1800.0, 3600.0, 3600.5, 3601.0):
        q = motion(t)
        expected = scene.link_poses({"arm": q[:2], "arm2": q[2:]})
        for name in ("arm/link2", "arm2/link2"):
            np.testing.assert_allclose(player.pose(name, t), expected[name], atol=1e-5)


def test_equal_values_give_equal_bytes(pair: rp.Scene, motion: rp.Trajectory, tmp_path: Path) -> None:
    files = [rp.save_glb(tmp_path / f"{i}.glb", pair, trajectory=motion) for i in range(2)]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_robots_problems_and_empty_scenes_are_written(rr1: rp.Robot, rr1_table: rp.Scene, tmp_path: Path) -> None:
    problem = rp.Problem(rr1_table, "home", rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
    for name, what in {"robot": rr1, "problem": problem, "nothing": rp.Scene()}.items():
        assert Player(rp.save_glb(tmp_path / f"{name}.glb", what)).content.nodes


def test_what_makes_no_sense_is_refused(pair: rp.Scene, motion: rp.Trajectory, tmp_path: Path) -> None:
    for words, file, what, more in (
        ("ends in .glb", "pair.gltf", pair, {}),
        ("has no page", "pair.glb", motion, {}),
        ("above zero", "pair.glb", pair, {"rate": 0}),
        (r"rate is 1e\+09, which makes more than", "pair.glb", pair, {"trajectory": motion, "rate": 1e9}),
        ("other than a scene", "pair.glb", pair.arms["left"].robot, {"trajectory": motion}),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.save_glb(tmp_path / file, what, **more)
    assert not list(tmp_path.iterdir())
