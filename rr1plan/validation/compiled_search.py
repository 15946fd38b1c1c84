"""The compiled search for contacts and smallest clearances: its memory, runs and results."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.referee_kernels import SOURCES, TOUCHES, RefereeStruct, load_library

# A smaller clearance cannot be distinguished from contact [m].
TOUCH = 1e-6
# Intervals between two calls of the callback.
_INTERVALS = 512
# Called with the decided fraction; returns False to cancel.
ProgressCallback = Callable[[float], bool | None]
# Numbers of two elements of a `MovingScene`.
ElementPair = tuple[int, int]


class FoundPair(NamedTuple):
    """Findings about a pair of elements.

    Args:
        elements: The pair.
        clearance: Smallest clearance found [m]; for a pair in contact, minus the largest depth.
        time: Its time [s].
        first: Time of the first contact found [s]; inf if there is none.
    """

    elements: ElementPair
    clearance: float
    time: float
    first: float = np.inf


@dataclass(frozen=True)
class ProofOptions:
    """Options of the search.

    Args:
        tolerance: The reported smallest clearance is within this distance of the true one [m].
        share: Or within this fraction of it, if that is more.
        max_searches: Searches for each chunk of pairs before giving up.
        clearance: Find smallest clearances as well as contacts.
    """

    tolerance: float
    max_searches: int
    clearance: bool = True
    share: float = 0.0


class Search:
    """One run of the compiled search, and its results.

    Args:
        scene: The scene.
        motion: The motion.
        options: Options of the search.

    Attributes:
        scene: The scene.
        struct: What the kernels read and write.
        marked: Pairs in contact, and undecided pairs.
        cancelled: Whether the run was cancelled.
    """

    def __init__(self, scene: MovingScene, motion: TimedColumns, options: ProofOptions) -> None:
        self.scene = scene
        self.marked: list[FoundPair] = []
        self.cancelled = False
        self._fraction = 0.0
        pieces, terms, columns = motion.coefficients.shape
        self.struct = RefereeStruct(
            "RefereeSearch",
            breaks=np.ascontiguousarray(motion.breaks),
            coefficients=np.ascontiguousarray(motion.coefficients),
            break_count=len(motion.breaks),
            piece_count=pieces,
            terms=terms,
            column_count=columns,
            with_clearance=options.clearance,
            tolerance=options.tolerance,
            share=options.share,
            touch=TOUCH,
            max_searches=options.max_searches,
            **scene.fields,
        )
        self._search, native = self.struct.value, load_library()
        # Not initialized: most of it stays unused.
        self._memory = np.empty(native.rr1_size_search(self.struct) // 8)
        native.rr1_begin_search(self.struct, self._memory)

    def table(self, name: str, count: int) -> Array:
        """The first rows of a table that the search writes; integer columns have to be viewed as integers."""
        start = (getattr(self._search, name) - self._memory.__array_interface__["data"][0]) // 8
        width = _row_size(name)
        return self._memory[start : start + count * width].reshape(count, width)

    def run(self, progress: ProgressCallback | None) -> None:
        """Search until all pairs are decided, or until cancelled."""
        search, done = self._search, SOURCES.constants["SEARCH_DONE"]
        while search.stage != done and not self.cancelled:
            load_library().rr1_prove_motion(self.struct, _INTERVALS)
            self._take_marked()
            if progress is not None:
                self.cancelled = progress(self._fraction_decided()) is False

    def _take_marked(self) -> None:
        """Collect the marked pairs of elements of the last chunk."""
        count, self._search.marked_count = self._search.marked_count, 0
        if not count:
            return
        rows = self.table("marked", count)
        numbers, seen = rows.view(np.int64)[:, :3].tolist(), rows[:, 4:].tolist()
        for (a, b, mark), (clearance, time, first) in zip(numbers, seen, strict=True):
            self.marked.append(FoundPair((a, b), clearance, time, first if mark == TOUCHES else np.inf))

    def _fraction_decided(self) -> float:
        search, moving = self._search, self.scene.moving
        if search.stage == SOURCES.constants["SEARCH_DONE"]:
            return 1.0
        alone = search.chunk_arms[1] < 0
        chunk = min(1.0, search.decided / search.chunk_work) if alone and search.chunk_work > 0.0 else 0.0
        if search.stage == SOURCES.constants["SEARCH_MOVING"]:
            self._fraction = max(self._fraction, min(1.0, (search.arm + chunk) / moving))
        return self._fraction

    @property
    def proven(self) -> list[float]:
        """Lower bounds of the smallest clearances [m]."""
        return list(self._search.proven)

    def nearest(self, group: int) -> FoundPair | None:
        """The smallest clearance of a group, if there is one."""
        if not self._search.has_nearest[group]:
            return None
        kind = SOURCES.classes["ElementPair"]
        start = self._search.elements + (self._search.pair_room + group) * ctypes.sizeof(kind)
        found = kind.from_address(start)
        return FoundPair((found.a, found.b), found.seen, found.when)

    @property
    def ends(self) -> list[FoundPair | None]:
        """The smallest clearance to the surroundings at both ends of the motion."""
        ends = self._search.ends
        return [FoundPair((end.a, end.b), end.seen, end.when) if end.a >= 0 else None for end in ends]

    @property
    def statistics(self) -> dict[str, float]:
        """Counts of the work done."""
        search = self._search
        counts = {
            "intervals": search.interval_count,
            "pair_checks": search.check_count,
            "searches": search.search_count,
            "depths": search.depth_count,
        }
        return {name: float(count) for name, count in counts.items()}


@cache
def _row_size(table: str) -> int:
    """Size of a row of a table, in units of eight bytes."""
    return SOURCES.item_sizes[SOURCES.pointers["RefereeSearch"][table]] // 8
