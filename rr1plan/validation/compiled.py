"""How the referee compiles its loops: strict floating point, one cached function for each entry.

The referee shares no code with the planners' kernels; how functions become machine code and how that is read from disk
is all they have in common. Only entries are cached on disk; the parts they call are compiled into them, so a new
process loads one file for each entry, on its first call. The cache looks at the file of an entry alone: whoever edits a
part touches the files of the entries that use it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.extending import typeof_impl

from rr1plan.code_units import generic_type, lower_part, sooner, unit_compiler
from rr1plan.compiling import Job, compile_ahead, register, tell
from rr1plan.kept_code import is_kept, keep

F = TypeVar("F", bound=Callable[..., Any])

# C arrays that an entry only reads.
FLOATS1, FLOATS2, FLOATS3 = (numba.types.Array(numba.float64, n, "C", readonly=True) for n in (1, 2, 3))
INTS1, INTS2 = (numba.types.Array(numba.int64, n, "C", readonly=True) for n in (1, 2))
# C arrays that an entry writes.
OUT1, OUT2, OUT3 = numba.float64[::1], numba.float64[:, ::1], numba.float64[:, :, ::1]
COUNT1, COUNT2 = numba.int64[::1], numba.int64[:, ::1]
F64, I64 = numba.float64, numba.int64


_OPTIONS = {"nogil": True, "error_model": "numpy"}

_entries: list[Entry] = []


class Entry:
    """A compiled function of plain arrays, built on its first call.

    Args:
        function: The function.
        signature: Numba's types of its arguments.
    """

    def __init__(self, function: Callable[..., Any], signature: Any) -> None:
        update_wrapper(self, function)
        self._function = function
        self._signature = signature
        self._built: Any = None
        self.job = Job(function, self.is_kept, self._build)
        register(self.job)
        _entries.append(self)

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        return (self._built or self.build())(*arguments)

    def is_kept(self) -> bool | None:
        """Whether its code is on disk; None if it can be kept nowhere."""
        made = self._dispatcher()
        return is_kept(made, self._signature) if _keep(made) else None

    def build(self) -> Any:
        """What numba makes of it: loaded where it is kept, else compiled, with others that are missing; made once."""
        if self._built is None and self.is_kept() is False:
            compile_ahead(self.job)
        return self._build()

    def _build(self) -> Any:
        if self._built is None:
            made = self._dispatcher()
            folder = _keep(made)
            if folder is None or not is_kept(made, self._signature):
                tell(folder)
            with sooner():
                made.compile(self._signature)
            made.disable_compile()
            self._built = made
        return self._built

    def _dispatcher(self) -> Any:
        return numba.njit(pipeline_class=unit_compiler(), no_cfunc_wrapper=True, **_OPTIONS)(self._function)


def _keep(made: Any) -> Path | None:
    """Keep a function's code on disk; the folder, or None if there is none: installed read-only and without a home."""
    try:
        return Path(keep(made))
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return None


def entry(signature: Any) -> Callable[[Callable[..., Any]], Entry]:
    """Compile a function for one signature when it is first called, or take it from the cache."""
    return lambda function: Entry(function, signature)


def build_entries() -> None:
    """Compile the referee's functions ahead, or find them in the cache."""
    for made in _entries:
        made.build()


class Part:
    """A function that entries call.

    Args:
        function: The function.
        fastmath: What of strict floating point it does without.
    """

    def __init__(self, function: Callable[..., Any], fastmath: set[str] | bool = False) -> None:
        update_wrapper(self, function)
        self._function = function
        self._options = {**_OPTIONS, "_nrt": False, "fastmath": fastmath}
        self._type: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Run it as Python does, not compiled."""
        return self._function(*arguments)

    def callee_type(self) -> Any:
        """What it is to functions that call it; made once."""
        if self._type is None:
            self._type = generic_type(self, lambda arguments: lower_part(self._function, self._options, arguments))
        return self._type


def _type_of(made: Part, _: Any) -> Any:
    return made.callee_type()


typeof_impl.register(Part)(_type_of)


def part(function: F) -> F:
    """A function that entries call; it makes no arrays."""
    return cast(F, Part(function))


def largest(function: F) -> F:
    """A part that looks for a largest value: no NaN comes in, so its comparisons may be done side by side."""
    return cast(F, Part(function, {"nnan", "nsz"}))
