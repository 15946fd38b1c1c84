"""The compiled search for contacts and smallest clearances: its memory, its runs, and what it found."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.validation.certificate import TOUCH
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.referee_kernels import LEFT, SOURCES, RefereeStruct, load_library

# Intervals between two calls of the callback.
_INTERVALS = 512
# Called with the fraction that is decided; False from it cancels.
ProgressCallback = Callable[[float], bool | None]
# Numbers of two elements of a `MovingScene`.
ElementPair = tuple[int, int]


class FoundPair(NamedTuple):
    """A clearance [m], its pair of elements and its time [s]."""

    clearance: float
    elements: ElementPair
    time: float


@dataclass(frozen=True)
class ProofOptions:
    """What is to be found.

    Args:
        tolerance: The smallest clearance reported is within this of the true one [m].
        max_distances: Searches for each chunk of pairs, and Coal's distances of two owners, before giving up.
        clearance: Whether smallest clearances are looked for, besides contacts.
        suspects: Whether they are looked for even if pairs are left to Coal, which otherwise count as contacts.
    """

    tolerance: float
    max_distances: int
    clearance: bool = True
    suspects: bool = False


class Search:
    """One run of the compiled search, and what it writes.

    Args:
        scene: The scene.
        motion: The motion.
        options: What is to be found.

    Attributes:
        scene: The scene.
        struct: What the kernels read and write.
        left: Pairs in which contact was found or suspected, with the first one [s]; inf where that is not known.
        undecided: Pairs that could not be decided, with the smallest clearance that was seen.
        cancelled: It was cut off.
    """

    def __init__(self, scene: MovingScene, motion: TimedColumns, options: ProofOptions) -> None:
        self.scene = scene
        self.left: dict[ElementPair, float] = {}
        self.undecided: dict[ElementPair, FoundPair] = {}
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
            with_suspects=options.suspects,
            tolerance=options.tolerance,
            touch=TOUCH,
            max_searches=options.max_distances,
            **scene.fields,
        )
        self._search, native = self.struct.value, load_library()
        # Not initialized: most of it is not used.
        self._memory = np.empty(native.rr1_size_search(self.struct) // 8)
        native.rr1_begin_search(self.struct, self._memory)

    def table(self, name: str, count: int) -> Array:
        """The first rows of a table that the search writes; integers among the numbers have to be viewed as such."""
        start = (getattr(self._search, name) - self._memory.__array_interface__["data"][0]) // 8
        width = _row_size(name)
        return self._memory[start : start + count * width].reshape(count, width)

    def run(self, progress: ProgressCallback | None) -> None:
        """Search until all is decided, or cancelled."""
        search, done = self._search, SOURCES.constants["SEARCH_DONE"]
        while search.stage != done and not self.cancelled:
            load_library().rr1_prove_motion(self.struct, _INTERVALS)
            self._take_left()
            if progress is not None:
                self.cancelled = progress(self._fraction_decided()) is False

    def _take_left(self) -> None:
        """Take over the pairs of elements of the last chunk that have a mark."""
        count, self._search.left_count = self._search.left_count, 0
        if not count:
            return
        rows = self.table("left", count)
        numbers, seen = rows.view(np.int64)[:, :3].tolist(), rows[:, 3:].tolist()
        for (a, b, mark), (clearance, time, first) in zip(numbers, seen, strict=True):
            if mark == LEFT:
                self.left[a, b] = first
            else:
                self.undecided[a, b] = FoundPair(clearance, (a, b), time)

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
    def smallest(self) -> Array:
        """Smallest clearances with the surroundings and of one arm's own, 0 with a contact [m], shape (2,)."""
        return np.array(self._search.smallest[:])

    @property
    def proven(self) -> list[float]:
        """Lower bounds of them [m]."""
        return list(self._search.proven)

    def nearest(self, group: int) -> FoundPair | None:
        """The smallest clearance of a group, if there is one."""
        if not self._search.has_nearest[group]:
            return None
        kind = SOURCES.classes["ElementPair"]
        start = self._search.elements + (self._search.pair_room + group) * ctypes.sizeof(kind)
        found = kind.from_address(start)
        return FoundPair(found.seen, (found.a, found.b), found.when)

    @property
    def ends(self) -> list[FoundPair | None]:
        """The smallest clearance with the surroundings at both ends of the motion."""
        ends = self._search.ends
        return [FoundPair(end.seen, (end.a, end.b), end.when) if end.a >= 0 else None for end in ends]

    def boxes(self) -> Array:
        """Boxes around the elements on each slice of the motion [m], shape (slices, elements, 2, 3)."""
        count, scene = self._search.slice_count, self.scene
        shape = count, scene.element_count, 2, 3
        boxes = self.table("element_slices", count * scene.element_count).reshape(shape).copy()
        still = scene.first_element[scene.moving]
        boxes[1:, still:] = boxes[0, still:]
        return boxes

    @property
    def statistics(self) -> dict[str, float]:
        """Counts of the work done."""
        search = self._search
        names = ("intervals", "pair_checks", "searches", "distances")
        counts = (search.interval_count, search.check_count, search.search_count, 0)
        return {name: float(count) for name, count in zip(names, counts, strict=True)}


@cache
def _row_size(table: str) -> int:
    """Numbers of eight bytes in a row of a table."""
    return SOURCES.item_size(SOURCES.pointers("RefereeSearch")[table]) // 8
