"""The collision certificate: the compiled search first, then Coal for the pairs that it leaves undecided.

The search settles pairs of convex shapes, and of one with a half-space or with an obstacle's mesh that is not convex.
Coal gets every pair of elements in which the search found contact or could not decide, once more from the start, and
shapes near each other of which one is not convex in another way: clouds, and meshes that move.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.validation.certificate import Certificate, Findings
from rr1plan.validation.certificate_bodies import Bodies
from rr1plan.validation.compiled_search import ElementPair, FoundPair, ProgressCallback, ProofOptions, Search
from rr1plan.validation.link_motion import SceneMotion, TimedColumns
from rr1plan.validation.moving_scene import MovingScene
from rr1plan.validation.referee_kernels import GROUPS, OTHERS, OWN

# The share of the search in all of the work, as far as progress is concerned.
_SEARCH_SHARE = 0.9


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


def prove(
    scene: MovingScene, motion: TimedColumns, options: ProofOptions, progress: ProgressCallback | None = None
) -> CollisionProof:
    """Decide every pair of elements on all of a motion.

    Args:
        scene: The scene.
        motion: The motion.
        options: What is to be found.
        progress: Called with the fraction decided; False from it cancels.
    """
    search = Search(scene, motion, options)
    search.run(None if progress is None else lambda fraction: progress(_SEARCH_SHARE * fraction))
    found = _Decisions(scene, search, motion, options).complete(progress)
    if not options.clearance or found.contacts or found.cancelled or search.smallest.min() > 0.0:
        return found
    # The search took for contacts what Coal finds free, and did not look for smallest clearances from there on.
    search = Search(scene, motion, replace(options, suspects=True))
    search.run(None if progress is None else lambda _: progress(1.0))
    again = _Decisions(scene, search, motion, options).complete(None)
    for name, count in found.statistics.items():
        again.statistics[name] += count
    return again


# ---- what the search leaves ----------------------------------------------------------------


@dataclass
class _Group:
    """Pairs of elements of two owners for Coal.

    Args:
        whole: Those that the search left.
        concave: Those near each other of which a shape is not convex.
        ends: Those of which that may be the nearest at an end of the motion.
    """

    whole: list[ElementPair] = field(default_factory=list)
    concave: list[ElementPair] = field(default_factory=list)
    ends: list[ElementPair] = field(default_factory=list)


class _NamedPair(NamedTuple):
    """Places of two elements in the scene, in order, their names, and whether one arm owns both."""

    places: tuple[int, int]
    names: tuple[str, str]
    own: bool


class _Decisions:
    """What the search found, to be completed by Coal.

    Args:
        scene: The scene.
        search: The search.
        motion: The motion.
        options: What is to be found.
    """

    def __init__(self, scene: MovingScene, search: Search, motion: TimedColumns, options: ProofOptions) -> None:
        self._scene, self._search, self._motion, self._options = scene, search, motion, options
        self._statistics = search.statistics
        self._cancelled = search.cancelled
        self._contacts: dict[ElementPair, Contact] = {}
        self._nearest = [self._named(search.nearest(group)) for group in range(GROUPS)]
        self._proven = search.proven
        self._ends = [self._named(end) for end in search.ends]

    def complete(self, progress: ProgressCallback | None) -> CollisionProof:
        """All that is found, after Coal has measured what is left."""
        for elements, (clearance, _, time) in self._search.undecided.items():
            _, names, own = self._pair(elements)
            self._contacts[elements] = Contact(names, clearance, time, np.inf, own)
        groups = [] if self._cancelled else list(self._groups().values())
        for i, group in enumerate(groups):
            if not self._cancelled:
                self._decide_group(group, None if progress is None else _part_of(progress, i, len(groups)))
        if progress is not None and not self._cancelled and not groups:
            self._cancelled = progress(1.0) is False
        return CollisionProof(
            self._sorted_contacts(), self._nearest, self._proven, self._ends, self._cancelled, self._statistics
        )

    def _sorted_contacts(self) -> list[Contact]:
        """The contacts in the order of the scene's elements, with those of arms in equal configurations."""
        rows = [
            (pair.places, contact._replace(pair=pair.names))
            for elements, contact in self._contacts.items()
            for pair in map(self._pair, self._scene.equal_pairs(elements))
        ]
        return [contact for _, contact in sorted(rows, key=lambda row: row[0])]

    def _pair(self, elements: ElementPair) -> _NamedPair:
        (i, a, one), (j, b, two) = sorted(self._scene.element(e) for e in elements)
        return _NamedPair((i, j), (a, b), one == two)

    def _named(self, found: FoundPair | None) -> Nearest | None:
        return None if found is None else Nearest(found.clearance, self._pair(found.elements).names, found.time)

    # ---- pairs for Coal ---------------------------------------------------------------

    def _groups(self) -> dict[ElementPair, _Group]:
        """The pairs of elements that Coal decides, by owners."""
        groups: dict[ElementPair, _Group] = {}
        for elements in sorted(self._search.left):
            groups.setdefault(self._owners(elements), _Group()).whole.append(elements)
        for elements, at_ends_only in self._concave_pairs():
            if elements not in self._search.left:
                group = groups.setdefault(self._owners(elements), _Group())
                (group.ends if at_ends_only else group.concave).append(elements)
        return groups

    def _owners(self, elements: ElementPair) -> tuple[int, int]:
        one, two = (self._scene.owner(e)[0] for e in elements)
        return min(one, two), max(one, two)

    def _concave_pairs(self) -> Iterator[tuple[ElementPair, bool]]:
        """Pairs of elements, one not convex, that can come near, and whether only as the nearest at an end."""
        scene, search, concave = self._scene, self._search, self._scene.concave_elements()
        if not concave:
            return
        owners = np.array([scene.owner(e)[0] for e in range(scene.element_count)])
        obstacles, later = owners >= len(scene.arms), np.ones(scene.element_count, dtype=bool)
        needed, least_at_ends = np.zeros(GROUPS), [-np.inf, -np.inf]
        if self._options.clearance:
            needed = np.maximum(0.0, search.smallest - self._options.tolerance)
            least_at_ends = [np.inf if end is None else end.clearance for end in search.ends]
        boxes = search.boxes()
        for c in concave:
            later[c] = False
            others = later & (owners != owners[c]) & ~(obstacles & obstacles[c])
            gap = _box_distances(boxes, c) - scene.most_padding
            near = gap.min(axis=0) <= needed[OTHERS]
            at_end = (gap[0] < least_at_ends[0]) | (gap[-1] < least_at_ends[1])
            self._note_proven(OTHERS, gap[:, others & ~near].min(initial=np.inf))
            own = later & (owners == owners[c]) & scene.decides_own_pairs(c) & ~obstacles
            for e in np.flatnonzero(own | (others & (near | at_end))).tolist():
                if scene.padding_between(c, e) >= 0.0:
                    yield (min(c, e), max(c, e)), not (own[e] or near[e])

    def _decide_group(self, group: _Group, progress: ProgressCallback | None) -> None:
        """Decide the pairs of two owners by Coal."""
        elements = [*group.whole, *group.concave, *group.ends]
        pairs = [self._pair(both) for both in elements]
        names = [pair.names for pair in pairs]
        motion = self._motion_of(names)
        bodies = Bodies(self._scene.tables.scene, motion, names)
        # Of pairs that the search did not leave, those of convex shapes are decided.
        items = np.flatnonzero(~bodies.searched | (bodies.pair < len(group.whole)))
        at_ends_only = bodies.pair[items] >= len(group.whole) + len(group.concave)
        # What others took is no longer available, but a tenth is left to each.
        most = max(self._options.max_distances - int(self._statistics["distances"]), self._options.max_distances // 10)
        first = np.array([self._search.left.get(both, np.inf) for both in elements])
        # The search knows the first contact of convex shapes: it does not look into others.
        first[bodies.pair[~bodies.convex]] = np.inf
        certificate = Certificate(
            motion, bodies, self._options.tolerance, most, progress, items[~at_ends_only], self._smallest(), first
        )
        self._add_findings(certificate.run(), elements, pairs)
        ends = certificate.nearest(motion.breaks[[0, -1]], items) if self._options.clearance else []
        for k, end in enumerate(ends):
            if end.pair >= 0 and not pairs[end.pair].own:
                self._ends[k] = _lesser(self._ends[k], Nearest(end.clearance, names[end.pair], end.time))

    def _smallest(self) -> Array:
        """What is known of the smallest clearances [m], shape (2,); 0 where they are not looked for."""
        if self._contacts or not self._options.clearance:
            return np.zeros(GROUPS)
        found = [np.inf if nearest is None else nearest.clearance for nearest in self._nearest]
        return np.minimum(self._search.smallest, found)

    def _motion_of(self, pairs: list[tuple[str, str]]) -> SceneMotion:
        """The motion of the arms that some pairs are about."""
        scene = self._scene.tables.scene
        owners = dict.fromkeys(scene.owner(name) for pair in pairs for name in pair)
        arms = {name: scene.arms[name] for name in owners if name is not None}
        columns = [i for name in arms for i in self._scene.columns_of_arm.get(name, ())]
        names = tuple(self._motion.joint_names[i] for i in columns)
        return SceneMotion(arms, names, self._motion.breaks, self._motion.coefficients[:, :, columns])

    def _add_findings(self, found: Findings, elements: list[ElementPair], pairs: list[_NamedPair]) -> None:
        for name, count in found.statistics.items():
            self._statistics[name] += count
        self._cancelled |= found.cancelled
        for k, (both, pair) in enumerate(zip(elements, pairs, strict=True)):
            group = OWN if pair.own else OTHERS
            clearance, time, first = float(found.clearance[k]), float(found.time[k]), float(found.first_contact[k])
            self._note_proven(group, float(found.proven[k]))
            if np.isfinite(clearance):
                self._nearest[group] = _lesser(self._nearest[group], Nearest(clearance, pair.names, time))
            if np.isfinite(first) or found.undecided[k]:
                self._contacts[both] = Contact(pair.names, clearance, time, first, pair.own)

    def _note_proven(self, group: int, bound: float) -> None:
        self._proven[group] = min(self._proven[group], float(bound))


def _box_distances(boxes: Array, element: int) -> Array:
    """Distances [m] of the boxes around all elements from that of one, shape (slices, elements)."""
    low, high = boxes[:, :, 0], boxes[:, :, 1]
    apart = np.maximum(low[:, element, None] - high, low - high[:, element, None])
    return np.asarray(np.linalg.norm(np.maximum(apart, 0.0), axis=2))


def _lesser(one: Nearest | None, two: Nearest) -> Nearest:
    return two if one is None or two.clearance < one.clearance else one


def _part_of(progress: ProgressCallback, done: int, count: int) -> ProgressCallback:
    """The progress of all of the work while a part of what the search left is being done."""
    rest = 1.0 - _SEARCH_SHARE
    return lambda fraction: progress(_SEARCH_SHARE + rest * (done + fraction) / count)
