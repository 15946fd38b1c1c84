"""Arrays in NumPy's formats, .npy and .npz, with bounded size and a uniform error for damaged data.

Damaged data makes numpy and zipfile raise many types of errors, which are listed here.
"""

from __future__ import annotations

import io
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.files.file_access import MAX_BYTES

Arrays = dict[str, NDArray[Any]]

# Besides ValueError, which numpy raises for most: not a zip archive, or a damaged one (BadZipFile), damaged compression
# (zlib.error), a truncated archive (EOFError), encryption or an unknown compression (RuntimeError and its subclasses),
# a header that is not a Python literal (TokenError, SyntaxError) or has other entries (LookupError, TypeError), a shape
# larger than the memory (MemoryError, OverflowError).
_DAMAGED = (
    zipfile.BadZipFile, zlib.error, EOFError, RuntimeError,
    tokenize.TokenError, SyntaxError, LookupError, TypeError, MemoryError, OverflowError,
)  # fmt: skip


def parse_array(data: bytes) -> NDArray[Any]:
    """The array of a .npy file.

    Raises:
        ValueError: the data is not an array, damaged, or contains Python objects.
    """
    try:
        array = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except _DAMAGED as error:
        raise ValueError(f"damaged array: {error}") from error
    return np.asarray(array)


def parse_archive(data: bytes) -> Arrays:
    """The arrays of a .npz file by name.

    Raises:
        ValueError: the data is not an archive, damaged, contains Python objects, or exceeds 256 MiB when decompressed.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                raise ValueError(f"larger than {MAX_BYTES} bytes unpacked, the most that is read")
            entries = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    except _DAMAGED as error:
        raise ValueError(f"damaged archive: {error}") from error
    return {name.removesuffix(".npy"): parse_array(entry) for name, entry in entries.items()}


def archive_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The content of a .npz file of arrays by name, compressed."""
    stream, by_name = io.BytesIO(), dict[str, Any](arrays)
    np.savez_compressed(stream, **by_name)
    return stream.getvalue()
