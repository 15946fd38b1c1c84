"""The referee's library: every variant gives the same verdicts, and threads do not affect each other."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from concave_meshes import torus
from scipy.spatial import ConvexHull

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.transforms import pose
from rr1plan.validation.bernstein_extremes import extremes
from rr1plan.validation.collision_proof import prove
from rr1plan.validation.compiled_search import ProofOptions
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import moving_scene
from rr1plan.validation.referee_kernels import LIBRARY

Make = Callable[..., Any]


@pytest.fixture
def by_each_variant(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Any]], list[Any]]:
    """Results of a function with each variant of the library, the fastest first."""

    def run(function: Callable[[], Any]) -> list[Any]:
        found = []
        for variant in LIBRARY.variants:
            monkeypatch.setitem(LIBRARY.__dict__, "fastest", LIBRARY.load(LIBRARY.variant_file(variant)))
            found.append(function())
        return found

    return run


def wander(scene: rp.Scene, rng: np.random.Generator, reach: float) -> rp.Trajectory:
    """Two cubics, one after the other."""
    c = reach * rng.normal(size=(2, 4, len(scene.joint_names())))
    c[0, 0] = scene.configuration()
    c[1, 0] = c[0].sum(axis=0)
    return rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0, 2.0]), c)


def findings(scene: rp.Scene, move: rp.Trajectory) -> tuple[Array, dict[str, float]]:
    """All results of the search for the pairs, and its operation counts."""
    motion = TimedColumns(move.joint_names, move.breaks, move.coefficients)
    found = prove(moving_scene(scene, move.joint_names), motion, ProofOptions(2e-4, 400_000))
    contacts = [(contact.clearance, contact.time, contact.first) for contact in found.contacts]
    nearest = [(one.clearance, one.time) for one in (*found.nearest, *found.ends) if one is not None]
    return np.concatenate([np.ravel(row) for row in (contacts, nearest, found.proven)]), found.statistics


def hull(rng: np.random.Generator, count: int) -> rp.Mesh:
    """A convex body with many corners, which are processed in groups of eight and by tables."""
    corners = rng.normal(size=(count, 3))
    corners *= 0.1 / np.linalg.norm(corners, axis=1)[:, None]
    return rp.Mesh(corners, ConvexHull(corners).simplices, convex=True)


@pytest.mark.parametrize("seed", range(4))
def test_all_variants_find_the_same_beside_a_sliding_body(
    seed: int, slider: Make, shape: Make, by_each_variant: Make
) -> None:
    """No sine is computed, so every bit is the same."""
    rng = np.random.default_rng(seed)
    body = hull(rng, (20, 300)[seed % 2])
    scene = rp.Scene().with_arm("arm", slider(body))
    for k in range(4):
        scene = scene.with_obstacle(f"thing{k}", shape(rng), pose([k - 1.5, 0.22, 0.05], rpy=rng.normal(size=3)))
    move = wander(scene, rng, 0.5)
    first, *others = by_each_variant(lambda: findings(scene, move))
    assert first[1]["searches"] > 10
    for other in others:
        assert other[0].tobytes() == first[0].tobytes()
        assert other[1] == first[1]


@pytest.mark.parametrize("seed", range(3))
def test_all_variants_find_the_same_beside_an_arm_that_turns(
    seed: int, chain: Make, shape: Make, by_each_variant: Make
) -> None:
    """Sines are those of the C library, which may differ from variant to variant in the last bit."""
    rng = np.random.default_rng(seed)
    scene = rp.Scene().with_arm("arm", chain(rng, 4))
    for k in range(3):
        scene = scene.with_obstacle(f"thing{k}", shape(rng), pose(0.8 * rng.normal(size=3), rpy=rng.normal(size=3)))
    move = wander(scene, rng, 0.1)
    first, *others = by_each_variant(lambda: findings(scene, move))
    for other in others:
        np.testing.assert_allclose(other[0], first[0], rtol=0.0, atol=1e-12)


def test_all_variants_find_the_same_extremes(by_each_variant: Make) -> None:
    rng = np.random.default_rng(0)
    breaks, coefficients = np.cumsum(rng.uniform(0.1, 1.0, 9)), rng.normal(size=(8, 6, 5))
    first, *others = by_each_variant(lambda: extremes(breaks, coefficients))
    for other in others:
        assert all((getattr(first, name) == getattr(other, name)).all() for name in ("peaks", "jumps", "end"))


def test_all_variants_find_the_same_beside_a_cloud_and_a_mesh(shape: Make, slider: Make, by_each_variant: Make) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (4000, 3)) * [1.0, 1.0, 0.05]
    for body in (hull(rng, 200), shape(rng), torus(0.1, 0.03)):
        scene = (
            rp.Scene().with_arm("arm", slider(body)).with_obstacle("cloud", rp.PointCloud(points, 0.02), [0, 0, 0.3])
        )
        scene = scene.with_obstacle("ring", torus(0.3, 0.05), [0.9, 0.0, -0.2])
        move = wander(scene, rng, 0.3)
        first, *others = by_each_variant(lambda scene=scene, move=move: findings(scene, move))
        for other in others:
            assert other[0].tobytes() == first[0].tobytes()


def test_threads_may_validate_motions_of_different_arms_in_one_scene(chain: Make) -> None:
    rng = np.random.default_rng(4)
    robot = chain(rng, 3)
    scene = rp.Scene()
    for i in range(6):
        scene = scene.with_arm(f"arm{i}", robot, [0.5 * i, 0.0, 0.0])
    moves = []
    for i in range(6):
        names = scene.joint_names([f"arm{i}"])
        rows = 0.3 * rng.normal(size=(3, len(names))) * np.array([[0.0], [1.0], [1.0]])
        moves.append(rp.Trajectory.from_samples(names, [0.0, 0.5, 1.0], rows, np.zeros_like(rows)))
    alone = [findings(scene, move)[0].tobytes() for move in moves]
    with ThreadPoolExecutor(6) as threads:
        together = list(threads.map(lambda move: findings(scene, move)[0].tobytes(), moves * 20))
    assert together == alone * 20


def _sanitizers() -> tuple[str, str] | None:
    """The compiler, and what its programs load first under AddressSanitizer; None if it has none."""
    gcc = shutil.which("gcc")
    if sys.platform != "linux" or gcc is None:
        return None
    # The latter so that the former finds how exceptions are thrown.
    names = ("libasan.so", "libstdc++.so")
    found = [
        subprocess.run([gcc, f"-print-file-name={name}"], capture_output=True, text=True, check=True) for name in names
    ]
    files = [Path(one.stdout.strip()) for one in found]
    return (gcc, " ".join(str(file.resolve()) for file in files)) if files[0].is_absolute() else None


@pytest.mark.skipif(_sanitizers() is None, reason="no gcc with AddressSanitizer")
def test_no_memory_is_misused_and_nothing_is_undefined(tmp_path: Path) -> None:
    """Compiled by another compiler, with its sanitizers; answers are those of the library that ships."""
    sanitizers = _sanitizers()
    assert sanitizers is not None
    gcc, preloaded = sanitizers
    root = Path(__file__).parents[2]
    code = f"""
import sys
sys.path.insert(0, {str(root)!r})
from pathlib import Path
import hatch_build
flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Og"]
out = Path({str(tmp_path)!r}) / "checked.so"
hatch_build.compile_kernels(hatch_build.UNITS[1], out, "-shared", "-fPIC", *flags, compiler=[{gcc!r}])
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("sanitized_search.py"), tmp_path / "checked.so"],
        env=os.environ | {"LD_PRELOAD": preloaded, "ASAN_OPTIONS": "detect_leaks=0"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.startswith("same answers")
