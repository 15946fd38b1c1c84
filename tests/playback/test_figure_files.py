"""Figures drawn by several threads."""

from __future__ import annotations

from threading import Event, Thread

from matplotlib import rcParams

import rr1plan as rp
from rr1plan.playback.figure_files import drawing
from rr1plan.playback.trajectory_figure import trajectory_svg


def test_figures_of_two_threads_use_their_own_settings_and_restore_those_before() -> None:
    trajectory = rp.Trajectory(("arm/a",), [0.0, 1.0], [[[0.0], [1.0]]])
    before, expected = dict(rcParams), trajectory_svg(trajectory)
    drawn: list[str] = []
    done = Event()
    other = Thread(target=lambda: (drawn.append(trajectory_svg(trajectory)), done.set()))
    with drawing({"axes.linewidth": 7.0, "svg.hashsalt": "another"}):
        other.start()
        done.wait(0.2)  # the time that the other thread would need
    other.join()
    assert drawn == [expected]
    assert dict(rcParams) == before
