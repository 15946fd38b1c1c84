"""The time line as a panel of the page: rows of arms, a time cursor, and conflicts that a click shows in red."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rr1plan.checks import counted
from rr1plan.playback.arm_colors import arm_color
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.view_options import Panel

if TYPE_CHECKING:
    from rr1plan.playback.schedules.timeline_rows import TimelineRows

_WIDTH = 440  # [px]
_MOST_CONFLICTS = 30


def timeline_panel(line: TimelineRows) -> Panel:
    """The panel of a time line."""
    html, css, script = (page_asset(f"timeline.{kind}") for kind in ("html", "css", "js"))
    return Panel("timeline", "Who moves when", html=html, css=css, script=script, data=_data(line), width=_WIDTH)


def _data(line: TimelineRows) -> dict[str, Any]:
    place = {arm: row for row, arm in enumerate(line.arms)}
    arms: list[dict[str, Any]] = []
    for arm in line.arms:
        waits = [
            [w.begin, w.end, [place[other] for other in w.others if other in place]] for w in line.waits if w.arm == arm
        ]
        color, moves = arm_color(line.numbers[arm]), [list(motion) for motion in line.motions[arm]]
        arms.append({"name": arm, "color": color, "moves": moves, "waits": waits, "undelayed": line.undelayed.get(arm)})
    conflicts = [
        {
            "time": violation.time,
            "elements": list(violation.subject),
            "rows": [place[arm] for arm in touching],
            "message": violation.message,
        }
        for violation, touching in zip(line.conflicts[:_MOST_CONFLICTS], line.touching, strict=False)
        if violation.time is not None
    ]
    times = {"start": line.start, "makespan": line.makespan}
    waiting = f", {line.waiting:.2f} s of waiting in all" if line.waits else ""
    summary = f"{counted(len(line.arms), 'arm')}, {line.makespan:.2f} s{waiting}"
    return {"arms": arms, **times, "conflicts": conflicts, "summary": summary}
