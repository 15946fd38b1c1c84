"""Libraries of compiled kernels, selected for the processor and loaded lazily."""

from __future__ import annotations

import ctypes
import platform
import sys
from functools import cached_property
from itertools import takewhile
from pathlib import Path

from rr1plan.binding.c_memory import bound
from rr1plan.binding.c_sources import KernelSources
from rr1plan.errors import InstallationError

_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
_SUFFIXES = {"win32": ".dll", "darwin": ".dylib"}
_LEVELS = (4, 3, 2)
HOW_TO_BUILD = "build them with `pip install -e .` or, in a source checkout, `python hatch_build.py`"


class KernelLibrary:
    """A library with one variant for each level of the processor.

    Args:
        sources: Its sources; the libraries are in the folder `built` beside them.
    """

    def __init__(self, sources: KernelSources) -> None:
        self.sources = sources
        self.folder = sources.unit.with_name("built")

    def variant_file(self, variant: str) -> Path:
        """File of a variant: "x86_64_v2", "x86_64_v3", "x86_64_v4" or "aarch64"."""
        return self.folder / f"{self.sources.unit.stem}-{variant}{_SUFFIXES.get(sys.platform, '.so')}"

    @cached_property
    def variants(self) -> tuple[str, ...]:
        """The built variants that this processor supports, the fastest first.

        Raises:
            InstallationError: the variant for all processors cannot be loaded.
        """
        machine = platform.machine().lower()
        machine = _MACHINES.get(machine, machine)
        if machine != "x86_64":
            return tuple(name for name in (machine,) if self.variant_file(name).is_file())
        base = self.variant_file("x86_64_v2")
        if not base.is_file():
            return ()
        try:
            level = int(ctypes.CDLL(str(base)).rr1_cpu_level())
        except (OSError, AttributeError) as error:
            raise _unloadable(base, error) from error
        names = (f"x86_64_v{k}" for k in _LEVELS if k <= level)
        return tuple(name for name in names if self.variant_file(name).is_file())

    def load(self, file: Path) -> ctypes.CDLL:
        """Load a library and declare its functions.

        Args:
            file: The library's file.

        Raises:
            InstallationError: it cannot be loaded, or was built from other sources.
        """
        try:
            library = ctypes.CDLL(str(file))
            checksum = ctypes.c_int64.in_dll(library, "rr1_checksum").value
            if checksum != self.sources.checksum():
                raise InstallationError(f"the compiled kernels {file} were built from other sources; {HOW_TO_BUILD}")
            for name, prototype in self.sources.prototypes.items():
                setattr(library, name, bound(self.sources, getattr(library, name), prototype))
            expected = self.sources.layout()
            compiled = (ctypes.c_int64 * (len(expected) + 1)).in_dll(library, "rr1_layout")
        except (OSError, AttributeError, ValueError) as error:
            raise _unloadable(file, error) from error
        if list(takewhile(lambda number: number >= 0, compiled)) != expected:
            raise InstallationError(f"the compiled kernels {file} have another layout of structs; {HOW_TO_BUILD}")
        return library

    @cached_property
    def fastest(self) -> ctypes.CDLL:
        """The fastest library that this processor can run.

        Raises:
            InstallationError: none is built, or it cannot be loaded.
        """
        if not self.variants:
            raise InstallationError(f"no compiled kernels for {platform.machine()} in {self.folder}; {HOW_TO_BUILD}")
        return self.load(self.variant_file(self.variants[0]))

    def module(self, name: str) -> bytes:
        """A WebAssembly module of the kernels, for pages.

        Args:
            name: Name of its file.

        Raises:
            InstallationError: it is not built, or was built from other headers.
        """
        file = self.folder / name
        if not file.is_file():
            raise InstallationError(f"no {file}; with ziglang installed, {HOW_TO_BUILD}")
        module = file.read_bytes()
        if self.sources.declarations.encode() not in module:
            raise InstallationError(f"{file} was built from other headers; {HOW_TO_BUILD}")
        return module


def _unloadable(file: Path, error: Exception) -> InstallationError:
    return InstallationError(f"the compiled kernels {file} cannot be loaded: {error}; {HOW_TO_BUILD}")
