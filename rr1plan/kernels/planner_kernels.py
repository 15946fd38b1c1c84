"""Python binding of the planning kernels."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from rr1plan.binding import c_memory as memory
from rr1plan.binding.c_sources import KernelSources
from rr1plan.binding.compiled_library import KernelLibrary

SOURCES = KernelSources(Path(__file__).with_name("kernels.c"))
LIBRARY = KernelLibrary(SOURCES)


def load_library() -> ctypes.CDLL:
    """The fastest library that this processor can run.

    Raises:
        InstallationError: none is built, or it cannot be loaded.
    """
    return LIBRARY.fastest


def constants() -> dict[str, int]:
    """The constants of the headers, by name."""
    return SOURCES.constants


class CStruct(memory.KernelStruct):
    """A struct of these kernels; see `rr1plan.binding.c_memory.KernelStruct`.

    Args:
        name: Its name.
        fields: Values of its fields.

    Raises:
        TypeError: an array that does not match the headers.
    """

    sources = SOURCES


def address_of(given: memory.KernelStruct | NDArray[Any], kind: str) -> int:
    """Address of a struct or an array, to be kept alive by the caller; see `rr1plan.binding.c_memory.address_of`."""
    return memory.address_of(SOURCES, given, kind)


def zeroed(kind: str, count: int) -> NDArray[Any]:
    """Zeroed memory for structs or numbers of a kind, aligned for vectors; see `rr1plan.binding.c_memory.zeroed`."""
    return memory.zeroed(SOURCES, kind, count)
