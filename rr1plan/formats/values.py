"""Our own values (robots, scenes, goals, reports) as plain JSON data and back, to the last bit.

Only the classes listed here are ever built, and only through their own checked constructors;
nothing is unpickled or looked up by a path.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rr1plan.errors import InputError
from rr1plan.limits import Limits
from rr1plan.problem import JointGoal, PoseGoal, RegionGoal
from rr1plan.report import Margin, Report, Violation
from rr1plan.robot import Geometry, Inertial, Joint, Link, Mimic, Robot
from rr1plan.scene import Arm, Attachment, Obstacle, Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, PointCloud, Sphere

_CLASSES = {
    c.__name__: c
    for c in (
        *(Box, Sphere, Cylinder, Capsule, HalfSpace, Mesh, PointCloud),
        *(Geometry, Inertial, Joint, Link, Mimic, Limits, Robot),
        *(Arm, Obstacle, Attachment, Scene),
        *(JointGoal, PoseGoal, RegionGoal, Margin, Report, Violation),
    )
}
_DTYPES = {"float64": np.float64, "int32": np.int32, "int64": np.int64}


def to_plain(value: Any, shared: list[Robot] | None = None) -> Any:
    """Data that JSON has a form for.

    Args:
        value: One of our values, or a nest of mappings, sequences, arrays and numbers.
        shared: Collects the robots, so that arms that share one refer to it by its index.

    Raises:
        InputError: a value that has no form.
    """
    if isinstance(value, Robot) and shared is not None:
        if not any(robot is value for robot in shared):
            shared.append(value)
        return {"shared": next(i for i, robot in enumerate(shared) if robot is value)}
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return _plain_number(float(value))
    if isinstance(value, np.ndarray):
        items = value.tolist() if np.isfinite(value).all() else _plain_list(value.tolist())
        return {"array": items, "dtype": value.dtype.name, "shape": list(value.shape)}
    return _plain_nest(value, shared)


def from_plain(data: Any, shared: list[Robot] | None = None) -> Any:
    """The value that `to_plain` made the data from.

    Raises:
        InputError: data that it cannot have made.
    """
    try:
        return _value(data, shared or [])
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"holds data that is no value of rr1plan: {error}") from error


def _plain_nest(value: Any, shared: list[Robot] | None) -> Any:
    if isinstance(value, Mapping):
        return {"map": [[to_plain(k, shared), to_plain(v, shared)] for k, v in value.items()]}
    if isinstance(value, frozenset | set):
        return {"set": sorted((to_plain(item, shared) for item in value), key=repr)}
    if isinstance(value, list | tuple):
        return [to_plain(item, shared) for item in value]
    if type(value).__name__ in _CLASSES:
        names = [f.name for f in dataclasses.fields(value)]
        return {"type": type(value).__name__, "fields": {n: to_plain(getattr(value, n), shared) for n in names}}
    raise InputError(f"a {type(value).__name__} has no form in a plan file")


def _plain_number(value: float) -> Any:
    return value if math.isfinite(value) else {"number": repr(value)}


def _plain_list(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain_list(item) for item in value]
    return _plain_number(value) if isinstance(value, float) else value


def _value(data: Any, shared: list[Robot]) -> Any:
    if isinstance(data, list):
        return tuple(_value(item, shared) for item in data)
    if not isinstance(data, dict):
        return data
    match data:
        case {"shared": index}:
            return shared[index]
        case {"number": "inf" | "-inf" | "nan" as text}:
            return float(text)
        case {"array": items, "dtype": dtype, "shape": shape}:
            return _array(items, _DTYPES[dtype]).reshape(shape)
        case {"map": items}:
            return {_value(k, shared): _value(v, shared) for k, v in items}
        case {"set": items}:
            return frozenset(_value(item, shared) for item in items)
        case {"type": name, "fields": fields}:
            return _CLASSES[name](**{n: _value(v, shared) for n, v in fields.items()})
    raise InputError(f"holds an entry with the keys {', '.join(map(str, data))}, which is no value of rr1plan")


def _array(items: Any, dtype: Any) -> Any:
    try:
        return np.array(items, dtype=dtype)
    except TypeError:  # it holds infinities, in the form that JSON has for them
        return np.array(_listed(items), dtype=dtype)


def _listed(items: Any) -> Any:
    if isinstance(items, list):
        return [_listed(item) for item in items]
    return float(items["number"]) if isinstance(items, dict) else items
