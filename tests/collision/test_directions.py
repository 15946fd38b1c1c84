"""Separating directions in lanes against Coal's distances."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from rr1plan._kernels.cover import RECORD, tables_of
from rr1plan._kernels.directions import separate
from rr1plan._kernels.jit import F64, FLOATS1, I64
from rr1plan._kernels.lanes import WIDTH, fill
from rr1plan._kernels.placing import bound_motion, place_ball, place_frames, place_spheres, take_edge
from rr1plan.collision.swept import SweptEdges

from rr1plan.collision import CollisionChecker
from rr1plan.library import load_scene
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Sphere
from rr1plan.transforms import pose

ALL = (1 << WIDTH) - 1


@numba.njit(
    numba.types.UniTuple(I64, 3)(FLOATS1, FLOATS1, I64, I64, I64, numba.types.UniTuple(I64, 3), F64, F64, F64, RECORD)
)
def ask(begin, end, a, b, o, near, padding, push, half, record):
    """Whether a body is told apart from another thing around the middle of an edge."""
    cover, work, _, _ = tables_of(record)
    work.counts[3] += 1
    h = fill(half)
    take_edge(begin, end, work)
    bound_motion(cover, work)
    place_frames(fill(0.5), cover, work)
    for k in range(cover.bodies.shape[0]):
        place_ball(cover.bodies[k, 3], cover.bodies[k, 1], h, cover, work)
        place_spheres(k, h, cover, work)
    return separate(a, b, o, 0, near, padding, push, (1 << 8) - 1, h, record)


def furnished(odd):
    scene = Scene().with_arm("a", odd).with_obstacle("ground", HalfSpace((0.1, 0, 1), -0.3))
    scene = scene.with_obstacle("can", Cylinder(0.05, 0.2), pose([-0.4, 0.2, 0.7], rpy=[0.3, 0.4, 0]))
    scene = scene.with_obstacle("ball", Sphere(0.1), [0.3, 0.3, 0.4])
    scene = scene.with_obstacle("stick", Capsule(0.02, 0.3), pose([-0.4, -0.3, 0.6], rpy=[1.0, 0.2, 0]))
    return scene.with_obstacle("block", Box((0.2, 0.1, 0.3)), pose([0.35, -0.3, 0.5], rpy=[0.1, 0.7, 0.4]))


def pairs_of(edges):
    """Core, other core or -1, obstacle or -1, spheres to begin with, index of the pair."""
    cover = edges.tables[0]
    for b in range(len(cover.bodies)):
        ball = int(cover.bodies[b, 1])
        for o in range(cover.pair_of.shape[1]):
            if cover.pair_of[b, o] >= 0 and cover.core_of[o] > -2:
                yield b, int(cover.core_of[o]), o, (ball, ball), int(cover.pair_of[b, o])
    for a, b, _, pair, *_ in cover.meetings.tolist():
        yield a, b, -1, (int(cover.bodies[a, 1]), int(cover.bodies[b, 1])), pair


@pytest.mark.parametrize("name", ["odd", "rr1_cluttered"])
def test_what_is_told_apart_is_apart_and_what_touches_touches(odd, name):
    checker = CollisionChecker(furnished(odd) if name == "odd" else load_scene(name))
    edges = SweptEdges(checker, 1e-6)
    found = {"apart": 0, "touching": 0, "open": 0}
    rng = np.random.default_rng(5)
    for _ in range(25):
        q = rng.uniform(-2.0, 2.0, checker.nq)
        for a, b, o, (one, two), pair in pairs_of(edges):
            distance = checker.solid_distance(q, pair)
            for padding in (0.0, max(distance - 0.002, 0.0), max(distance, 0.0) + 0.002):
                left, _, touching = ask(q, q, a, b, o, (pair, one, two), padding, 0.0, 0.0, edges.record)
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
    edges = SweptEdges(checker, 1e-6)
    proven = 0
    rng = np.random.default_rng(6)
    for _ in range(40):
        q0 = rng.uniform(-2.0, 2.0, checker.nq)
        q1 = q0 + rng.normal(size=checker.nq) * 0.2
        for a, b, o, (one, two), pair in pairs_of(edges):
            if b >= 0 and o < 0:
                continue
            ask(q0, q1, a, b, o, (pair, one, two), 0.0, 0.0, 0.0, edges.record)
            push = float(edges.tables[1].pushes[edges.tables[0].bodies[a, 3], 0])
            left, _, touching = ask(q0, q1, a, b, o, (pair, one, two), 0.0, push, 0.5, edges.record)
            if left or touching:
                continue
            proven += 1
            for t in np.linspace(0.0, 1.0, 9):
                assert checker.solid_distance(q0 + t * (q1 - q0), pair) > 0.0
    assert proven > 100
