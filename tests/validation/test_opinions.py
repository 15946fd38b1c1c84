"""Second and third opinions: dense samples through python-fcl and MuJoCo, which the referee never uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.transforms import pose
from rr1plan.validation import certify_path, validate

Make = Callable[..., Any]


def cluttered(rng: np.random.Generator, chain: Make, shape: Make) -> tuple[rp.Scene, rp.Trajectory]:
    """A random arm among three random obstacles, moving along random cubics."""
    scene = rp.Scene().with_arm("arm", chain(rng, 3))
    for k in range(3):
        at = rng.normal(size=3)
        T = pose(at / np.linalg.norm(at) * rng.uniform(0.2, 0.8), rpy=rng.normal(size=3))
        scene = scene.with_obstacle(f"thing{k}", shape(rng), T)
    coefficients = rng.normal(size=(2, 4, 3)) * np.array([1.0, 1.0, 0.5, 0.3])[None, :, None]
    coefficients[1, 0] = coefficients[0].sum(axis=0)
    return scene, rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0, 2.0]), coefficients)


@pytest.mark.parametrize("seed", range(40))
def test_fcl_agrees_at_every_sample_of_random_motions(seed: int, chain: Make, shape: Make, fcl_world: Make) -> None:
    rng = np.random.default_rng(seed)
    scene, move = cluttered(rng, chain, shape)
    tolerance = (None, 2e-4)[seed % 2]
    report = validate(move, scene, clearance_tolerance=tolerance)
    world = fcl_world(scene)
    hits = {v.subject: v for v in report.violations if v.kind in ("collision", "undecided")}
    nearest = {True: np.inf, False: np.inf}
    for t in np.linspace(0.0, 2.0, 150):
        world.place(move.joint_names, move(t))
        if hits:
            for pair in scene.checked_pairs:
                assert pair in hits or not world.pair_touches(*pair)
        else:
            nearest = {own: min(least, world.distance(own)) for own, least in nearest.items()}
    for pair, hit in hits.items():
        world.place(move.joint_names, move(hit.time))
        assert hit.value > -1e-5 or world.pair_touches(*pair)
    for name, own in (("clearance", False), ("self_clearance", True)):
        if hits or np.isinf(nearest[own]):
            continue
        found = report.margins[name]
        slack = max(2e-4, 0.0 if tolerance else 0.05 * found.value)
        assert 0.0 < found.value <= nearest[own] + slack + 1e-6
        world.place(move.joint_names, move(found.time))
        assert found.value == pytest.approx(world.distance(own), abs=1e-4)
        assert report.margins[f"{name}_proven"].value >= found.value - slack - 1e-4


def test_the_random_motions_hold_both_free_ones_and_collisions(chain: Make, shape: Make) -> None:
    verdicts = []
    for seed in range(40):
        scene, move = cluttered(np.random.default_rng(seed), chain, shape)
        verdicts.append(any(v.kind == "collision" for v in validate(move, scene).violations))
    assert 8 <= sum(verdicts) <= 32


def wander(scene: rp.Scene, rng: np.random.Generator, reach: float) -> rp.Path:
    limits, home = scene.limits(), scene.configuration()
    steps = [np.clip(home + reach * rng.normal(size=len(home)), limits.lower, limits.upper) for _ in range(2)]
    return rp.Path(scene.joint_names(), [home, *steps, home])


def timed(path: rp.Path) -> rp.Trajectory:
    """Stop at every waypoint: a cubic from rest to rest along each edge, a second each."""
    a, d = path.waypoints[:-1], np.diff(path.waypoints, axis=0)
    return rp.Trajectory(
        path.joint_names, np.arange(float(len(path))), np.stack([a, np.zeros_like(a), 3.0 * d, -2.0 * d], axis=1)
    )


@pytest.mark.parametrize("name", ["rr1_table", "rr1_shelf", "rr1_cage", "rr1_pair"])
@pytest.mark.parametrize("seed", range(2))
def test_fcl_and_mujoco_agree_on_rr1(name: str, seed: int, fcl_world: Make) -> None:
    scene = rp.load_scene(name)
    path = wander(scene, np.random.default_rng(seed), 0.25)
    move = timed(path)
    report = validate(move, scene)
    hits = {frozenset(v.subject): v for v in report.violations if v.kind in ("collision", "undecided")}
    world = fcl_world(scene)
    for t in np.linspace(0.0, move.duration, 40):
        world.place(move.joint_names, move(t))
        if not hits:
            assert not world.touching()
            continue
        for pair in scene.checked_pairs:
            assert frozenset(pair) in hits or not world.pair_touches(*pair)
    seen = rp.simulate(move, scene, mode="kinematic", dt=0.005).contacts
    assert {frozenset(c.pair) for c in seen if c.depth > 1e-5} <= set(hits)
    # The path has the same geometry as the motion along it.
    on_path = {frozenset(v.subject) for v in certify_path(path, scene).violations if v.kind == "collision"}
    assert on_path == {pair for pair, v in hits.items() if v.kind == "collision"}


def test_mujoco_sees_what_the_referee_plants_in_the_way() -> None:
    """RR1 swings its shoulder through a post: the same links, at the same first moment."""
    scene = rp.load_scene("rr1_table")
    home = scene.configuration()
    free = rp.Scene().with_arm("rr1", scene.arms["rr1"].robot)
    tool = free.link_poses()[f"rr1/{free.arms['rr1'].robot.tool}"][:3, 3]
    turned = rp.transforms.pose(rpy=[0.0, 0.0, 0.6])[:3, :3] @ tool
    blocked = free.with_obstacle("post", rp.Cylinder(0.01, 2.0), [turned[0], turned[1], 0.0])
    move = timed(rp.Path(free.joint_names(), [home, home + np.eye(len(home))[0] * 1.2]))
    hits = {v.subject: v for v in validate(move, blocked).violations if v.kind == "collision"}
    seen = {frozenset(c.pair): c for c in rp.simulate(move, blocked, mode="kinematic", dt=0.001).contacts}
    assert {frozenset(pair) for pair in hits} == set(seen)
    assert hits
    for pair, hit in hits.items():
        first = float(hit.message.split("first contact at ")[1].split()[0])
        assert first <= seen[frozenset(pair)].first <= first + 0.003
