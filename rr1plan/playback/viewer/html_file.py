"""One HTML file that plays a motion offline."""

from __future__ import annotations

import os
from pathlib import Path as FilePath
from typing import TypedDict

from rr1plan.errors import InputError
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.path import Path
from rr1plan.playback.simulation.replay import Replay
from rr1plan.playback.viewer.html_page import page_html
from rr1plan.playback.viewer.page_content import HasPage, page_content
from rr1plan.playback.viewer.page_document import view_document
from rr1plan.playback.viewer.view_options import ViewOptions
from rr1plan.report import Report
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory


def save_html(
    file: str | os.PathLike[str],
    scene: Scene | Robot | Problem | HasPage,
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
        file: The file (.html), written atomically.
        scene: The arms and obstacles; or a value that has a page, without the arguments up to `replay`: a motion, a
            sequence plan, a C-space, a lesson, a problem or a robot.
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
        InputError: a value without a page, an argument given together with a value that has its own content, another
            suffix, a file that cannot be written, or data that JSON cannot represent.
        NoPlanError: a plan without a motion.
        MissingPackageError: Meshcat is not installed.
    """
    given = _Content(trajectory=trajectory, path=path, problem=problem, report=report, replay=replay)
    target = check_writable(file, ".html")
    if isinstance(scene, Scene):
        return write_text(target, page_html(view_document(scene, **given, options=options), options))
    document, options = page_content(scene, options)
    extra = [name for name, value in given.items() if value is not None]
    if extra:
        raise InputError(
            f"{extra[0]} is given together with a {type(scene).__name__}, which has its own content; expected its scene"
        )
    return write_text(target, page_html(document, options))


class _Content(TypedDict):
    """Arguments of `view_document`."""

    trajectory: Trajectory | None
    path: Path | None
    problem: Problem | None
    report: Report | None
    replay: Replay | None
