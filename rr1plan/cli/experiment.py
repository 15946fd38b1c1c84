"""`experiment`: the simulator and the viewer compared with the figures of the thesis."""

from __future__ import annotations

from argparse import Namespace

import rr1plan as rp
from rr1plan.checks import counted
from rr1plan.cli.console import Console
from rr1plan.cli.exit_codes import INVALID_PLAN, OK


def experiment(options: Namespace, console: Console) -> int:
    """Measure, and write tables, figures and a report."""
    with console.progress("experiments") as advance:
        report = rp.run_experiments(
            options.experiment,
            options.out,
            quick=options.quick,
            seed=options.seed,
            arms=options.arms,
            progress=lambda progress: advance(progress.fraction, progress.stage),
        )
    for failure in report.failures:
        console.warn(f"not measured: {failure}")
    rows = sum(map(len, report.results.values()))
    console.say(f"{counted(rows, 'row')} of results; the report: {report.files[-1]}")
    console.result(
        {
            "results": {name: [dict(row) for row in rows] for name, rows in report.results.items()},
            "failures": list(report.failures),
            "files": [str(file) for file in report.files],
        }
    )
    return OK if report else INVALID_PLAN
