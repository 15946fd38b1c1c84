"""The collision certificate as a whole: the compiled search first, Coal for what it leaves.

The search settles pairs of convex shapes, and of one with a half-space or a mesh that is not convex. Coal gets every
pair of elements in which the search met contact or could not tell, once more from the start, clouds, and pairs of which
neither shape is convex.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rr1plan.validation.certificate import TOUCH, Certificate, Findings, Nearest
from rr1plan.validation.motion import SceneMotion
from rr1plan.validation.native import GROUPS, LEFT, PROVEN, SEEN, SOURCES, UNDECIDED, WHEN, RefereeStruct, load_library
from rr1plan.validation.tables import Setting

# Intervals between two looks at whether to go on.
_SLICE = 512

Tell = Callable[[float], bool | None]


def prove(motion: SceneMotion, setting: Setting, tolerance: float, most: int, tell: Tell | None = None) -> Findings:
    """Decide every pair of elements on all of a motion.

    Args:
        motion: The motion.
        setting: Its scene.
        tolerance: The smallest clearance reported is within this of the true one [m].
        most: Searches, and Coal's distances, before giving up on what is still open.
        tell: Called with the fraction decided; False from it cancels.
    """
    quick = Search(motion, setting, tolerance, most)
    if len(setting.pairs):
        quick.run(tell)
    found = quick.findings()
    item = np.flatnonzero(~setting.searched | quick.left[setting.bodies.pair])
    if len(item) and not found.cancelled:
        bodies = setting.bodies.along(motion)
        slow = Certificate(motion, bodies, tolerance, most, _rest(tell, quick.fraction), item, found)
        slow.run()
    found.statistics["pairs"] = float(len(setting.bodies.padding))
    asked = found.statistics["searches"] + found.statistics["distances"]
    found.statistics["culled_share"] = 1.0 - asked / max(found.statistics["pair_checks"], asked, 1.0)
    return found


def _rest(tell: Tell | None, done: float) -> Tell | None:
    """What is told of the remaining work, when a part is done."""
    return None if tell is None else lambda fraction: tell(done + (1.0 - done) * fraction)


class Search:
    """One run of the compiled search, and what it writes.

    Args:
        motion: The motion.
        setting: Its scene.
        tolerance: Smallest clearances are found within this [m].
        most: Searches for directions before giving up on what is still open.

    Attributes:
        struct: What the kernels read and write.
    """

    def __init__(self, motion: SceneMotion, setting: Setting, tolerance: float, most: int) -> None:
        self._motion, self._setting = motion, setting
        count, elements, bodies = len(setting.pairs), len(setting.bodies.padding), len(setting.kinds)
        self.found = np.full((elements, 3), np.inf)
        self.found[:, WHEN] = 0.0
        self.marks = np.zeros(elements, dtype=np.int64)
        breaks, coefficients = np.ascontiguousarray(motion.breaks), np.ascontiguousarray(motion.coefficients)
        pieces, terms, columns = coefficients.shape
        chain = int(setting.bodies.moved.sum(axis=1).max(initial=0)) + 1
        depth = SOURCES.constants["SEARCH_DEPTH"]
        self.struct = RefereeStruct(
            "RefereeSearch",
            breaks=breaks,
            coefficients=coefficients,
            break_count=len(breaks),
            piece_count=pieces,
            terms=terms,
            column_count=columns,
            steps=setting.steps,
            frames=setting.frames,
            joints=setting.joints,
            step_count=len(setting.steps),
            joint_count=len(setting.joints),
            bodies=setting.bodies_struct,
            chains=setting.chains,
            movers=setting.movers,
            mover_count=len(setting.movers),
            pairs=setting.pairs,
            padding=setting.padding,
            pair_count=count,
            tolerance=tolerance,
            touch=TOUCH,
            max_searches=most,
            links=setting.links.copy(),
            columns=np.zeros((columns, 4)),
            ranges=np.zeros((pieces * columns, 2)),
            states=_zeroed("JointState", len(setting.joints) + 1),
            placed=np.zeros((bodies, 15)),
            sweeps=np.zeros((bodies * chain, 2)),
            sweep_stride=chain,
            terms_scratch=np.zeros(terms),
            gjk=_zeroed("GjkState", count),
            found=self.found,
            marks=self.marks,
            directions=np.zeros((count, 4)),
            intervals=_zeroed("TimeInterval", depth),
            items=np.zeros(count * depth, np.int64),
        )
        self._search = self.struct.value
        self._search.nearest[:], self._search.smallest[:] = [-1] * GROUPS, [np.inf] * GROUPS
        self._search.end_clearance[:], self._search.end_pair[:] = [np.inf] * 2 * GROUPS, [-1] * 2 * GROUPS
        self.cancelled = False
        self.fraction = 0.0
        along = setting.bodies.along(motion)
        self.marks[along.pair[along.enclosed()]] = LEFT

    def run(self, tell: Tell | None) -> None:
        """Search until all is decided, or cancelled."""
        s, breaks = self._setting, self._motion.breaks
        total = float(breaks[-1] - breaks[0]) * len(s.searched)
        done = SOURCES.constants["SEARCH_DONE"]
        while self._search.stage != done and not self.cancelled:
            load_library().rr1_prove_motion(self.struct, _SLICE)
            if self._search.stage == done:
                rest = float(self.left[s.bodies.pair].sum() + (~s.searched & ~self.left[s.bodies.pair]).sum())
                self.fraction = max(self.fraction, 1.0 - rest / len(s.searched))
            elif total > 0.0:
                self.fraction = max(self.fraction, min(1.0, self._search.decided / total))
            self.cancelled = tell is not None and tell(self.fraction) is False

    @property
    def left(self) -> NDArray[np.bool_]:
        """Pairs of elements that are left to Coal, shape (pairs,)."""
        return np.asarray(self.marks == LEFT)

    def findings(self) -> Findings:
        """What was found; nothing is claimed of the pairs that are left."""
        left = self.left
        seen, proven = np.where(left, np.inf, self.found[:, SEEN]), np.where(left, np.inf, self.found[:, PROVEN])
        return Findings(
            seen,
            self.found[:, WHEN].copy(),
            np.full(len(left), np.inf),
            self.marks == UNDECIDED,
            proven,
            self._ends(),
            self.cancelled,
            {
                "intervals": float(self._search.interval_count),
                "pair_checks": float(self._search.check_count),
                "searches": float(self._search.search_count),
                "distances": 0.0,
            },
        )

    def _ends(self) -> tuple[tuple[Nearest, Nearest], ...]:
        begin, finish = (float(time) for time in self._motion.breaks[[0, -1]])
        clearances, pairs = self._search.end_clearance, self._search.end_pair
        return tuple(
            (
                Nearest(clearances[2 * group], pairs[2 * group], begin),
                Nearest(clearances[2 * group + 1], pairs[2 * group + 1], finish),
            )
            for group in range(GROUPS)
        )


def _zeroed(kind: str, count: int) -> NDArray[np.uint8]:
    """Zeroed memory for structs of a kind, a row of bytes each."""
    return np.zeros((count, SOURCES.item_size(kind)), np.uint8)
