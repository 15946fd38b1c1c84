"""OMPL with Pinocchio's collision checks in a Python script; see `worker.py`.

States are checked by Pinocchio's naive broad phase, its fastest for about thirty bodies;
edges at steps of `STEP`. There is no retiming.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from ompl import base, geometric, util
from pinocchio_model import load_model, with_obstacles
from worker import Answer, serve

STEP = 0.05  # between checked states of an edge [rad]


def load(robot: dict[str, Any], task: dict[str, Any]) -> tuple[Any, Any, float]:
    """Model, geometry, and time limit of one search."""
    util.setLogLevel(util.LogLevel.LOG_NONE)
    return *load_model(robot), task["seconds"]


def solve(own: tuple[Any, Any, float], problem: dict[str, Any], answer: Answer) -> None:
    """Plan with RRT-Connect and simplify, both at OMPL's defaults."""
    model, bodies, seconds = own
    with answer.stage("set up"):
        setup = make_setup(model, with_obstacles(model, bodies, problem), problem)
    util.RNG.setSeed(1 + problem["seed"])  # OMPL rejects 0
    with answer.stage("plan"):
        setup.solve(seconds)
    if not setup.getProblemDefinition().hasExactSolution():
        raise RuntimeError("no path")
    answer.keep("raw", waypoints(setup, model.nq))
    with answer.stage("shorten"):
        setup.simplifySolution()
    answer.keep("path", waypoints(setup, model.nq))


def make_setup(model: Any, bodies: Any, problem: dict[str, Any]) -> Any:
    """OMPL's simple setup, with states checked by Pinocchio."""
    space = base.RealVectorStateSpace(model.nq)
    bounds = base.RealVectorBounds(model.nq)
    for i, (low, high) in enumerate(zip(model.lowerPositionLimit, model.upperPositionLimit, strict=True)):
        bounds.setLow(i, float(low))
        bounds.setHigh(i, float(high))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(make_check(model, bodies))
    space.setup()
    setup.getSpaceInformation().setStateValidityCheckingResolution(STEP / space.getMaximumExtent())
    ends = [space.allocState() for _ in range(2)]
    for state, q in zip(ends, (problem["start"], problem["goal"]), strict=True):
        state[0 : model.nq] = q
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    return setup


def make_check(model: Any, bodies: Any) -> Any:
    """A function of a state: whether it is collision-free."""
    data, places = model.createData(), bodies.createData()
    pin.updateGeometryPlacements(model, data, bodies, places, pin.neutral(model))
    manager = pin.BroadPhaseManager_NaiveCollisionManager(model, bodies, places)
    callback = pin.CollisionCallBackDefault(bodies, places)
    callback.stopAtFirstCollision = True

    def is_free(state: Any) -> bool:
        pin.updateGeometryPlacements(model, data, bodies, places, np.array(state[0 : model.nq]))
        manager.update(False)
        return not pin.computeCollisions(manager, callback)

    return is_free


def waypoints(setup: Any, n: int) -> np.ndarray:
    """The solution's waypoints, copied."""
    return np.array([state[0:n] for state in setup.getSolutionPath().getStates()])


if __name__ == "__main__":
    serve(load, solve)
