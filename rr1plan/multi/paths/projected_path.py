"""The path of one arm of an agent that moves several arms as one."""

from __future__ import annotations

import numpy as np

from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.agent_path import AgentPath
from rr1plan.path import Path
from rr1plan.retiming.path_blends import Curve


class ProjectedPath(AgentPath):
    """One arm's columns of an agent's path, with the same gridpoints.

    Args:
        whole: The path.
        arm: One of its agent's arms.
    """

    def __init__(self, whole: AgentPath, arm: str) -> None:
        self.agent = Agent(whole.agent.problem, [arm])
        names = whole.path.joint_names
        columns = [names.index(name) for name in self.agent.joint_names]
        self.path = Path(self.agent.joint_names, whole.path.waypoints[:, columns])
        self.start, self.goal = whole.start[columns], whole.goal[columns]
        curve = whole.curve
        self.curve = Curve(curve.lengths, np.ascontiguousarray(curve.coefficients[:, :, columns]), curve.corners)
        self.grid, self.halts, self.segments = whole.grid, whole.halts, whole.segments


def path_of_arm(path: AgentPath, arm: str) -> AgentPath:
    """The path of one arm: the path itself where its agent is that arm alone."""
    return path if path.agent.arms == (arm,) else ProjectedPath(path, arm)
