"""One HTML file that plays a motion offline."""

from __future__ import annotations

import os
from pathlib import Path as FilePath

from rr1plan.files.file_access import write_text
from rr1plan.path import Path
from rr1plan.playback.simulation.replay import Replay
from rr1plan.playback.viewer.html_page import page_html
from rr1plan.playback.viewer.page_document import view_document
from rr1plan.playback.viewer.view_options import ViewOptions
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory


def save_html(
    file: str | os.PathLike[str],
    scene: Scene,
    *,
    trajectory: Trajectory | None = None,
    path: Path | None = None,
    problem: Problem | None = None,
    report: Report | None = None,
    replay: Replay | None = None,
    options: ViewOptions | None = None,
) -> FilePath:
    """Write one self-contained page, which loads nothing from the network.

    Args:
        file: The file, written atomically.
        scene: The arms and obstacles.
        trajectory: The motion to play; its columns are joints of the scene.
        path: A path without times: drawn, and played at a steady speed if there is no trajectory.
        problem: The query: its start and goal are drawn as ghosts.
        report: The referee's verdict on the trajectory, shown as a badge. Elements that collide are red at that
            time, and the time line is marked there.
        replay: The simulated trajectory, drawn as a shadow next to it; its contacts are also shown, and loose bodies
            move as in the simulation. Without a trajectory or path, the replay itself is played.
        options: How the page looks (default: `ViewOptions()`).

    Returns:
        The file.

    Raises:
        UnknownNameError: a column that is not a joint of the scene.
        InputError: a file that cannot be written, or data that JSON cannot represent.
        MissingPackageError: Meshcat is not installed.
    """
    document = view_document(
        scene, trajectory=trajectory, path=path, problem=problem, report=report, replay=replay, options=options
    )
    return write_text(file, page_html(document, options))
