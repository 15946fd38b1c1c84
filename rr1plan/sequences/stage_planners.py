"""Planner data of a page of a sequence: the scene of each stage, with the gripper locked and held objects attached."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from rr1plan.playback.viewer.page_planner import page_planner
from rr1plan.scene import Attachment, Scene
from rr1plan.scene.unlocked_joints import locked_scene
from rr1plan.sequences.stages import StagedMotion, scene_at, stage_scenes

_MOST_BYTES = 4_000_000  # of all planners in the page
_STILL = 1e-9  # [rad or m]


def planning_scenes(motion: StagedMotion) -> list[Scene | None]:
    """The scene of each stage for planning in a page, with locked gripper joints; None if they move."""
    scenes: list[Scene | None] = []
    names = list(motion.trajectory.joint_names)
    grippers = [f"{arm}/{joint}" for arm, joints in motion.gripper_joints.items() for joint in joints]
    # An arm that never moves has no columns.
    own = [names.index(name) for name in grippers if name in names]
    for stage, scene in zip(motion.stages, stage_scenes(motion.scene, motion.trajectory, motion.stages), strict=True):
        times = np.linspace(stage.begin, stage.end, 9)
        moves = bool(own) and bool(np.ptp(motion.trajectory(times)[:, own], axis=0).max() > _STILL)
        scenes.append(None if moves else locked_scene(scene, motion.gripper_joints))
    return scenes


def stage_planners(motion: StagedMotion) -> dict[str, Any]:
    """The planners of the page of a sequence, as data for `page/scene_stages.js`.

    Args:
        motion: The motion and its stages.

    Returns:
        Plain values that JSON can represent: for each of the `stages` its start, its planner, the held objects, and the
        configuration at its start; and the `planners`, without duplicates.
    """
    columns = motion.scene.joint_names()
    planners: list[dict[str, Any]] = []
    known: dict[object, int] = {}
    rows = []
    for stage, scene in zip(motion.stages, planning_scenes(motion), strict=True):
        key = None if scene is None else _content(scene)
        if key not in known:
            known[key] = len(planners)
            planners.append(_planner(scene, motion, columns, planners))
        held = {} if scene is None else scene.attachments
        rows.append(
            {
                "begin": stage.begin,
                "planner": known[key],
                "held": [_held_row(name, thing) for name, thing in held.items()],
                "rest": scene_at(motion.scene, motion.trajectory, stage.begin).configuration().tolist(),
            }
        )
    return {"stages": rows, "planners": planners}


def _planner(
    scene: Scene | None, motion: StagedMotion, columns: tuple[str, ...], others: list[dict[str, Any]]
) -> dict[str, Any]:
    if scene is None:
        return {"missing": "the gripper moves at this time"}
    data = page_planner(scene, motion.trajectory.arms)
    if "missing" in data:
        return data
    if len(json.dumps([*others, data])) > _MOST_BYTES:
        return {"missing": f"the tables of the stages have more than {_MOST_BYTES / 1e6:g} MB"}
    return data | {"columns": [columns.index(name) for name in data["joints"]]}


def _content(scene: Scene) -> object:
    """Everything that distinguishes the scenes of stages, except the configuration."""
    return (
        tuple((name, o.pose.tobytes()) for name, o in scene.obstacles.items()),
        tuple((name, h.arm, h.link, h.pose.tobytes(), h.touch) for name, h in scene.attachments.items()),
        scene.allowed,
        tuple(tuple(arm.robot.locked_joints.items()) for arm in scene.arms.values()),
    )


def _held_row(name: str, thing: Attachment) -> dict[str, Any]:
    return {"object": name, "arm": thing.arm, "link": thing.link, "pose": thing.pose.T.ravel().tolist()}
