"""Do the compiled kernels agree with Coal? Random configurations and edges of several robots and of many arms.

    python benchmarks/agreement.py --panda panda.urdf --folder ROBOTS
    python benchmarks/agreement.py --robot crowds --configurations 100000 --edges 10000

The scenes (`clutter.py`) have every kind of shape, padding, margins, attached objects; "crowds" are scenes of 2 to 16
arms of one or several robots, spaced 0.35 m or more, of which all or some move.

Configurations: the kernel's result is compared with Coal's. Edges: Coal alone proves edges that the kernel reports free
(`coal_proof.py`); if the kernel finds a contact, Coal has to find one at that configuration. The referee also checks
every `_EVERY_JUDGED`th edge. Results may differ if the least distance is proven to be within `BAND` of the padding,
which is counted as grazing; any other difference is printed in full, and the exit code is 1. "narrow" counts free
edges on which the clearance is within Coal's own error; all their samples are free. "undecided" counts edges whose
proof by Coal exceeded the limit of samples.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from clutter import Crowd, box_of, cluttered_scenes, crowds, find_urdf
from coal_proof import CoalProof, PlainCoal
from shared import Clock, console, heading, make_parser, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import CONTACT, FREE, EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables

# Motions with less clearance than this are rejected by design [m].
TOLERANCE = 1e-6
# Results may differ if the least distance is proven to be this close to the padding [m].
BAND = 2e-6
_CHUNK = 2000
_CHUNK_OF_EDGES = 200
_EVERY_PLAIN = 500
_EVERY_JUDGED = 5
_MOST_PAIRS = 20_000
_EDGES = ("free", "proven", "narrow", "undecided", "contact confirmed", "judged", "grazing", "different")
ROBOTS = ("planar2r", "rr1", "panda", "ur5")
CROWDS = "crowds"
# Robots that do not ship with the package, and their files in the package example-robot-data.
FOREIGN = {"panda": "panda.urdf", "ur5": "ur5_robot.urdf"}


@dataclass
class Tally:
    """Results of the checks in one scene."""

    robot: str
    scene: str
    configurations: Counter[str] = field(default_factory=Counter)
    edges: Counter[str] = field(default_factory=Counter)
    differences: list[dict[str, Any]] = field(default_factory=list)
    grazing: list[dict[str, Any]] = field(default_factory=list)
    clock: Clock = field(default_factory=Clock)

    def to_dict(self) -> dict[str, Any]:
        """All results as plain values."""
        return {**vars(self), "clock": self.clock.cpu}


class Comparison:
    """Comparison of the kernels with Coal in one scene."""

    def __init__(self, robot: str, crowd: Crowd) -> None:
        self.tally = Tally(robot, crowd.name)
        self.scene, self.margin = crowd.scene, crowd.margin
        self.checker = CollisionChecker(crowd.scene, crowd.arms, margin=crowd.margin)
        tables = build_edge_tables(self.checker.geometry, self.checker.fixed, self.checker.solid_padding, TOLERANCE)
        self.kernel = EdgeKernel(tables, self.checker.exact_kernel, self.checker.nq)
        self.exact = self.checker
        # Coal's pairs through Pinocchio need 20 kB each.
        self.is_large = len(self.checker.solid_pairs) > _MOST_PAIRS
        self.plain = PlainCoal(crowd.scene, crowd.arms, crowd.margin)
        self.proof = CoalProof(self.checker)
        self.low, self.high = box_of(self.checker.limits)
        self.chunks = (
            max(1, _CHUNK // len(self.checker.arms) ** 2),
            max(1, _CHUNK_OF_EDGES // len(self.checker.arms) ** 2),
        )

    def configurations(self, rng: np.random.Generator, count: int) -> None:
        """Check random configurations."""
        tally, clock = self.tally.configurations, self.tally.clock
        q = np.array([self._sample(rng) for _ in range(count)])
        with clock.stage("configurations, kernel"):
            quick = self._certify(q, q)[0] == FREE
        with clock.stage("configurations, Coal"):
            sure = np.array([self.is_free_by_coal(one) for one in q])
        tally.update(checked=count, free=int(sure.sum()))
        for i in np.flatnonzero(quick != sure):
            self._differ(tally, q[i], q[i], q[i], f"Coal: {'free' if sure[i] else 'a contact'}")
        for one, free in zip(q[::_EVERY_PLAIN], sure[::_EVERY_PLAIN], strict=True):
            tally["plain"] += 1
            if self.plain.is_free(one) != free:
                self._differ(tally, one, one, one, "Coal through numpy and through Pinocchio differ")

    def random_edges(self, rng: np.random.Generator, count: int) -> None:
        """Check random edges from free configurations."""
        begins, ends = self._draw(rng, count)
        tally, clock = self.tally.edges, self.tally.clock
        with clock.stage("edges, kernel"):
            status, where = self._certify(begins, ends)
        with clock.stage("edges, exact kernel"):
            exact = np.array([self.exact.edge_is_free_slowly(*ends_of) for ends_of in zip(begins, ends, strict=True)])
        tally.update(checked=count, free=int((status == FREE).sum()))
        with clock.stage("edges, Coal"):
            for i in range(count):
                self._judge(begins[i], ends[i], int(status[i]), float(where[i]))
        for i in np.flatnonzero((status == FREE) != exact):
            contact = self.exact.first_contact(begins[i], ends[i])
            spot = begins[i] + where[i] * (ends[i] - begins[i]) if contact is None else contact.q
            self._differ(
                tally, begins[i], ends[i], spot, f"the exact kernel alone: {'free' if exact[i] else 'not free'}"
            )
        # The referee checks the scene's padding, not the margin.
        for i in range(0, count if self.margin == 0.0 else 0, _EVERY_JUDGED):
            with clock.stage("edges, referee"):
                self._compare_with_referee(begins[i], ends[i], status[i] == FREE, float(where[i]))

    def is_free_by_coal(self, q: Array) -> bool:
        """Coal's result for a configuration."""
        return self.plain.is_free(q) if self.is_large else self.checker.is_free_slowly(q)

    def _judge(self, q0: Array, q1: Array, status: int, where: float) -> None:
        """Compare the kernel's result for an edge with Coal's."""
        tally = self.tally.edges
        if status != FREE:
            q = q0 + where * (q1 - q0)
            if self.is_free_by_coal(q):
                self._differ(
                    tally, q0, q1, q, f"the kernel: {'contact' if status == CONTACT else 'too near'}; Coal: free there"
                )
            else:
                tally["contact confirmed"] += 1
            return
        verdict, where = self.proof.judge(q0, q1)
        if verdict != "contact":
            tally["proven" if verdict == "free" else verdict] += 1
            return
        self._differ(tally, q0, q1, q0 + where * (q1 - q0), f"the kernel: free; Coal: {verdict}")

    def _compare_with_referee(self, q0: Array, q1: Array, free: bool, where: float) -> None:
        """The referee's verdict on an edge."""
        path = rp.Path(self.checker.joint_names, np.array([q0, q1]))
        report = rp.certify_path(path, self.scene, clearance=False)
        self.tally.edges["judged"] += 1
        if report.certified == free:
            return
        if free:
            where = max(0.0, report.violations[0].time or 0.0) / max(report.duration, 1e-300)
        told = "free" if report.certified else report.violations[0].message
        self._differ(self.tally.edges, q0, q1, q0 + where * (q1 - q0), f"the kernel: {free=}; the referee: {told}")

    def _differ(self, tally: Counter[str], q0: Array, q1: Array, q: Array, what: str) -> None:
        """Count a differing result: as grazing if this is proven, else as a difference."""
        bracket = self.plain.bracket(q)
        record = {"robot": self.tally.robot, "scene": self.tally.scene, "what": what, "pair": bracket.pair}
        record |= {"at least": bracket.lower, "at most": bracket.upper, "begin": q0.tolist(), "end": q1.tolist()}
        record |= {"q": q.tolist()}
        if bracket.lower >= -BAND and bracket.upper <= BAND:
            tally["grazing"] += 1
            self.tally.grazing.append(record)
        else:
            tally["different"] += 1
            self.tally.differences.append(record)

    def _sample(self, rng: np.random.Generator) -> Array:
        """A random configuration; each of several arms is drawn between its configuration in the scene and any other.

        Many arms at arbitrary configurations would nearly always collide.
        """
        q = rng.uniform(self.low, self.high)
        arms = self.checker.arms
        if len(arms) == 1:
            return q
        shares = {arm: rng.uniform() ** 2 * (rng.uniform() < 0.7) for arm in arms}
        share = np.array([shares[name.split("/", 1)[0]] for name in self.checker.joint_names])
        stand = self.scene.configuration(arms)
        return np.asarray(stand + share * (q - stand))

    def _draw(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Free start configurations, and ends 0.02 to 1.5 rad (or m) from them within the limits."""
        free: list[Array] = []
        while len(free) < count:
            q = self._sample(rng)
            if self.is_free_by_coal(q):
                free.append(q)
        begins = np.array(free)
        steps = rng.normal(size=begins.shape)
        steps *= rng.uniform(0.02, 1.5, (count, 1)) / np.linalg.norm(steps, axis=1)[:, None]
        limits = self.checker.limits
        return begins, np.clip(begins + steps, limits.lower, limits.upper)

    def _certify(self, begins: Array, ends: Array) -> tuple[Array, Array]:
        """The kernel's status of each edge (free, a contact, or grazing), and where."""
        if not self.checker.static_is_free:
            return np.full(len(begins), CONTACT), np.zeros(len(begins))
        results = [self.kernel.certify_edge(q0, q1) for q0, q1 in zip(begins, ends, strict=True)]
        return np.array([r[0] for r in results]), np.array([r[1] for r in results])


# ---- the command ---------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    pin_to_core(args.core)
    tallies = [tally for name in args.robot for tally in _compare(name, args)]
    facts = {"seed": args.seed, "tolerance": f"{TOLERANCE:g} m", "band": f"{BAND:g} m"}
    differences = [d for tally in tallies for d in tally.differences]
    text = "\n\n".join([heading("Compiled kernels and Coal", facts), *_tables(tallies), _listed(differences)])
    save(args.out, "agreement", {"settings": facts, "scenes": [t.to_dict() for t in tallies]}, text)
    return 1 if differences else 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser("Compare the compiled kernels with Coal", "agreement")
    subjects = (*ROBOTS, CROWDS)
    parser.add_argument("--robot", nargs="+", choices=subjects, default=list(subjects), help="robots to check")
    parser.add_argument("--scenes", help="those of which the name contains this")
    for name in FOREIGN:
        parser.add_argument(
            f"--{name}", type=Path, help="its URDF, an SRDF beside it (default: that of example-robot-data)"
        )
    parser.add_argument("--folder", type=Path, help="where pip may put example-robot-data if it is not installed")
    parser.add_argument("--configurations", type=int, default=1_000_000, help="of each robot, over all its scenes")
    parser.add_argument("--edges", type=int, default=100_000, help="of each robot, over all its scenes")
    parser.add_argument("--seconds", type=float, default=np.inf, help="check each robot for no longer than this")
    return parser.parse_args(argv)


def _compare(name: str, args: argparse.Namespace) -> list[Tally]:
    parts = [Comparison(name, crowd) for crowd in _scenes(name, args) if (args.scenes or "") in crowd.name]
    work = [*_shares(parts, "configurations", args.configurations, 0)]
    work += _shares(parts, "random_edges", args.edges, 1)
    rng, begun = np.random.default_rng([args.seed, (*ROBOTS, CROWDS).index(name)]), time.monotonic()
    # Shuffled, so that the checks within the time limit are spread over all scenes.
    for k in track(rng.permutation(len(work)).tolist(), name):
        part, check, count = work[k]
        getattr(part, check)(rng, count)
        if time.monotonic() - begun > args.seconds:
            break
    return [part.tally for part in parts]


def _shares(parts: list[Comparison], check: str, total: int, kind: int) -> Iterator[tuple[Comparison, str, int]]:
    """The checks in each scene, in chunks."""
    for i, part in enumerate(parts):
        left = total * (i + 1) // len(parts) - total * i // len(parts)
        while left > 0:
            yield part, check, min(part.chunks[kind], left)
            left -= part.chunks[kind]


def _scenes(name: str, args: argparse.Namespace) -> Iterator[Crowd]:
    if name == CROWDS:
        others = rp.load_robot("planar2r"), _load("panda", args)
        yield from crowds(rp.load_robot("rr1"), [robot for robot in others if robot is not None], args.seed)
        return
    robot = _load(name, args)
    if robot is None:
        console.print(f"{name} is left out: no file; see --help", highlight=False)
        return
    for scene in (*cluttered_scenes(robot, args.seed), *_shipped(name)):
        yield Crowd(*scene)


def _load(name: str, args: argparse.Namespace) -> rp.Robot | None:
    if name not in FOREIGN:
        return rp.load_robot(name)
    file = getattr(args, name) or find_urdf(FOREIGN[name], args.folder)
    if file is None:
        return None
    srdf = file.with_suffix(".srdf")
    return rp.load_robot(file, srdf=srdf if srdf.is_file() else None)


def _shipped(name: str) -> Iterator[tuple[str, rp.Scene]]:
    """Shipped scenes of a robot, except the one with twelve arms."""
    for scene in rp.scene_names():
        if scene.startswith(f"{name}_") and scene != "rr1_twelve":
            yield scene, rp.load_scene(scene)


def _tables(tallies: Sequence[Tally]) -> list[str]:
    header = ["configurations", "scenes", "checked", "free", "grazing", "different"]
    edges = [
        "edges",
        "checked",
        "free",
        "proven by Coal",
        "narrow",
        "undecided",
        "contact confirmed",
        "checked by the referee",
        "grazing",
        "different",
    ]
    rows, more = [], []
    for robot in dict.fromkeys(t.robot for t in tallies):
        own = [t for t in tallies if t.robot == robot]
        c, e = sum((t.configurations for t in own), Counter()), sum((t.edges for t in own), Counter())
        rows.append([robot, len(own), c["checked"], *_of(c, "free", "grazing", "different")])
        more.append([robot, e["checked"], *_of(e, *_EDGES)])
    return [table(header, rows), table(edges, more)]


def _of(counts: Counter[str], *names: str) -> list[int]:
    return [counts[name] for name in names]


def _listed(differences: list[dict[str, Any]]) -> str:
    if not differences:
        return "No result differs."
    return "\n".join(["Results that differ:", "", *(f"- {d}" for d in differences)])


if __name__ == "__main__":
    sys.exit(main())
