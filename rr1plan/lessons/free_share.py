"""The share of a configuration space that is free, estimated by sampling, with a confidence interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from rr1plan.checks import Seed, as_generator, finite_number, of_kind, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError

_MOST_SAMPLES = 100_000_000
_BLOCK = 100_000  # samples that are drawn at once


@dataclass(frozen=True)
class FreeShare:
    """An estimate of the free share.

    Args:
        free: Number of free samples.
        samples: Number of samples.
        low: Lower end of the confidence interval.
        high: Upper end.
        confidence: Least probability with which such an interval contains the true share.
    """

    free: int
    samples: int
    low: float
    high: float
    confidence: float

    @property
    def share(self) -> float:
        """The estimate."""
        return self.free / self.samples

    def __str__(self) -> str:
        percent = f"{100 * self.share:.2f} % free, {100 * self.low:.2f} to {100 * self.high:.2f} %"
        return f"{percent} with {100 * self.confidence:g} % confidence ({self.samples} samples)"


def free_share(
    checker: CollisionChecker, samples: int = 10_000, *, confidence: float = 0.95, rng: Seed = None
) -> FreeShare:
    """Estimate the share of configurations within the joint limits that are free, from uniform samples.

    The interval is the exact one for a binomial count (Clopper and Pearson 1934). Its width shrinks with the square
    root of the number of samples and does not depend on the number of joints.

    Args:
        checker: Checker of arms whose joints all have limits; continuous joints are sampled over one turn.
        samples: Number of samples.
        confidence: Confidence of the interval, between 0 and 1.
        rng: Seed or generator of the samples.

    Raises:
        InputError: a joint without limits, or numbers out of range.
    """
    of_kind("checker", checker, CollisionChecker)
    whole_number("samples", samples, 1, _MOST_SAMPLES)
    confidence = finite_number("confidence", confidence)
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}, expected a probability between 0 and 1")
    lower, upper = np.array(checker.limits.lower), np.array(checker.limits.upper)
    turning = np.concatenate([checker.scene.arms[arm].robot.continuous for arm in checker.arms]) > 0.0
    lower[turning], upper[turning] = -np.pi, np.pi
    if not np.isfinite(upper - lower).all():
        name = checker.joint_names[int(np.argmin(np.isfinite(upper - lower)))]
        raise InputError(f"joint {name!r} has no limits, so its values cannot be sampled uniformly")
    generator = as_generator(rng)
    free = 0
    for first in range(0, samples, _BLOCK):
        q = generator.uniform(lower, upper, (min(_BLOCK, samples - first), checker.nq))
        free += int(checker.are_free(q).sum())
    interval = binomtest(free, samples).proportion_ci(confidence, method="exact")
    return FreeShare(free, samples, float(interval.low), float(interval.high), confidence)
