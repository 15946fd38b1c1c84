"""Plan graphs in motion files."""

from __future__ import annotations

import pathlib

import numpy as np

from rr1plan.checks import of_kind
from rr1plan.errors import FormatError, InputError
from rr1plan.export.plan_files import read_plan_file, save_motion
from rr1plan.multi.execution.route import Route
from rr1plan.multi.execution.temporal_plan_graph import PlanGraph
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory

# A plan is at the gridpoints of its routes at the times of its steps, up to the rounding of times [rad or m].
_SAME_PLACE = 1e-4


def save_plan_graph(
    file: str | pathlib.Path,
    graph: PlanGraph,
    trajectory: Trajectory,
    scene: Scene,
    problem: Problem | None = None,
    *,
    embed: bool = False,
) -> pathlib.Path:
    """Write a plan and its temporal plan graph to a motion file and return the file's path.

    Args:
        file: The file; read it with `load_plan_graph`, or as a motion with `load_motion`.
        graph: The graph.
        trajectory: The motion of the plan.
        scene: Its scene.
        problem: The planning problem.
        embed: Put large meshes and point clouds into the file; see `save_motion`.

    Raises:
        InputError: a graph of another trajectory, or the file cannot be written.
    """
    of_kind("graph", graph, PlanGraph)
    of_kind("trajectory", trajectory, Trajectory)
    of_kind("scene", scene, Scene)
    wrong = _difference(graph, trajectory, scene)
    if wrong:
        raise InputError(f"the plan cannot be saved: it is {wrong}")
    return save_motion(file, scene, trajectory=trajectory, problem=problem, plan_graph=graph.to_dict(), embed=embed)


def load_plan_graph(file: str | pathlib.Path, scene: Scene | None = None) -> PlanGraph:
    """Read the temporal plan graph of a motion file written by `save_plan_graph`.

    The function checks that the trajectory of the file follows the routes of the graph; it does not prove cells free
    again.

    Args:
        file: The file.
        scene: A scene with the meshes that are missing next to the file.

    Raises:
        FormatError: a truncated, modified or unsupported file, one without a plan graph, or with one that is not of
            its scene and trajectory.
    """
    of_kind("scene", scene, Scene, optional=True)
    saved = read_plan_file(file, scene)
    if saved.plan_graph is None or saved.scene is None or saved.trajectory is None:
        raise FormatError("holds no plan graph", file)
    try:
        graph = PlanGraph.from_dict(saved.plan_graph)
    except FormatError as error:
        raise FormatError(str(error), file) from error
    wrong = _difference(graph, saved.trajectory, saved.scene)
    if wrong:
        raise FormatError(f"holds {wrong}", file)
    return graph


def _difference(graph: PlanGraph, trajectory: Trajectory, scene: Scene) -> str:
    """Why a graph is not that of a trajectory in a scene, in words; empty if it is."""
    known = scene.joint_names()
    for route in graph.routes:
        arms = ", ".join(route.arms)
        if not set(route.joint_names) <= set(known) or route.joint_names != scene.joint_names(route.arms):
            return f"a plan graph whose joints of {arms} are not those of the scene"
        if not _follows(trajectory, route):
            return f"a plan graph of another trajectory: {arms} is elsewhere"
    return ""


def _follows(trajectory: Trajectory, route: Route) -> bool:
    """Whether a trajectory is at the first gridpoint of each step when the plan enters the step."""
    if not set(route.joint_names) <= set(trajectory.joint_names):
        return False
    columns = [trajectory.joint_names.index(name) for name in route.joint_names]
    times = np.append(trajectory.start_time, route.steps.times[1:])
    return float(np.abs(trajectory(times)[:, columns] - route.gridpoints[route.steps.begins]).max()) <= _SAME_PLACE
