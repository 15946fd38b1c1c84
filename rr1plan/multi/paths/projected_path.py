"""The paths of some arms of an agent that moves more arms as one."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.path import Path
from rr1plan.retiming.path_blends import Curve
from rr1plan.retiming.path_speed import Grid


class ProjectedPath(AgentPath):
    """A path of some arms on a given curve.

    Args:
        agent: These arms.
        curve: The curve, not parameterized by length.
        grid: Its segments.
        halts: Gridpoints at which every motion stops.
        ends: First and last configuration, shape (2, nq).
    """

    def __init__(self, agent: Agent, curve: Curve, grid: Grid, halts: tuple[int, ...], ends: Array) -> None:
        self.agent, self.curve, self.grid, self.halts = agent, curve, grid, halts
        self.segments = len(grid.delta)
        self.start, self.goal = ends
        inner = grid.position(curve, 0.0)[1:]
        self.path = Path(agent.joint_names, np.concatenate([ends[:1], inner, ends[1:]]))
        self._limits_jerk = agent.timing.method == "ruckig"
        self._stretches, self._lines = {}, {}
