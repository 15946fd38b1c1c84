"""The compiled kernels: the library made for this processor, loaded when it is first needed."""

from __future__ import annotations

import ctypes
import platform
import sys
from functools import cache
from itertools import takewhile
from pathlib import Path

from rr1plan.errors import InstallationError
from rr1plan.kernels import structs
from rr1plan.kernels.memory import argument_type

FOLDER = structs.FOLDER / "built"
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
_SUFFIXES = {"win32": ".dll", "darwin": ".dylib"}
_LEVELS = (4, 3, 2)
_RESULTS = {"void": None, "int64_t": ctypes.c_int64, "double": ctypes.c_double}

HOW_TO_BUILD = "build them with `pip install -e .` or, in a source checkout, `python hatch_build.py`"


def variant_file(variant: str) -> Path:
    """Where the library of a variant is: "x86_64_v2", "x86_64_v3", "x86_64_v4" or "aarch64"."""
    return FOLDER / f"kernels-{variant}{_SUFFIXES.get(sys.platform, '.so')}"


@cache
def variants() -> tuple[str, ...]:
    """The variants that are built and that this processor can run, the fastest first."""
    machine = platform.machine().lower()
    machine = _MACHINES.get(machine, machine)
    if machine != "x86_64":
        return tuple(name for name in (machine,) if variant_file(name).is_file())
    base = variant_file("x86_64_v2")
    if not base.is_file():
        return ()
    level = int(ctypes.CDLL(str(base)).rr1_cpu_level())
    return tuple(name for k in _LEVELS if k <= level and variant_file(name := f"x86_64_v{k}").is_file())


@cache
def load_file(file: Path) -> ctypes.CDLL:
    """A library, its functions declared.

    Raises:
        InstallationError: it cannot be loaded, or was built from other headers.
    """
    try:
        library = ctypes.CDLL(str(file))
        for name, prototype in structs.parse_prototypes(structs.source_text()).items():
            function = getattr(library, name)
            function.restype = _RESULTS[prototype.result]
            function.argtypes = [argument_type(kind) for kind in prototype.arguments]
        expected = structs.layout_of(structs.struct_classes())
        compiled = (ctypes.c_int64 * (len(expected) + 1)).in_dll(library, "rr1_layout")
    except (OSError, AttributeError, ValueError) as error:
        raise InstallationError(f"the compiled kernels {file} cannot be loaded: {error}; {HOW_TO_BUILD}") from error
    if list(takewhile(lambda number: number >= 0, compiled)) != expected:
        raise InstallationError(f"the compiled kernels {file} were built from other headers; {HOW_TO_BUILD}")
    return library


@cache
def load_library() -> ctypes.CDLL:
    """The fastest library that this processor can run.

    Raises:
        InstallationError: none is built, or it cannot be loaded.
    """
    if not variants():
        raise InstallationError(f"no compiled kernels for {platform.machine()} in {FOLDER}; {HOW_TO_BUILD}")
    return load_file(variant_file(variants()[0]))
