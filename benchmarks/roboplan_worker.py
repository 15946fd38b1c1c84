"""roboplan as a worker of the comparison; see `worker.py`. Options: step, instead of its default of 0.05 rad."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import roboplan.core as core
from roboplan.rrt import RRT, RRTOptions
from roboplan.toppra import PathParameterizerTOPPRA, TOPPRAOptions
from worker import COARSE, FINE, Answer, serve

COLOR = np.array([0.5, 0.5, 0.5, 1.0])
SHAPES = {"box": ("Box", core.Box), "cylinder": ("Cylinder", core.Cylinder), "sphere": ("Sphere", core.Sphere)}


def load(robot: dict[str, Any], task: dict[str, Any]) -> dict[str, Any]:
    """The robot in an empty scene, with acceleration limits, which a URDF does not have."""
    urdf = Path(robot["urdf"])
    scene = core.Scene("benchmark", core.loadUrdfSceneDescription(str(urdf), [str(urdf.parent)]))
    scene.importSrdf(Path(robot["srdf"]).read_text(encoding="utf-8"))
    limits = urdf.with_suffix(".limits.yaml")
    rows = [
        f"  {n}:\n    max_acceleration: [{a!r}]" for n, a in zip(robot["joints"], robot["acceleration"], strict=True)
    ]
    limits.write_text("\n".join(["joint_limits:", *rows, ""]), encoding="utf-8")
    scene.importJointLimitsFromConfig(core.loadJointLimitsConfig(str(limits)))
    step = task["options"].get("step")
    search = RRTOptions(group_name="arm", rrt_connect=True, max_planning_time=task["seconds"])
    shorten = core.PathShortcuttingOptions(group_name="arm")
    if step is not None:
        search.collision_check_step_size = shorten.max_step_size = step
        search.max_nodes = 1_000_000
    return {"scene": scene, "joints": robot["joints"], "search": search, "shorten": shorten}


def solve(own: dict[str, Any], problem: dict[str, Any], answer: Answer) -> None:
    """Plan, shorten and retime at its defaults."""
    scene = own["scene"]
    try:
        with answer.stage("set up"):
            place(scene, problem)
        start, goal = (core.JointConfiguration(own["joints"], np.array(problem[k])) for k in ("start", "goal"))
        with answer.stage("plan"):
            planner = RRT(scene, own["search"])
            planner.setRngSeed(problem["seed"])
            raw = planner.plan(start, goal)
        answer.keep("raw", raw.positions)
        own["shorten"].seed = problem["seed"]
        with answer.stage("shorten"):
            path = core.PathShortcutter(scene, own["shorten"]).shortcut(raw)
        answer.keep("path", path.positions)
        with answer.stage("retime"):
            timing = PathParameterizerTOPPRA(scene, "arm")
            motion = timing.generate(path, TOPPRAOptions(dt=COARSE))
        answer.data |= {"duration": float(motion.times[-1]), "step": FINE}
        answer.keep("timed", timing.generate(path, TOPPRAOptions(dt=FINE)).positions)
    finally:
        for obstacle in problem["obstacles"]:
            scene.removeGeometry(obstacle["name"])


def place(scene: core.Scene, problem: dict[str, Any]) -> None:
    """The problem's obstacles, which must not be checked against each other."""
    names = [obstacle["name"] for obstacle in problem["obstacles"]]
    for obstacle in problem["obstacles"]:
        kind, shape = SHAPES[obstacle["kind"]]
        T = np.array(obstacle["pose"], order="F")
        getattr(scene, f"add{kind}Geometry")(obstacle["name"], "universe", shape(*obstacle["size"]), T, COLOR)
    unchecked = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    scene.setCollisions([*unchecked, *map(tuple, problem["may_touch"])], False)


if __name__ == "__main__":
    serve(load, solve)
