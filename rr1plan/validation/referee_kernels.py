"""The referee's own kernels as Python calls them, and the columns of the tables that they read."""

from __future__ import annotations

import ctypes
from pathlib import Path

from rr1plan.binding import c_memory as memory
from rr1plan.binding.c_sources import KernelSources
from rr1plan.binding.compiled_library import KernelLibrary

SOURCES = KernelSources(Path(__file__).parent / "kernels" / "referee.c")
LIBRARY = KernelLibrary(SOURCES)


def load_library() -> ctypes.CDLL:
    """The fastest library that this processor can run.

    Raises:
        InstallationError: none is built, or it cannot be loaded.
    """
    return LIBRARY.fastest


class RefereeStruct(memory.KernelStruct):
    """A struct of the referee's kernels; see `rr1plan.binding.c_memory.KernelStruct`.

    Args:
        name: Its name.
        fields: Values of its fields.

    Raises:
        TypeError: an array that does not match the headers.
    """

    sources = SOURCES


def _columns(struct: str, *fields: str) -> tuple[int, ...]:
    """Offsets of fields in a row of a table, counted in numbers."""
    return tuple(getattr(SOURCES.classes[struct], field).offset // 8 for field in fields)


_C = SOURCES.constants
# Kinds of shapes; see `referee_tables.h`.
HULL, BOX, CYLINDER, PLANE, TABLE, SURFACE, GRID_CELLS = (
    _C[f"SHAPE_{n}"] for n in ("HULL", "BOX", "CYLINDER", "PLANE", "TABLE", "SURFACE", "CELLS")
)
CLOSED, FIRST, MIXED = (_C[f"FACE_{n}"] for n in ("CLOSED", "FIRST", "MIXED"))
# Cells of directions: SIDE x SIDE on each face of a cube.
SIDE, CELLS = _C["SUPPORT_SIDE"], _C["SUPPORT_CELLS"]
# Rows of `corners` (4, n): the points, and for a table where the corners of each cell begin, relative to its first
# column.
STARTS = 3
TURNS, SLIDES = _C["MOVE_TURNS"], _C["MOVE_SLIDES"]
TOUCHES, GROUPS = _C["PAIR_TOUCHES"], _C["PAIR_GROUPS"]
# Columns of the tables of bodies (b, 7) and of joint frames (j, 17).
SHAPE, LINK, FIRST_JOINT, DEPTH, FIRST_NODE = _columns(
    "RefereeBody", "shape", "link", "first_joint", "depth", "first_node"
)
SHIFT, AXIS, GAIN, OFFSET = _columns("JointFrame", "shift", "axis", "gain", "offset")
