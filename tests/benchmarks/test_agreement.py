"""The comparison with Coal: small, on all robots that are here, and with errors planted to be found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.transforms import pose


@pytest.mark.parametrize("robot", ["planar2r", "rr1", "panda", "ur5"])
def test_compiled_answers_are_coals(script, tmp_path, robot):
    """Thousands of configurations and hundreds of edges in cluttered and shipped scenes."""
    agreement = script("agreement")
    if robot in agreement.FOREIGN and agreement.find_urdf(agreement.FOREIGN[robot], None) is None:
        pytest.skip("the package example-robot-data is not installed; try: pip install 'rr1plan[robots]'")
    sizes = ["--configurations", "1500", "--edges", "120", "--out", str(tmp_path)]
    assert agreement.main(["--robot", robot, *sizes]) == 0
    scenes = json.loads((tmp_path / "agreement.json").read_text())["scenes"]
    asked = {what: sum(scene[what]["asked"] for scene in scenes) for what in ("configurations", "edges")}
    assert asked == {"configurations": 1500, "edges": 120}
    edges = [scene["edges"] for scene in scenes]
    told = [sum(e.get(name, 0) for e in edges) for name in ("proven", "contact confirmed", "narrow", "grazing")]
    assert sum(told) == 120
    assert min(told[:2]) > 12
    assert "No answer differs." in (tmp_path / "agreement.md").read_text()


# ---- errors are found ----------------------------------------------------------------------


@pytest.mark.parametrize(("status", "what"), [(0, "Coal: contact"), (1, "Coal: free there")])
def test_a_kernel_with_one_answer_for_all_is_found_out(script, tmp_path, monkeypatch, status, what):
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
    """Coal's proof for the planar arm beside things, and the checker it asks."""
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
