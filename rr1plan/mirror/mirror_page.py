"""The live page of a mirror: the arms as measured, and a panel with their deviation from the plan."""

from __future__ import annotations

import math
from dataclasses import replace

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
        data = {"joints": list(names), "state": None}
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

    def draw(
        self,
        state: MirrorState,
        positions: Array,
        now: float,
        statistics: MirrorStatistics,
        event: MirrorEvent | None,
    ) -> None:
        """Show a state that arrived at a time [s], with the positions of all movable joints, and the latest event."""
        if self.viewer.closed:
            return
        if now >= self._next_frame:
            self.viewer.update(positions[self._columns])
            self._next_frame = now + _FRAME
        if now >= self._next_panel:
            self.viewer.update_panel("mirror", {"state": _panel_state(state, statistics, event)})
            self._next_panel = now + _PANEL


def _panel_state(state: MirrorState, statistics: MirrorStatistics, event: MirrorEvent | None) -> dict[str, object]:
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
        "event": None if event is None else f"{event.time:.2f} s: {event.message}",
    }
