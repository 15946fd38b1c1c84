"""Replays with arms that differ from their description: the differences and the results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rr1plan.checks import Seed, as_generator, counted, number_from_zero, whole_number
from rr1plan.errors import InputError
from rr1plan.playback.simulation.arm_variation import ArmVariation
from rr1plan.playback.simulation.replay import Replay

_MOST_CASES = 100_000


@dataclass(frozen=True)
class ReplayVariations:
    """Random differences of arms from their description, the same for the same seed.

    Args:
        payload: Largest unknown mass at the tool [kg]; uniform from zero.
        mass: Largest error of the masses of all links, as a share; uniform to both sides.
        friction: Largest Coulomb friction of the joints as a share of their effort limits; uniform from zero.
        count: Number of replays.
        rng: Seed or generator.

    Raises:
        InputError: numbers that are negative, not finite or too large, or no replays.
    """

    payload: float = 0.0
    mass: float = 0.1
    friction: float = 0.0
    count: int = 20
    rng: Seed = 0

    def __post_init__(self) -> None:
        for name in ("payload", "mass", "friction"):
            object.__setattr__(self, name, number_from_zero(name, getattr(self, name)))
        if self.mass >= 1.0:
            raise InputError(f"mass is {self.mass}, expected a share below 1")
        ArmVariation(self.payload)  # checks that it is not too large
        whole_number("count", self.count, 1, _MOST_CASES)
        as_generator(self.rng)

    def cases(self) -> tuple[ArmVariation, ...]:
        """The differences, one for each replay."""
        draws = as_generator(self.rng).uniform(size=(self.count, 3))
        return tuple(
            ArmVariation(self.payload * a, 1.0 + self.mass * (2.0 * b - 1.0), self.friction * c)
            for a, b, c in draws.tolist()
        )


@dataclass(frozen=True, eq=False)
class VariedReplays:
    """Replays of one motion with arms as described and with varied ones; true if all passed.

    Args:
        replays: The replays.
        cases: How the arms of each differed from their description; None: not at all.
        tolerance: Largest tracking error allowed during the motion [rad or m].
        goal_tolerance: Largest distance from the goal of the motion allowed at the end [rad or m].
    """

    replays: tuple[Replay, ...]
    cases: tuple[ArmVariation | None, ...]
    tolerance: float
    goal_tolerance: float

    @property
    def passed(self) -> tuple[bool, ...]:
        """Which replays had no contact, kept the tolerance and reached the end."""
        return tuple(share <= 1.0 for share in map(self._share, self.replays))

    @property
    def worst_case(self) -> int:
        """Index of the worst replay: one with a contact, otherwise the one with the largest error over tolerance."""
        return int(np.argmax([self._share(replay) for replay in self.replays]))

    @property
    def worst(self) -> Replay:
        """The worst replay."""
        return self.replays[self.worst_case]

    def __bool__(self) -> bool:
        """Whether all replays passed."""
        return all(self.passed)

    def _share(self, replay: Replay) -> float:
        """The error of a replay as a multiple of the allowed one; inf for a contact."""
        if not replay.free:
            return np.inf
        end = float(np.abs(replay.record.actual[-1] - replay.record.desired[-1]).max(initial=0.0))
        return max(replay.worst_error / self.tolerance, end / self.goal_tolerance)

    def __str__(self) -> str:
        number = self.worst_case
        case = self.cases[number]
        head = f"{sum(self.passed)} of {counted(len(self.replays), 'replay')} passed; the worst, number {number}"
        return f"{head} ({'arms as described' if case is None else case}):\n{self.worst}"
