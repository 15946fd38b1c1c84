"""The most memory that this process has used."""

from __future__ import annotations

import sys
from pathlib import Path

from rr1plan.files.file_access import is_regular

_STATUS = Path("/proc/self/status")


def peak_memory() -> float:
    """Largest resident set size of this process [MB]; NaN where the system does not say."""
    if is_regular(_STATUS):
        # Not `getrusage`: on Linux that of a new process begins with the memory of the one that started it.
        for line in _STATUS.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:
        return float("nan")
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1e6 if sys.platform == "darwin" else 1e3)
