"""All experiments: measured one after the other, written as tables, figures and a report."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rr1plan.checks import check_callback, known_name, shown, true_or_false, whole_number
from rr1plan.errors import CancelledError, InputError, Rr1PlanError
from rr1plan.experiments.experiment_report import save_report
from rr1plan.experiments.measuring_process import Row, measure
from rr1plan.files.file_access import make_folder, write_text
from rr1plan.progress import Progress, ProgressCallback
from rr1plan.progress_bar import Advance, library_bar

EXPERIMENTS = ("static", "dynamic", "multi", "latency")
_ARMS = (1, 2, 4, 10, 12, 20, 50, 100, 120)
_MOST_ARMS = 10_000
_UNITS = {"size": "bytes"}
Task = Mapping[str, float]


@dataclass(frozen=True)
class ExperimentReport:
    """Results of experiments.

    Args:
        results: Rows of the table of each experiment: values by the name of the column, which ends in the unit.
        failures: Measurements that failed, and why.
        files: Written files: a table for each experiment, figures, the report as Markdown and as a page.
    """

    results: Mapping[str, tuple[Mapping[str, float], ...]]
    failures: tuple[str, ...]
    files: tuple[Path, ...]

    def __bool__(self) -> bool:
        """Whether all measurements succeeded."""
        return not self.failures


def run_experiments(
    experiments: Sequence[str],
    folder: str | Path,
    *,
    quick: bool = False,
    seed: int = 0,
    arms: Sequence[int] | None = None,
    progress: ProgressCallback | None = None,
) -> ExperimentReport:
    """Repeat the experiments of the thesis with MuJoCo and the page, and write a report that compares the figures.

        rp.run_experiments(["dynamic", "multi"], "results", quick=True)

    Each measurement runs in a separate process, one after the other. Motions and contacts are the same in every run;
    times are not.

    Args:
        experiments: "static" (an arm among stationary boats), "dynamic" (a falling tower of boats), "multi" (arms
            that follow seven poses), "latency" (messages from planner to viewer); or "all".
        folder: The folder for the files; it is created if it does not exist. The report and the files of these
            experiments replace older ones; those of other experiments remain, but are not in the report.
        quick: Few and short measurements, in less than half a minute.
        seed: Seed of the tilt of the boats and of the content of messages.
        arms: Numbers of arms of "multi", each measured once, in increasing order (default: 1 to 120, as in the thesis).
        progress: Called before each measurement; it may return False to cancel.

    Returns:
        The results. A measurement that fails does not stop the others; see `failures`.

    Raises:
        InputError: no such experiment, an invalid seed or number of arms, arms without "multi", or a folder that cannot
            be written.
        CancelledError: `progress` returned False; files in the folder are unchanged.
    """
    names = _checked_names(experiments)
    whole_number("seed", seed, 0, 2**63 - 1)
    if arms is not None and "multi" not in names:
        raise InputError("option arms has no effect without the experiment multi")
    counts = _checked_counts(arms, true_or_false("quick", quick))
    check_callback("progress", progress)
    target = make_folder(folder, "experiments.md")
    tasks = [(name, task) for name in names for task in _tasks(name, quick, int(seed), counts)]
    with library_bar("experiments") as advance:
        results, failures = _measure_all(tasks, _reporting(progress, advance))
    # Only now, so that the tables in the folder always belong to its report.
    for name in (name for name, rows in results.items() if not rows):
        for suffix in (".csv", ".png"):
            (target / f"{name}{suffix}").unlink(missing_ok=True)
    files = [write_text(target / f"{name}.csv", _csv(rows)) for name, rows in results.items() if rows]
    files += save_report(target, results, failures)
    return ExperimentReport({name: tuple(rows) for name, rows in results.items()}, tuple(failures), tuple(files))


def _checked_names(experiments: Sequence[str]) -> list[str]:
    """The experiments in the order of `EXPERIMENTS`, without repetition."""
    words = [experiments] if isinstance(experiments, str) else experiments
    if not isinstance(words, Sequence) or not len(words):
        raise InputError(f"experiments is {shown(experiments)}, expected some of {', '.join(EXPERIMENTS)}, all")
    for word in words:
        known_name("experiment", word, (*EXPERIMENTS, "all"))
    return [name for name in EXPERIMENTS if name in words or "all" in words]


def _checked_counts(arms: Sequence[int] | None, quick: bool) -> tuple[int, ...]:
    if arms is None:
        return (1, 4) if quick else _ARMS
    if not isinstance(arms, list | tuple) or not arms:
        raise InputError(f"arms is {shown(arms)}, expected numbers of arms, e.g. [1, 120, 1000]")
    # Figures join the measurements in their order.
    return tuple(sorted({whole_number("number of arms", count, 1, _MOST_ARMS) for count in arms}))


def _tasks(name: str, quick: bool, seed: int, arms: Sequence[int]) -> Iterator[Task]:
    """Arguments of each measurement of an experiment."""
    match name:
        case "static" if quick:
            yield from ({"boats": boats, "stations": 50, "around": 100, "seconds": 1.0} for boats in (0, 20))
        case "static":
            yield from ({"boats": boats} for boats in (0, 10, 50, 100, 200, 500))
        case "dynamic":
            counts = (10, 20) if quick else (10, 20, 50, 100, 200, 500)
            yield from ({"boats": boats, "seed": seed, "seconds": 2.0 if quick else 6.0} for boats in counts)
        case "multi":
            yield from ({"arms": count, "seconds": 4.0 if quick else 28.0} for count in arms)
        case "latency":
            sizes = (100, 10_000, 1_000_000) if quick else (100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000)
            yield from ({"size": size, "repeats": 20 if quick else 200, "seed": seed} for size in sizes)


def _reporting(progress: ProgressCallback | None, advance: Advance) -> Advance:
    """A function that reports the fraction done and the next measurement."""
    began = time.perf_counter()

    def report(fraction: float, what: str = "") -> None:
        advance(fraction, what)
        if progress is not None and progress(Progress(what, time.perf_counter() - began, fraction)) is False:
            raise CancelledError(f"cancelled: the progress callback returned False before {what!r}")

    return report


def _measure_all(tasks: Sequence[tuple[str, Task]], report: Advance) -> tuple[dict[str, list[Row]], list[str]]:
    """Rows by experiment, and failures."""
    results: dict[str, list[Row]] = {}
    failures = []
    for done, (name, task) in enumerate(tasks):
        parameter, value = next(iter(task.items()))
        what = f"{name}: {value:,} {_UNITS.get(parameter, parameter)}"
        report(done / len(tasks), what)
        rows = results.setdefault(name, [])
        try:
            rows += measure(name, task)
        except Rr1PlanError as error:
            failures.append(f"{what}: {error}")
    return results, failures


def _csv(rows: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
