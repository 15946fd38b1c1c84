"""Contact rules in the referee, against the scene's rule for every single pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Geometry
from rr1plan.transforms import pose
from rr1plan.validation.compiled_search import ProofOptions, Search
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import moving_scene
from rr1plan.validation.referee_kernels import load_library

Make = Callable[..., Any]
BALL = rp.Sphere(0.01)


def random_scene(rng: np.random.Generator, chain: Make) -> rp.Scene:
    """Three arms of two kinds, two of them holding things, obstacles, and rules about names of all kinds."""
    robots = [with_base(chain(rng, 3)), chain(rng, 2)]
    scene = rp.Scene()
    for i, name in enumerate(("left", "middle", "right")):
        scene = scene.with_arm(name, robots[i % 2], pose(rng.normal(size=3)))
    for name in ("table", "post"):
        scene = scene.with_obstacle(name, BALL, rng.normal(size=3))
    for name, arm in (("cup", "left"), ("lid", "left"), ("rod", "right")):
        links = scene.arms[arm].robot.link_names
        touch = rng.choice(links, 2, replace=False).tolist()
        scene = scene.with_obstacle(name, BALL).attach(name, arm, str(rng.choice(links)), touch=touch)
    names = [*scene.element_names, *scene.arms]
    allowed = [frozenset(rng.choice(names, 2, replace=False).tolist()) for _ in range(int(rng.integers(6)))]
    keep = [frozenset(rng.choice(names, 2, replace=False).tolist()) for _ in range(int(rng.integers(25)))]
    keep += [frozenset({str(rng.choice(list(scene.arms)))})] * int(rng.integers(2))
    distances = {both: float(rng.uniform(0.0, 0.1)) for both in keep}
    return rp.Scene(
        scene.arms, scene.obstacles, scene.attachments, frozenset(allowed), float(rng.uniform(0.0, 0.1)), distances
    )


def with_base(robot: rp.Robot) -> rp.Robot:
    """The same robot with a shape on its base."""
    first, *rest = robot.links
    return replace(robot, links=(replace(first, collisions=(Geometry("foot", BALL),)), *rest))


def said(scene: rp.Scene, joint_names: tuple[str, ...]) -> dict[frozenset[str], float]:
    """Distances to keep between forbidden pairs, as in the tables of the compiled search."""
    moving, count = moving_scene(scene, joint_names), len(scene.element_names)
    rest = TimedColumns(joint_names, np.zeros(1), np.zeros((1, 1, len(joint_names))))
    table = np.full((count, count), -1.0)
    search = Search(moving, rest, ProofOptions(1e-3, 1))
    load_library().rr1_probe_paddings(search.struct, table)
    names = [moving.element(e)[1] for e in range(count)]
    found = {frozenset((names[a], names[b])): float(table[a, b]) for a, b in combinations(range(count), 2)}
    return {both: distance for both, distance in found.items() if distance >= 0.0}


@pytest.mark.parametrize("seed", range(40))
def test_all_pairs_have_the_distances_that_the_scene_says(seed: int, chain: Make) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, chain)
    names = scene.element_names
    wanted = {frozenset((a, b)): scene.padding_of(a, b) for a, b in combinations(names, 2) if not scene.may_touch(a, b)}
    moving = scene.joint_names(rng.choice(list(scene.arms), int(rng.integers(1, 4)), replace=False).tolist())
    assert said(scene, moving) == wanted


@pytest.mark.parametrize(("first", "second"), [(0.01, 0.05), (0.05, 0.01)])
def test_of_two_rules_for_an_element_and_an_arm_the_larger_distance_counts(
    first: float, second: float, chain: Make
) -> None:
    robot = chain(np.random.default_rng(0), 2)
    scene = rp.Scene().with_arm("left", robot).with_arm("right", robot, (1, 0, 0))
    one, two = (f"{arm}/{robot.solid_links[-1]}" for arm in ("left", "right"))
    scene = scene.with_padding(first, one, "right").with_padding(second, "left", two)
    assert said(scene, scene.joint_names())[frozenset((one, two))] == 0.05
