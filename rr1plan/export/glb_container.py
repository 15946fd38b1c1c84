"""Binary glTF 2.0: one JSON document and the arrays it refers to, in one file (Khronos glTF 2.0, section 4)."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963  # targets of buffer views
_KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4"}
_MAGIC, _VERSION, _JSON, _BINARY = 0x46546C67, 2, 0x4E4F534A, 0x004E4942


class GlbArrays:
    """Arrays of a glTF document: each is one buffer view with one accessor; equal arrays are stored once."""

    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self._data = bytearray()
        self._known: dict[tuple[bytes, str, int | None], int] = {}

    def vertices(self, values: ArrayLike) -> int:
        """The accessor of positions or normals, shape (n, 3)."""
        return self._add(np.asarray(values, dtype="<f4"), _VERTICES)

    def indices(self, values: ArrayLike) -> int:
        """The accessor of the corners of triangles, any shape."""
        return self._add(np.asarray(values, dtype="<u4").ravel(), _INDICES)

    def track(self, values: ArrayLike) -> int:
        """The accessor of times, shape (n,), or of animated vectors or quaternions, shape (n, 3) or (n, 4)."""
        return self._add(np.asarray(values, dtype="<f4"), None)

    def _add(self, values: NDArray[Any], target: int | None) -> int:
        data, kind = values.tobytes(), _KINDS[values.shape[1:]]
        key = (data, kind, target)
        if key not in self._known:
            self._known[key] = len(self.accessors)
            view = {"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)}
            self.views.append(view if target is None else {**view, "target": target})
            columns = values.reshape(len(values), -1)
            self.accessors.append(
                {
                    "bufferView": len(self.views) - 1,
                    "componentType": _UINT if values.dtype == np.dtype("<u4") else _FLOAT,
                    "count": len(values),
                    "type": kind,
                    "min": columns.min(axis=0).tolist(),
                    "max": columns.max(axis=0).tolist(),
                }
            )
            self._data += data  # every component has four bytes, so all views are aligned
        return self._known[key]

    def pack(self, document: dict[str, object]) -> bytes:
        """The file of a document without its accessors, buffer views and buffers, which are added here."""
        whole = {
            **document,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self._data)}],
        }
        filled = {name: value for name, value in whole.items() if value and (self._data or name != "buffers")}
        text = json.dumps(filled, allow_nan=False, separators=(",", ":")).encode("utf-8")
        chunks = [_chunk(_JSON, text, b" ")] + [_chunk(_BINARY, bytes(self._data), b"\0")] * bool(self._data)
        body = b"".join(chunks)
        return struct.pack("<III", _MAGIC, _VERSION, 12 + len(body)) + body


def _chunk(kind: int, data: bytes, filler: bytes) -> bytes:
    padded = data + filler * (-len(data) % 4)
    return struct.pack("<II", len(padded), kind) + padded
