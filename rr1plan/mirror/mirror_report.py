"""Results of a mirror: states, events and reports."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from rr1plan.checks import Array, Value, counted
from rr1plan.mirror.corridor import CorridorPosition
from rr1plan.mirror.joint_states import StreamFault

# Number of latest messages for the current rate and the median delay.
_RECENT, _TYPICAL = 50, 10_000


@dataclass(frozen=True)
class MirrorEvent:
    """An event detected by a mirror.

    Args:
        time: Time on the clock of the sender, continued over restarts [s]; that of the last message if the event has
            none.
        kind: "outside" or "inside" (the arms left the certified corridor, or came back), "contact" (bodies touch), or
            a fault of the stream as in `StreamError`.
        message: Description for people.
    """

    time: float
    kind: Literal["outside", "inside", "contact"] | StreamFault
    message: str

    def __str__(self) -> str:
        return f"{self.time:.3f} s: {self.kind}: {self.message}"


@dataclass(frozen=True, eq=False, repr=False)
class MirrorState(Value):
    """The arms according to the latest messages.

    Args:
        time: Time of the latest measurement, on the clock of the sender, continued over restarts [s].
        q: Planning joints of all arms of the scene [rad or m], shape (nq,).
        deviation: Measured minus planned positions [rad or m], of the joints of the corridor; None without a plan.
        corridor: Position of the arms in the certified corridor; None without a plan.
        contacts: Pairs of elements in forbidden contact.
        moved: Joints outside the plan that are not where the corridor assumes them; nothing is proven then.
    """

    time: float
    q: Array
    deviation: Array | None
    corridor: CorridorPosition | None
    contacts: tuple[tuple[str, str], ...]
    moved: tuple[str, ...]

    @property
    def proven_free(self) -> bool:
        """Whether the arms are in the certified corridor, with all other joints where it assumes them."""
        return self.corridor is not None and self.corridor.use < 1.0 and not self.moved and not self.contacts


@dataclass(frozen=True, eq=False, repr=False)
class MirrorReport(Value):
    """Summary of the messages, and their comparison with the plan.

    Args:
        messages: Number of messages that gave a new state.
        rate: Such messages per second, by their arrival; by their times of measurement if it is unknown, as in a file.
        delays: Median and largest delay of messages beyond that of the fastest one [s]; clocks may differ. Zero if
            their arrival is unknown.
        max_deviation: Largest deviation from the plan of each of its joints [rad or m], by name.
        outside: Intervals in which the arms were not proven free of collision, on the clock of the sender, continued
            over restarts [s].
        faults: Number of faults of the stream of each kind.
        contacts: Number of messages with each pair of elements in forbidden contact.
        unmeasured: Joints that no message had with finite positions; without them there is no state.
        unchecked_links: Links ("arm/link") that the corridor does not check because they have no collision shape.
    """

    messages: int
    rate: float
    delays: tuple[float, float]
    max_deviation: Mapping[str, float]
    outside: tuple[tuple[float, float], ...]
    faults: Mapping[StreamFault, int]
    contacts: Mapping[tuple[str, str], int]
    unmeasured: tuple[str, ...]
    unchecked_links: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("max_deviation", "faults", "contacts"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __bool__(self) -> bool:
        """Whether all messages were valid, nothing touched, and the arms stayed in the corridor."""
        return self.messages > 0 and not self.outside and not self.faults and not self.contacts

    def __str__(self) -> str:
        typical, longest = (1e3 * delay for delay in self.delays)
        text = (
            f"{counted(self.messages, 'message')}, {self.rate:.1f}/s, delay {typical:.1f} ms, at most {longest:.1f} ms"
        )
        if self.max_deviation and not self.messages:
            what = "finite positions of " if "finite" in self.faults else ""
            lacking = f": no message had {what}{', '.join(self.unmeasured)}" if self.unmeasured else ""
            text += f"\nnothing was compared with the plan{lacking}"
        elif self.max_deviation:
            name = max(self.max_deviation, key=lambda joint: self.max_deviation[joint])
            text += f"\nat most {self.max_deviation[name]:.3g} rad or m off the plan ({name})"
            text += "" if self.outside else "\nalways inside the certified corridor"
            if self.unchecked_links:
                text += f"\nnot checked, because they have no collision shape: {', '.join(self.unchecked_links)}"
        for begin, end in self.outside:
            text += f"\noutside the certified corridor from {begin:.3f} s to {end:.3f} s"
        for (first, second), count in self.contacts.items():
            text += f"\n{first} and {second} touch in {counted(count, 'message')}"
        for fault, count in self.faults.items():
            text += f"\n{fault}: {counted(count, 'time')}"
        return text


@dataclass
class MirrorStatistics:
    """Running statistics of a mirror, of bounded size however long it runs.

    Args:
        joint_names: Joints of the plan.
        max_deviation: Largest deviation of each so far [rad or m], shape (n,).
        arrivals: Arrival times of the latest messages, of their measurement if unknown [s].
        offsets: Arrival times minus times of measurement, on different clocks [s].
        totals: Number of messages, first and last arrival, least and largest offset [s].
        outside: Intervals in which the arms were not proven free of collision [s].
        faults: Number of faults of the stream of each kind.
        contacts: Number of messages with each pair of elements in forbidden contact.
    """

    joint_names: tuple[str, ...]
    max_deviation: Array
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    offsets: deque[float] = field(default_factory=lambda: deque(maxlen=_TYPICAL))
    totals: Totals = field(default_factory=lambda: Totals())
    outside: list[tuple[float, float]] = field(default_factory=list)
    faults: Counter[StreamFault] = field(default_factory=Counter)
    contacts: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, state: MirrorState, arrival: float, was_inside: bool) -> None:
        """Count a message."""
        self.arrivals.append(arrival)
        self.offsets.append(arrival - state.time)
        self.totals = self.totals.with_message(arrival, arrival - state.time)
        self.contacts.update(state.contacts)
        if state.deviation is not None:
            np.maximum(self.max_deviation, np.abs(state.deviation), out=self.max_deviation)
        if state.corridor is not None and not state.proven_free:
            begin = state.time if was_inside else self.outside.pop()[0]
            self.outside.append((begin, state.time))

    def rate(self) -> float:
        """Messages per second, from the arrivals of the latest ones."""
        lasted = self.arrivals[-1] - self.arrivals[0] if self.arrivals else 0.0
        return (len(self.arrivals) - 1) / lasted if lasted > 0.0 else 0.0

    def delay(self) -> float:
        """Delay of the latest message beyond that of the fastest one [s]."""
        return self.offsets[-1] - self.totals.least_offset

    def report(self, unmeasured: tuple[str, ...], unchecked_links: tuple[str, ...]) -> MirrorReport:
        """The statistics so far, with the joints that no message had, and the links that the corridor lacks."""
        totals = self.totals
        lasted, delays = totals.last - totals.first, (0.0, 0.0)
        if totals.count:
            typical = float(np.median(self.offsets)) - totals.least_offset
            delays = (typical, totals.largest_offset - totals.least_offset)
        return MirrorReport(
            messages=totals.count,
            rate=(totals.count - 1) / lasted if lasted > 0.0 else 0.0,
            delays=delays,
            max_deviation=dict(zip(self.joint_names, self.max_deviation.tolist(), strict=True)),
            outside=tuple(self.outside),
            faults=dict(self.faults),
            contacts=dict(self.contacts),
            unmeasured=unmeasured,
            unchecked_links=unchecked_links,
        )


@dataclass(frozen=True)
class Totals:
    """For all messages so far: number, first and last arrival, least and largest offset between the clocks [s]."""

    count: int = 0
    first: float = 0.0
    last: float = 0.0
    least_offset: float = math.inf
    largest_offset: float = -math.inf

    def with_message(self, arrival: float, offset: float) -> Totals:
        """The totals with another message."""
        first = arrival if self.count == 0 else self.first
        least, largest = min(self.least_offset, offset), max(self.largest_offset, offset)
        return Totals(self.count + 1, first, arrival, least, largest)
