"""The comparison with Coal: small samples on all installed robots, and planted errors that it has to find."""

from __future__ import annotations

import json
from pathlib import Path

import concave_meshes
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.collision.convex.convex_bodies import holds_point
from rr1plan.transforms import pose


@pytest.mark.parametrize("robot", ["planar2r", "rr1", "panda", "ur5"])
def test_compiled_results_are_those_of_coal(script, tmp_path, robot):
    """Thousands of configurations and hundreds of edges in cluttered and shipped scenes."""
    agreement = script("agreement")
    if robot in agreement.FOREIGN and agreement.find_urdf(agreement.FOREIGN[robot], None) is None:
        pytest.skip("the package example-robot-data is not installed; try: pip install 'rr1plan[robots]'")
    sizes = ["--configurations", "1500", "--edges", "120", "--out", str(tmp_path)]
    assert agreement.main(["--robot", robot, *sizes]) == 0
    scenes = json.loads((tmp_path / "agreement.json").read_text())["scenes"]
    checked = {what: sum(scene[what]["checked"] for scene in scenes) for what in ("configurations", "edges")}
    assert checked == {"configurations": 1500, "edges": 120}
    edges = [scene["edges"] for scene in scenes]
    told = [sum(e.get(name, 0) for e in edges) for name in ("proven", "contact confirmed", "narrow", "grazing")]
    assert sum(told) == 120
    assert min(told[:2]) > 12
    assert "No result differs." in (tmp_path / "agreement.md").read_text()


# ---- errors are found ----------------------------------------------------------------------


@pytest.mark.parametrize(("status", "what"), [(0, "Coal: contact"), (1, "Coal: free there")])
def test_a_kernel_with_one_result_for_all_is_found_out(script, tmp_path, monkeypatch, status, what):
    agreement = script("agreement")

    def always(self, begins, ends):
        return np.full(len(begins), status), np.full(len(begins), 0.5)

    monkeypatch.setattr(agreement.Comparison, "_certify", always)
    arguments = ["--robot", "planar2r", "--configurations", "80", "--edges", "80", "--out", str(tmp_path)]
    assert agreement.main(arguments) == 1
    scenes = json.loads((tmp_path / "agreement.json").read_text())["scenes"]
    differences = [d for scene in scenes for d in scene["differences"]]
    assert any(what in d["what"] for d in differences)
    assert all(d["at least"] < -agreement.BAND or d["at most"] > agreement.BAND for d in differences)
    assert what in (tmp_path / "agreement.md").read_text()


@pytest.fixture
def proof_of(script):
    """Coal's proof for the planar arm next to objects, and its checker."""
    coal_proof = script("coal_proof")

    def make(shape, place, padding=0.0):
        scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r")).with_obstacle("thing", shape, place)
        checker = CollisionChecker(scene.with_padding(padding, "arm", "thing"))
        return coal_proof.CoalProof(checker), coal_proof.PlainCoal(checker.scene)

    return make


@pytest.mark.parametrize("thin", [rp.Box((0.001, 0.3, 0.3)), rp.Cylinder(0.0005, 0.4), rp.Capsule(0.0005, 0.4)])
def test_an_edge_through_something_thin_is_a_contact_and_one_beside_it_is_proven(proof_of, thin):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        angle, far = rng.uniform(-3.0, 3.0), rng.uniform(0.5, 1.5)
        place = pose([far * np.cos(angle), far * np.sin(angle), 0.0], rpy=[0.0, 0.0, rng.uniform(-3.0, 3.0)])
        proof, _ = proof_of(thin, place)
        swing = np.array([rng.uniform(0.3, 1.5), 0.0])
        straight = np.array([angle, 0.0])
        assert proof.judge(straight - swing, straight + 1.1 * swing)[0] == "contact"
        away = np.array([angle + np.pi, 0.0])
        assert proof.judge(away - swing, away + swing)[0] == "free"


@pytest.mark.parametrize(("gap", "verdict"), [(1e-3, "free"), (1e-4, "free"), (8e-6, "narrow"), (-1e-6, "contact")])
def test_what_passes_within_coals_error_is_told_apart(proof_of, gap, verdict):
    """The arm's round end reaches 1.74 m."""
    proof, _ = proof_of(rp.Sphere(0.1), [1.84 + gap, 0.0, 0.0])
    assert proof.judge(np.array([-0.2, 0.0]), np.array([0.2, 0.0]))[0] == verdict


@pytest.mark.parametrize("padding", [0.0, 0.02])
@pytest.mark.parametrize(
    ("shape", "size"),
    [
        (rp.Sphere(0.1), 0.1),
        (rp.Box((0.2, 0.2, 0.2)), 0.1),
        (rp.Cylinder(0.1, 0.2), 0.1),
        (rp.Capsule(0.1, 0.2), 0.1),
        (rp.HalfSpace((-1.0, 0.0, 0.0)), 0.0),
        (rp.PointCloud([[-0.05, 0.0, 0.0]], 0.1), 0.1),
    ],
)
def test_a_distance_is_bracketed_to_a_nanometer(proof_of, shape, size, padding):
    for gap in (0.3, 1e-3, 3e-7, -3e-7, -1e-3):
        _, plain = proof_of(shape, [1.74 + size + gap, 0.0, 0.0], padding)
        found = plain.bracket(np.zeros(2))
        assert found.lower == pytest.approx(gap - padding, abs=2e-9)
        assert found.upper == pytest.approx(max(gap, 0.0 if size else gap) - padding, abs=2e-9)
        assert set(found.pair) == {"arm/link2", "thing"}
        assert plain.is_free(np.zeros(2)) == (gap > padding)


def test_swings_reach_all_that_a_joint_carries(script):
    coal_proof = script("coal_proof")
    assert coal_proof.swings(rp.Scene().with_arm("arm", rp.load_robot("planar2r"))) == pytest.approx([1.74, 0.74])
    scene = rp.load_scene("rr1_pair")
    swings, rng = coal_proof.swings(scene), np.random.default_rng(0)
    checker = CollisionChecker(scene)
    for _ in range(20):
        q = rng.uniform(checker.limits.lower, checker.limits.upper)
        step = np.zeros(checker.nq)
        column = rng.integers(checker.nq)
        step[column] = 0.01
        moved = np.abs(checker.distances(q + step) - checker.distances(q))
        apart = checker.distances(q) > 0.02
        assert moved[apart].max() <= 0.01 * swings[column] + 1e-5


def test_a_robot_without_a_file_is_left_out(script, tmp_path, monkeypatch):
    agreement = script("agreement")
    monkeypatch.setattr(agreement, "find_urdf", lambda name, folder: None)
    assert agreement.main(["--robot", "ur5", "--out", str(tmp_path)]) == 0
    assert json.loads(Path(tmp_path / "agreement.json").read_text())["scenes"] == []


# ---- many arms ------------------------------------------------------------------------------


@pytest.mark.parametrize("scenes", ["2 at 0.35 m", "4 at 0.5 m, 3 move", "margin", "rods", "all shapes", "planar2r"])
def test_compiled_results_are_those_of_coal_among_many_arms(script, tmp_path, monkeypatch, scenes):
    """Equal arms and two robots, some stationary, next to all shapes, with margin, padding and attached rods."""
    agreement = script("agreement")
    monkeypatch.setattr(agreement, "find_urdf", lambda name, folder: None)
    sizes = ["--configurations", "120", "--edges", "24", "--out", str(tmp_path)]
    assert agreement.main(["--robot", "crowds", "--scenes", scenes, *sizes]) == 0
    found = json.loads((tmp_path / "agreement.json").read_text())["scenes"]
    assert all(scenes in scene["scene"] for scene in found)
    configurations = [scene["configurations"] for scene in found]
    assert sum(c["checked"] for c in configurations) == 120
    assert 0 < sum(c["free"] for c in configurations) < 120
    edges = [scene["edges"] for scene in found]
    assert sum(e.get(n, 0) for e in edges for n in ("proven", "contact confirmed", "narrow", "grazing")) == 24
    assert sum(e.get("judged", 0) for e in edges) > 0 or scenes == "margin"


def test_arms_on_a_narrow_grid_find_room(script):
    crowds = list(script("clutter").crowds(rp.load_robot("rr1"), [], 0))
    assert {len(crowd.scene.arms) for crowd in crowds} == {2, 4, 16}
    assert any(crowd.arms is not None and len(crowd.arms) < len(crowd.scene.arms) for crowd in crowds)
    for crowd in crowds:
        checker = CollisionChecker(crowd.scene, crowd.arms)
        assert checker.is_free(crowd.scene.configuration(crowd.arms))
    again = list(script("clutter").crowds(rp.load_robot("rr1"), [], 0))
    assert [a.scene.content_hash for a in again] == [b.scene.content_hash for b in crowds]


# ---- concave meshes -------------------------------------------------------------------------


@pytest.mark.parametrize("turned_round", [False, True])
@pytest.mark.parametrize("name", ["mug", "angle_block", "half_shell", "torus"])
def test_what_is_inside_a_concave_mesh_is_a_contact(script, name, turned_round):
    """A ball of a nanometer against the winding number that Coal's checker decides by."""
    mesh = getattr(concave_meshes, name)()
    if turned_round:
        mesh = rp.Mesh(mesh.vertices, mesh.faces[:, ::-1])
    surface = script("coal_proof").Surface(mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, (400, 3))
    inside = np.array([surface.holds(point) for point in points])
    assert inside.tolist() == [holds_point(mesh, point) for point in points]
    assert 0.02 < inside.mean() < 0.98


@pytest.mark.parametrize("mesh", [concave_meshes.terrain(6), concave_meshes.open_bowl(), concave_meshes.soup()])
def test_an_open_surface_has_no_inside(script, mesh):
    surface = script("coal_proof").Surface(mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = np.random.default_rng(1).uniform(low, high, (100, 3))
    assert not any(surface.holds(point) for point in points)


def test_an_edge_within_a_ring_is_proven_and_one_out_of_it_is_not(proof_of):
    """The arm is 8 cm thick and points through a ring, whose hole of 28 cm a convex hull would fill."""
    proof, plain = proof_of(concave_meshes.torus(0.2, 0.06), pose([1.2, 0.0, 0.0], rpy=[0.0, np.pi / 2, 0.0]))
    for swing in (0.05, 0.07):
        assert proof.judge(np.array([-swing, 0.0]), np.array([swing, 0.0])) == ("free", 0.0)
    begin, end = np.array([-0.05, 0.0]), np.array([0.4, 0.0])
    verdict, where = proof.judge(begin, end)
    assert verdict == "contact"
    q = begin + where * (end - begin)
    assert not plain.is_free(q)
    assert plain.bracket(q).lower < 0.0


@pytest.mark.parametrize("padding", [0.0, 0.02])
def test_the_distance_of_a_concave_mesh_is_bracketed(proof_of, padding):
    """The arm's round end reaches 1.74 m; the block's face is at x = 0 of its frame."""
    for gap in (0.3, 1e-3, 3e-7, -3e-7, -1e-3):
        _, plain = proof_of(concave_meshes.angle_block(), [1.74 + gap, -0.05, -0.07], padding)
        found = plain.bracket(np.zeros(2))
        assert found.lower == pytest.approx(gap - padding, abs=2e-9)
        assert found.upper == pytest.approx(max(gap, 0.0) - padding, abs=2e-9)
        assert plain.is_free(np.zeros(2)) == (gap > padding)
    # Wholly inside: no triangle is touched.
    _, plain = proof_of(rp.Mesh(*_shell(3.0)), [0.0, 0.0, 0.0], padding)
    found = plain.bracket(np.zeros(2))
    assert (found.lower, found.upper) == (-np.inf, -padding)
    assert not plain.is_free(np.zeros(2))


def _shell(half):
    """Corners and triangles of a concave cube with a notch in its top."""
    block = concave_meshes.angle_block(2.0 * half, 1.5 * half)
    return block.vertices * [1.0, 1.0, 2.0 * half / 0.15] - [0.75 * half, 0.75 * half, half], block.faces
