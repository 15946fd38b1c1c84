"""Motion files that were changed and hashed again: each is rejected with a reason, or loads as a valid motion."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import json
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

import rr1plan as rp
from rr1plan.export import motion_schema
from rr1plan.export.motion_values import build_scene

_MUTANTS = 300
_VALUES: list[Any] = [
    None, True, False, 0, -1, 1, 7, 0.0, -0.5, 0.5, 1e-300, 1e6, 1e300, -1e300, 2**31, 2**63, 10**400, "", "x", "arm",
    "inf", "-inf", "nan", "0", [], [[]], [0], [0.0, 0.0], [1.0, 2.0, 3.0], {}, {"type": "box"}, {"number": "nan"},
    {"shared": 0}, {"type": "sphere", "radius": 0.1}, [None], [["a"]],
]  # fmt: skip


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A real file that has every kind of entry."""
    corners, faces = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    scene = rp.load_scene("planar2r_path").with_obstacle("rod", rp.Capsule(0.01, 0.05), (3, 0, 0))
    scene = scene.with_obstacle("mesh", rp.Mesh(corners, faces), (3, 3, 3), color=(0.1, 0.2, 0.3, 1.0))
    scene = scene.with_obstacle("cloud", rp.PointCloud([[4.0, 4.0, 4.0]])).with_padding(0.002, "arm", "rod")
    scene = scene.with_obstacle("wall", rp.HalfSpace(offset=-3)).with_obstacle("ball", rp.Sphere(0.01), (0, 0, 3))
    scene = scene.with_obstacle("pin", rp.Cylinder(0.01, 0.05), (0, 3, 0)).allow("arm", "pin").attach("pin")
    named = rp.load_problems("planar2r_path")["to_a_point"]
    pose, region = rp.PoseGoal("tool", [9.0, 0, 0], [1, 0, 0, 0]), rp.RegionGoal("tool", [5] * 3, [6] * 3)
    goals = [*named.goal["arm"], pose, region]
    problem = rp.Problem(scene, named.start, goals)
    motion = rp.plan_motion(problem, rng=0)
    assert motion
    file = motion.save(tmp_path_factory.mktemp("motion") / "motion.json")
    return json.loads(file.read_text())


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of every entry of a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*path, key)
        yield from places(inner, (*path, key))


def mutated(content: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """A copy of a content in which one to three entries are replaced, nested, removed, doubled or swapped."""
    content = copy.deepcopy(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        everywhere = list(places(content))
        *above, key = rng.choice(everywhere)
        parent: Any = content
        for step in above:
            parent = parent[step]
        action = rng.choice(("replace", "replace", "replace", "nest", "remove", "double", "swap", "scale"))
        if action == "replace":
            parent[key] = copy.deepcopy(rng.choice(_VALUES))
        elif action == "nest":
            parent[key] = rng.choice(([parent[key]], {"a": parent[key]}))
        elif action == "remove":
            del parent[key]
        elif action == "double":
            parent.append(parent[key]) if isinstance(parent, list) else parent.setdefault(f"{key}_", parent[key])
        elif action == "swap":
            *others, other = rng.choice(everywhere)
            source: Any = content
            for step in others:
                source = source[step]
            parent[key] = copy.deepcopy(source[other])
        elif isinstance(parent[key], int | float):
            parent[key] = parent[key] * rng.choice((-1.0, 10.0, 1e9, 1e-9))
    return content


def signed(document: dict[str, Any], content: dict[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return json.dumps(document | {"content": content, "sha256": hashlib.sha256(text.encode()).hexdigest()})


def honest(content: dict[str, Any]) -> dict[str, Any]:
    """The content with the hashes that its scene has, as a careful forger would write them, where it makes a scene."""
    try:
        entries = msgspec.convert(content, motion_schema.MotionDocument)
        scene = build_scene(entries.scene, entries.robots, lambda _: rp.Mesh([], []))
    except (rp.InputError, msgspec.ValidationError):
        return content
    robots = {n: {"robot": arm.robot.name, "sha256": arm.robot.content_hash} for n, arm in scene.arms.items()}
    return content | {"made_for": {"scene": scene.name, "sha256": scene.content_hash, "arms": robots}}


@pytest.mark.parametrize("seed", range(4))
def test_a_changed_file_that_is_signed_again_is_refused_or_makes_sense(
    document: dict[str, Any], tmp_path: Path, seed: int
) -> None:
    rng, file, loaded = random.Random(seed), tmp_path / "motion.json", []
    for _ in range(_MUTANTS // 4):
        file.write_text(signed(document, honest(mutated(document["content"], rng))))
        # Any other error ends the test, and so does a warning.
        with contextlib.suppress(rp.FormatError):
            loaded.append(rp.load_motion(file))
    assert 0 < len(loaded) < _MUTANTS // 4
    for motion in loaded:
        assert all(math.isfinite(margin.value) for margin in motion.report.margins.values())
        again = rp.load_motion(motion.save(tmp_path / "again.json", embed=True))
        assert again.report.valid == motion.report.valid
        assert again.scene.content_hash == motion.scene.content_hash


def test_the_document_itself_loads_and_a_nan_does_not(document: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "motion.json"
    file.write_text(signed(document, honest(document["content"])))
    assert rp.load_motion(file)
    content = copy.deepcopy(document["content"])
    content["scene"]["padding"] = math.nan
    file.write_text(signed(document, content))
    with pytest.raises(rp.FormatError, match=r"motion\.json: holds a number that is not finite"):
        rp.load_motion(file)
