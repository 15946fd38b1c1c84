"""Separating directions in lanes against Coal's distances."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.kernels.planner_kernels import constants, load_library, zeroed
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Sphere
from rr1plan.transforms import pose

LANES, LEFT_OUT = constants()["LANES"], constants()["CORE_LEFT_OUT"]
ALL = 2**LANES - 1


class Separation:
    """Pairs of bodies by directions, around the middle of an edge, at any padding."""

    def __init__(self, checker):
        tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, 1e-6)
        # A copy, so that it can be written.
        self.tables = tables._replace(padding=tables.padding.copy())
        self.kernel = EdgeKernel(self.tables, checker.exact_kernel, checker.nq)
        self.spheres = zeroed("SphereProbe", len(tables.arm.spheres))

    def candidates(self):
        """Each pair for the kernel: body, obstacle or other body, row of `body_pairs`, pair, lanes, spheres, stuck."""
        bodies, pair_of = self.tables.arm.bodies, self.tables.pairs.pair_of
        for b, o in np.argwhere(pair_of >= 0).tolist():
            if self.tables.obstacles.part("core")[o] != LEFT_OUT:
                yield [b, o, -1, int(pair_of[b, o]), ALL, int(bodies[b, 1]), int(bodies[b, 1]), 0]
        for m, (a, b, _, pair, *_) in enumerate(self.tables.pairs.body_pairs.tolist()):
            yield [a, b, m, pair, ALL, int(bodies[a, 1]), int(bodies[b, 1]), 0]

    def place(self, q0, q1, half):
        """Compute all poses at the middle of an edge."""
        curve, lanes = np.array([q0, q1 - q0, 0.0 * q0]), np.ones(LANES)
        load_library().rr1_place_spheres(*self.kernel.context, curve, 0.5 * lanes, half * lanes, self.spheres)

    def ask(self, candidate, padding, half):
        """Lanes in which a candidate is open, and in which it touches, so far before and after the middle."""
        found = np.zeros(3, np.uint64)
        self.tables.padding[candidate[3]] = padding
        load_library().rr1_separate(*self.kernel.context, np.array([candidate]), half, found)
        return int(found[0]), int(found[2])


def furnished(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("ground", HalfSpace((0.1, 0, 1), -0.3))
    scene = scene.with_obstacle("can", Cylinder(0.05, 0.2), pose([-0.4, 0.2, 0.7], rpy=[0.3, 0.4, 0]))
    scene = scene.with_obstacle("ball", Sphere(0.1), [0.3, 0.3, 0.4])
    scene = scene.with_obstacle("stick", Capsule(0.02, 0.3), pose([-0.4, -0.3, 0.6], rpy=[1.0, 0.2, 0]))
    return scene.with_obstacle("block", Box((0.2, 0.1, 0.3)), pose([0.35, -0.3, 0.5], rpy=[0.1, 0.7, 0.4]))


@pytest.mark.parametrize("name", ["odd", "rr1_cluttered"])
def test_what_is_told_apart_is_apart_and_what_touches_touches(odd, name):
    checker = CollisionChecker(furnished(odd) if name == "odd" else load_scene(name))
    separation = Separation(checker)
    found = {"apart": 0, "touching": 0, "open": 0}
    rng = np.random.default_rng(5)
    for _ in range(25):
        q = rng.uniform(-2.0, 2.0, checker.nq)
        separation.place(q, q, 0.0)
        for candidate in separation.candidates():
            distance = checker.solid_distances(q, [candidate[3]])[0]
            for padding in (0.0, max(distance - 0.002, 0.0), max(distance, 0.0) + 0.002):
                left, touching = separation.ask(candidate, padding, 0.0)
                assert touching in (0, ALL)
                if touching:
                    found["touching"] += 1
                    assert distance < padding + 1e-5
                elif left == 0:
                    found["apart"] += 1
                    assert distance > padding - 1e-5
                else:
                    found["open"] += 1
    assert found["apart"] > 500
    assert found["touching"] > 500
    assert found["open"] < 0.1 * sum(found.values())


def test_an_interval_that_is_told_apart_is_apart_everywhere(odd):
    checker = CollisionChecker(furnished(odd))
    separation = Separation(checker)
    proven = 0
    rng = np.random.default_rng(6)
    for _ in range(40):
        q0 = rng.uniform(-2.0, 2.0, checker.nq)
        q1 = q0 + rng.normal(size=checker.nq) * 0.2
        separation.place(q0, q1, 0.5)
        for candidate in separation.candidates():
            left, touching = separation.ask(candidate, 0.0, 0.5)
            if left or touching:
                continue
            proven += 1
            for t in np.linspace(0.0, 1.0, 9):
                assert checker.solid_distances(q0 + t * (q1 - q0), [candidate[3]])[0] > 0.0
    assert proven > 100
