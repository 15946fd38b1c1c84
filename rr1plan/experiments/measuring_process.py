"""Measurements in separate processes, so that none affects the memory or speed of the next."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence

from rr1plan.errors import BackendError, InputError, Rr1PlanError

Row = Mapping[str, float]

# Set `sys.path` first: the parent process may have found the package anywhere.
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from rr1plan.experiments.measuring_process import print_measurement; print_measurement(*sys.argv[2:])"
)
_MARK = "measured: "


def measure(name: str, arguments: Mapping[str, float]) -> list[Row]:
    """Run one of the measurements of this folder in a new process.

    Args:
        name: "static", "dynamic", "multi" or "latency".
        arguments: Keyword arguments of its function.

    Returns:
        Rows of results, by name.

    Raises:
        InputError: it cannot run with these arguments.
        BackendError: the process failed.
    """
    words = [sys.executable, "-c", _CHILD, json.dumps(sys.path), name, json.dumps(dict(arguments))]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith(_MARK)]
    if done.returncode != 0 or not lines:
        last = (done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"])[-1]
        raise BackendError(f"a measurement failed: {last}")
    result = json.loads(lines[-1].removeprefix(_MARK))
    if "error" in result:
        raise InputError(result["error"])
    return list(result["rows"])


def print_measurement(name: str, arguments: str) -> None:
    """Run a measurement in this process and print the result as JSON."""
    from rr1plan.experiments.falling_tower import measure_tower
    from rr1plan.experiments.message_latency import measure_latency
    from rr1plan.experiments.simulated_arms import measure_arms, measure_static_scene

    functions: dict[str, Callable[..., Row | Sequence[Row]]] = {
        "static": measure_static_scene,
        "dynamic": measure_tower,
        "multi": measure_arms,
        "latency": measure_latency,
    }
    try:
        result = functions[name](**json.loads(arguments))
        rows = [result] if isinstance(result, Mapping) else result
        text = json.dumps({"rows": rows})
    except Rr1PlanError as error:
        text = json.dumps({"error": str(error)})
    sys.stdout.write(f"{_MARK}{text}\n")
