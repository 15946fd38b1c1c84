"""SRMP's multi-robot planner at its defaults on Coal; see `worker.py`.

A problem has `arms` instead of `start` and `goal`: for each a name, a pose of its base, a start and a goal. The answer
has in `raw` the concatenated configurations of all arms at SRMP's instants. There is no retiming.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import srmp
from worker import Answer, serve

_PLANNER = "xECBS"


def load(robot: dict[str, Any], task: dict[str, Any]) -> tuple[dict[str, Any], float, str]:
    """The robot's files with paths that SRMP resolves, the time limit of one search, and the planner's name."""
    urdf = Path(robot["urdf"])
    own = urdf.with_suffix(".srmp.urdf")
    own.write_text(urdf.read_text(encoding="utf-8").replace("package://", f"{urdf.parent}/"), encoding="utf-8")
    return robot | {"urdf": str(own)}, task["seconds"], task["options"].get("planner", _PLANNER)


def solve(own: tuple[dict[str, Any], float, str], problem: dict[str, Any], answer: Answer) -> None:
    """Plan for all arms."""
    robot, seconds, name = own
    arms = problem["arms"]
    with answer.stage("set up"):
        planner = srmp.PlannerInterface()
        for arm in arms:
            planner.add_articulation(
                arm["name"], robot["tip"], urdf_path=robot["urdf"], srdf_path=robot["srdf"], joint_names=robot["joints"]
            )
            planner.set_base_pose(arm["name"], _pose(arm["base"]))
        for thing in problem["obstacles"]:
            if thing["kind"] != "box":
                raise ValueError(f"obstacle of kind {thing['kind']}")
            planner.add_box(thing["name"], np.array(thing["size"]), _pose(thing["pose"]))
        names = [arm["name"] for arm in arms]
        planner.make_planner(names, {"planner_id": name, "time_limit": str(seconds)})
    starts = {arm["name"]: np.array(arm["start"]) for arm in arms}
    goals = {arm["name"]: srmp.GoalConstraint(srmp.GoalType.JOINTS, [np.array(arm["goal"])]) for arm in arms}
    with answer.stage("plan"):
        found = planner.plan_multi(starts, goals)
    parts = [np.array(found[arm].positions) for arm in names if arm in found]
    if len(parts) < len(names) or any(len(part) == 0 for part in parts):
        raise RuntimeError("no path")
    longest = max(len(part) for part in parts)
    parts = [np.concatenate([part, np.repeat(part[-1:], longest - len(part), axis=0)]) for part in parts]
    answer.keep("raw", np.hstack(parts))


def _pose(matrix: list[list[float]]) -> Any:
    """SRMP's pose of a matrix (4, 4); its quaternion is wxyz."""
    T = np.array(matrix)
    R, pose = T[:3, :3], srmp.Pose()
    pose.p = T[:3, 3]
    # Start with the largest component, which is never small.
    squares = np.array([1.0 + np.trace(R), *(1.0 + 2.0 * R[k, k] - np.trace(R) for k in range(3))])
    k = int(squares.argmax())
    rows = np.array(
        [
            [squares[0], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], squares[1], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], squares[2], R[2, 1] + R[1, 2]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2], squares[3]],
        ]
    )
    pose.q = rows[k] / np.linalg.norm(rows[k])
    return pose


if __name__ == "__main__":
    serve(load, solve)
