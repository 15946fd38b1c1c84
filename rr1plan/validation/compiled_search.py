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
from rr1plan.validation.motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.native import GROUPS, LEFT, SOURCES, RefereeStruct, load_library

# Intervals between two calls of the callback.
_INTERVALS = 512
# Pairs of shapes that are searched at once, unless those of two owners are more.
_CHUNK = 4096

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
    """

    tolerance: float
    max_distances: int
    clearance: bool = True


class Search:
    """One run of the compiled search, and what it writes.

    Args:
        scene: The scene.
        motion: The motion.
        options: What is to be found.

    Attributes:
        scene: The scene.
        struct: What the kernels read and write.
        left: Pairs in which contact was found or suspected.
        undecided: Pairs that could not be decided, with the smallest clearance that was seen.
        cancelled: It was cut off.
    """

    def __init__(self, scene: MovingScene, motion: TimedColumns, options: ProofOptions) -> None:
        self.scene = scene
        self.left: set[ElementPair] = set()
        self.undecided: dict[ElementPair, FoundPair] = {}
        self.cancelled = False
        self._fraction = 0.0
        breaks, coefficients = np.ascontiguousarray(motion.breaks), np.ascontiguousarray(motion.coefficients)
        pieces, terms, columns = coefficients.shape
        room, sizes = _room(scene), SOURCES.constants
        elements, owners = scene.fields["element_count"], scene.fields["owner_count"]
        bodies, slices = scene.body_count, sizes["MOTION_SLICES"]
        counts = {
            "columns": columns + len(scene.postures),
            "states": scene.fields["joint_count"] + 1,
            "sweeps": bodies * scene.fields["sweep_stride"],
            "placed_on": bodies,
            "links": scene.link_count,
            "chords": pieces * columns,
            "placed": bodies,
            "terms_scratch": terms,
            "element_boxes": elements,
            "owner_boxes": owners,
            "element_slices": slices * elements,
            "owner_slices": slices * owners,
            "owner_sweeps": owners,
            "slices": slices,
            "intervals": sizes["SEARCH_DEPTH"],
            "elements": room + GROUPS + 1,
            "directions": room + GROUPS + 1,
            "pairs": room + GROUPS + 1,
            "gjk": room + GROUPS + 1,
            "left": room,
            "items": room * sizes["SEARCH_DEPTH"],
        }
        self._tables = _Tables("RefereeSearch", counts)
        # What stands still has no speed and goes nowhere.
        self._tables.clear("columns", "states", "sweeps", "placed_on")
        self.table("columns")[columns:, 0] = scene.postures
        self.struct = RefereeStruct(
            "RefereeSearch",
            breaks=breaks,
            coefficients=coefficients,
            break_count=len(breaks),
            piece_count=pieces,
            terms=terms,
            column_count=columns,
            with_clearance=options.clearance,
            tolerance=options.tolerance,
            touch=TOUCH,
            max_searches=options.max_distances,
            pair_room=room,
            **scene.fields,
        )
        value = self._search = self.struct.value
        self._tables.point_from(value)
        value.smallest[:], value.proven[:] = [np.inf] * GROUPS, [np.inf] * GROUPS

    def table(self, name: str) -> Array:
        """A table that the search writes, as rows of numbers; integers among them have to be viewed as such."""
        return self._tables.rows(name)

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
        rows = self.table("left")[:count]
        numbers, seen = rows.view(np.int64)[:, :3].tolist(), rows[:, 3:].tolist()
        for (a, b, mark), (clearance, time) in zip(numbers, seen, strict=True):
            if mark == LEFT:
                self.left.add((a, b))
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
        row = self.table("elements")[self._search.pair_room + group]
        a, b = row.view(np.int64)[:2].tolist()
        seen, when = row[3:].tolist()
        return FoundPair(seen, (a, b), when)

    @property
    def ends(self) -> list[FoundPair | None]:
        """The smallest clearance with the surroundings at both ends of the motion."""
        ends = self._search.ends
        return [FoundPair(end.seen, (end.a, end.b), end.when) if end.a >= 0 else None for end in ends]

    def boxes(self) -> Array:
        """Boxes around the elements on each slice of the motion [m], shape (slices, elements, 2, 3)."""
        count, scene = self._search.slice_count, self.scene
        boxes = self.table("element_slices").reshape(-1, scene.element_count, 2, 3)[:count].copy()
        still = int(scene.first_element[scene.moving])
        boxes[1:, still:] = boxes[0, still:]
        return boxes

    @property
    def statistics(self) -> dict[str, float]:
        """Counts of the work done."""
        search = self._search
        names = ("intervals", "pair_checks", "searches", "distances")
        counts = (search.interval_count, search.check_count, search.search_count, 0)
        return {name: float(count) for name, count in zip(names, counts, strict=True)}


class _Tables:
    """Memory for arrays that the pointers of a struct lead to, in one block and not initialized.

    Args:
        struct: Name of the struct.
        counts: Number of items of each array, by field.
    """

    def __init__(self, struct: str, counts: dict[str, int]) -> None:
        kinds, end = SOURCES.pointers(struct), 0
        self._widths = {name: _item_size(kinds[name]) for name in counts}
        self._starts: dict[str, tuple[int, int]] = {}
        for name, count in counts.items():
            start, end = end, end + count * self._widths[name]
            self._starts[name] = start, end
        # All items are structs of numbers of eight bytes, or such numbers.
        self._block = np.empty(end // 8)

    def rows(self, name: str) -> Array:
        """An array as rows of numbers."""
        start, end = self._starts[name]
        return self._block[start // 8 : end // 8].reshape(-1, self._widths[name] // 8)

    def clear(self, *names: str) -> None:
        """Set arrays to zero."""
        for name in names:
            self.rows(name)[:] = 0.0

    def point_from(self, struct: ctypes.Structure) -> None:
        """Set the pointers of a struct, which must not outlive this object."""
        address = self._block.__array_interface__["data"][0]
        for name, (start, _) in self._starts.items():
            setattr(struct, name, address + start)


@cache
def _item_size(kind: str) -> int:
    return SOURCES.item_size(kind)


def _room(scene: MovingScene) -> int:
    """Pairs of shapes in a chunk: at least those of any two owners, no more than there can be."""
    bodies, arms = scene.owner_bodies, len(scene.arms)
    two = int(bodies[:arms].max(initial=0)) * int(bodies.max(initial=0))
    return max(two, min(_CHUNK, int(bodies[:arms].sum()) * int(bodies.sum()))) + 1
