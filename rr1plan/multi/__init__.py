"""Many arms: placing them, and planning them apart on one clock.

A `Problem` that moves several arms is one problem with more columns, and every planner answers it in the joint space
of all of them (see `composite`). From three arms on `plan_motion` plans them apart instead: `plan_many_arms`.

    portfolio.py                             plan_many_arms: all stages under one deadline, one trajectory
    preflight.py  interaction.py             starts and goals that cannot be; arms that can meet
    prioritized.py                           schedules one after the other, detours, eviction, meta-agents
    path_pool.py                             paths of one agent
    safe_intervals.py  schedule.py           timing on a fixed path; what a schedule occupies
    coordination.py                          coordination diagrams: which segments of two paths do not touch
    agent_path.py  placed_path.py  agents.py   paths in segments, with their bodies; arms that move as one
    temporal_plan_graph.py  route.py         temporal plan graphs: who waits for whom; all that an agent passes
    plan_execution.py  route_motion.py       executing a plan with delays; an agent that brakes and goes on
    added_motions.py  running_plan.py        new goals for single arms while a plan runs
    saved_plan_graph.py  projected_path.py   plan graphs from files; the path of one arm of an agent
    problems.py                              seeded problems; grids and rings are in `rr1plan.scene.placement`
"""

from rr1plan.multi.added_motions import AddedMotion, add_motion
from rr1plan.multi.plan_execution import ArmDelay, PlanExecution, execute_plan
from rr1plan.multi.portfolio import GroupResult, ManyArmsResult, plan_many_arms
from rr1plan.multi.problems import dual_arm_shelf, random_grid, ring_swap
from rr1plan.multi.route import Route
from rr1plan.multi.running_plan import Part, RunningPlan
from rr1plan.multi.saved_plan_graph import load_plan_graph, save_plan_graph
from rr1plan.multi.schedule import Leg, Schedule
from rr1plan.multi.temporal_plan_graph import Dependency, Node, PlanGraph, plan_graph
from rr1plan.scene.placement import place_grid, place_ring

__all__ = [
    "AddedMotion",
    "ArmDelay",
    "Dependency",
    "GroupResult",
    "Leg",
    "ManyArmsResult",
    "Node",
    "Part",
    "PlanExecution",
    "PlanGraph",
    "Route",
    "RunningPlan",
    "Schedule",
    "add_motion",
    "dual_arm_shelf",
    "execute_plan",
    "load_plan_graph",
    "place_grid",
    "place_ring",
    "plan_graph",
    "plan_many_arms",
    "random_grid",
    "ring_swap",
    "save_plan_graph",
]
