"""All stages on one problem: plan, shorten, retime, validate, replay.

The order and the margins are those of `rr1plan.plan_motion`; here every stage has a clock of CPU time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from shared import Clock

import rr1plan as rp
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.pipeline import halved_margin

STAGES = ("set up", "plan", "shorten", "retime", "validate")


@dataclass
class Outcome:
    """Result of one problem."""

    name: str
    clock: Clock = field(default_factory=Clock)
    status: str = ""
    reason: str = ""
    margin: float = 0.0
    retiming: str = ""
    raw: rp.Path | None = None
    path: rp.Path | None = None
    trajectory: rp.Trajectory | None = None
    report: rp.Report | None = None
    replay: Any = None

    @property
    def solved(self) -> bool:
        """Whether there is a path."""
        return self.raw is not None

    @property
    def certified(self) -> bool:
        """Whether the referee proved the timed motion."""
        return self.report is not None and self.report.certified

    def to_dict(self) -> dict[str, Any]:
        """The figures, without the motions."""
        data: dict[str, Any] = {
            "name": self.name,
            "status": self.status,
            "cpu": self.clock.cpu,
            "wall": self.clock.wall,
        }
        if self.reason:
            data["reason"] = self.reason
        if self.raw is not None and self.path is not None and self.trajectory is not None:
            data |= {"length_raw": self.raw.length, "length": self.path.length, "waypoints": len(self.path)}
            data |= {"duration": self.trajectory.duration, "margin": self.margin, "retiming": self.retiming}
        if self.report is not None:
            data |= {"certified": self.report.certified, "violations": [v.message for v in self.report.violations]}
            data["clearance"] = float(self.report.margins["clearance"]) if "clearance" in self.report.margins else None
        if self.replay is not None:
            data["tracking_error"] = self.replay.worst_error
            data["contacts"] = [[*c.pair, c.first, c.depth] for c in self.replay.contacts]
        return data


def run_line(
    name: str,
    problem: rp.Problem,
    seed: int,
    *,
    planner: str = "rrt_connect",
    margin: float = 0.002,
    seconds: float = 10.0,
    replay: bool = False,
) -> Outcome:
    """Solve a problem like `plan_motion`, with the CPU time of each stage."""
    out = Outcome(name)
    margin = find_margin(out, problem, margin)
    roomy = find_path(out, problem, seed, planner=planner, margin=margin, seconds=seconds)
    time_motion(out, problem, roomy)
    if replay and out.trajectory is not None:
        with out.clock.stage("replay"):
            out.replay = rp.simulate(out.trajectory, problem.scene)
    return out


def find_margin(out: Outcome, problem: rp.Problem, margin: float) -> float:
    """The margin that the start allows [m]; this creates the scene's first checker."""
    with out.clock.stage("set up"):
        return halved_margin(problem, margin)


def find_path(
    out: Outcome, problem: rp.Problem, seed: int, *, planner: str, margin: float, seconds: float
) -> rp.Problem:
    """The stages up to a short path. Returns the problem that it solves, with the margin."""
    result, roomy, out.margin = _plan(problem, planner, margin, rp.Budget(seconds=seconds), seed, out.clock)
    out.status, out.reason, out.raw = result.status.value, result.reason, result.path
    if out.raw is not None:
        with checker_from_pool(problem.scene, problem.arms, roomy.margin) as motions, out.clock.stage("shorten"):
            out.path = rp.shorten(out.raw, problem.scene, checker=motions, rng=seed)
    return roomy


def time_motion(out: Outcome, problem: rp.Problem, roomy: rp.Problem) -> None:
    """The stages from the short path to a proven motion."""
    if out.path is None:
        return
    with checker_from_pool(problem.scene, problem.arms, roomy.margin) as motions:
        for out.retiming in ("blend", "stop"):
            with out.clock.stage("retime"):
                out.trajectory = rp.retime(out.path, problem.scene, method=out.retiming, checker=motions)
            with out.clock.stage("validate"):
                out.report = rp.validate(out.trajectory, problem.scene, problem)
            if out.report.valid:
                break


def _plan(
    problem: rp.Problem, planner: str, margin: float, budget: rp.Budget, seed: int, clock: Clock
) -> tuple[rp.PlanResult, rp.Problem, float]:
    """The planner's result, its problem and its margin, which is dropped if no goal has it."""
    for m in (margin, 0.0):
        with clock.stage("set up"):
            roomy = problem.with_margin(m)
            rp.warm_up(roomy)
        with clock.stage("plan"):
            result = rp.plan(roomy, planner=planner, budget=budget, rng=seed)
        if result.status not in (rp.PlanStatus.INVALID_GOAL, rp.PlanStatus.INFEASIBLE):
            break
    return result, roomy, m


def warm_up() -> None:
    """Load modules and kernels."""
    run_line("warm up", rp.load_problems("rr1_table")["reach_over_crate"], 0, replay=True)
