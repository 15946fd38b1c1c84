"""The one way to compile: explicit signatures, strict floating point, when needed, kept on disk where possible.

To load compiled code takes milliseconds and to compile it seconds, so neither is done on import: an entry is
built when it is first called, or made ready before an entry that calls it by its address. All other kernels become
part of the entries that call them (`code_units.py`). Code that is kept is loaded by `kept_code.py`.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import update_wrapper
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numba
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import typeof_impl

from rr1plan._kernels.code_folder import code_folder, stamp_of
from rr1plan.code_units import callable_type, lower_part, offer, sooner, unit_compiler
from rr1plan.compiling import Job, all_jobs, compile_ahead, compile_together, register, tell
from rr1plan.kept_code import keep

# C arrays that a kernel only reads; an array that may be written is accepted too.
FLOATS1 = numba.types.Array(numba.float64, 1, "C", readonly=True)
FLOATS2 = numba.types.Array(numba.float64, 2, "C", readonly=True)
FLOATS3 = numba.types.Array(numba.float64, 3, "C", readonly=True)
INTS1 = numba.types.Array(numba.int64, 1, "C", readonly=True)
INTS2 = numba.types.Array(numba.int64, 2, "C", readonly=True)
# C arrays that a kernel writes.
OUT1 = numba.float64[::1]
OUT2 = numba.float64[:, ::1]
INT1 = numba.int64[::1]
INT2 = numba.int64[:, ::1]
OUT3 = numba.float64[:, :, ::1]
F64 = numba.float64
I64 = numba.int64

logger = logging.getLogger(__name__)

_made: list[Kernel] = []
_interrupts: list[int] = []


class Kernel:
    """A compiled function of plain arrays, built on its first call. Kernels may call each other.

    Args:
        function: The function.
        signature: Numba's types of result and arguments.
        options: Numba's options.
        entry: Other kernels call it by its address; else it is compiled into them.
        ahead: See `compiling.Job`.
    """

    def __init__(
        self, function: Callable[..., Any], signature: Any, options: dict[str, Any], entry: bool, ahead: bool = True
    ) -> None:
        update_wrapper(self, function)
        self.entry = entry
        self._function = function
        self._signature = signature
        self._options = options
        self._file = Path(function.__code__.co_filename)
        self._stamp = stamp_of(self._file)
        self._identity = f"{function.__module__}.{function.__qualname__} {self._stamp}" if self._stamp else ""
        self._built: Any = None
        self._callee: Any = None
        _made.append(self)
        if self._identity:
            offer(self._identity, self._build)
        self.job = Job(function, self.is_kept, self._build, ahead)
        if entry:
            register(self.job)

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        return (self._built or self.build())(*arguments)

    def is_kept(self) -> bool | None:
        """Whether its code is on disk, so that to build it is only to load it; None if it cannot be kept anywhere."""
        folder, mark = self._folder(), f".{self._function.__qualname__}-"
        if folder is None:
            return None
        # A pattern for each kernel would take as long as to load it.
        return any(mark in name and name.endswith(".nbi") for _, _, names in os.walk(folder) for name in names)

    def build(self) -> Any:
        """What Python calls: loaded where it is kept, else compiled, with others that are missing; made once."""
        if self._built is None and self.is_kept() is False:
            compile_ahead(self.job)
        return self._build()

    def _build(self) -> Any:
        if self._built is None:
            with _undisturbed(), global_compiler_lock:
                self._built = self._built or self._make()
        return self._built

    def callee_type(self) -> Any:
        """What it is to kernels that call it; made once."""
        if self._callee is None:
            with _undisturbed():
                if self.entry and not self._options["forceinline"]:
                    (made,) = self._build().overloads.values()
                else:
                    made = lower_part(self._function, self._options, self._signature.args, self._signature.return_type)
                self._callee = callable_type(self._function.__name__, self, self._signature, made)
        return self._callee

    def _make(self) -> Any:
        folder = self._folder()
        try:
            return self._compile(folder)
        except OSError as error:
            logger.warning("machine code cannot be kept in %s: %s", folder, error)
            return self._compile(None)

    def _folder(self) -> Path | None:
        """Where its code is kept, if it can be."""
        return code_folder(self._file, self._stamp) if self._stamp else None

    def _compile(self, folder: Path | None) -> Any:
        if folder is None or not self.is_kept():
            tell(folder and folder.parent)
        compiler = unit_compiler(self._identity, self._stamp.rpartition("-")[2] or None)
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder or "")
        try:
            made = numba.njit(pipeline_class=compiler, no_cfunc_wrapper=True, **self._options)(self._function)
            if folder is not None:
                keep(made)
        finally:
            numba.config.CACHE_DIR = before
        with sooner():
            made.compile(self._signature)
        made.disable_compile()
        return made


def _type_of(kernel: Kernel, _: Any) -> Any:
    return kernel.callee_type()


typeof_impl.register(Kernel)(_type_of)


def jit(
    signature: Any, *, inline: bool = False, entry: bool = False, allocates: bool = True, ahead: bool = True
) -> Callable[[Callable[..., Any]], Kernel]:
    """Compile a function for one signature.

    No fastmath: a bound that rounds another way is no bound.

    Args:
        signature: Numba's types of result and arguments.
        inline: Put it into each of its callers at every call, instead of once into their code.
        entry: It has code of its own, which `build_all` makes ahead: Python calls it, or several entries do. Any
            kernel can be called from Python, but others are then compiled once more.
        allocates: It makes arrays. Without, no references to arrays are counted, which costs more than the
            arithmetic of short functions that pass many on.
        ahead: An entry is compiled as soon as another one is. Without, when it is called: few need it.
    """
    options = {"nogil": True, "fastmath": False, "error_model": "numpy", "forceinline": inline, "_nrt": allocates}
    return lambda function: Kernel(function, signature, options, entry, ahead)


def build_all(progress: Callable[[float], object] | None = None) -> None:
    """Compile the code of all entries ahead, and all else that is known to `compiling`, or find it on disk.

    Args:
        progress: Called with the fraction that is done.
    """
    entries = _all_entries()
    compile_together(all_jobs(), progress)
    for kernel in entries:
        kernel.build()


def all_kept() -> bool:
    """Whether the code of all entries is on disk, or can be kept nowhere."""
    return all(kernel.is_kept() is not False for kernel in _all_entries())


def _all_entries() -> list[Kernel]:
    package = __name__.rpartition(".")[0]
    for module in iter_modules(import_module(package).__path__):
        import_module(f"{package}.{module.name}")
    return [kernel for kernel in _made if kernel.entry]


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let Ctrl-C wait until a kernel is built: the compiler's callbacks swallow exceptions, or abort on them."""
    if _interrupts:
        # Between two kernels that a third one needs.
        raise KeyboardInterrupt
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return
    signal.signal(signal.SIGINT, lambda number, _: _interrupts.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if _interrupts:
            _interrupts.clear()
            raise KeyboardInterrupt
