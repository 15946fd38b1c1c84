"""The certified edge by its kernel: against the exact kernel, Coal, its own variants, and under sanitizers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from concave_meshes import half_shell, soup, terrain, torus

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import CONTACT, FREE, EdgeKernel, ExactKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.kernels.planner_kernels import LIBRARY
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, PointCloud
from rr1plan.transforms import pose

TOLERANCE = 1e-6
ROOT = Path(__file__).parents[2]


def strange(odd):
    """Every shape that an arm or an obstacle may have."""
    cloud = PointCloud(np.random.default_rng(0).uniform(0.3, 0.6, (60, 3)), 0.03)
    scene = rp.Scene().with_arm("a", odd).with_obstacle("ground", HalfSpace((0, 0, 1), -0.01))
    scene = scene.with_obstacle("cloud", cloud).with_obstacle("can", Cylinder(0.05, 0.2), [-0.4, 0.2, 0.7])
    scene = scene.with_obstacle("stick", Capsule(0.02, 0.3), [-0.4, -0.3, 0.6])
    return scene.with_obstacle("plate", Box((0.3, 0.3, 0.001)), pose([0.2, -0.5, 0.6], rpy=[0.3, 0.2, 0.1]))


def holding(six):
    scene = rp.Scene().with_arm("a", six).with_obstacle("post", Box((0.1, 0.1, 1.0)), [0.5, 0.3, 0.5])
    held = scene.with_obstacle("tray", Box((0.2, 0.3, 0.02)), [9, 9, 9])
    return held.attach("tray", "a", touch=["l5"], pose=pose([0, 0, 0.12]))


def among_triangles(six):
    """A closed, a half open, an open and a hollow mesh that are not convex, and loose triangles."""
    scene = rp.Scene().with_arm("a", six).with_obstacle("ring", torus(), pose([0.45, 0.2, 0.3], rpy=[1.0, 0.3, 0]))
    scene = scene.with_obstacle("ground", terrain(12, 2.0), [0.0, 0.0, -0.08])
    scene = scene.with_obstacle("bowl", half_shell(), pose([-0.5, 0.1, 0.5], rpy=[0.4, 0.2, 0.1]))
    return scene.with_obstacle("scraps", soup(12, 0.3), [0.1, -0.6, 0.5])


@pytest.fixture(scope="module")
def worlds(cluttered, odd, six):
    return {
        "triangles": (among_triangles(six), 2.0),
        "triangles, padded": (among_triangles(six).with_padding(0.02), 2.0),
        "cluttered": (cluttered, 2.5),
        "padded": (cluttered.with_padding(0.03).with_padding(0.08, "arm", "ball"), 2.5),
        "strange": (strange(odd), 1.0),
        "strange, padded": (strange(odd).with_padding(0.02), 1.0),
        "holding": (holding(six), 2.0),
        "two arms": (rp.Scene().with_arm("l", six).with_arm("r", six, [0.7, 0, 0]).with_padding(0.01), 1.5),
        "rr1 pair": (rp.load_scene("rr1_pair"), 1.0),
        "planar": (rp.load_scene("planar2r_path"), 3.0),
    }


WORLDS = (
    "triangles",
    "triangles, padded",
    "cluttered",
    "padded",
    "strange",
    "strange, padded",
    "holding",
    "two arms",
    "rr1 pair",
    "planar",
)


def kernel_of(checker, library=None, queue_size=None):
    """A kernel with separate scratch memory."""
    exact = ExactKernel(checker.tables, checker.nq)
    exact.scratch.value.queue_size = queue_size or exact.scratch.value.queue_size
    tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, TOLERANCE)
    return EdgeKernel(tables, exact, checker.nq, library)


def questions(nq, wide, count, seed):
    """Edges, some of length zero, and parabolas with durations."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        q0 = rng.uniform(-wide, wide, nq)
        step = rng.normal(size=nq) * rng.choice([0.0, 0.02, 0.2, 0.6])
        duration = 10.0 ** rng.uniform(-3.0, 1.0)
        bend = rng.normal(size=nq) * rng.uniform(0.0, 1.0) - rng.choice([0.0, 1.0]) * step
        terms = 1 + i % 3
        yield q0, q0 + step, np.array([q0, step / duration, bend / duration**2])[:terms], duration


@pytest.mark.parametrize("name", WORLDS)
def test_verdicts_are_those_of_the_exact_kernel_and_contacts_are_coals(worlds, name):
    scene, wide = worlds[name]
    checker = CollisionChecker(scene)
    motion, kernel = checker, kernel_of(checker)
    free = contacts = 0
    for q0, q1, curve, duration in questions(checker.nq, wide, 300, 31):
        status, fraction, pair = kernel.certify_edge(q0, q1)
        assert (status == FREE) == motion.edge_is_free_slowly(q0, q1)
        parabola = kernel.certify_parabola(curve, duration)
        assert (parabola[0] == FREE) == (motion.first_contact_on(curve, duration) is None)
        free += status == FREE
        if status == CONTACT:
            contacts += 1
            distance = checker.solid_distances(q0 + fraction * (q1 - q0), [pair])[0]
            assert distance <= checker.solid_padding[pair] + 1e-6
    assert 20 < free < 290
    assert contacts > 5


@pytest.mark.parametrize("name", WORLDS)
def test_the_exact_kernel_is_right_about_curves_of_any_degree(worlds, name):
    """Coal confirms every contact, and every sample of a free curve is free."""
    scene, wide = worlds[name]
    checker = CollisionChecker(scene)
    kernel, rng = kernel_of(checker), np.random.default_rng(33)
    found = {FREE: 0, CONTACT: 0}
    for terms in (1, 2, 3, 5, 12):
        for _ in range(20):
            curve = np.array([rng.uniform(-wide, wide, checker.nq), *rng.normal(size=(terms - 1, checker.nq)) * 0.03])
            status, where, pair = kernel.certify_curve(curve, 1.3)
            found[status] += 1
            if status == CONTACT:
                q = where ** np.arange(terms) @ curve
                assert checker.solid_distances(q, [pair])[0] <= checker.solid_padding[pair] + 1e-6
            else:
                samples = np.power.outer(np.linspace(0.0, 1.3, 15), np.arange(terms)) @ curve
                assert all(checker.is_free_slowly(q) for q in samples)
    assert min(found.values()) > 5


@pytest.mark.parametrize("name", WORLDS)
def test_clearance_of_the_pairs_that_move_is_coals(worlds, name):
    scene, wide = worlds[name]
    checker = CollisionChecker(scene)
    for q in np.random.default_rng(34).uniform(-wide, wide, (40, checker.nq)):
        expected = float((checker.solid_distances(q) - checker.solid_padding).min())
        found = checker.exact_kernel.least_clearance(q, 0.3)
        if checker.solid_distances(q).min() > 1e-6:
            assert found == pytest.approx(min(expected, 0.3), abs=2e-5)
        else:
            assert found <= 1e-6 - float(checker.solid_padding.min())


@pytest.mark.parametrize("name", WORLDS)
def test_all_variants_give_the_same_bytes(worlds, name):
    scene, wide = worlds[name]
    checker = CollisionChecker(scene)
    told = set()
    for variant in LIBRARY.variants:
        kernel = kernel_of(checker, LIBRARY.load(LIBRARY.variant_file(variant)))
        answers = [
            (
                kernel.certify_edge(q0, q1),
                kernel.certify_parabola(curve, duration),
                kernel.certify_curve(curve, duration),
            )
            for q0, q1, curve, duration in questions(checker.nq, wide, 60, 34)
        ]
        told.add((repr(answers), kernel.scratch_bytes()))
    assert len(told) == 1


def test_a_far_angle_and_a_number_that_is_none_are_never_free_by_mistake(worlds):
    checker = CollisionChecker(worlds["cluttered"][0])
    kernel = kernel_of(checker)
    for q in np.random.default_rng(35).uniform(-2.5, 2.5, (40, checker.nq)):
        far = q + 2.0 * np.pi * 1e5
        near = np.arctan2(np.sin(far), np.cos(far))  # Coal's verdict, of the checker, is limited to 1e4
        assert (kernel.certify_edge(far, far)[0] == FREE) == checker.is_free_slowly(near)
        assert kernel.certify_edge(q + 1e14, q + 1e14 + 7.0)[0] != FREE
    for bad in (np.nan, np.inf, -np.inf):
        q = np.zeros(checker.nq)
        q[2] = bad
        assert kernel.certify_edge(q, q)[0] != FREE
        assert kernel.certify_edge(np.zeros(checker.nq), q)[0] != FREE


def test_a_full_queue_changes_the_order_and_no_verdict(worlds):
    """The exact kernel takes the widest intervals first; where its memory is half full, the narrowest."""
    checker = CollisionChecker(worlds["strange"][0])
    roomy = kernel_of(checker)
    tight = kernel_of(checker, queue_size=1 << (3 * len(checker.tables.pairs)).bit_length())
    for q0, q1, _, _ in questions(checker.nq, 1.0, 200, 36):
        for stretch in (0.5, 3.0, 10.0):
            curve = np.array([q0, stretch * (q1 - q0)])
            assert (tight.certify_curve(curve, 1.0)[0] == FREE) == (roomy.certify_curve(curve, 1.0)[0] == FREE)
    counts = [kernel.counters.configurations for kernel in (tight, roomy)]
    assert counts[0] != counts[1]


def test_kernels_of_one_thread_share_lists_and_answer_as_alone(worlds):
    """Lists keep no state between calls, so alternating kernels give the results of kernels in separate threads."""
    names = ("cluttered", "two arms", "planar", "triangles")
    checkers = [CollisionChecker(worlds[name][0]) for name in names]
    asked = [list(questions(c.nq, worlds[name][1], 25, 38)) for c, name in zip(checkers, names, strict=True)]

    def answers(kernel, question):
        q0, q1, curve, duration = question
        return (
            kernel.certify_edge(q0, q1),
            kernel.certify_parabola(curve, duration),
            kernel.certify_curve(curve, duration),
        )

    def alone(checker, own):
        kernel = kernel_of(checker)
        return [answers(kernel, question) for question in own]

    def lists(kernel):
        _ = kernel.context
        return kernel._scratch.value.intervals

    with ThreadPoolExecutor(len(names)) as pool:
        expected = list(pool.map(alone, checkers, asked))
        kernels = [kernel_of(checker) for checker in checkers]
        turns = [[answers(*both) for both in zip(kernels, row, strict=True)] for row in zip(*asked, strict=True)]
        assert [list(column) for column in zip(*turns, strict=True)] == expected
        pair = [kernel_of(checkers[0]), kernel_of(checkers[0])]
        here = {lists(kernel) for kernel in pair}
        assert len(here) == 1
        assert pool.submit(lists, kernels[0]).result() not in here
        moved, halves = kernel_of(checkers[0]), (asked[0][::2], asked[0][1::2])
        found = []
        for one, two in zip(halves[0], [*halves[1], None], strict=True):
            found.append(answers(moved, one))
            if two is not None:
                found.append(pool.submit(answers, moved, two).result())
        assert found == expected[0]


def test_bodies_of_a_planar_arm_are_no_contact_for_lack_of_a_volume():
    """A corner that the search finds twice spans no volume around the origin; rounding alone did, with fused sums."""
    arm = rp.load_robot("planar2r")
    needle = Capsule(0.0005, 1.2755500448673367)
    scene = rp.Scene().with_arm("arm", arm)
    rng = np.random.default_rng(37)
    for i in range(6):
        scene = scene.with_obstacle(
            f"needle{i}", needle, pose([*rng.uniform(-1, 1, 2), 0.0], rpy=rng.uniform(-3, 3, 3))
        )
    checker = CollisionChecker(scene.with_padding(0.015))
    motion = checker
    kernel, free = kernel_of(checker), 0
    for q0, q1, curve, duration in questions(checker.nq, 3.0, 300, 38):
        answer = motion.first_contact_on(curve, duration) is None
        free += answer
        assert (kernel.certify_parabola(curve, duration)[0] == FREE) == answer
        assert (kernel.certify_edge(q0, q1)[0] == FREE) == motion.edge_is_free_slowly(q0, q1)
    assert 20 < free < 280


def test_many_edges_by_one_call(worlds):
    checker = CollisionChecker(worlds["holding"][0])
    kernel = kernel_of(checker)
    pairs = [(q0, q1) for q0, q1, _, _ in questions(checker.nq, 2.0, 50, 39)]
    begins, ends = (np.array(rows) for rows in zip(*pairs, strict=True))
    assert kernel.certify_edges(begins, ends).tolist() == [kernel.certify_edge(*ends_of)[0] for ends_of in pairs]


# ---- under sanitizers ------------------------------------------------------------------------------


def _sanitizers():
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
def test_no_memory_is_misused_and_nothing_is_undefined(tmp_path):
    """Compiled by another compiler, with its sanitizers; that takes some ten seconds.

    Edges, plans, shorter paths, motions and inverse kinematics are those of the library that ships, to the last bit.
    """
    gcc, preloaded = _sanitizers()
    code = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from pathlib import Path
import hatch_build
flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Og"]
out = Path({str(tmp_path)!r}) / "checked.so"
hatch_build.compile_kernels(hatch_build.UNITS[0], out, "-shared", "-fPIC", *flags, compiler=[{gcc!r}])
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("sanitized_kernels.py"), tmp_path / "checked.so"],
        env=os.environ | {"LD_PRELOAD": preloaded, "ASAN_OPTIONS": "detect_leaks=0"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.startswith("same answers")
