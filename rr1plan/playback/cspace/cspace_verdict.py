"""The result of a query in words: what is proven, what was found, what is open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rr1plan.checks import counted

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery


def describe(cspace: CSpaceQuery) -> str:
    """The configuration space, the query and its result as lines of text."""
    grid = cspace.grid
    first, second = grid.joint_names
    share = f"{100 * grid.free.mean():.1f} % free"
    lines = [f"configuration space of {first} and {second}: {_cells(cspace, 'x')}, {share}, {_parts(cspace)}"]
    lines += [f"  {text}" for text in [_slice(cspace, "-")] if text]
    lines += [f"  {name}: {100 * mask.mean():.1f} % of the cells" for name, mask in grid.layers.items()]
    for name, goal, reachable, blocked in zip(
        cspace.goal_names, cspace.goals, cspace.reachable_goals, cspace.goals_blocked_by, strict=True
    ):
        where = f"{name} ({goal[0]:+.3f}, {goal[1]:+.3f})"
        if blocked:
            lines.append(f"  {where}: not free ({', '.join(blocked)})")
        elif cspace.start_blocked_by:
            lines.append(f"  {where}: free")
        elif cspace.proves_no_path:
            lines.append(f"  {where}: cut off from the start")
        else:
            lines.append(f"  {where}: {'same component as' if reachable else 'on the grid not joined to'} the start")
    if cspace.start is not None:
        lines.append(f"  {verdict(cspace)}")
    return "\n".join(lines)


def _slice(cspace: CSpaceQuery, minus: str = "−") -> str:
    """The values of the other joints of the arm; empty if there are none."""
    arm = cspace.grid.scene.arms[cspace.grid.arm]
    others = [(n, q) for n, q in zip(arm.robot.joint_names, arm.q, strict=True) if n not in cspace.grid.joint_names]
    values = ", ".join(f"{name} = {f'{value:z.4g}'.replace('-', minus)}" for name, value in others)
    return f"a slice, at {values}" if others else ""


def headline(cspace: CSpaceQuery) -> str:
    """The result in a few words, for a title."""
    if cspace.found:
        return "the same path in the workspace and in the configuration space"
    if cspace.start_blocked_by:
        return "the start is not free"
    if cspace.proves_no_path and cspace.goals and not all(cspace.goals_blocked_by):
        return "no path exists, start and goal lie in different components"
    if cspace.proves_no_path:
        return f"no path exists, {_why_none(cspace)}"
    return _slice(cspace)


def tone(cspace: CSpaceQuery) -> str:
    """The style on the page: "bad" if no path exists, "good" if there is one, "open" if neither is known."""
    if cspace.start is None:
        return ""
    if cspace.proves_no_path:
        return "bad"
    return "good" if any(cspace.reachable_goals) else "open"


def verdict(cspace: CSpaceQuery) -> str:
    """The result in a sentence, with the names of goals that are out of reach."""
    fault = [f"The path does not answer the query: {cspace.path_fault}."] if cspace.path_fault else []
    return " ".join([_answer(cspace), *fault, *(f"{why[0].upper()}{why[1:]}." for why in cspace.unreached)])


def _answer(cspace: CSpaceQuery) -> str:
    grid = cspace.grid
    if cspace.start is None:
        return f"{100 * grid.free.mean():.0f} % of all configurations are free, in {_parts(cspace)}."
    if cspace.start_blocked_by:
        return f"The start is not free: {' and '.join(cspace.start_blocked_by)}."
    if cspace.found:
        return f"Start and goal lie in the same component of free space{_about_path(cspace)}."
    if cspace.proves_no_path:
        return f"No path exists: {_why_none(cspace)}{_by_which_cells(cspace)}."
    if any(cspace.reachable_goals):
        return f"On this grid of {_cells(cspace)} start and goal lie in the same component of free space."
    if not cspace.goals:
        return "Open: no configuration was found that reaches the goal, but that is no proof."
    start = f"Open: this grid of {_cells(cspace)} does not join start and goal, but that is no proof"
    if cspace.decomposition is None:
        return f"{start}."
    size = cspace.decomposition.resolution
    return f"{start}: certified cells, refined to a grid of {size} × {size}, do not separate them."


def _why_none(cspace: CSpaceQuery) -> str:
    if not cspace.goals:
        return "no configuration reaches the goal"
    if all(cspace.goals_blocked_by):
        return "no configuration that reaches the goal is free"
    return "start and goal are free, but in different components of free space"


def _by_which_cells(cspace: CSpaceQuery) -> str:
    """The resolution of the cells, if the proof uses cells."""
    if (cspace.goals and all(cspace.goals_blocked_by)) or cspace.decomposition is None:
        return ""
    cells = f"{cspace.decomposition.resolution} × {cspace.decomposition.resolution}"
    return f", proven by certified cells on a grid of {cells}"


def _about_path(cspace: CSpaceQuery) -> str:
    notes = ["; the path leads over the seam"] if crosses_seam(cspace) else []
    if cspace.path is not None and not cspace.grid.connected(cspace.path[0], cspace.path[-1]):
        notes.append(f"; the path leads through a gap too narrow for this grid of {_cells(cspace)}")
    return "".join(notes)


def crosses_seam(cspace: CSpaceQuery) -> bool:
    """Whether the path leaves the square and re-enters at the opposite side."""
    if cspace.path is None:
        return False
    for axis, ((low, high), closes) in enumerate(zip(cspace.grid.ranges, cspace.grid.periodic, strict=True)):
        turns = np.floor((cspace.path[:, axis] - low) / (high - low))
        if closes and len(np.unique(turns)) > 1:
            return True
    return False


def _cells(cspace: CSpaceQuery, times: str = "×") -> str:
    return f"{f' {times} '.join(str(n) for n in cspace.grid.free.shape)} cells"


def _parts(cspace: CSpaceQuery) -> str:
    return f"{counted(cspace.grid.components, 'component')} of free space"
