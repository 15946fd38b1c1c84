"""What a mirror finds: states, events and reports."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from rr1plan.checks import Array, Value, counted
from rr1plan.mirror.corridor import CorridorPosition
from rr1plan.mirror.joint_states import StreamFault

# The rate is that of the newest messages.
_RECENT = 50


@dataclass(frozen=True)
class MirrorEvent:
    """Something that a mirror noticed.

    Args:
        time: On the clock of the sender [s]; that of the last message where there is none.
        kind: "outside" or "inside" (the arms left the certified corridor, or came back), "contact" (bodies touch), or
            a fault of the stream as in `StreamError`.
        message: Description for people.
    """

    time: float
    kind: Literal["outside", "inside", "contact"] | StreamFault
    message: str


@dataclass(frozen=True, eq=False, repr=False)
class MirrorState(Value):
    """The arms by the newest message.

    Args:
        time: When it was measured, on the clock of the sender [s].
        q: Planning joints of all arms of the scene [rad or m], shape (nq,).
        deviation: Measured less planned positions [rad or m], of the joints of the corridor; None without a plan.
        corridor: Where the arms are in the certified corridor; None without a plan.
        contacts: Pairs of elements that touch and must not.
    """

    time: float
    q: Array
    deviation: Array | None
    corridor: CorridorPosition | None
    contacts: tuple[tuple[str, str], ...]

    @property
    def proven_free(self) -> bool:
        """Whether the arms are in the certified corridor."""
        return self.corridor is not None and self.corridor.use < 1.0


@dataclass(frozen=True, eq=False, repr=False)
class MirrorReport(Value):
    """What came in, and how it compares with the plan.

    Args:
        messages: Number of messages that were used.
        rate: Messages per second, by their arrival.
        delays: Median and largest delay of messages beyond that of the fastest one [s]; clocks may differ.
        max_deviation: Largest deviation from the plan of each of its joints [rad or m], by name.
        outside: Intervals outside the certified corridor, on the clock of the sender [s].
        faults: Number of faults of the stream of each kind.
    """

    messages: int
    rate: float
    delays: tuple[float, float]
    max_deviation: Mapping[str, float]
    outside: tuple[tuple[float, float], ...]
    faults: Mapping[StreamFault, int]

    def __post_init__(self) -> None:
        for name in ("max_deviation", "faults"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __bool__(self) -> bool:
        """All messages were good, and the arms stayed in the corridor."""
        return self.messages > 0 and not self.outside and not self.faults

    def __str__(self) -> str:
        typical, longest = (1e3 * delay for delay in self.delays)
        text = (
            f"{counted(self.messages, 'message')}, {self.rate:.1f}/s, delay {typical:.1f} ms, at most {longest:.1f} ms"
        )
        if self.max_deviation:
            name = max(self.max_deviation, key=lambda joint: self.max_deviation[joint])
            text += f"\nat most {self.max_deviation[name]:.3g} rad or m off the plan ({name})"
            text += "" if self.outside else "\nalways inside the certified corridor"
        for begin, end in self.outside:
            text += f"\noutside the certified corridor from {begin:.3f} s to {end:.3f} s"
        for fault, count in self.faults.items():
            text += f"\n{fault}: {counted(count, 'time')}"
        return text


@dataclass
class MirrorStatistics:
    """Running figures of a mirror.

    Args:
        joint_names: Joints of the plan.
        max_deviation: Largest deviation of each so far [rad or m], shape (n,).
        arrivals: When messages arrived, on this machine's clock [s].
        offsets: How much later than they were measured, on different clocks [s].
        outside: Intervals outside the certified corridor [s].
        faults: Number of faults of the stream of each kind.
    """

    joint_names: tuple[str, ...]
    max_deviation: Array
    arrivals: list[float] = field(default_factory=list)
    offsets: list[float] = field(default_factory=list)
    outside: list[tuple[float, float]] = field(default_factory=list)
    faults: Counter[StreamFault] = field(default_factory=Counter)

    def add(self, state: MirrorState, arrival: float, was_inside: bool) -> None:
        """Count a message."""
        self.arrivals.append(arrival)
        self.offsets.append(arrival - state.time)
        if state.deviation is not None:
            np.maximum(self.max_deviation, np.abs(state.deviation), out=self.max_deviation)
        if state.corridor is not None and not state.proven_free:
            begin = state.time if was_inside else self.outside.pop()[0]
            self.outside.append((begin, state.time))

    def rate(self, recent: int = _RECENT) -> float:
        """Messages per second, by the arrival of some of the newest."""
        arrivals = self.arrivals[-recent:]
        lasted = arrivals[-1] - arrivals[0] if arrivals else 0.0
        return (len(arrivals) - 1) / lasted if lasted > 0.0 else 0.0

    def delay(self) -> float:
        """Delay of the newest message beyond that of the fastest one [s]."""
        return self.offsets[-1] - min(self.offsets)

    def report(self) -> MirrorReport:
        """The figures so far."""
        delays = np.array(self.offsets or [0.0]) - min(self.offsets, default=0.0)
        return MirrorReport(
            messages=len(self.arrivals),
            rate=self.rate(len(self.arrivals)),
            delays=(float(np.median(delays)), float(delays.max())),
            max_deviation=dict(zip(self.joint_names, self.max_deviation.tolist(), strict=True)),
            outside=tuple(self.outside),
            faults=dict(self.faults),
        )
