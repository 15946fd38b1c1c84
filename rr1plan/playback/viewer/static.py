"""One HTML file that plays a motion offline."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

from rr1plan.formats.files import write_text
from rr1plan.path import Path
from rr1plan.playback.replay import Replay
from rr1plan.playback.viewer.document import view_document
from rr1plan.playback.viewer.page import Panel, page_html
from rr1plan.problem import Problem
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory


def save_html(
    file: str | os.PathLike[str],
    scene: Scene,
    trajectory: Trajectory | None = None,
    *,
    path: Path | None = None,
    problem: Problem | None = None,
    report: Report | None = None,
    replay: Replay | None = None,
    title: str | None = None,
    spheres: bool = False,
    panels: Sequence[Panel] = (),
    view: Any = None,
    play: bool = True,
) -> FilePath:
    """Write one self-contained page: it asks no server for anything, and works from a USB stick.

    Args:
        file: Where to write it; written whole or not at all.
        scene: The arms and obstacles.
        trajectory: The motion to play; its columns are joints of the scene.
        path: A path without times: drawn, and played at a steady speed when there is no trajectory.
        problem: The question: its start and goal are drawn as ghosts.
        report: The referee's verdict on the trajectory, shown as a badge.
        replay: What a simulation made of the trajectory.
        title: Headline of the page (default: the scene's name).
        spheres: Show the spheres that contain each link and held object, with chips for each of their levels.
        panels: Panels beside the 3-D view.
        view: Where it is looked at from first: a name ("front", "back", "left", "right", "top", "corner"), azimuth and
            elevation [rad], or a direction of the world, shape (3,). None chooses a view that shows the motion.
        play: The motion runs from the start.

    Returns:
        The file.

    Raises:
        UnknownNameError: a column that is no joint of the scene, or no view of that name.
        InputError: a file that cannot be written, data JSON cannot hold.
        MissingPackageError: Meshcat is not installed.
    """
    document = view_document(
        scene, trajectory, path=path, problem=problem, report=report, replay=replay, title=title, spheres=spheres
    )
    return write_text(file, page_html(document, panels, view=view, play=play))
