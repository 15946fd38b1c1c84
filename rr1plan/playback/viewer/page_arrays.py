"""Arrays as JSON values: base64 of little-endian numbers, `{"dtype": "f4", "shape": [...], "data": "..."}`."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import known_name, number_array


def pack_array(array: ArrayLike, dtype: str = "f4") -> dict[str, Any]:
    """An array as a JSON value for the data of a `Panel`, whose script reads it by `viewer.unpack`.

        script = "root.textContent = viewer.unpack(data.q).shape.join(' x ')"
        panel = Panel("table", "Table", script=script, data={"q": pack_array(q)})

    Args:
        array: Numbers of any shape.
        dtype: Their type on the page: "f4" or "f8" (floating point), or "u4" (whole numbers from 0).

    Returns:
        A mapping with the keys "dtype", "shape" and "data" (base64).

    Raises:
        UnknownNameError: another type.
        InputError: not numbers.
    """
    known_name("dtype", dtype, ("f4", "f8", "u4"))
    with np.errstate(over="ignore", invalid="ignore"):  # numbers beyond the range become infinite
        plain = array if isinstance(array, np.ndarray) and array.dtype.kind in "iuf" else number_array("array", array)
        values: NDArray[Any] = np.ascontiguousarray(plain, dtype="<" + dtype)
    return {"dtype": dtype, "shape": list(values.shape), "data": base64.b64encode(values.tobytes()).decode("ascii")}


def pack_bytes(values: NDArray[np.uint8]) -> dict[str, Any]:
    """Bytes as the words that the page unpacks, padded with zeros."""
    return pack_array(np.frombuffer(values.tobytes() + bytes(-values.size % 4), dtype="<u4"), "u4")


def plain_value(value: object) -> object:
    """A number or an array of NumPy as a plain value, for `json.dumps`, which calls this for values it does not know.

    Raises:
        TypeError: another value.
    """
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"a value of type {type(value).__name__}")


def unpack_array(packed: Mapping[str, Any]) -> NDArray[Any]:
    """The array in a value of `pack_array`."""
    values: NDArray[Any] = np.frombuffer(base64.b64decode(packed["data"]), dtype="<" + packed["dtype"])
    return values.reshape(packed["shape"])
