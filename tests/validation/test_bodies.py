"""The bounds on which the certificate is based, against actual motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from slow_certificate.certificate_bodies import Bodies
from slow_certificate.scene_motion import SceneMotion

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.transforms import pose

Make = Callable[..., Any]


def still_life(scene: rp.Scene) -> tuple[SceneMotion, Bodies]:
    names = scene.joint_names()
    motion = SceneMotion(scene.arms, names, np.zeros(1), np.zeros((1, 1, len(names))))
    return motion, Bodies(scene, motion, scene.checked_pairs)


def distances(motion: SceneMotion, bodies: Bodies, q: Array) -> Array:
    placed = bodies.place(motion.frames(q[None]))
    items = np.arange(len(bodies.a))
    return bodies.clearances(placed, np.zeros_like(items), items)[0]


def scene_of(name: str, rng: np.random.Generator, chain: Make, shape: Make) -> rp.Scene:
    if name != "random":
        return rp.load_scene(name)
    scene = rp.Scene().with_arm("a", chain(rng, 4)).with_arm("b", chain(rng, 3), pose(rng.normal(size=3)))
    return scene.with_obstacle("thing", shape(rng), rng.normal(size=3)).with_obstacle("floor", rp.HalfSpace())


@pytest.mark.parametrize("name", ["random", "rr1_pair", "rr1_cluttered"])
@pytest.mark.parametrize("size", [1e-3, 0.1, 1.5, 4.0])
def test_no_pair_comes_nearer_than_the_bound_says(name: str, size: float, chain: Make, shape: Make) -> None:
    rng = np.random.default_rng(int(1000 * size))
    for _ in range(4 if name == "random" else 1):
        motion, bodies = still_life(scene_of(name, rng, chain, shape))
        q = rng.normal(size=len(motion.column))
        change = size * rng.uniform(0.0, 1.0, len(q))
        q = q[: motion.coefficients.shape[2]]
        frames = motion.frames(q[None])
        placed = bodies.place(frames)
        per_joint = change[motion.column] * motion.gain
        items = np.arange(len(bodies.a))
        node = np.zeros_like(items)
        allowed = bodies.approach(bodies.sweeps(frames, placed, per_joint[None]), node, items)
        before = distances(motion, bodies, q)
        for _ in range(6):
            step = change[: len(q)] * rng.choice([-1.0, 0.3, 1.0], len(q))
            nearer = before - distances(motion, bodies, q + step)
            # Only distances count here: the depth of two polyhedra is Coal's estimate.
            assert (nearer <= allowed + 2e-5)[before > 0.0].all()


@pytest.mark.parametrize("name", ["random", "rr1_pair", "rr1_cluttered"])
def test_bounding_volumes_never_promise_more_than_the_distance(name: str, chain: Make, shape: Make) -> None:
    rng = np.random.default_rng(5)
    for _ in range(5 if name == "random" else 1):
        motion, bodies = still_life(scene_of(name, rng, chain, shape))
        q = rng.normal(size=motion.coefficients.shape[2])
        placed = bodies.place(motion.frames(q[None]))
        items = np.arange(len(bodies.a))
        node = np.zeros_like(items)
        value, proven = bodies.clearances(placed, node, items)
        assert (proven <= value + 1e-12).all()
        for bound in (bodies.far_bound, bodies.box_bound):
            assert (bound(placed, node, items) <= value + 1e-9).all()


def test_a_pair_that_does_not_move_against_each_other_has_a_bound_of_zero(gripper: Make) -> None:
    robot = gripper(rp.Sphere(0.02))
    scene = rp.Scene().with_arm("arm", replace(robot, disabled_collisions=frozenset()))
    motion, bodies = still_life(scene)
    frames = motion.frames(np.zeros((1, 1)))
    sweeps = bodies.sweeps(frames, bodies.place(frames), np.ones((1, 1)))
    assert bodies.pairs == (("arm/left", "arm/right"),)
    assert bodies.approach(sweeps, np.zeros(1, dtype=int), np.zeros(1, dtype=int)) == pytest.approx([0.0])
    assert sweeps.max() == pytest.approx(np.hypot(0.5, 0.06) + 0.02, abs=1e-6)
