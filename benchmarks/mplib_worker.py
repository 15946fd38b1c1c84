"""MPlib as a worker of the comparison; see `worker.py`."""

from __future__ import annotations

from typing import Any

import mplib
import numpy as np
from mplib.collision_detection import fcl
from worker import COARSE, FINE, Answer, serve

RANGE = 0.1  # the default of its plan_qpos [rad]
SHAPES = {"box": fcl.Box, "cylinder": fcl.Cylinder, "sphere": fcl.Sphere}


def load(robot: dict[str, Any], task: dict[str, Any]) -> tuple[Any, float]:
    """Planner for the robot without obstacles, and time limit of one search."""
    planner = mplib.Planner(
        robot["urdf"],
        robot["tip"],
        srdf=robot["srdf"],
        use_convex=True,
        joint_vel_limits=robot["velocity"],
        joint_acc_limits=robot["acceleration"],
    )
    if [planner.user_joint_names[i] for i in planner.move_group_joint_indices] != robot["joints"]:
        raise ValueError(f"joints are {planner.user_joint_names}, expected {robot['joints']}")
    return planner, task["seconds"]


def solve(own: tuple[Any, float], problem: dict[str, Any], answer: Answer) -> None:
    """The stages of its `plan_qpos` at their defaults, one by one."""
    planner, seconds = own
    world = planner.planning_world
    try:
        with answer.stage("set up"):
            for o in problem["obstacles"]:
                body = fcl.CollisionObject(SHAPES[o["kind"]](*o["size"]))
                world.add_object(fcl.FCLObject(o["name"], mplib.Pose(np.array(o["pose"])), [body], [mplib.Pose()]))
            for pair in problem["may_touch"]:
                planner.acm.set_entry(*pair, True)
        mplib.set_global_seed(problem["seed"])
        start, goal = np.array(problem["start"]), np.array(problem["goal"])
        with answer.stage("plan"):
            status, raw = planner.planner.plan(start, [goal], time=seconds, range=RANGE, simplify=False)
        if status != "Exact solution":
            raise RuntimeError(status)
        answer.keep("raw", raw)
        with answer.stage("shorten"):
            path = planner.planner.simplify_path(raw)
        answer.keep("path", path)
        with answer.stage("retime"):
            *_, duration = planner.TOPP(path, COARSE)
        times, samples, *_ = planner.TOPP(path, FINE)
        answer.data |= {"duration": float(duration), "step": float(times[1] - times[0])}
        answer.keep("timed", samples)
    finally:
        for o in problem["obstacles"]:
            world.remove_object(o["name"])


if __name__ == "__main__":
    serve(load, solve)
