"""Arrays of page documents, read back."""

from __future__ import annotations

import base64

import numpy as np


def unpacked(packed: dict) -> np.ndarray:
    """The array that `pack_array` packed."""
    values = np.frombuffer(base64.b64decode(packed["data"]), dtype="<" + packed["dtype"])
    return values.reshape(packed["shape"])
