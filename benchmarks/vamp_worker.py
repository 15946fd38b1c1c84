"""VAMP as a worker of the comparison, for its own Panda model of spheres; see `worker.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
import vamp
from worker import Answer, serve


def load(robot: dict[str, Any], task: dict[str, Any]) -> tuple[Any, ...]:
    """VAMP's compiled robot, planner and settings."""
    if not hasattr(vamp, robot["name"]):
        raise ValueError(f"{robot['name']} is none of the robots compiled into it")
    return vamp.configure_robot_and_planner_with_kwargs(robot["name"], "rrtc")


def solve(own: tuple[Any, ...], problem: dict[str, Any], answer: Answer) -> None:
    """Plan and simplify at its defaults; it has no retiming."""
    robot, rrtc, plan_settings, simplify_settings = own
    with answer.stage("set up"):
        environment = make_environment(problem)
    rng = robot.halton()
    start, goal = (np.array(problem[k]) for k in ("start", "goal"))
    with answer.stage("plan"):
        found = rrtc(start, [goal], environment, plan_settings, rng)
    if not found.solved:
        raise RuntimeError("no path")
    answer.keep("raw", found.path.numpy())
    with answer.stage("shorten"):
        short = robot.simplify(found.path, environment, simplify_settings, rng)
    answer.keep("path", short.path.numpy())


def make_environment(problem: dict[str, Any]) -> Any:
    """The obstacles. VAMP has no flat-ended cylinders and uses capsules, or in set "box" boxes; so do we."""
    environment = vamp.Environment()
    for obstacle in problem["obstacles"]:
        T, size = np.array(obstacle["pose"]), obstacle["size"]
        place, turn = T[:3, 3].tolist(), euler(T[:3, :3])
        if obstacle["kind"] == "sphere":
            environment.add_sphere(vamp.Sphere(place, *size))
        elif obstacle["kind"] == "cylinder" and not problem["name"].startswith("box/"):
            environment.add_capsule(vamp.Cylinder(place, turn, *size))
        else:
            half = [0.5 * s for s in size] if obstacle["kind"] == "box" else [size[0], size[0], 0.5 * size[1]]
            environment.add_cuboid(vamp.Cuboid(place, turn, half))
    return environment


def euler(R: np.ndarray) -> list[float]:
    """Angles about the fixed x, y and z axes."""
    pitch = np.arcsin(-np.clip(R[2, 0], -1.0, 1.0))
    return [float(np.arctan2(R[2, 1], R[2, 2])), float(pitch), float(np.arctan2(R[1, 0], R[0, 0]))]


if __name__ == "__main__":
    serve(load, solve)
