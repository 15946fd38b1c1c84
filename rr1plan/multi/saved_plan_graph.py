"""Plan graphs from motion files."""

from __future__ import annotations

import pathlib

import numpy as np

from rr1plan.checks import of_kind
from rr1plan.errors import FormatError
from rr1plan.export.plan_files import read_plan_file
from rr1plan.multi.route import Route
from rr1plan.multi.temporal_plan_graph import PlanGraph
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

# A plan passes the gridpoints of its routes at the times of its steps, up to the rounding of times [rad or m].
_SAME_PLACE = 1e-4


def load_plan_graph(file: str | pathlib.Path, scene: Scene | None = None) -> PlanGraph:
    """Read the temporal plan graph of a motion file that `save_motion(..., plan_graph=graph)` wrote.

    That the trajectory of the file follows the routes of the graph is checked; that cells are free is not proven again.

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
    known = saved.scene.joint_names()
    for route in graph.routes:
        arms = ", ".join(route.arms)
        if not set(route.joint_names) <= set(known) or route.joint_names != saved.scene.joint_names(route.arms):
            raise FormatError(f"holds a plan graph whose joints of {arms} are not those of the scene", file)
        if not _follows(saved.trajectory, route):
            raise FormatError(f"holds a plan graph of another trajectory: {arms} is elsewhere", file)
    return graph


def _follows(trajectory: Trajectory, route: Route) -> bool:
    """Whether a trajectory is at the gridpoint at which each step begins when the plan enters it."""
    if not set(route.joint_names) <= set(trajectory.joint_names):
        return False
    columns = [trajectory.joint_names.index(name) for name in route.joint_names]
    gridpoints = np.concatenate([route.start[None], route.at(route.pieces, route.offsets + route.spans)])
    times = np.append(trajectory.start_time, route.times[1:])
    return float(np.abs(trajectory(times)[:, columns] - gridpoints[route.begins]).max()) <= _SAME_PLACE
