"""Contacts of a simulation as intervals of time, with elements and depth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rr1plan.checks import millimeters
from rr1plan.playback.simulation.mujoco_model import MujocoScene
from rr1plan.playback.simulation.replay import ReplayContact


class ContactLog:
    """Collects contacts at instants and merges them into intervals.

    Args:
        gap: Longest time between two contacts of one interval [s].

    Attributes:
        deepest: Deepest penetration [m], including allowed contacts of loose bodies.
    """

    def __init__(self, gap: float) -> None:
        self._gap = gap
        self.deepest = 0.0
        self._intervals: dict[tuple[str, str], list[ReplayContact]] = {}
        self._passages: dict[tuple[str, str], str] = {}

    def add(self, world: MujocoScene, data: Any, time: float) -> None:
        """Add the contacts at one instant, as intervals those that the scene does not allow.

        Args:
            world: The model.
            data: MuJoCo's data after the collision stage.
            time: The instant [s], not before that of the previous call.
        """
        geoms, distances = data.contact.geom, data.contact.dist
        self.deepest = max(self.deepest, -float(distances.min(initial=0.0)))
        for k in np.flatnonzero(world.forbidden(geoms) & (distances <= 0.0)).tolist():
            first, second = geoms[k].tolist()
            a, b = sorted((world.geom_elements[first], world.geom_elements[second]))
            intervals = self._intervals.setdefault((a, b), [])
            depth = -float(distances[k])
            if intervals and time - intervals[-1].last <= self._gap:
                last = intervals.pop()
                intervals.append(ReplayContact((a, b), last.first, time, max(last.depth, depth)))
            else:
                intervals.append(ReplayContact((a, b), time, time, depth))

    def add_passages(self, passages: Mapping[tuple[str, str], float], time: float) -> None:
        """Add passages from `FastBodies` in the step that ends at `time` [s]; of each pair the first is kept."""
        for (body, other), distance in passages.items():
            text = (
                f"{body!r} moved by {millimeters(distance)} in the step to {time:.3f} s, into or through {other!r}: "
                "take a smaller time step"
            )
            self._passages.setdefault((body, other), text)

    def passages(self) -> tuple[str, ...]:
        """The passages in words, in order of time."""
        return tuple(self._passages.values())

    def clear(self) -> None:
        """Forget all contacts."""
        self._intervals.clear()
        self._passages.clear()
        self.deepest = 0.0

    def intervals(self) -> tuple[ReplayContact, ...]:
        """All intervals in the order of their start."""
        found = (contact for intervals in self._intervals.values() for contact in intervals)
        return tuple(sorted(found, key=lambda contact: contact.first))
