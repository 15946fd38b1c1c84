"""Many arms: each on a separate path, scheduled on one clock and certified in continuous time.

A `Problem` that moves several arms is one problem with more columns, and every planner answers it in the joint space
of all of them (see `composite`). From three arms on `plan_motion` plans a path for each arm instead: `plan_many_arms`.
`search` finds schedules, `timing` says when arms move on fixed paths, `paths` where; `execution` is about plans that
run, and `scenarios` makes seeded problems. Grids and rings of arms are in `rr1plan.scene.placement`.
"""

from rr1plan.multi.execution.added_motions import AddedMotion, add_motion
from rr1plan.multi.execution.plan_execution import ArmDelay, PlanExecution, execute_plan
from rr1plan.multi.execution.route import Route
from rr1plan.multi.execution.running_plan import Part, RunningPlan
from rr1plan.multi.execution.saved_plan_graph import load_plan_graph, save_plan_graph
from rr1plan.multi.execution.temporal_plan_graph import Dependency, Node, PlanGraph, plan_graph
from rr1plan.multi.plan_quality import PlanQuality
from rr1plan.multi.portfolio import GroupResult, ManyArmsResult, plan_many_arms
from rr1plan.multi.scenarios.problems import dual_arm_shelf, random_grid, reach_grid, ring_swap
from rr1plan.multi.scenarios.workcell_problems import conveyor_line, handover_window, shared_bin, shelf_rows
from rr1plan.multi.timing.schedule import Leg, Schedule
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
    "PlanQuality",
    "Route",
    "RunningPlan",
    "Schedule",
    "add_motion",
    "conveyor_line",
    "dual_arm_shelf",
    "execute_plan",
    "handover_window",
    "load_plan_graph",
    "place_grid",
    "place_ring",
    "plan_graph",
    "plan_many_arms",
    "random_grid",
    "reach_grid",
    "ring_swap",
    "save_plan_graph",
    "shared_bin",
    "shelf_rows",
]
