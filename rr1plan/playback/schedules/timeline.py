"""`timeline`: when each arm of a motion moves and rests, for whom it waits, and where arms touch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from rr1plan.checks import finite_number, items_of, known_name, of_kind, true_or_false
from rr1plan.planning import Wait
from rr1plan.playback.figure_files import check_width, save_figure
from rr1plan.playback.schedules.timeline_rows import Interval, TimelineRows
from rr1plan.report import Report, Violation
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.view_options import Panel

_STILL = 1e-9  # rates below this are rest [rad or m per power of a second]
_SHORTEST = 1e-3  # texts have milliseconds: shorter rests would read as rests of no length [s]


class Timeline(TimelineRows):
    """The time line (Gantt chart) of a motion of several arms, as a figure and as a panel."""

    def figure(self, *, width: float = 13.0, dark: bool = False) -> Figure:
        """A matplotlib figure: a row for each arm.

        Args:
            width: Its width [inch], at most 100.
            dark: For a dark slide.

        Raises:
            InputError: another width.
        """
        from rr1plan.playback.schedules.timeline_figure import draw

        return draw(self, check_width(width), true_or_false("dark", dark))

    def save(self, file: str | FilePath, *, dark: bool = False) -> FilePath:
        """Write it atomically in the format given by the suffix: .png, .svg or .pdf.

        Args:
            file: The file, 13 inches wide.
            dark: For a dark slide.

        Raises:
            InputError: another suffix, or a file that cannot be written.
        """
        return save_figure(file, lambda: self.figure(dark=dark))

    def panel(self) -> Panel:
        """A panel for a page of the same motion: a cursor follows the clock, and a click jumps to a time."""
        from rr1plan.playback.schedules.timeline_panel import timeline_panel

        return timeline_panel(self)


def timeline(
    trajectory: Trajectory,
    scene: Scene,
    *,
    report: Report | None = None,
    waits: Iterable[Wait] = (),
    undelayed: Mapping[str, float] | None = None,
) -> Timeline:
    """The time line of any motion of several arms; `MotionPlan.timeline` is that of a plan.

    Args:
        trajectory: The motion; its columns are joints of the scene.
        scene: The scene.
        report: The referee's verdict, whose collisions are marked.
        waits: The waits (`Wait`) of a plan. A rest that overlaps none of them has no reason.
        undelayed: Duration of the path of an arm without waiting [s], where known.

    Raises:
        UnknownNameError: a column that is not a joint of the scene, or a name that is not an arm.
        InputError: an argument of another type.
    """
    of_kind("trajectory", trajectory, Trajectory)
    of_kind("scene", scene, Scene)
    of_kind("report", report, Report, optional=True)
    of_kind("undelayed", undelayed, Mapping, optional=True)
    alone = {arm: finite_number(f"undelayed of {arm!r}", seconds) for arm, seconds in (undelayed or {}).items()}
    given = items_of("waits", waits, "Waits")
    for wait in given:
        of_kind("one of the waits", wait, Wait)
    columns = _columns(trajectory, scene)
    start = trajectory.start_time
    motions = {arm: _motions(trajectory, own) for arm, own in columns.items()}
    for name in {wait.arm for wait in given} | set(alone):
        known_name("moving arm", name, columns)
    rests = [Wait(arm, *gap, _whom(arm, gap, given)) for arm in columns for gap in _gaps(motions[arm], start)]
    found = [v for v in ([] if report is None else report.violations) if _is_conflict(v)]
    touching = [tuple(a for a in dict.fromkeys(scene.owner(e) for e in v.subject) if a in columns) for v in found]
    return Timeline(
        scene.name,
        tuple(columns),
        {arm: list(scene.arms).index(arm) for arm in columns},
        motions,
        tuple(rests),
        start,
        max((last[-1][1] - start for last in motions.values() if last), default=0.0),
        alone,
        tuple(found),
        tuple(tuple(str(arm) for arm in arms) for arms in touching),
    )


def _is_conflict(violation: Violation) -> bool:
    return violation.kind in ("collision", "undecided") and len(violation.subject) == 2 and violation.time is not None


def _columns(trajectory: Trajectory, scene: Scene) -> dict[str, list[int]]:
    """Columns of each moving arm, in the order of the scene."""
    known = scene.joint_names()
    owned: dict[str, list[int]] = {}
    for column, name in enumerate(trajectory.joint_names):
        known_name("joint of the scene", name, known)
        owned.setdefault(name.split("/", 1)[0], []).append(column)
    return {arm: owned[arm] for arm in scene.arms if arm in owned}


def _motions(trajectory: Trajectory, columns: list[int]) -> tuple[Interval, ...]:
    """When these columns move; consecutive pieces are one interval."""
    moves = (np.abs(trajectory.coefficients[:, 1:, columns]) > _STILL).any(axis=(1, 2))
    if not moves.any():
        return ()
    edges = np.flatnonzero(np.diff(moves.astype(np.int8), prepend=0, append=0))
    times = trajectory.breaks[edges]
    return tuple((float(begin), float(end)) for begin, end in times.reshape(-1, 2))


def _gaps(motions: tuple[Interval, ...], start: float) -> list[Interval]:
    """The rests before, and between, motions, without those too short to mention."""
    ends = [start, *(end for _, end in motions)]
    return [(end, begin) for end, (begin, _) in zip(ends, motions, strict=False) if begin - end >= _SHORTEST]


def _whom(arm: str, gap: Interval, waits: Iterable[Wait]) -> tuple[str, ...]:
    """The arms that an arm waits for during a rest, from its waits that overlap the rest."""
    found = [w for w in waits if w.arm == arm and min(w.end, gap[1]) > max(w.begin, gap[0])]
    return tuple(dict.fromkeys(other for wait in found for other in wait.others))
