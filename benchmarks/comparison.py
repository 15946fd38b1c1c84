"""Results of several planners on the same problems: tables in Markdown, data for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shared import number, spread, table

import rr1plan as rp

Array = NDArray[np.float64]
KINDS = ("raw", "path", "timed")
WORDS = {"raw": "raw path", "path": "short path", "timed": "timed motion"}
WHOLE = ("plan", "shorten", "retime")
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "set up": ("set up",),
    "plan": ("plan",),
    "shorten": ("shorten",),
    "plan + shorten": ("plan", "shorten"),
    "retime": ("retime",),
    "whole query": WHOLE,
    "with referee": (*WHOLE, "validate"),
}
QUANTILES = {"median": 0.5, "p95": 0.95, "max": 1.0}
RATIOS = (("plan", "median"), ("plan", "p95"), ("plan + shorten", "median"), ("whole query", "median"))


@dataclass
class Run:
    """One planner's results, in the order of the problems.

    An answer has `name`, `seconds` (CPU, by stage), and where it found a path `raw`, `path` (waypoints), `duration`,
    `touches`: for each of `KINDS` what each opinion sees, None or the first touch; and `excess`, see there.
    """

    name: str
    answers: list[dict[str, Any]]
    note: str = ""
    skipped: str = ""
    solved: list[dict[str, Any]] = field(init=False)

    def __post_init__(self) -> None:
        self.solved = [answer for answer in self.answers if "raw" in answer]

    def times(self, column: str, group: str = "") -> Array:
        """CPU milliseconds of a column of `COLUMNS` for every problem (of one set), endless where it was not solved.

        Answers without such a stage do not count.
        """
        stages = COLUMNS[column]
        mine = [a for a in self.answers if a["name"].startswith(group)]
        found = np.array(
            [
                1e3 * sum(a["seconds"][stage] for stage in stages) if "raw" in a else np.inf
                for a in mine
                if "raw" not in a or a["seconds"].keys() >= set(stages)
            ]
        )
        return found if np.isfinite(found).any() else np.empty(0)

    def lengths(self, kind: str) -> list[float]:
        """Lengths of its paths [rad]."""
        return [_length(a[kind]) for a in self.solved if kind in a]

    def touching(self, kind: str) -> tuple[int, int]:
        """Number of results with a contact by any checker, and number of checked results."""
        judged = [a["touches"][kind] for a in self.solved if kind in a.get("touches", {})]
        return sum(any(touch is not None for touch in found.values()) for found in judged), len(judged)

    def breaking(self) -> tuple[int, int]:
        """Number of timed motions that exceed a limit by more than 5 %, and number of checked motions."""
        found = [a["excess"] for a in self.solved if "excess" in a]
        return sum(value > 1.05 for value in found), len(found)

    def to_dict(self) -> dict[str, Any]:
        """Its figures without the motions."""
        answers = [{k: v for k, v in a.items() if k not in KINDS} for a in self.answers]
        for entry, own in zip(answers, self.answers, strict=True):
            entry |= {f"length {k}": _length(own[k]) for k in ("raw", "path") if k in own}
        times = {
            column: {word: quantile(found, share) for word, share in QUANTILES.items()}
            for column in COLUMNS
            if len(found := self.times(column))
        }
        return {
            "planner": self.name,
            "note": self.note,
            "skipped": self.skipped,
            "solved": len(self.solved),
            "milliseconds": times,
            "breaking": self.breaking(),
            "touching": {kind: self.touching(kind) for kind in KINDS},
            "answers": answers,
        }


def _length(waypoints: Any) -> float:
    return float(np.linalg.norm(np.diff(np.array(waypoints), axis=0), axis=1).sum())


def excess(samples: Any, step: float, limits: rp.Limits) -> float:
    """The largest speed or acceleration of a timed motion, as a multiple of its joint's limit.

    Differences over about 10 ms are means of the true values, so a value above 1 proves a violation.

    Args:
        samples: Positions, shape (n, nq); the last interval may be shorter than the others.
        step: Time between samples [s].
        limits: The limits of the joints.
    """
    stride = max(1, round(0.01 / step))
    q = np.asarray(samples, dtype=np.float64)[:-1][::stride]
    if len(q) < 3:
        return 0.0
    v = np.diff(q, axis=0) / (stride * step)
    a = np.diff(v, axis=0) / (stride * step)
    return float(max((np.abs(v) / limits.velocity).max(), (np.abs(a) / limits.acceleration).max()))


def quantile(values: Array, share: float) -> float | None:
    """Quantile, interpolated as in NumPy; None if it is infinite."""
    if not len(values):
        return None
    values, place = np.sort(values), share * (len(values) - 1)
    low, high = values[int(np.floor(place))], values[int(np.ceil(place))]
    return float(low + (place % 1.0) * (high - low)) if np.isfinite(high) else None


# ---- tables ----------------------------------------------------------------------------------------


def compare(runs: Sequence[Run], reference: str) -> list[str]:
    """The tables, and the planners that did not run, as parts of a report."""
    ran = [run for run in runs if not run.skipped]
    parts = [
        "CPU milliseconds on the same core in the same run, median / p95 / max; a problem that is not solved counts as "
        "endless, and what is endless is written as a dash:",
        time_table(ran),
    ]
    parts += [
        "Medians, the share of results that Coal or FCL sees in collision at a millimeter, and of timed motions whose "
        "speed or acceleration is more than 5 % above a limit:",
        result_table(ran),
    ]
    if any(run.name == reference for run in ran):
        parts += [f"How many times faster than {reference} at its defaults:", ratio_table(ran, reference)]
    parts += ["Plan + shorten by set of problems, median [CPU ms]:", set_table(ran)]
    notes = [f"- {run.name}: {run.note}." for run in ran if run.note]
    notes += [f"- **{run.name} did not run**: {run.skipped}." for run in runs if run.skipped]
    return [*parts, "\n".join(notes)] if notes else parts


def time_table(runs: Sequence[Run]) -> str:
    """Median, p95 and max of every stage, one row per planner."""
    rows = [[run.name, *(_three(run.times(column)) for column in COLUMNS)] for run in runs]
    return table(["planner", *COLUMNS], rows)


def _three(values: Array) -> str:
    return " / ".join(_told(quantile(values, share)) for share in QUANTILES.values()) if len(values) else "-"


def _told(value: float | None) -> str:
    return "-" if value is None else number(value)


def result_table(runs: Sequence[Run]) -> str:
    """Solved, lengths, duration and contacts, one row per planner."""
    header = ["planner", "solved", "raw path [rad]", "short path [rad]", "duration [s]"]
    rows = []
    for run in runs:
        durations = [a["duration"] for a in run.solved if a.get("duration") is not None]
        medians = [number(spread(v, 1.0)["median"]) for v in (run.lengths("raw"), run.lengths("path"), durations)]
        shares = [_share(*run.touching(kind)) for kind in KINDS]
        rows.append([run.name, f"{len(run.solved)} / {len(run.answers)}", *medians, *shares, _share(*run.breaking())])
    return table([*header, *(f"{WORDS[kind]} touches" for kind in KINDS), "limits broken"], rows)


def _share(touching: int, judged: int) -> str:
    return f"{100 * touching / judged:.1f} %" if judged else "-"


def ratio_table(runs: Sequence[Run], reference: str) -> str:
    """Ratio of the reference's figure to each planner's."""
    (base,) = [run for run in runs if run.name == reference]
    rows = []
    for run in runs:
        pairs = [[quantile(r.times(c), QUANTILES[k]) for r in (base, run)] for c, k in RATIOS]
        rows.append([run.name, *(number(theirs / own) if theirs and own else "-" for theirs, own in pairs)])
    return table(["planner", *(f"{column}, {kind}" for column, kind in RATIOS)], rows)


def set_table(runs: Sequence[Run]) -> str:
    """Medians of planning and shortening, one row per set of problems."""
    groups = list(dict.fromkeys(a["name"].rsplit("/", 1)[0] for run in runs for a in run.answers))
    rows = [
        [group, *(_told(quantile(run.times("plan + shorten", f"{group}/"), 0.5)) for run in runs)] for group in groups
    ]
    return table(["set", *(run.name for run in runs)], rows)
