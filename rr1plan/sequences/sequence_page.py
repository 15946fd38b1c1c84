"""Pages of sequences: held objects move with the hand, and a list of the stages leads to each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from rr1plan.checks import of_kind
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.html_page import page_html
from rr1plan.playback.viewer.live_viewer import Viewer
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.page_document import Document, with_moving_objects
from rr1plan.playback.viewer.view_options import Panel, ViewOptions, checked_options, with_panel
from rr1plan.sequences.sequence_replay import SequenceReplay
from rr1plan.sequences.stage_planners import stage_planners
from rr1plan.sequences.stages import StagedMotion, carried_names
from rr1plan.transforms import position_and_quaternion

# Time between two poses of an object that a page interpolates [s].
_FRAME = 1.0 / 60.0


def save_sequence_html(
    file: str | FilePath, motion: StagedMotion, replay: SequenceReplay | None, options: ViewOptions | None
) -> FilePath:
    """Write one self-contained page of a sequence; see `SequencePlan.save_html`."""
    target = check_writable(file, ".html")
    document, options = page_parts(motion, replay, options)
    return write_text(target, page_html(document, options))


class SequenceViewer(Viewer):
    """A live page of a sequence. `SequencePlan.show` makes one; see `Viewer` for its methods.

    Args:
        motion: The motion and its stages.
        replay: The simulated sequence, or None.
        options: As in `rr1plan.show`.
    """

    def __init__(self, motion: StagedMotion, replay: SequenceReplay | None, options: ViewOptions | None) -> None:
        document, options = page_parts(motion, replay, options)
        self._open(motion.scene, document, options)


def page_parts(
    motion: StagedMotion, replay: SequenceReplay | None, options: ViewOptions | None
) -> tuple[Document, ViewOptions]:
    """The document of a page and its options, with the panel of the stages."""
    options = checked_options(options)
    of_kind("replay", replay, SequenceReplay, optional=True)
    scene, names, trajectory = motion.scene, carried_names(motion.stages), motion.trajectory
    for name in names:
        if name in scene.attachments:
            scene = scene.detach(name)
    document = view_document(
        scene,
        trajectory=trajectory,
        report=motion.report,
        replay=None if replay is None else replay.replay,
        # Held objects and allowed contacts change from stage to stage, so each stage has its planner.
        options=replace(options, clearances=False, planner=False),
    )
    torque = document["samples"]["torque"]
    if names and torque is not None:
        # Torques are those of the scene at the beginning, without the objects.
        torque["remark"] = ", ".join(filter(None, [f"without the mass of {', '.join(names)}", torque["remark"]]))
    if replay is None and names:
        times = trajectory.sample_times(_FRAME)
        poses = {
            name: np.array([position_and_quaternion(T) for T in motion.object_poses(name, times)]) for name in names
        }
        document = with_moving_objects(document, times, poses)
    if replay is None and options.planner:
        document["planner"] = stage_planners(motion)
    return document, with_panel(options, _stage_panel(motion))


def _stage_panel(motion: StagedMotion) -> Panel:
    """A list of the stages; a click goes to the beginning of one."""
    data = [{"label": s.label, "begin": s.begin, "end": s.end} for s in motion.stages]
    return Panel(
        "stages",
        "Sequence",
        html="<ol></ol>",
        css=page_asset("stages.css", "rr1plan.sequences"),
        script=page_asset("stages.js", "rr1plan.sequences"),
        data=data,
        width=290,
    )
