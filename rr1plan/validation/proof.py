"""The collision certificate as a whole: the compiled search first, Coal for what it leaves.

The search settles pairs of convex shapes, and of one with a half-space or with an obstacle's mesh that is not convex.
Coal gets every pair of elements in which the search found contact or could not decide, once more from the start, and
shapes near each other of which one is not convex in another way: clouds, and meshes that move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.binding.memory import slab
from rr1plan.checks import Array
from rr1plan.validation.bodies import Bodies
from rr1plan.validation.certificate import TOUCH, Certificate, Findings
from rr1plan.validation.motion import SceneMotion, TimedColumns
from rr1plan.validation.native import GROUPS, LEFT, OTHERS, OWN, SOURCES, RefereeStruct, load_library
from rr1plan.validation.referee_scene import Arrangement, RefereeScene

# Intervals between two looks at whether to go on.
_SLICE = 512
# Pairs of shapes that are searched at once, unless those of two owners are more.
_CHUNK = 4096
# The share of the search in all of the work, as far as progress is concerned.
_SEARCH_SHARE = 0.9

_NUMBERS: dict[str, type[np.generic]] = {"int64_t": np.int64, "double": np.float64}

Tell = Callable[[float], bool | None]


class Nearest(NamedTuple):
    """A smallest clearance [m], its pair of elements and the time [s]."""

    clearance: float
    pair: tuple[str, str]
    time: float


class Contact(NamedTuple):
    """A pair of elements that touches, or that could not be decided.

    Args:
        pair: Their names.
        clearance: The smallest one seen [m].
        time: When that was [s].
        first: The first moment seen in contact [s]; inf for none.
        own: Whether one arm owns both.
    """

    pair: tuple[str, str]
    clearance: float
    time: float
    first: float
    own: bool


@dataclass
class CollisionProof:
    """What is found of all pairs of elements over the whole motion.

    Args:
        contacts: Pairs that are not free, in the order of the scene's elements.
        nearest: Smallest clearance with the surroundings, and of one arm's own; None where there is no pair.
        proven: Lower bounds of them [m], where nothing is undecided.
        ends: Smallest clearance with the surroundings at the first and at the last instant.
        cancelled: The search was cut off; what is left of it is not decided.
        statistics: Counts of the work done.
    """

    contacts: list[Contact]
    nearest: list[Nearest | None]
    proven: list[float]
    ends: list[Nearest | None]
    cancelled: bool
    statistics: dict[str, float]


@dataclass(frozen=True)
class Aim:
    """What is to be found.

    Args:
        tolerance: The smallest clearance reported is within this of the true one [m].
        most: Searches for each chunk of pairs, and Coal's distances of two owners, before giving up.
        clearance: Whether smallest clearances are looked for, besides contacts.
    """

    tolerance: float
    most: int
    clearance: bool = True


def prove(scene: RefereeScene, motion: TimedColumns, aim: Aim, tell: Tell | None = None) -> CollisionProof:
    """Decide every pair of elements on all of a motion.

    Args:
        scene: The scene.
        motion: The motion.
        aim: What is to be found.
        tell: Called with the fraction decided; False from it cancels.
    """
    search = Search(scene.arranged(motion.joint_names), motion, aim)
    search.run(tell)
    return _Rest(scene, search, motion, aim).proof(tell)


# ---- the compiled search -------------------------------------------------------------------


class Search:
    """One run of the compiled search, and what it writes.

    Args:
        arrangement: The scene.
        motion: The motion.
        aim: What is to be found.

    Attributes:
        arrangement: The scene.
        struct: What the kernels read and write.
        left: Pairs of elements that are left, by their numbers: the mark, the smallest clearance [m] and its time [s].
        cancelled: It was cut off.
    """

    def __init__(self, arrangement: Arrangement, motion: TimedColumns, aim: Aim) -> None:
        self.arrangement = arrangement
        self.left: dict[tuple[int, int], tuple[int, float, float]] = {}
        self.cancelled = False
        self._fraction = 0.0
        self._duration = float(motion.breaks[-1] - motion.breaks[0])
        breaks, coefficients = np.ascontiguousarray(motion.breaks), np.ascontiguousarray(motion.coefficients)
        pieces, terms, columns = coefficients.shape
        room, sizes = _room(arrangement), SOURCES.constants
        elements, owners = arrangement.fields["element_count"], arrangement.fields["owner_count"]
        bodies, slices = arrangement.body_count, sizes["MOTION_SLICES"]
        made = {
            "links": ("LinkPose", arrangement.link_count),
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
            columns=("ColumnMotion", columns + len(arrangement.postures)),
            states=("JointState", arrangement.fields["joint_count"] + 1),
            sweeps=("Sweep", bodies * arrangement.fields["sweep_stride"]),
            placed_on=("int64_t", bodies),
        )
        self.tables["columns"].view(np.float64)[columns:, 0] = arrangement.postures
        self.struct = RefereeStruct(
            "RefereeSearch",
            breaks=breaks,
            coefficients=coefficients,
            break_count=len(breaks),
            piece_count=pieces,
            terms=terms,
            column_count=columns,
            with_clearance=aim.clearance,
            tolerance=aim.tolerance,
            touch=TOUCH,
            max_searches=aim.most,
            pair_room=room,
            **arrangement.fields,
            **self.tables,
        )
        value = self._search = self.struct.value
        value.smallest[:], value.proven[:] = [np.inf] * GROUPS, [np.inf] * GROUPS

    def run(self, tell: Tell | None) -> None:
        """Search until all is decided, or cancelled."""
        search, done = self._search, SOURCES.constants["SEARCH_DONE"]
        while search.stage != done and not self.cancelled:
            load_library().rr1_prove_motion(self.struct, _SLICE)
            self._take_left()
            if tell is not None:
                self.cancelled = tell(_SEARCH_SHARE * self._progress()) is False

    def _take_left(self) -> None:
        count, self._search.left_count = self._search.left_count, 0
        rows = self.tables["left"][:count]
        for (a, b, mark), (seen, when) in zip(
            rows.view(np.int64)[:, :3].tolist(), rows.view(np.float64)[:, 3:].tolist(), strict=True
        ):
            # Shapes of a pair of elements may be in several chunks.
            if self.left.get((a, b), (None,))[0] != LEFT:
                self.left[a, b] = mark, seen, when

    def _progress(self) -> float:
        search, moving = self._search, self.arrangement.moving
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

    def nearest(self, group: int) -> tuple[float, tuple[int, int], float] | None:
        """The smallest clearance of a group [m], its elements and its time [s], if there is one."""
        if not self._search.has_nearest[group]:
            return None
        row = self.tables["elements"][self._search.pair_room + group]
        a, b = row.view(np.int64)[:2].tolist()
        seen, when = row.view(np.float64)[3:].tolist()
        return seen, (a, b), when

    @property
    def ends(self) -> list[tuple[float, tuple[int, int], float] | None]:
        """The same with the surroundings at both ends of the motion."""
        return [(end.seen, (end.a, end.b), end.when) if end.a >= 0 else None for end in self._search.ends]

    def boxes(self) -> Array:
        """Boxes around the elements on each slice of the motion [m], shape (slices, elements, 2, 3)."""
        count, arrangement = self._search.slice_count, self.arrangement
        boxes = self.tables["element_slices"].view(np.float64).reshape(-1, arrangement.element_count, 2, 3)[:count]
        still = int(arrangement.first_element[arrangement.moving])
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


def _room(arrangement: Arrangement) -> int:
    """Pairs of shapes in a chunk: at least those of any two owners, no more than there can be."""
    bodies, arms = arrangement.owner_bodies, len(arrangement.arms)
    two = int(bodies[:arms].max(initial=0)) * int(bodies.max(initial=0))
    return max(two, min(_CHUNK, int(bodies[:arms].sum()) * int(bodies.sum()))) + 1


# ---- what the search leaves ----------------------------------------------------------------


@dataclass
class _Group:
    """Pairs of elements of two owners for Coal.

    Args:
        whole: Those that the search left.
        concave: Those near each other of which a shape is not convex.
        ends: Those of which that may be the nearest at an end of the motion.
    """

    whole: list[tuple[int, int]] = field(default_factory=list)
    concave: list[tuple[int, int]] = field(default_factory=list)
    ends: list[tuple[int, int]] = field(default_factory=list)


# Places of two elements in the scene, their names, and whether one arm owns both.
_Row = tuple[tuple[int, int], tuple[str, str], bool]


class _Rest:
    """What the search found, and what Coal finds of what it left.

    Args:
        scene: The scene.
        search: The search.
        motion: The motion.
        aim: What is to be found.
    """

    def __init__(self, scene: RefereeScene, search: Search, motion: TimedColumns, aim: Aim) -> None:
        self._scene, self._search, self._motion, self._aim = scene, search, motion, aim
        self._statistics = search.statistics
        self._cancelled = search.cancelled
        self._contacts: dict[tuple[int, int], Contact] = {}
        self._nearest = [self._named(search.nearest(group)) for group in range(GROUPS)]
        self._proven = search.proven
        self._ends = [self._named(end) for end in search.ends]

    def proof(self, tell: Tell | None) -> CollisionProof:
        """All that is found, after Coal has measured what is left."""
        self._add_undecided()
        groups = {} if self._cancelled else self._groups()
        for i, group in enumerate(groups.values()):
            if self._cancelled:
                break
            self._add_group(group, None if tell is None else _part_of(tell, i, len(groups)))
        if tell is not None and not self._cancelled and not groups:
            self._cancelled = tell(1.0) is False
        return CollisionProof(
            self._sorted_contacts(),
            self._nearest,
            self._proven,
            self._ends,
            self._cancelled,
            self._statistics,
        )

    # ---- names ------------------------------------------------------------------------

    def _pair(self, elements: tuple[int, int]) -> _Row:
        """Places of two elements in the scene in order, their names, and whether one arm owns both."""
        (i, a, one), (j, b, two) = sorted(self._scene.element(self._search.arrangement, e) for e in elements)
        return (i, j), (a, b), one == two

    def _named(self, found: tuple[float, tuple[int, int], float] | None) -> Nearest | None:
        return None if found is None else Nearest(found[0], self._pair(found[1])[1], found[2])

    # ---- pairs for Coal ---------------------------------------------------------------

    def _add_undecided(self) -> None:
        for elements, (mark, seen, when) in self._search.left.items():
            if mark != LEFT:
                _, names, own = self._pair(elements)
                self._contacts[elements] = Contact(names, seen if seen < 1e300 else np.inf, when, np.inf, own)

    def _sorted_contacts(self) -> list[Contact]:
        """The contacts in the order of the scene's elements, those of arms in equal postures too."""
        rows = []
        for elements, contact in self._contacts.items():
            for twin in (elements, *self._scene.twins_of(self._search.arrangement, elements)):
                order, names, _ = self._pair(twin)
                rows.append((order, contact._replace(pair=names)))
        return [contact for _, contact in sorted(rows, key=lambda row: row[0])]

    def _groups(self) -> dict[tuple[int, int], _Group]:
        """The pairs of elements that Coal decides, by owners."""
        groups: dict[tuple[int, int], _Group] = {}
        for elements in (pair for pair, (mark, *_) in self._search.left.items() if mark == LEFT):
            groups.setdefault(self._owners(elements), _Group()).whole.append(elements)
        known = set(self._search.left)
        for elements, decide in self._concave_pairs():
            group = groups.setdefault(self._owners(elements), _Group())
            if elements not in known:
                (group.concave if decide else group.ends).append(elements)
        return groups

    def _owners(self, elements: tuple[int, int]) -> tuple[int, int]:
        one, two = (self._owner(e) for e in elements)
        return min(one, two), max(one, two)

    def _owner(self, element: int) -> int:
        """Number of the owner of an element, among those of the scene."""
        return self._scene.owner_of(self._search.arrangement, element)

    def _concave_pairs(self) -> Iterator[tuple[tuple[int, int], bool]]:
        """Pairs of elements that can come near, one not convex; and whether that matters not only at an end."""
        concave = self._scene.concave_elements(self._search.arrangement)
        if not concave:
            return
        boxes, search = self._search.boxes(), self._search
        low, high = boxes[:, :, 0], boxes[:, :, 1]
        padding = search.arrangement.most_padding
        need = np.maximum(0.0, search.smallest - self._aim.tolerance) if self._aim.clearance else np.zeros(GROUPS)
        ends = [np.inf if end is None else end[0] for end in search.ends] if self._aim.clearance else [-np.inf, -np.inf]
        done: set[int] = set()
        for c in concave:
            done.add(c)
            apart = np.maximum(np.maximum(low[:, c, None] - high, low - high[:, c, None]), 0.0)
            gap = np.linalg.norm(apart, axis=2) - padding
            own = self._owner(c)
            near, at_end = gap.min(axis=0) <= need[OTHERS], (gap[0] < ends[0]) | (gap[-1] < ends[1])
            for e in np.flatnonzero(near | at_end | ~(gap.min(axis=0) > need[OWN])).tolist():
                if e in done or self._padding(c, e) < 0.0:
                    continue
                elements = min(c, e), max(c, e)
                if self._owner(e) == own:
                    # Of arms in the same posture one is enough.
                    if self._scene.own_pairs_count(search.arrangement, c):
                        yield elements, True
                elif near[e] or at_end[e]:
                    yield elements, bool(near[e])

    def _padding(self, a: int, b: int) -> float:
        return self._scene.padding_between(self._search.arrangement, a, b)

    def _add_group(self, group: _Group, tell: Tell | None) -> None:
        """Decide the pairs of two owners by Coal."""
        numbers = [*group.whole, *group.concave, *group.ends]
        rows = [self._pair(elements) for elements in numbers]
        names = [pair for _, pair, _ in rows]
        motion = self._motion_of(names)
        bodies = Bodies(self._scene.scene, motion, names)
        items = np.arange(len(bodies.a))
        searched = bodies.searched & (bodies.pair >= len(group.whole))
        decided = bodies.pair < len(group.whole) + len(group.concave)
        known = self._search.smallest if self._aim.clearance else np.zeros(GROUPS)
        # What others took is no more there, but a tenth is left to each.
        most = max(self._aim.most - int(self._statistics["distances"]), self._aim.most // 10)
        certificate = Certificate(motion, bodies, self._aim.tolerance, most, tell, items[~searched & decided], known)
        found = certificate.run()
        self._add_findings(found, numbers, rows)
        rest = items[~searched & ~decided]
        ends = [*found.ends, *(certificate.nearest(motion.breaks[[0, -1]], rest) if len(rest) else ())]
        for i, (clearance, pair, time) in enumerate(ends):
            if pair >= 0 and not rows[pair][2]:
                self._ends[i % 2] = _lesser(self._ends[i % 2], Nearest(clearance, names[pair], time))

    def _motion_of(self, pairs: list[tuple[str, str]]) -> SceneMotion:
        """The motion of the arms that some pairs are about."""
        scene, arrangement = self._scene.scene, self._search.arrangement
        owners = dict.fromkeys(scene.owner(name) for pair in pairs for name in pair)
        arms = {name: scene.arms[name] for name in owners if name is not None}
        columns = [i for name in arms for i in arrangement.columns_of_arm.get(name, ())]
        names = tuple(self._motion.joint_names[i] for i in columns)
        return SceneMotion(arms, names, self._motion.breaks, self._motion.coefficients[:, :, columns])

    def _add_findings(self, found: Findings, numbers: list[tuple[int, int]], rows: list[_Row]) -> None:
        for name, count in found.statistics.items():
            self._statistics[name] += count
        self._cancelled |= found.cancelled
        for k, (_, names, own) in enumerate(rows):
            group = OWN if own else OTHERS
            seen, time, first = float(found.clearance[k]), float(found.time[k]), float(found.first_contact[k])
            self._proven[group] = min(self._proven[group], float(found.proven[k]))
            if np.isfinite(seen):
                self._nearest[group] = _lesser(self._nearest[group], Nearest(seen, names, time))
            if np.isfinite(first) or found.undecided[k]:
                self._contacts[numbers[k]] = Contact(names, seen, time, first, own)


def _lesser(one: Nearest | None, two: Nearest) -> Nearest:
    return two if one is None or two.clearance < one.clearance else one


def _part_of(tell: Tell, done: int, count: int) -> Tell:
    """What is told of all of the work while a part of what the search left is being done."""
    rest = 1.0 - _SEARCH_SHARE
    return lambda fraction: tell(_SEARCH_SHARE + rest * (done + fraction) / count)
