"""Samples of a trajectory that keep its limits when they are interpolated.

`Trajectory.from_samples`, like a joint trajectory controller, interpolates positions and velocities by cubics, and
samples with accelerations by quintics. If the acceleration of a motion jumps, these exceed its acceleration limit
between samples by a quarter and more. Therefore there is a sample at each break of the motion, accelerations are
omitted if they jump, and the remaining excess (a few thousandths for rounded corners) is removed by stretching time.
If velocities jump, as those of positions joined by straight lines, they are omitted, too: cubics and quintics would
overshoot at each jump, and straight lines are no faster than the motion.
"""

from __future__ import annotations

from math import perm
from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array, of_kind, positive_number
from rr1plan.errors import InputError
from rr1plan.retiming.polynomial_extrema import MAX_DEGREE, peaks
from rr1plan.trajectory import Trajectory

# Samples at regular times are omitted if they are nearer to a break than this share of their distance.
_NEAR = 0.1
# Breaks at smaller distances are merged [s]: rounding of positions would cause accelerations between them.
_ONE = 1e-6
# Jumps of acceleration and of velocity below these shares of their peaks are rounding errors.
_ROUNDING = 1e-7
# The referee treats peaks that differ by less than this share as equal; peaks of joints at rest [rad/s or rad/s²].
_EQUAL, _STILL = 1e-10, 1e-6
_ATTEMPTS = 12
# Most regular samples; files of more take minutes to write and cannot be read again.
_MOST_SAMPLES = 1_000_000
# Speeds at the end below this are zero [rad/s or m/s].
_REST = 1e-6
# Smaller jumps of positions are due to rounded times, such as those since 1970 [rad or m].
_JUMP = 1e-5


class TrajectorySamples(NamedTuple):
    """Samples of a motion.

    Args:
        times: Times since the start [s], shape (n,).
        positions: Positions [rad or m], shape (n, nq).
        velocities: Velocities, shape (n, nq); the last ones are zero. None if they jump.
        accelerations: Accelerations, shape (n, nq); None if they or the velocities jump.
    """

    times: Array
    positions: Array
    velocities: Array | None
    accelerations: Array | None


def sample_within_limits(trajectory: Trajectory, dt: float, *, tick: float | None = None) -> TrajectorySamples:
    """Samples between which no speed and no acceleration is higher than those of the motion, unless velocities jump.

    Args:
        trajectory: A trajectory that ends at rest.
        dt: Longest time between samples [s]; there is one at each break, too.
        tick: Times are multiples of this [s] (default: no constraint).

    Raises:
        InputError: the trajectory has no joints, does not end at rest, its positions jump, or it has too many samples.
    """
    of_kind("trajectory", trajectory, Trajectory)
    if not trajectory.joint_names:
        raise InputError("the trajectory has no joints, of which this kind of file has values; save as .json")
    times = _times(trajectory, dt)
    _check_rest_at_end(trajectory)
    _check_positions_do_not_jump(trajectory)
    continuous = _is_continuous(trajectory, 1)
    smooth = continuous and _is_continuous(trajectory, 2)
    begin, factor = trajectory.start_time, 1.0
    from_zero = trajectory.shifted(-begin)  # large times would be rounded again
    times = times - begin
    for attempt in range(_ATTEMPTS):
        # The motion is sampled at the rounded times that are written.
        written = factor * times
        written = tick * np.round(written / tick) if tick is not None else (begin + written) - begin
        own = np.clip(written / factor, 0.0, from_zero.end_time)
        q, v, a = (from_zero(own, derivative) / factor**derivative for derivative in range(3))
        v[-1] = 0.0
        samples = TrajectorySamples(written, q, v if continuous else None, a if smooth else None)
        if len(times) == 1 or not continuous or trajectory.degree > MAX_DEGREE + 1:
            break
        excess = _excess(trajectory, Trajectory.from_samples(trajectory.joint_names, *samples))
        if excess <= 1.0:
            break
        factor *= excess * (1.0 + _ROUNDING * 2.0**attempt)
    return samples


def _times(trajectory: Trajectory, dt: float) -> Array:
    """Regular times and breaks."""
    breaks = trajectory.breaks
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > _ONE])]
    breaks = np.append(breaks[:-1], trajectory.end_time) if len(breaks) > 1 else trajectory.breaks[[0, -1]]
    if trajectory.duration > _MOST_SAMPLES * positive_number("dt", dt):
        count = np.round(trajectory.duration / dt) + 1.0
        raise InputError(
            f"dt of {dt:g} s makes {count:.8g} samples of {trajectory.duration:g} s, expected at most {_MOST_SAMPLES}; "
            "take a longer dt, or save as .json, which keeps the motion without samples"
        )
    regular = trajectory.sample_times(dt)
    after = np.clip(np.searchsorted(breaks, regular), 1, len(breaks) - 1)
    gaps = np.minimum(np.abs(regular - breaks[after - 1]), np.abs(regular - breaks[after]))
    return np.unique(np.concatenate([breaks, regular[gaps > _NEAR * dt]]))


def _is_continuous(trajectory: Trajectory, derivative: int) -> bool:
    """Whether a derivative does not jump at breaks."""
    return not _jumps(trajectory, derivative).any()


def _jumps(trajectory: Trajectory, derivative: int) -> Array:
    """Jumps of a derivative at inner breaks, shape (m - 1, nq), zero where they are rounding errors."""
    rows = np.moveaxis(trajectory.derivative_coefficients(derivative), 1, 0)
    if len(trajectory.breaks) < 3:
        return np.zeros((0, len(trajectory.joint_names)))
    steps = np.diff(trajectory.breaks)[:, None]
    ends = sum(row * steps**k for k, row in enumerate(rows))
    jumps = np.abs(ends[:-1] - rows[0][1:])
    rounding = _ROUNDING * max(1.0, float(np.abs(ends).max(initial=0.0))) + _rounding(trajectory, derivative)
    return np.where(jumps > rounding, jumps, 0.0)


def _rounding(trajectory: Trajectory, derivative: int) -> float:
    """Largest change of a derivative within the rounding of times, which is coarse for times since 1970."""
    return float(np.spacing(np.abs(trajectory.breaks).max()) * _peaks(trajectory, derivative + 1).max())


def _excess(trajectory: Trajectory, read: Trajectory) -> float:
    """Factor by which interpolated samples have to be stretched so that their peaks equal those of the motion."""
    factor = 1.0
    for derivative in (1, 2):
        allowed, found = _peaks(trajectory, derivative), _peaks(read, derivative)
        moving = allowed > _STILL
        over = (found[moving] / allowed[moving]).max(initial=1.0)
        if over > 1.0 + _EQUAL:
            factor = max(factor, float(over) ** (1.0 / derivative))
    return factor


def _peaks(trajectory: Trajectory, derivative: int) -> Array:
    """Largest absolute value of a derivative of each joint, shape (nq,); a bound for quintics."""
    steps, c = np.diff(trajectory.breaks), trajectory.coefficients
    found = peaks(c[:, : MAX_DEGREE + 1], steps, derivative)
    if trajectory.degree > MAX_DEGREE:
        power = MAX_DEGREE + 1
        found += np.abs(c[:, power]) * perm(power, derivative) * steps[:, None] ** (power - derivative)
    return np.asarray(found.max(axis=0))


def _check_rest_at_end(trajectory: Trajectory) -> None:
    """Reject a trajectory that does not end at rest."""
    speeds = np.abs(trajectory(trajectory.end_time, 1))
    if speeds.max(initial=0.0) > _REST + _rounding(trajectory, 1):
        joint = trajectory.joint_names[int(np.argmax(speeds))]
        raise InputError(f"the trajectory does not end at rest: {joint!r} has the speed {speeds.max():.3g}")


def _check_positions_do_not_jump(trajectory: Trajectory) -> None:
    """Reject a trajectory whose positions jump, which samples would replace by a fast motion."""
    jumps = _jumps(trajectory, 0)
    if jumps.max(initial=0.0) > _JUMP:
        k, j = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
        raise InputError(
            f"the trajectory has a jump of {trajectory.joint_names[j]!r} by {jumps[k, j]:.3g} at "
            f"{trajectory.breaks[k + 1]:.6g} s, which samples cannot represent"
        )
