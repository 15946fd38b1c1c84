"""roboplan's side of the comparison: answers the same problems in an environment of its own.

Run by `panda_problems.py` with the Python of that environment; it knows nothing of rr1plan. Standard
input: one JSON object with `urdf`, `srdf`, `joints`, `problems` (a list), `steps`, `seed`. Standard output:
one JSON line for each problem and step.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from roboplan.core import (
    Box,
    Cylinder,
    JointConfiguration,
    PathShortcutter,
    PathShortcuttingOptions,
    Scene,
    Sphere,
    loadUrdfSceneDescription,
)
from roboplan.rrt import RRT, RRTOptions

GROUP = "panda_arm"
COLOR = np.array([0.5, 0.5, 0.5, 1.0])


def main() -> None:
    task = json.load(sys.stdin)
    for problem in task["problems"]:
        started = time.process_time()
        scene = build_scene(task, problem)
        set_up = time.process_time() - started
        for step in task["steps"]:
            answer = solve(scene, task["joints"], problem, step, task["seed"])
            print(json.dumps({"name": problem["name"], "step": step, "set up": set_up, **answer}), flush=True)


def build_scene(task: dict[str, Any], problem: dict[str, Any]) -> Scene:
    """The robot and the problem's obstacles; these must not be checked against each other."""
    urdf = Path(task["urdf"])
    scene = Scene("benchmark", loadUrdfSceneDescription(str(urdf), [str(urdf.parent)]))
    scene.importSrdf(Path(task["srdf"]).read_text(encoding="utf-8"))
    names = []
    for name, size, place, quaternion in problem["boxes"]:
        scene.addBoxGeometry(name, "universe", Box(*size), transform(place, quaternion), COLOR)
        names.append(name)
    for name, radius, length, place, quaternion in problem["cylinders"]:
        scene.addCylinderGeometry(name, "universe", Cylinder(radius, length), transform(place, quaternion), COLOR)
        names.append(name)
    for name, radius, place in problem["spheres"]:
        scene.addSphereGeometry(name, "universe", Sphere(radius), transform(place, [0, 0, 0, 1]), COLOR)
        names.append(name)
    bodies = [*names, "panda_link0"]
    scene.setCollisions([(a, b) for i, a in enumerate(bodies) for b in bodies[i + 1 :]], False)
    return scene


def transform(place: list[float], quaternion: list[float]) -> Any:
    """A pose as a matrix, from a position and a quaternion xyzw."""
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    T = np.eye(4, order="F")
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = place
    return T


def solve(scene: Scene, joints: list[str], problem: dict[str, Any], step: float, seed: int) -> dict[str, Any]:
    """Plan and shorten with one collision-check step; CPU seconds, and the two paths."""
    options = RRTOptions(
        group_name=GROUP,
        rrt_connect=True,
        collision_check_step_size=step,
        max_nodes=1_000_000,
        max_planning_time=30.0,
    )
    start, goal = (JointConfiguration(joints, np.array(problem[key])) for key in ("start", "goal"))
    started = time.process_time()
    planner = RRT(scene, options)
    planner.setRngSeed(seed)
    try:
        raw = planner.plan(start, goal)
    except RuntimeError as error:
        return {"plan": time.process_time() - started, "failure": str(error)}
    planned = time.process_time()
    shortcutter = PathShortcutter(scene, PathShortcuttingOptions(group_name=GROUP, max_step_size=step, seed=seed))
    path = shortcutter.shortcut(raw)
    shortened = time.process_time()
    return {
        "plan": planned - started,
        "shorten": shortened - planned,
        "raw": [list(q) for q in raw.positions],
        "path": [list(q) for q in path.positions],
    }


if __name__ == "__main__":
    main()
