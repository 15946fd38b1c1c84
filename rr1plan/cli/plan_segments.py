"""`plan`: a motion in a scene, or the sequence of a file with segments."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from typing import TYPE_CHECKING

import rr1plan as rp
from rr1plan.cli.console import Console, progress_callback
from rr1plan.cli.exit_codes import INVALID_PLAN, NO_PLAN, OK
from rr1plan.cli.plan import check_outputs, plan
from rr1plan.cli.scene_options import page_options
from rr1plan.errors import InputError
from rr1plan.export.csv_files import csv_text, save_csv
from rr1plan.sequences.sequence_toml import is_sequence_file

if TYPE_CHECKING:
    from rr1plan.sequences.sequence_plan import SequencePlan

# Options that a sequence defines itself or does not support.
_OF_MOTIONS = (
    *("--query", "--arm", "--start", "--goal", "--position", "--quaternion", "--frame"),
    *("--no-shorten", "--margin", "--torque-limits", "--limits", "--timeline", "--diagram", "--pair"),
)


def plan_any(options: Namespace, console: Console) -> int:
    """Plan a motion, or all segments of a sequence file; prove it, and write the requested files."""
    if not is_sequence_file(options.scene):
        return plan(options, console)
    idle = [option for option in _OF_MOTIONS if option in options.given]
    if idle:
        raise InputError(f"{idle[0]} has no effect with a sequence, whose file says what is to happen")
    if options.output == "-":
        raise InputError("--output - has no effect with a sequence; name a file")
    look = page_options(options)
    check_outputs(options)
    with console.watch.stage("load the scene"), console.progress("loading the scene"):
        sequence = rp.load_segments(options.scene)
    with console.progress("planning") as advance:
        found = rp.plan_sequence(
            sequence,
            planner=options.planner or "rrt_connect",
            retiming=options.retiming,
            budget=rp.Budget(options.seconds, options.iterations),
            rng=options.seed,
            progress=progress_callback(advance),
        )
    if not found.found:
        if console.as_json:
            console.result({"status": found.status.value, "reason": found.reason, "failed": found.failed})
        else:
            console.error(str(found), NO_PLAN)
        return NO_PLAN
    if options.csv == "-":
        console.leave_stdout()
    with console.watch.stage("write the files"):
        files = _save(found, options, look, console)
    console.say(str(found))
    for kind, file in files.items():
        console.say(f"{kind}: {file}")
    stages = [{"label": stage.label, "begin": stage.begin, "end": stage.end} for stage in found.stages]
    values = {"status": found.status.value, "duration": found.trajectory.duration, "stages": stages}
    console.result({**values, "report": found.report.to_dict(), "files": files})
    return OK if found.valid else INVALID_PLAN


def _save(found: SequencePlan, options: Namespace, look: rp.ViewOptions | None, console: Console) -> Mapping[str, str]:
    files: dict[str, object] = {}
    if options.output is not None:
        files["motion"] = found.save(options.output, embed=options.embed)
    if options.csv == "-":
        console.write(csv_text(found.trajectory))
    elif options.csv is not None:
        files["csv"] = save_csv(options.csv, found.trajectory)
    if options.html is not None:
        files["page"] = found.save_html(options.html, options=look)
    return {kind: str(file) for kind, file in files.items()}
