"""The planning kernels for JavaScript: `core.wasm`, its binding `core.js`, and memory for it.

A page with its own planner needs three things from here: the module, the text of the binding, and a memory image of the
tables of its scene (`CollisionChecker.memory_image`).
"""

from __future__ import annotations

from rr1plan.binding import memory_image as images
from rr1plan.kernels.planner_kernels import LIBRARY, SOURCES


def core_module() -> bytes:
    """The WebAssembly module.

    Raises:
        InstallationError: it is not built, or was built from other headers.
    """
    return LIBRARY.module("core.wasm")


def core_script() -> str:
    """The binding, an ES module without imports: `export async function load(module)`."""
    return SOURCES.unit.with_name("core.js").read_text(encoding="utf-8")


def memory_image(**roots: images.Root) -> bytes:
    """Memory for the module; see `rr1plan.binding.memory_image.memory_image`."""
    return images.memory_image(SOURCES, **roots)
