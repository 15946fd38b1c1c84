"""Peak memory of this process."""

from __future__ import annotations

import sys
from pathlib import Path

from rr1plan.files.file_access import is_regular

_STATUS = Path("/proc/self/status")


def peak_memory() -> float:
    """Largest resident set size of this process [MB]; NaN if the system does not report it."""
    if is_regular(_STATUS):
        # Not `getrusage`: on Linux its value in a new process starts at the memory of the parent.
        for line in _STATUS.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:
        return float("nan")
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1e6 if sys.platform == "darwin" else 1e3)
