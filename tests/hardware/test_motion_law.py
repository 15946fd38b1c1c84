"""The emulator of the control box has every step at the tick of the firmware."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import rr1plan as rp

_CHANNELS = ("S1", "S2", "E1", "E2", "W1", "W2", "G")


@dataclass
class PlainRule:
    """The plain tick rule: all joints of many boxes as arrays, one pass of the loop after the other.

    Everything is derived from the law as written down: a sine ramp, truncated times, stretching to the slowest joint.
    """

    steps: np.ndarray  # (boxes, joints), each command from rest
    fast_period: np.ndarray
    ramp: np.ndarray

    def run(self) -> list[list[list[int]]]:
        """Ticks of the steps, by box and joint."""
        size = np.abs(self.steps).astype(float)
        named = size > 0
        long = size > 2 * self.ramp
        speed = np.where(long, 1 / self.fast_period, (1 / self.fast_period) * (size / (2.0 * self.ramp)))
        ramp = np.where(long, self.ramp, size // 2)
        with np.errstate(all="ignore"):
            ramp_ticks = np.trunc(ramp / (0.5 * speed))
            steady = np.trunc((size - 2 * ramp) * (1 / speed))
            total = np.where(named, 2 * ramp_ticks + steady, 0.0)
            slowest = total.max(axis=1, keepdims=True)
            way = np.where(size > 2 * ramp, size + 2.0 * ramp, 4.0 * ramp)
            factor = way / (speed * slowest)
            ramp_ticks = np.trunc(ramp_ticks / factor)
            speed = factor * speed
        total = np.broadcast_to(slowest, size.shape)
        box, joint = np.nonzero(named)
        left, speed, ramp_ticks, total = size[box, joint], speed[box, joint], ramp_ticks[box, joint], total[box, joint]
        since, period, holds = np.zeros(len(left)), np.full(len(left), 65536.0), np.zeros(len(left), bool)
        found: list[list[list[int]]] = [[[] for _ in _CHANNELS] for _ in self.steps]
        for tick in range(1, 200_000):
            if holds.all():
                return found
            pulse = ~holds & (tick - since > period)
            since = np.where(pulse, since + period, since)
            for k in np.flatnonzero(pulse & (left > 0)).tolist():
                found[box[k]][joint[k]].append(tick)
            holds |= pulse & (left == 0)
            left = left - (pulse & (left > 0))
            time = np.where(tick <= ramp_ticks, tick, total - tick)
            on_ramp = (tick <= ramp_ticks) | (tick >= total - ramp_ticks)
            with np.errstate(divide="ignore"):
                now = 1 / (0.5 * (np.sin((time / ramp_ticks - 0.5) * np.pi) + 1) * speed)
            period = np.where(on_ramp, now, period)
        raise AssertionError("a joint never holds")


def commands_of(rng: np.random.Generator, count: int, most: float) -> np.ndarray:
    """Random commands, most of them short, of one to seven joints, none of a single step."""
    size = np.rint(2.0 * (most / 2.0) ** rng.uniform(size=(count, 7)))
    steps = size * rng.choice([-1, 1], size=size.shape) * (rng.uniform(size=size.shape) < rng.uniform(size=(count, 1)))
    steps[np.arange(count), rng.integers(7, size=count)] = 7
    return steps


def random_box(rng: np.random.Generator) -> rp.ControlBox:
    """A box with short ramps, so that its motions take few ticks."""
    channels = {
        name: rp.BoxChannel(name, float(rng.integers(3, 15)) / 2.0, int(rng.integers(1, 16))) for name in _CHANNELS
    }
    return rp.ControlBox(channels, 0.0006)


def test_every_step_of_ten_thousand_random_commands_has_the_tick_of_the_rule(
    box: rp.ControlBox, rng: np.random.Generator
) -> None:
    """Five hundred with the published law, the others with laws whose motions are shorter."""
    cases = [(box, commands_of(rng, 500, 1000.0))]
    cases += [(random_box(rng), commands_of(rng, 95, 60.0)) for _ in range(100)]
    laws = [[[getattr(b.channels[c], n) for c in _CHANNELS] for b, _ in cases] for n in ("fast_period", "ramp_steps")]
    counts = [len(steps) for _, steps in cases]
    assert sum(counts) == 10_000
    steps = np.concatenate([steps for _, steps in cases])
    fast, ramp = (np.repeat(np.array(law, dtype=float), counts, axis=0) for law in laws)
    want = iter(
        [
            *PlainRule(steps[:500], fast[:500], ramp[:500]).run(),
            *PlainRule(steps[500:], fast[500:], ramp[500:]).run(),
        ]
    )
    for one, commands in cases:
        emulator, position = rp.BoxEmulator(one), np.zeros(7)
        for row in commands:
            found = emulator.run(rp.BoxCommand(tuple(row.astype(int).tolist()), "low"))
            assert [found.get(name, []) for name in _CHANNELS] == next(want)
            position += row
            assert emulator.position == tuple(position)


# ---- the rest of the firmware's behavior -----------------------------------------------------------


def one_joint(steps: int, safety: str = "high") -> rp.BoxCommand:
    """A command for E1 alone."""
    return rp.BoxCommand((0, 0, steps, 0, 0, 0, 0), safety)


def test_joints_are_stretched_to_the_slowest_one(box: rp.ControlBox) -> None:
    alone = rp.BoxEmulator(box).run(one_joint(50))["E1"]
    with_s1 = rp.BoxEmulator(box).run(rp.BoxCommand((1000, 0, 50, 0, 0, 0, 0)))
    assert len(alone) == len(with_s1["E1"]) == 50
    assert alone[-1] < 1200
    assert abs(with_s1["E1"][-1] - with_s1["S1"][-1]) < 0.05 * with_s1["S1"][-1]


def test_with_high_safety_a_joint_with_too_many_steps_stays(box: rp.ControlBox) -> None:
    command = (0, 0, 1025, 100, 0, 0, 0)
    assert set(rp.BoxEmulator(box).run(rp.BoxCommand(command, "high"))) == {"E2"}
    assert set(rp.BoxEmulator(box).run(rp.BoxCommand(command, "low"))) == {"E1", "E2"}


def test_a_single_step_is_never_finished(box: rp.ControlBox) -> None:
    with pytest.raises(rp.HardwareError, match=r"never finishes the command .*: E1 hangs"):
        rp.BoxEmulator(box).run(one_joint(-1))


@pytest.mark.parametrize(("second", "position"), [(300, 700), (-50, 240)])
def test_a_command_on_the_way_is_appended_or_cuts_the_steady_part(
    box: rp.ControlBox, second: int, position: int
) -> None:
    """400 steps of E1 take 512 ticks up, 288 steady and 512 down; at 480 ticks 320 are left before the way down."""
    emulator = rp.BoxEmulator(box)
    emulator.command(one_joint(400))
    emulator.advance(480)
    emulator.command(one_joint(second))
    while not emulator.idle:
        emulator.advance(100)
    # Of the steady part and what is left of the ramp before it, a step every two ticks is dropped.
    assert emulator.position[2] == position


def test_the_same_commands_give_the_same_ticks_however_time_is_cut(box: rp.ControlBox) -> None:
    command = rp.BoxCommand((90, -40, 300, 0, 12, 5, -700))
    whole = rp.BoxEmulator(box).run(command)
    emulator = rp.BoxEmulator(box)
    emulator.command(command)
    found: dict[str, list[int]] = {}
    while not emulator.idle:
        since = emulator.ticks
        for name, ticks in emulator.advance(7).items():
            found.setdefault(name, []).extend(since + tick for tick in ticks)
    assert found == whole


def test_a_channel_that_is_not_in_use_takes_no_steps(box: rp.ControlBox) -> None:
    small = rp.ControlBox({"E1": box.channels["E1"]}, box.tick)
    with pytest.raises(rp.InputError, match="steps for S1, which is not in use"):
        rp.BoxEmulator(small).command(rp.BoxCommand((5, 0, 0, 0, 0, 0, 0)))
