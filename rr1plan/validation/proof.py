"""The collision certificate as a whole: the compiled search first, Coal for what it leaves.

The search settles pairs of convex shapes, and half-spaces. Coal gets every pair of elements in which the
search met contact or could not tell, once more from the start, and all shapes that are not convex.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rr1plan.validation.certificate import TOUCH, Certificate, Findings, Nearest
from rr1plan.validation.gaps import (
    AMOUNTS,
    CHECKS,
    COUNTS,
    DECIDED,
    DONE,
    GROUPS,
    INTERVALS,
    LEFT,
    NEAREST,
    PROVEN,
    SEARCHES,
    SEEN,
    SMALLEST,
    STAGE,
    UNDECIDED,
    WHEN,
)
from rr1plan.validation.motion import SceneMotion
from rr1plan.validation.search import DEEPEST, search
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
    quick = _Search(motion, setting, tolerance)
    if len(setting.pairs):
        quick.run(most, tell)
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


class _Search:
    """One run of the compiled search, and what it writes."""

    def __init__(self, motion: SceneMotion, setting: Setting, tolerance: float) -> None:
        self._motion, self._setting, self._tolerance = motion, setting, tolerance
        count, elements = len(setting.pairs), len(setting.bodies.padding)
        self.found = np.full((elements, 3), np.inf)
        self.found[:, WHEN] = 0.0
        self.marks = np.zeros(elements, dtype=np.int64)
        self.counts, self.amounts = np.zeros(COUNTS, dtype=np.int64), np.zeros(AMOUNTS)
        self.counts[NEAREST : NEAREST + GROUPS], self.amounts[SMALLEST : SMALLEST + GROUPS] = -1, np.inf
        self.directions = np.zeros((count, 4))
        self.stack, self.spans = np.empty((DEEPEST, 4), dtype=np.int64), np.empty((DEEPEST, 2))
        self.items = np.empty(count * DEEPEST, dtype=np.int64)
        self.ends = np.full((GROUPS, 2, 2), np.inf)
        self.ends[:, :, 1] = -1.0
        self.cancelled = False
        self.fraction = 0.0

    def run(self, most: int, tell: Tell | None) -> None:
        """Search until all is decided, or cancelled."""
        s, motion = self._setting, self._motion
        breaks, coefficients = np.ascontiguousarray(motion.breaks), np.ascontiguousarray(motion.coefficients)
        links = s.links.copy()
        total = float(breaks[-1] - breaks[0]) * len(s.searched)
        while self.counts[STAGE] != DONE and not self.cancelled:
            search(
                *(breaks, coefficients, s.steps, s.frames, s.joints, links),
                *(s.kinds, s.sizes, s.corners, s.chains, s.movers, s.pairs, s.padding),
                *(self._tolerance, TOUCH, most, _SLICE),
                *(self.found, self.marks, self.counts, self.amounts, self.directions),
                *(self.stack, self.spans, self.items, self.ends),
            )
            if self.counts[STAGE] == DONE:
                rest = float(self.left[s.bodies.pair].sum() + (~s.searched & ~self.left[s.bodies.pair]).sum())
                self.fraction = max(self.fraction, 1.0 - rest / len(s.searched))
            elif total > 0.0:
                self.fraction = max(self.fraction, min(1.0, float(self.amounts[DECIDED]) / total))
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
                "intervals": float(self.counts[INTERVALS]),
                "pair_checks": float(self.counts[CHECKS]),
                "searches": float(self.counts[SEARCHES]),
                "distances": 0.0,
            },
        )

    def _ends(self) -> tuple[tuple[Nearest, Nearest], ...]:
        begin, finish = (float(time) for time in self._motion.breaks[[0, -1]])
        return tuple(
            (Nearest(float(first), int(pair), begin), Nearest(float(last), int(other), finish))
            for (first, pair), (last, other) in self.ends
        )
