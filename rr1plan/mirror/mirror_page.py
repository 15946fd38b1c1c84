"""The live page of a mirror: the arms as measured, and a panel with their deviation from the plan."""

from __future__ import annotations

import math
from dataclasses import replace
from time import monotonic

from rr1plan.checks import Array
from rr1plan.mirror.mirror_report import MirrorEvent, MirrorState, MirrorStatistics
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.viewer import Panel, Viewer, ViewOptions
from rr1plan.playback.viewer.live_viewer import announced
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.view_options import with_panel
from rr1plan.scene import Scene
from rr1plan.scene.unlocked_joints import unlocked_scene
from rr1plan.trajectory import Trajectory

# Shortest interval between updates of the page, and of its panel [s].
_FRAME, _PANEL = 1 / 60, 0.1
# A state counts as out of date if messages have given no other for longer than this [s].
_LATE = 1.0
_WIDTH = 380  # [px]


class MirrorPage:
    """The page, which gets no more updates than it can draw. Locked joints have columns: they are measured, too.

    Args:
        scene: The scene.
        plan: The plan; None: the panel has no deviations.
        names: The joints whose deviations the panel shows.
        options: How the page looks.

    Attributes:
        viewer: The page itself.
    """

    def __init__(self, scene: Scene, plan: Trajectory | None, names: tuple[str, ...], options: ViewOptions) -> None:
        html, css, script = (page_asset(f"mirror.{kind}") for kind in ("html", "css", "js"))
        data = {"joints": list(names), "state": None, "event": None, "late": False}
        panel = Panel("mirror", "Mirror", html=html, css=css, script=script, data=data, width=_WIDTH)
        title = f"{scene.name}: mirror" if options.title is None else options.title
        options = replace(with_panel(options, panel), title=title, play=False, planner=False)
        locked = {name: tuple(arm.robot.locked_joints) for name, arm in scene.arms.items()}
        shown = unlocked_scene(scene, locked)
        self._columns = JointMap(scene).indices(shown.joint_names())
        if plan is not None:
            fixed = [n for arm in plan.arms for n in shown.joint_names([arm]) if n not in plan.joint_names]
            values = dict(zip(shown.joint_names(), shown.configuration().tolist(), strict=True))
            rest = Trajectory.rest(fixed, [values[name] for name in fixed], start=plan.start_time)
            plan = Trajectory.merge(plan, rest)
        self.viewer = announced(Viewer(shown, trajectory=plan, options=options))
        self._next_frame = self._next_panel = -math.inf
        self._event: MirrorEvent | None = None
        self._late = False
        self._heard = monotonic()

    def draw(
        self,
        state: MirrorState,
        positions: Array,
        statistics: MirrorStatistics,
        event: MirrorEvent | None,
        now: float | None = None,
    ) -> None:
        """Show a state.

        Args:
            state: The state.
            positions: Positions of all movable joints [rad or m], shape (n,).
            statistics: Those of all messages so far.
            event: The latest event; a new one is shown at once.
            now: Time of arrival [s]; a state that arrives soon after the one shown is omitted. None: it is shown.
        """
        if self.viewer.closed:
            return
        if now is None:
            self.viewer.update(positions[self._columns])
            self._fill_panel(state, statistics, event, late=self._late)
            return
        self._heard = monotonic()
        if now >= self._next_frame:
            self.viewer.update(positions[self._columns])
            self._next_frame = now + _FRAME
        if now >= self._next_panel or event is not self._event or self._late:
            self._fill_panel(state, statistics, event, late=False)
            self._next_panel = now + _PANEL

    def draw_fault(
        self,
        state: MirrorState | None,
        positions: Array,
        statistics: MirrorStatistics,
        event: MirrorEvent | None,
        *,
        silent: bool,
    ) -> None:
        """Show the latest event, and whether the latest state, which may be omitted so far, is out of date by now."""
        late = silent or monotonic() > self._heard + _LATE
        if self.viewer.closed or (late is self._late and event is self._event):
            return
        if state is not None:
            self.viewer.update(positions[self._columns])
        self._fill_panel(state, statistics, event, late=late)

    def _fill_panel(
        self, state: MirrorState | None, statistics: MirrorStatistics, event: MirrorEvent | None, *, late: bool
    ) -> None:
        shown = None if state is None else _panel_state(state, statistics)
        text = None if event is None else f"{event.time:.2f} s: {event.message}"
        self.viewer.update_panel("mirror", {"state": shown, "event": text, "late": late})
        self._event, self._late = event, late


def _panel_state(state: MirrorState, statistics: MirrorStatistics) -> dict[str, object]:
    corridor = state.corridor
    return {
        "time": state.time,
        "moved": list(state.moved),
        "rate": statistics.rate(),
        "delay": statistics.delay(),
        "deviation": None if state.deviation is None else state.deviation.tolist(),
        "most": statistics.max_deviation.tolist(),
        "use": None if corridor is None else corridor.use,
        "pair": None if corridor is None else list(corridor.pair),
        "contacts": [list(pair) for pair in state.contacts],
    }
