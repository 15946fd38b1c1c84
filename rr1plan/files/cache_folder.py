"""The cache folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """The folder of cached results: RR1PLAN_CACHE, or the platform's cache folder."""
    given = os.environ.get("RR1PLAN_CACHE")
    if given:
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "rr1plan" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "rr1plan"
    shared = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # The XDG specification has relative folders ignored.
    return (shared if shared.is_absolute() else Path.home() / ".cache") / "rr1plan"
