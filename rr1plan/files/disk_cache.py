"""Disk cache for results of slow conversions, keyed by the hash of their input.

The folder is RR1PLAN_CACHE, else the user's cache folder. If the cache is not accessible
or an entry is damaged, the result is recomputed. Entries are arrays, never pickles,
and written atomically, so that several processes can share the folder.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.errors import InputError
from rr1plan.files.cache_folder import cache_folder
from rr1plan.files.file_access import write_bytes
from rr1plan.files.npy_files import Arrays, archive_bytes, parse_archive

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
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        write_bytes(folder / f"{key}.npz", archive_bytes(arrays))
    except (OSError, RuntimeError, InputError) as error:
        log.info("the cache cannot be written: %s", error)
