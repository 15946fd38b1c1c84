"""Conversion of schedules of several agents to one composite path of all their arms."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rr1plan.checks import Array
from rr1plan.multi.agents import Agent
from rr1plan.multi.timing.schedule import Schedule

# Instants closer than this are merged [s].
_SAME_TIME = 1e-6


def composite_waypoints(schedules: Iterable[Schedule], agent: Agent) -> Array:
    """Configurations of the arms of several schedules at all instants at which one of them passes a gridpoint.

    Straight lines between these waypoints approximate the motion, and are not certified.

    Args:
        schedules: Schedules of agents whose arms are those of `agent`.
        agent: The agent of all of these arms.

    Returns:
        Configurations in the column order of `agent`, shape (n, nq), n >= 2.
    """
    schedules = list(schedules)
    instants = np.concatenate([[0.0], *(schedule.occupancy.enter[1:] for schedule in schedules)])
    instants = np.unique(instants)
    instants = instants[np.concatenate([[True], np.diff(instants) > _SAME_TIME])]
    columns: dict[str, Array] = {}
    for schedule in schedules:
        motion = schedule.trajectory()
        values = motion(np.minimum(instants, motion.end_time))
        values[0], values[-1] = schedule.path.start, schedule.path.goal
        columns.update(zip(motion.joint_names, values.T, strict=True))
    waypoints = np.column_stack([columns[name] for name in agent.joint_names])
    return waypoints if len(waypoints) > 1 else np.repeat(waypoints, 2, axis=0)
