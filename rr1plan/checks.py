"""Validation of arguments of public functions; private functions do not repeat it."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence, Sized
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rr1plan.errors import InputError, UnknownNameError
from rr1plan.errors import shown as shown

Array = NDArray[np.float64]
"""Any array of float64."""
# At larger distances [m], errors exceed a micrometer, and Coal returns wrong distances (or none).
FARTHEST = 1e4
# Largest mass of a body [kg], and moment of inertia [kg m²]: far above any machine, and safe to compute with.
HEAVIEST = 1e12
# A whole turn [rad], rounded up.
_TURN = 6.2832
# Hints in messages about angles that are too large for radians, and about positions too large for meters.
DEGREES = "(angles are in radians: are these degrees?)"
MILLIMETERS = "(positions are in meters: are these millimeters?)"
# The functions that read values of these types from files or by name, for messages.
_READERS = {
    "Scene": "load_scene",
    "Robot": "load_robot",
    "Problem": "load_problems",
    "Trajectory": "load_motion",
    "Mesh": "load_mesh",
    "Calibration": "load_calibration",
    "ControlBox": "load_control_box",
}
# Values of these types, for messages.
_EXAMPLES = {
    "Budget": "Budget(seconds=5)",
    "CollisionChecker": "CollisionChecker(scene)",
    "Kinematics": "Kinematics(scene)",
    "Problem": "Problem(scene, start, goal)",
    "Sequence": "Sequence(scene, segments)",
}
# Limits of common file systems for one part of a path, and for a path [bytes].
_LONGEST_NAME = 255
_LONGEST_PATH = 4095
# Most entries in a repr: numbers or names of a list, entries of other lists.
_MOST_NUMBERS, _MOST_ENTRIES = 8, 2
Seed = np.random.Generator | int | None
"""A generator, the seed of a new one, or None for a random seed."""


def _in_brief(value: object) -> str:
    """One-line repr of a field."""
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.size <= _MOST_NUMBERS:
            return "[" + ", ".join(f"{number:.6g}" for number in value.tolist()) + "]"
        if value.shape == (4, 4):
            turned = "" if np.array_equal(value[:3, :3], np.eye(3)) else ", turned"
            return f"<pose at {_in_brief(value[:3, 3])}{turned}>"
        return f"<{' x '.join(map(str, value.shape))} array>"
    if isinstance(value, Mapping):
        entries = [f"{shown(key)}: {_in_brief(item)}" for key, item in islice(value.items(), _MOST_ENTRIES)]
        return "{" + ", ".join(entries) + _rest(value, _MOST_ENTRIES) + "}"
    if isinstance(value, list | tuple | set | frozenset):
        most = _MOST_ENTRIES if any(isinstance(item, Value | np.ndarray) for item in value) else _MOST_NUMBERS
        comma = "," if len(value) == 1 else ""  # else a tuple in a tuple would read like that tuple alone
        return "(" + ", ".join(map(_in_brief, islice(value, most))) + comma + _rest(value, most) + ")"
    if isinstance(value, float):
        return f"{value:.6g}"
    return repr(value) if isinstance(value, Value) else shown(value)


def _rest(value: Sized, most: int) -> str:
    return f", ... {len(value)} in all" if len(value) > most else ""


def number_array(name: str, value: object, expected: str = "an array of numbers") -> Array:
    """A new C-ordered float64 array of `value`, of any shape, possibly with infinities and NaN.

    Args:
        name: Name of the value, for messages.
        value: Anything that NumPy can convert to numbers.
        expected: What it should be, for messages.

    Raises:
        InputError: not numbers.
    """
    try:
        if np.asarray(value).dtype.kind in "bUSmMc" or isinstance(value, np.ma.MaskedArray):
            raise TypeError("NumPy converts truth values, text, times, masked values and complex numbers, too")
        array = np.array(value, dtype=np.float64, order="C")  # kernels read C order
    except (TypeError, ValueError, OverflowError, Warning) as error:
        is_name = name == "q" and isinstance(value, str)
        advice = "; robot.configuration(name) has the numbers of a named one" if is_name else ""
        raise InputError(f"{name} is not {expected}: {shown(value)}{advice}") from error
    return array


def shape_of(value: Any) -> tuple[int, ...]:
    """The shape of an array or nested lists; () for anything else."""
    try:
        return np.shape(value)
    except ValueError:
        return ()


def finite_array(name: str, value: Any, shape: tuple[int | None, ...]) -> Array:
    """A new float64 array of `value`, checked for shape and finiteness.

    Args:
        name: Name of the value, for messages.
        value: Anything that NumPy can convert to numbers.
        shape: Expected shape; None stands for any length.

    Raises:
        InputError: not numbers, wrong shape, NaN or infinite.
    """
    array = number_array(name, value, "an array of numbers" if shape else "a number")
    if array.ndim != len(shape) or any(
        want is not None and got != want for got, want in zip(array.shape, shape, strict=True)
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + (",)" if len(shape) == 1 else ")")
        wanted = "a number" if not shape else "a list of numbers" if shape == (None,) else wanted
        raise InputError(f"{name} has shape {array.shape}, expected {wanted}")
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        index = ", ".join(str(i) for i in bad)
        where = f"[{index}]" if index else ""
        given = None if np.array(value, dtype=object)[tuple(bad)] is None else array[tuple(bad)]  # NaN in `array`
        raise InputError(f"{name}{where} is {given}, expected a finite number")
    return array


def is_plain(given: object, shape: tuple[int, ...]) -> TypeGuard[Array]:
    """Whether `given` is an array of this shape that compiled kernels can read."""
    return type(given) is np.ndarray and given.dtype == np.float64 and given.shape == shape and given.flags.c_contiguous


def is_near(given: object, shape: tuple[int]) -> TypeGuard[Array]:
    """Whether `near_array` would return an array of this shape unchanged; fast, but false for some that are large."""
    # Without overflow, and false for NaN.
    return is_plain(given, shape) and math.hypot(*given.tolist()) <= FARTHEST


def near_array(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """`finite_array` of lengths, coordinates or angles [m or rad] of at most 1e4 (10 km).

    Raises:
        InputError: not numbers, wrong shape, not finite, or too large.
    """
    array = finite_array(name, value, shape)
    farthest = float(np.abs(array).max(initial=0.0))
    if farthest > FARTHEST:
        raise InputError(f"{name} holds {farthest:.6g}, expected at most {FARTHEST:g}")
    return array


def turn_angles(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """`finite_array` of angles of a rotation [rad] within one turn.

    Raises:
        InputError: not numbers, wrong shape, not finite, or beyond a turn, which suggests degrees.
    """
    array = finite_array(name, value, shape)
    if float(np.abs(array).max(initial=0.0)) > _TURN:
        shown = ", ".join(f"{angle:g}" for angle in array.ravel())
        shown = f"[{shown}]" if array.ndim else shown
        raise InputError(f"{name} is {shown} rad, expected angles within a turn, ±2π {DEGREES}")
    return array


def finite_number(name: str, value: Any) -> float:
    """`value` as a finite float.

    Raises:
        InputError: not a number, NaN or infinite.
    """
    # Fast path for floats: converting to an array would dominate the time of most callers.
    if type(value) is float and math.isfinite(value):
        return value
    return float(finite_array(name, value, ()))


def number_in(text: str) -> float:
    """The number that a word of a file spells; underscores between digits, which `float` accepts, are typing errors.

    Raises:
        ValueError: not a number.
    """
    try:
        return float(text.replace("_", "x"))
    except ValueError:
        raise ValueError(f"{shown(text)} is not a number") from None


def positive_number(name: str, value: Any) -> float:
    """`value` as a finite positive float.

    Raises:
        InputError: not a number, NaN, infinite, zero or negative.
    """
    number = finite_number(name, value)
    if number <= 0.0:
        raise InputError(f"{name} is {number}, expected a number above zero")
    return number


def number_from_zero(name: str, value: object) -> float:
    """`value` as a finite float of zero or more.

    Raises:
        InputError: not a number, NaN, infinite or negative.
    """
    number = finite_number(name, value)
    if number < 0.0:
        raise InputError(f"{name} is {number}, expected a number >= 0")
    return number


def positive_length(name: str, value: Any) -> float:
    """`value` as a positive length of at most 10 km [m].

    Raises:
        InputError: not a number, NaN, zero, negative or too long.
    """
    return positive_number(name, near_array(name, value, ()))


def of_kind(name: str, value: Any, kind: type, *, optional: bool = False, method: str = "") -> None:
    """Require a value of a type, or None if it is optional.

    Args:
        name: The argument.
        value: Its value.
        kind: The type.
        optional: Whether it may be None.
        method: A method that does the same for values of some other types.

    Raises:
        InputError: another type; the message says so if one of our own types has that method, or such a value as an
            attribute, and names the function that reads one from a file.
    """
    if isinstance(value, kind) or (optional and value is None):
        return
    if isinstance(value, type) and issubclass(value, kind):
        raise InputError(f"{name} is the class {value.__name__}, expected an object of it, as {value.__name__}(...)")
    raise InputError(f"{name} is of type {type(value).__name__}, expected {kind.__name__}{_hint(value, kind, method)}")


def _hint(value: object, kind: type, method: str) -> str:
    """What to pass instead of a value of another type, where that is likely known."""
    if type(value).__module__.startswith("rr1plan."):
        if method and callable(getattr(value, method, None)):
            return f"; call its method {method!r} instead"
        if kind.__module__.startswith("rr1plan.") and (attribute := _attribute_of_kind(value, kind)):
            return f"; pass its attribute {attribute!r}"
    if isinstance(value, str | os.PathLike) and kind.__name__ in _READERS:
        return f"; load one with {_READERS[kind.__name__]}"
    return f", e.g. {_EXAMPLES[kind.__name__]}" if kind.__name__ in _EXAMPLES else ""


def _attribute_of_kind(value: object, kind: type) -> str | None:
    """Name of an attribute that holds a value of a type: a property named after it, or a public field."""
    named = kind.__name__.lower()
    if isinstance(getattr(value, named, None), kind):
        return named
    fields = getattr(value, "__dict__", {})
    return next((name for name, one in fields.items() if isinstance(one, kind) and not name.startswith("_")), None)


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """`value` as an int within bounds.

    Raises:
        InputError: not an integer, or out of bounds.
    """
    if not _is_whole(value) or not least <= value <= most:
        raise InputError(f"{name} is {shown(value)}, expected a whole number from {least} to {most}")
    return int(value)


def _is_whole(value: object) -> TypeGuard[int | np.integer[Any]]:
    # NumPy's durations are a subclass of its integers.
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)


def true_or_false(name: str, value: Any) -> bool:
    """`value` as a bool.

    Raises:
        InputError: not a bool; 0 and 1 are rejected too.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} is {shown(value)}, expected True or False")
    return bool(value)


def check_text(name: str, value: Any) -> None:
    """Require text.

    Raises:
        InputError: not text, or text that cannot be encoded.
    """
    if not isinstance(value, str):
        raise InputError(f"{name} is {shown(value)}, expected text")
    if not value.isascii() and any("\ud800" <= letter <= "\udfff" for letter in value):
        raise InputError(f"{name} is {shown(value)}, which contains a lone surrogate")


def check_callback(name: str, value: Any) -> None:
    """Require a function or None.

    Raises:
        InputError: neither.
    """
    if value is not None and not callable(value):
        raise InputError(f"{name} is {shown(value)}, expected a function")


def items_of(name: str, value: Any, kind: str) -> tuple[Any, ...]:
    """The items of a list, a tuple or another iterable that is not text.

    Raises:
        InputError: text, or not iterable.
    """
    try:
        if not isinstance(value, str | bytes | Mapping):
            return tuple(value)
    except TypeError:
        pass
    raise InputError(f"{name} is {shown(value)}, expected a list of {kind}")


def file_path(value: Any) -> Path:
    """`value` as a path that is valid on common file systems.

    Raises:
        InputError: neither text nor a path, empty, an invalid character, a name longer than 255 bytes or a path longer
            than 4095.
    """
    if not isinstance(value, str | os.PathLike) or not isinstance(os.fspath(value), str):
        raise InputError(f"file name is {shown(value)}, expected text or a path")
    if not os.fspath(value):
        raise InputError("file name is empty, expected text or a path")
    path = Path(value)
    if "\0" in str(path):
        raise InputError(f"file name {str(path)!r} holds a NUL")
    try:
        longest, whole = max((len(os.fsencode(part)) for part in path.parts), default=0), len(os.fsencode(path))
    except UnicodeEncodeError as error:
        raise InputError(f"file name {str(path)[:60]!r} holds a character that no file name can have") from error
    if longest > _LONGEST_NAME or whole > _LONGEST_PATH:
        most = _LONGEST_NAME if longest > _LONGEST_NAME else _LONGEST_PATH
        raise InputError(f"file name {str(path)[:60]!r}... is longer than {most} bytes")
    return path


def resolved_path(value: object) -> Path:
    """`file_path`, absolute and with symbolic links resolved, except for a loop of links, which cannot be opened.

    Raises:
        InputError: as in `file_path`, or a relative path in a working folder that was deleted.
    """
    path = file_path(value)
    try:
        return Path(os.path.realpath(path))
    except FileNotFoundError as error:
        raise InputError(f"{path} is in a working folder that is no longer there") from error


def known_name(kind: str, name: str, known: Iterable[str], advice: str = "") -> str:
    """`name`, if it is one of `known`.

    Raises:
        UnknownNameError: it is not; the message suggests similar names and gives the advice, a sentence.
    """
    names = known if isinstance(known, Collection) else tuple(known)  # a name in a dictionary is not searched for
    if not isinstance(name, str) or name not in names:
        raise UnknownNameError(kind, name, names, advice)
    return name


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number with its noun: "1 waypoint", "2 waypoints"; `plural` for irregular plurals."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def rounded(number: float, digits: int = 3) -> str:
    """A number with a few significant digits, also without an exponent if it is large: "2.5", "3000"."""
    text = f"{number:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text


def millimeters(length: float, digits: int = 3) -> str:
    """A length [m] in millimeters, with a few significant digits: "2.5 mm", "3000 mm"."""
    return f"{rounded(1e3 * length, digits)} mm"


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence: "a", "a and b", "a, b and c"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, no longer writeable."""
    array.setflags(write=False)
    return array


class Value:
    """Base of immutable dataclasses: read-only arrays and mappings, after pickling too, and a one-line repr.

    Decorate subclasses with `repr=False`, so that dataclass does not replace the repr.
    """

    def __repr__(self) -> str:
        fields = self.__dataclass_fields__  # type: ignore[attr-defined]  # every subclass is a dataclass
        entries = [f"{name}={_in_brief(getattr(self, name))}" for name, field in fields.items() if field.repr]
        return f"{type(self).__name__}({', '.join(entries)})"

    def __getstate__(self) -> dict[str, object]:
        """The fields, without cached properties."""
        fields = self.__dataclass_fields__  # type: ignore[attr-defined]  # every subclass is a dataclass
        return {n: dict(v) if isinstance(v, MappingProxyType) else v for n, v in self.__dict__.items() if n in fields}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Restore the fields as read-only values."""
        for name, value in state.items():
            parts = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
            for array in parts:
                if isinstance(array, np.ndarray):
                    read_only(array)
            object.__setattr__(self, name, MappingProxyType(value) if isinstance(value, dict) else value)


def _is_seed(rng: Seed) -> TypeGuard[int | np.integer[Any]]:
    return _is_whole(rng) and bool(rng >= 0)


def as_generator(rng: Seed) -> np.random.Generator:
    """A numpy Generator from a Generator, a seed or None (fresh entropy).

    Raises:
        InputError: a negative seed or something else.
    """
    if isinstance(rng, np.random.Generator):
        return rng
    if rng is None or _is_seed(rng):
        return np.random.default_rng(rng)
    raise InputError(f"rng is {shown(rng)}, expected a numpy Generator, a seed >= 0 or None")


def as_seed(rng: Seed) -> int:
    """The seed itself, or one drawn from a generator or fresh entropy.

    Raises:
        InputError: a negative seed or something else.
    """
    return int(rng) if _is_seed(rng) else int(as_generator(rng).integers(2**32))
