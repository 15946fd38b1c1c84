"""Random feasible queries: generated, solved by the whole pipeline, replayed, and reported in tables.

Both ends are drawn uniformly within the joint limits until they are free and a roadmap of certified edges
joins them, so that a path is known to exist. Half of the goals are the drawn configuration itself, a quarter
the tool's pose there, a quarter only its position.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from line import STAGES, Outcome, run_line, warm_up
from shared import STAGE_HEADER, heading, number, save, save_distribution, spread, stage_rows, table, track

import rr1plan as rp
from rr1plan.checks import Array

# Largest tracking error of the replay [rad] under each of the limits.
TRACKING = {"sim": 0.005, "hardware": 0.001}
GOALS = ("joints", "pose", "joints", "position")
_ANSWERS = ("invalid_start", "invalid_goal", "infeasible")
_MOST_DRAWS = 20_000


@dataclass(frozen=True)
class Query:
    """A query with all data to repeat it."""

    name: str
    scene: str
    limits: str
    goal: str
    seed: int
    problem: rp.Problem


class Roadmap:
    """A roadmap of random free configurations, connected by certified edges.

    Two ends that certified edges connect to the same component have a path between them.
    """

    def __init__(self, motions: rp.CollisionChecker, points: Array, neighbors: int = 30) -> None:
        self._motions, self._points, self._neighbors = motions, points, neighbors
        self._part = np.arange(len(points))
        for i in range(len(points)):
            for j in self._nearest(points[i]):
                if self._part[i] != self._part[j] and motions.edge_is_free(points[i], points[j]):
                    self._part[self._part == self._part[j]] = self._part[i]

    def part(self, q: Array) -> int | None:
        """The component of the roadmap to which q is connected, or None."""
        for i in self._nearest(q):
            if self._motions.edge_is_free(q, self._points[i]):
                return int(self._part[i])
        return None

    def _nearest(self, q: Array) -> Array:
        far = np.linalg.norm(self._points - q, axis=1)
        return np.asarray(np.argsort(far, kind="stable")[: self._neighbors])


class Drawer:
    """Draws queries in one scene under one of the limits."""

    def __init__(self, scene_name: str, limits: str, seed: int, nodes: int) -> None:
        scene = rp.load_scene(scene_name)
        for name, arm in scene.arms.items():
            scene = scene.with_robot(name, arm.robot.with_limits(limits))
        # Configurations of the file may be outside these limits; they do not matter, because every arm moves.
        self.scene, self.scene_name, self.limits = scene, scene_name, limits
        self._motions = rp.CollisionChecker(scene)
        self._checker = self._motions
        self._kinematics = rp.Kinematics(scene)
        rng = np.random.default_rng(seed)
        self._roadmap = Roadmap(self._motions, np.array([self._free(rng) for _ in range(nodes)]))

    def draw(self, goal: str, seed: int) -> Query:
        """A query of all arms, the same for the same seed."""
        rng = np.random.default_rng(seed)
        start, end = self._ends(rng)
        parts = self.scene.split(end)
        goals = {arm: self._goal(goal, arm, q, end) for arm, q in parts.items()}
        problem = rp.Problem(self.scene, self.scene.split(start), goals)
        name = f"{self.scene_name}/{self.limits}/{goal}/{seed}"
        return Query(name, self.scene_name, self.limits, goal, seed, problem)

    def _ends(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Two free configurations with a proven path between them."""
        for _ in range(_MOST_DRAWS):
            start, end = self._free(rng), self._free(rng)
            part = self._roadmap.part(start)
            if part is not None and part == self._roadmap.part(end):
                return start, end
        raise SystemExit(f"{self.scene_name}: no two connected configurations in {_MOST_DRAWS} draws")

    def _free(self, rng: np.random.Generator) -> Array:
        for _ in range(_MOST_DRAWS):
            q = rng.uniform(self._checker.limits.lower, self._checker.limits.upper)
            if self._checker.is_free(q):
                return q
        raise SystemExit(f"{self.scene_name}: no free configuration in {_MOST_DRAWS} draws")

    def _goal(self, kind: str, arm: str, q: Array, end: Array) -> Any:
        if kind == "joints":
            return rp.JointGoal(q)
        T = self._kinematics.pose(end, f"{arm}/{self.scene.arms[arm].robot.tool}")
        return rp.PoseGoal("tool", T if kind == "pose" else T[:3, 3])


def draw_queries(scenes: Sequence[str], count: int, seed: int, nodes: int) -> list[Query]:
    """`count` queries, spread evenly over scenes, limits and kinds of goals."""
    wanted = [(scene, limits) for limits in TRACKING for scene in scenes]
    drawers = [Drawer(scene, limits, seed, nodes) for scene, limits in track(wanted, "roadmaps")]
    queries = []
    for k in track(range(count), "drawing queries"):
        drawer, goal = drawers[k % len(drawers)], GOALS[(k // len(drawers)) % len(GOALS)]
        queries.append(drawer.draw(goal, seed + k))
    return queries


# ---- answering ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answer:
    """A query and its result."""

    query: Query
    outcome: Outcome

    def faults(self) -> list[str]:
        """All failures of the result."""
        out = self.outcome
        if not out.solved:
            return [] if out.status in _ANSWERS else [f"{out.status}: {out.reason}"]
        violations = out.report.violations if out.report is not None else ()
        found = [] if out.certified else ["refused: " + "; ".join(v.message for v in violations)]
        if out.replay is not None:
            contacts = out.replay.contacts
            found += [
                f"touches: {' and '.join(c.pair)} at {c.first:.3f} s, {1e3 * c.depth:.3f} mm deep" for c in contacts
            ]
            if out.replay.worst_error >= TRACKING[self.query.limits]:
                found.append(f"tracking error {out.replay.worst_error:.2e} rad")
        return found


def answer_queries(args: argparse.Namespace, queries: Sequence[Query]) -> list[Answer]:
    """Run each query through the whole pipeline and the replay."""
    warm_up()
    return [
        Answer(
            q,
            run_line(
                q.name, q.problem, q.seed, planner=args.planner, margin=args.margin, seconds=args.seconds, replay=True
            ),
        )
        for q in track(queries, "queries")
    ]


def add_options(parser: argparse.ArgumentParser, count: int, nodes: int) -> None:
    """The options of both benchmarks of queries."""
    parser.add_argument("--count", type=int, default=count, help="how many queries")
    parser.add_argument("--planner", default="rrt_connect", help="a name of planner_names()")
    parser.add_argument("--seconds", type=float, default=10.0, help="budget of the planner [s]")
    parser.add_argument("--nodes", type=int, default=nodes, help="size of the roadmaps that prove queries feasible")
    parser.add_argument("--margin", type=float, default=0.002, help="distance to keep while planning [m]")


# ---- telling -----------------------------------------------------------------------------------


def tell(args: argparse.Namespace, name: str, title: str, answers: Sequence[Answer]) -> int:
    """Write the results. Returns 0 if no query failed."""
    facts = {"queries": len(answers), "planner": args.planner, "seed": args.seed, "margin": f"{1e3 * args.margin:g} mm"}
    clocks = [a.outcome.clock for a in answers if a.outcome.solved]
    faults = [f"- {a.query.name}: {fault}" for a in answers for fault in a.faults()]
    parts = [heading(title, facts), _summary(answers)]
    parts.append(table(STAGE_HEADER, stage_rows(clocks, (*STAGES, "replay"))))
    parts.append("\n".join(["What went wrong:", "", *(faults or ["nothing."])]))
    results = [
        {"scene": a.query.scene, "limits": a.query.limits, "goal": a.query.goal, "seed": a.query.seed}
        | a.outcome.to_dict()
        | {"faults": a.faults()}
        for a in answers
    ]
    save(args.out, name, {"settings": facts, "queries": results}, "\n\n".join(parts))
    curves = {s: [1e3 * c.cpu[s] for c in clocks if s in c.cpu] for s in (*STAGES[1:], "replay")}
    save_distribution(args.out / f"{name}.png", curves, "CPU time [ms]")
    return 1 if faults else 0


_HEADER = [
    *("scene", "limits", "queries", "solved", "infeasible", "certified", "with contact"),
    *(
        "worst error [rad]",
        "least clearance [mm]",
        "plan [ms]",
        "shorten [ms]",
        "retime [ms]",
        "validate [ms]",
        "replay [ms]",
    ),
]


def _summary(answers: Sequence[Answer]) -> str:
    groups = dict.fromkeys((a.query.scene, a.query.limits) for a in answers)
    rows = [_row(*g, [a.outcome for a in answers if (a.query.scene, a.query.limits) == g]) for g in groups]
    limits = dict.fromkeys(a.query.limits for a in answers)
    rows += [_row("all", x, [a.outcome for a in answers if a.query.limits == x]) for x in limits]
    return table(_HEADER, rows)


def _row(scene: str, limits: str, outcomes: Sequence[Outcome]) -> list[str]:
    solved = [o for o in outcomes if o.solved]
    replays = [o.replay for o in solved if o.replay is not None]
    stages = ("plan", "shorten", "retime", "validate", "replay")
    return [
        scene,
        limits,
        str(len(outcomes)),
        str(len(solved)),
        str(sum(o.status in _ANSWERS for o in outcomes)),
        str(sum(o.certified for o in solved)),
        str(sum(not r.free for r in replays)),
        f"{max((r.worst_error for r in replays), default=float('nan')):.1e}",
        number(min(_clearances(solved), default=float("nan"))),
        *(number(spread(o.clock.cpu[s] for o in solved if s in o.clock.cpu)["median"]) for s in stages),
    ]


def _clearances(outcomes: Iterable[Outcome]) -> list[float]:
    reports = [o.report for o in outcomes if o.report is not None]
    return [1e3 * float(r.margins["clearance"]) for r in reports if "clearance" in r.margins]
