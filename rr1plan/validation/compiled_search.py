"""The compiled search for contacts and smallest clearances: its memory, its runs, and what it found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.binding.memory import slab
from rr1plan.checks import Array
from rr1plan.validation.certificate import TOUCH
from rr1plan.validation.motion import TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.native import GROUPS, LEFT, SOURCES, RefereeStruct, load_library

# Intervals between two calls of the callback.
_INTERVALS = 512
# Pairs of shapes that are searched at once, unless those of two owners are more.
_CHUNK = 4096
_NUMBERS: dict[str, type[np.generic]] = {"int64_t": np.int64, "double": np.float64}

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
        self._duration = float(motion.breaks[-1] - motion.breaks[0])
        breaks, coefficients = np.ascontiguousarray(motion.breaks), np.ascontiguousarray(motion.coefficients)
        pieces, terms, columns = coefficients.shape
        room, sizes = _room(scene), SOURCES.constants
        elements, owners = scene.fields["element_count"], scene.fields["owner_count"]
        bodies, slices = scene.body_count, sizes["MOTION_SLICES"]
        made = {
            "links": ("LinkPose", scene.link_count),
            "ranges": ("ColumnRange", pieces * columns),
            "placed": ("PlacedBody", bodies),
            "terms_scratch": ("double", terms),
            "element_boxes": ("BoundingBox", elements),
            "owner_boxes": ("BoundingBox", owners),
            "element_slices": ("BoundingBox", slices * elements),
            "owner_slices": ("BoundingBox", slices * owners),
            "owner_sweeps": ("BoundingBox", owners),
            "slices": ("TimeInterval", slices),
            "intervals": ("TimeInterval", sizes["SEARCH_DEPTH"]),
            "elements": ("ElementPair", room + GROUPS + 1),
            "directions": ("KnownDirection", room + GROUPS + 1),
            "pairs": ("RefereePair", room + GROUPS + 1),
            "gjk": ("GjkState", room + GROUPS + 1),
            "left": ("ElementPair", room),
            "items": ("int64_t", room * sizes["SEARCH_DEPTH"]),
        }
        self.tables = {name: _uninitialized(kind, count) for name, (kind, count) in made.items()}
        # What stands still has no speed and goes nowhere.
        self.tables |= slab(
            SOURCES,
            columns=("ColumnMotion", columns + len(scene.postures)),
            states=("JointState", scene.fields["joint_count"] + 1),
            sweeps=("Sweep", bodies * scene.fields["sweep_stride"]),
            placed_on=("int64_t", bodies),
        )
        self.tables["columns"].view(np.float64)[columns:, 0] = scene.postures
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
            **self.tables,
        )
        value = self._search = self.struct.value
        value.smallest[:], value.proven[:] = [np.inf] * GROUPS, [np.inf] * GROUPS

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
        rows = self.tables["left"][:count]
        numbers, seen = rows.view(np.int64)[:, :3].tolist(), rows.view(np.float64)[:, 3:].tolist()
        for (a, b, mark), (clearance, time) in zip(numbers, seen, strict=True):
            if mark == LEFT:
                self.left.add((a, b))
            else:
                self.undecided[a, b] = FoundPair(clearance, (a, b), time)

    def _fraction_decided(self) -> float:
        search, moving = self._search, self.scene.moving
        if search.stage == SOURCES.constants["SEARCH_DONE"]:
            return 1.0
        work = self._duration * search.pair_count
        chunk = min(1.0, search.decided / work) if work > 0.0 and search.whole else 0.0
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
        row = self.tables["elements"][self._search.pair_room + group]
        a, b = row.view(np.int64)[:2].tolist()
        seen, when = row.view(np.float64)[3:].tolist()
        return FoundPair(seen, (a, b), when)

    @property
    def ends(self) -> list[FoundPair | None]:
        """The smallest clearance with the surroundings at both ends of the motion."""
        ends = self._search.ends
        return [FoundPair(end.seen, (end.a, end.b), end.when) if end.a >= 0 else None for end in ends]

    def boxes(self) -> Array:
        """Boxes around the elements on each slice of the motion [m], shape (slices, elements, 2, 3)."""
        count, scene = self._search.slice_count, self.scene
        boxes: Array = self.tables["element_slices"].view(np.float64).reshape(-1, scene.element_count, 2, 3)[:count]
        still = int(scene.first_element[scene.moving])
        boxes = boxes.copy()
        boxes[1:, still:] = boxes[0, still:]
        return boxes

    @property
    def statistics(self) -> dict[str, float]:
        """Counts of the work done."""
        search = self._search
        names = ("intervals", "pair_checks", "searches", "distances")
        counts = (search.interval_count, search.check_count, search.search_count, 0)
        return {name: float(count) for name, count in zip(names, counts, strict=True)}


def _uninitialized(kind: str, count: int) -> NDArray[Any]:
    """Memory for structs or numbers of a kind: a row of bytes or a number for each."""
    if kind in _NUMBERS:
        return np.empty(count, _NUMBERS[kind])
    return np.empty((count, SOURCES.item_size(kind)), np.uint8)


def _room(scene: MovingScene) -> int:
    """Pairs of shapes in a chunk: at least those of any two owners, no more than there can be."""
    bodies, arms = scene.owner_bodies, len(scene.arms)
    two = int(bodies[:arms].max(initial=0)) * int(bodies.max(initial=0))
    return max(two, min(_CHUNK, int(bodies[:arms].sum()) * int(bodies.sum()))) + 1
