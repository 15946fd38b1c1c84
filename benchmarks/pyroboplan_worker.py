"""pyroboplan as a worker of the comparison; see `worker.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
from pinocchio_model import load_model, with_obstacles
from pyroboplan.planning.path_shortcutting import shortcut_path
from pyroboplan.planning.rrt import RRTPlanner, RRTPlannerOptions
from pyroboplan.trajectory.trapezoidal_velocity import TrapezoidalVelocityTrajectory
from worker import COARSE, FINE, Answer, serve


def load(robot: dict[str, Any], task: dict[str, Any]) -> tuple[Any, ...]:
    """Model, geometry, velocity and acceleration limits, and its options."""
    options = RRTPlannerOptions(rrt_connect=True, bidirectional_rrt=True, max_planning_time=task["seconds"])
    return *load_model(robot), np.array(robot["velocity"]), np.array(robot["acceleration"]), options


def solve(own: tuple[Any, ...], problem: dict[str, Any], answer: Answer) -> None:
    """Plan, shorten and retime at its defaults; its retiming stops at every waypoint."""
    model, bodies, velocity, acceleration, options = own
    with answer.stage("set up"):
        whole = with_obstacles(model, bodies, problem)
    options.rng_seed = problem["seed"]
    with answer.stage("plan"):
        planner = RRTPlanner(model, whole, options)
        raw = planner.plan(np.array(problem["start"]), np.array(problem["goal"]))
    if not raw:
        raise RuntimeError("no path")
    answer.keep("raw", raw)
    with answer.stage("shorten"):
        path = shortcut_path(model, whole, raw)
    answer.keep("path", path)
    with answer.stage("retime"):
        motion = TrapezoidalVelocityTrajectory(np.array(path).T, velocity, acceleration)
        motion.generate(COARSE)
    answer.data |= {"duration": float(motion.segment_times[-1]), "step": FINE}
    answer.keep("timed", motion.generate(FINE)[1].T)


if __name__ == "__main__":
    serve(load, solve)
