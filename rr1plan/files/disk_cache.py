"""Disk cache for results of slow conversions, keyed by the hash of their input.

The folder is RR1PLAN_CACHE, else the user's cache folder. If the cache is not accessible
or an entry is damaged, the result is recomputed. Entries are arrays, never pickles,
written to a temporary file and renamed, so that several processes can share the folder.
"""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.files.cache_folder import cache_folder
from rr1plan.files.npy_files import Arrays, parse_archive

log = logging.getLogger(__name__)


def cache_key(*parts: str | NDArray[Any]) -> str:
    """Hash of everything that a result depends on (hex)."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        kind = "text" if isinstance(part, str) else f"{part.dtype.str}{part.shape}"
        digest.update(f"{kind}:{len(data)};".encode())
        digest.update(data)
    return digest.hexdigest()


def load_cached(key: str) -> Arrays | None:
    """The cached arrays of a key, or None."""
    try:
        return parse_archive((cache_folder() / f"{key}.npz").read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, RuntimeError, ValueError) as error:
        log.warning("the cache entry %s cannot be used and is recomputed: %s", key[:12], error)
        return None


def store_cached(key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Cache arrays under a key, if the cache is writable."""
    temporary: str | None = None
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=folder, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, **dict(arrays))  # type: ignore[arg-type]  # numpy's stub mistakes ** for options
        Path(temporary).replace(folder / f"{key}.npz")
    except (OSError, RuntimeError) as error:
        log.info("the cache cannot be written: %s", error)
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
