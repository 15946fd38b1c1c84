"""Calibration from measured tool positions: sign, zero and scale of every joint by nonlinear least squares.

Signs are searched; zeros and scales follow from Levenberg-Marquardt, at first with a loss that outliers hardly affect.
Parameters that the poses do not determine are found from the singular values of the Jacobian, as in the calibration of
kinematic parameters (Hollerbach, Khalil, Gautier: Model identification, Springer Handbook of Robotics).
"""

from __future__ import annotations

import datetime
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from rr1plan.calibration.joint_calibration import (
    Calibration,
    CalibrationFit,
    JointCalibration,
    check_position_units,
)
from rr1plan.calibration.measured_points import MeasuredPoints, Parameters
from rr1plan.checks import Array, counted, finite_array, near_array, of_kind, positive_number, shape_of, true_or_false
from rr1plan.errors import InputError
from rr1plan.robot import Robot

_MOST_JOINTS = 10  # 1024 combinations of signs
_MOST_ROWS = 10_000
_MOST_NOISE = 1.0  # [m]
# A direction of the parameters is undetermined if its standard deviation is above this [rad].
_UNDETERMINED = 0.2
# Parameters that share an undetermined direction: those with at least this fraction of its largest component.
_SHARE = 0.1
# An outlier exceeds this many standard deviations of a coordinate; by chance 1 measurement in 7000 does.
_OUTLIER = 4.5
# Residuals above this many stated standard deviations count linearly.
_LINEAR = 3.0
# Signs are accepted at once if the standard deviation of their residuals is at most this many stated ones; wrong signs
# of a joint with a short lever fit nearly as well.
_GOOD = 1.5
# Other signs explain the measurements as well if half the sum of squared residuals, in standard deviations, is larger
# by at most this: three standard deviations.
_AS_GOOD = 4.5
# Loss of the first fit with trial signs, as a fraction of the spread of the measurements, and the expected errors
# of zeros [rad or m] and of scales (as a fraction) of the start, which count as much in it.
_WIDE, _ZERO_RANGE, _SCALE_RANGE = 0.3, 0.5, 0.2
# A fit has failed if half of the measurements are farther off than this fraction of their spread.
_FAILED = 0.1
_ROUNDS = 10
# With few measurements, a larger standard deviation than this many stated ones is due to outliers.
_SUSPICIOUS = 2.0
# Smallest plausible standard deviation of a coordinate, as a fraction of the stated one.
_FLOOR = 0.01
# Singular values below this fraction of the largest are rounding errors.
_RANK = 1e-9
# Median of the absolute value of a normal variable with a standard deviation of 1.
_MEDIAN = 0.6745
# The readings of a joint have no effect if they have to be scaled by less than this.
_NO_EFFECT = 1e-2
# Smaller ranges of joints do not tell readings in other units from readings of joints that hardly move [rad or m].
_LEAST_RANGE = 1.0
# Largest numbers of evaluations of a fit, and of one with trial signs: right signs take 20 to 36, most wrong ones 100.
_EVALUATIONS, _EVALUATIONS_OF_SIGNS = 100, 40


def calibrate(
    robot: Robot,
    readings: ArrayLike,
    positions: ArrayLike,
    *,
    start: Calibration | None = None,
    point: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 1e-3,
    free_base: bool = False,
) -> Calibration:
    """Estimate the sign, zero and scale of every joint from measured positions of a point of the tool.

    About 20 poses suffice (`propose_calibration_poses`); `expected_calibration` computes beforehand how accurate the
    result will be. The point should be away from the axis of the last joint, which otherwise does not move it: use a
    transverse pointer, for example. Links are assumed to be as described.

    Args:
        robot: The robot.
        readings: Readings of the planning joints, shape (m, nq), in the unit of `start`.
        positions: Measured positions of the point in the frame of the robot's base [m], shape (m, 3).
        start: Initial values (default: positive signs, readings in rad); signs may be wrong, zeros by about 30 degrees,
            and scales by a fifth. Other joints than the planning joints, such as fingers, are kept.
        point: The point in the frame of the robot's tool [m], shape (3,), or one for each row, shape (m, 3).
        noise: Expected standard deviation of a measured coordinate [m], for the search of signs. The uncertainty of the
            result comes from the residuals.
        free_base: Positions are in another frame, whose pose is estimated too. The zero of the first joint is then not
            determined, and remains that of `start`. Neither are signs of planar arms, SCARA arms and gantries, which
            may also be upside down: as many as possible are those of `start`.

    Returns:
        The calibration; `fit` has residuals, outliers and the values that the poses do not determine. Undetermined
        values have a standard deviation of inf; as few of them as possible are fixed at those of `start`.

    Raises:
        InputError: arguments of wrong shapes, types or likely units, a start in other units, too few different
            measurements, few measurements that disagree, poses that determine no joint, or no signs, zeros and scales
            near the start that explain the measurements.
    """
    start = _checked_start(robot, start)
    rows = finite_array("readings", readings, (None, robot.nq))
    scales = np.array([start.joints[name].scale for name in robot.joint_names])
    near_array("readings, divided by the scales of start,", rows / scales, rows.shape)
    measured = near_array("positions", positions, (len(rows), 3))
    points = _checked_points(point, len(rows))
    noise, free_base = _checked_noise(noise), true_or_false("free_base", free_base)
    _check_count(robot, len(rows), free_base=free_base)
    data = MeasuredPoints(robot, start, rows, measured, points)
    _check_units(robot, data, "readings, divided by the scales of start,")
    begin = data.begin(free_base=free_base)
    found, mirrored = _nearest_signs(data, begin, _search_signs(data, begin, noise), noise)
    off = float(np.median(np.linalg.norm(data.residuals(found), axis=1)))
    if off > max(_FAILED * data.spread, _LINEAR * noise):
        raise InputError(
            f"no signs, zeros and scales near the start explain the measurements: half of them are more than "
            f"{1e3 * off:.0f} mm off; check units, the point of the tool, and the scales and zeros of start"
        )
    estimate = _without_outliers(data, _hold_undetermined(data, begin, found, mirrored, noise), noise)
    _check_repetitions(data, estimate)
    residuals = data.residuals(estimate.parameters)[estimate.kept]
    expected, noise = noise, math.sqrt(float((residuals**2).sum()) / (residuals.size - int(estimate.free.sum())))
    if noise > _SUSPICIOUS * expected and _are_few(estimate.kept, estimate.free):
        raise InputError(
            f"{counted(len(residuals), 'measurement')} deviate by {1e3 * noise:.2g} mm with an expected noise of "
            f"{1e3 * expected:.2g} mm, and are too few to tell which of them is wrong; measure at least "
            f"{counted(int(estimate.free.sum()), 'pose')}, or give the true noise (option noise)"
        )
    source = f"estimated from {counted(len(residuals), 'measured position')}"
    return _result(robot, start, data, estimate, noise, source)


def expected_calibration(
    robot: Robot,
    poses: ArrayLike,
    *,
    start: Calibration | None = None,
    point: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 1e-3,
    free_base: bool = False,
) -> Calibration:
    """The accuracy of a calibration from measurements in given poses, before they are taken.

    Standard deviations are the Cramer-Rao bound for normal noise; those of `calibrate` are close to it. If they are too
    large, take more poses (they decrease with the square root of the number) or a longer pointer.

    Args:
        robot: The robot.
        poses: Configurations in which to measure [rad or m], shape (m, nq), for example from
            `propose_calibration_poses`.
        start: Calibration that the robot is assumed to have (default: positive signs, readings in rad).
        point: The point that will be measured, as for `calibrate`.
        noise: Standard deviation of a measured coordinate [m].
        free_base: Whether the pose of the base will be estimated too.

    Returns:
        The values of `start` with the expected standard deviations; inf for those that the poses do not determine.

    Raises:
        InputError: as for `calibrate`.
    """
    start = _checked_start(robot, start)
    configurations = near_array("poses", poses, (None, robot.nq))
    points = _checked_points(point, len(configurations))
    noise, free_base = _checked_noise(noise), true_or_false("free_base", free_base)
    _check_count(robot, len(configurations), free_base=free_base)
    readings = start.readings(configurations, robot.joint_names)
    data = MeasuredPoints(robot, start, readings, np.zeros((len(readings), 3)), points)
    _check_units(robot, data, "poses")
    data = MeasuredPoints(robot, start, readings, data.residuals(data.begin(free_base=False)), points)
    begin = data.begin(free_base=free_base)
    mirrored = _nearest_signs(data, begin, begin, noise)[1]
    estimate = _hold_undetermined(data, begin, begin, mirrored, noise)
    _check_repetitions(data, estimate)
    source = f"expected from {counted(len(readings), 'position')}, noise {1e3 * noise:g} mm per coordinate"
    return replace(_result(robot, start, data, estimate, noise, source), fit=None)


def _checked_start(robot: Robot, start: Calibration | None) -> Calibration:
    of_kind("robot", robot, Robot)
    of_kind("start", start, Calibration, optional=True)
    start = Calibration.assumed(robot) if start is None else start
    missing = [name for name in robot.joint_names if name not in start.joints]
    if missing:
        raise InputError(f"start has no joint {missing[0]!r}, expected all of {', '.join(robot.joint_names)}")
    check_position_units(start, robot)
    if robot.nq > _MOST_JOINTS:
        raise InputError(f"robot {robot.name!r} has {robot.nq} joints, expected at most {_MOST_JOINTS}")
    return start


def _checked_points(point: ArrayLike, count: int) -> Array:
    """The measured point in the frame of the tool for each of some measurements [m], shape (count, 3)."""
    points = near_array("point", point, (3,) if len(shape_of(point)) == 1 else (count, 3))
    return np.broadcast_to(points, (count, 3))


def _checked_noise(noise: float) -> float:
    noise = positive_number("noise", noise)
    if noise > _MOST_NOISE:
        raise InputError(f"noise is {noise:g} m, expected at most {_MOST_NOISE:g} m")
    return noise


def _check_count(robot: Robot, count: int, *, free_base: bool) -> None:
    if count > _MOST_ROWS:
        raise InputError(f"{count} measurements are too many, expected at most {_MOST_ROWS}")
    unknowns = 2 * robot.nq + 6 * free_base
    if 3 * count <= unknowns:
        raise InputError(
            f"got {counted(count, 'measurement')} of 3 coordinates for {unknowns} unknowns; measure at least "
            f"{unknowns // 3 + 1} poses, better {unknowns}"
        )


def _check_units(robot: Robot, data: MeasuredPoints, readings: str) -> None:
    """Reject readings that vary by more than the range of a joint, and positions by more than the reach of the robot.

    Median deviations from the median, because single readings and positions may be outliers.

    Args:
        robot: The robot.
        data: The measurements.
        readings: Name of the readings in messages.
    """
    deviations = np.median(np.abs(data.turns - np.median(data.turns, axis=0)), axis=0)
    ranges = robot.limits.upper - robot.limits.lower
    for name, deviation, most in zip(robot.joint_names, deviations.tolist(), ranges.tolist(), strict=True):
        if deviation > max(most, _LEAST_RANGE):
            unit = robot.joint(name).unit
            other, size = ("mm", 1e3) if unit == "m" else ("degrees", math.degrees(1.0))
            if deviation > size * max(most, _LEAST_RANGE):
                other = "steps or counts (give their scale in start)"
            raise InputError(
                f"{readings} seem to be in {other} instead of {unit}: half of those of joint {name!r} are more than "
                f"{deviation:.3g} {unit} from their median, and its range is {most:.3g} {unit}"
            )
    reach = sum(float(np.linalg.norm(joint.origin[:3, 3])) for joint in robot.joints)
    reach += sum(max(abs(joint.lower), abs(joint.upper)) for joint in robot.joints if joint.unit == "m")
    reach += float(np.linalg.norm(data.points, axis=1).max())
    deviation = float(np.median(np.linalg.norm(data.positions - np.median(data.positions, axis=0), axis=1)))
    if deviation > 2.0 * reach:
        raise InputError(
            f"positions seem to be in mm instead of m: half of them are more than {deviation:.3g} m from their median, "
            f"and the point is never more than {reach:.3g} m from the base"
        )


@dataclass(frozen=True, eq=False)
class _Estimate:
    """An intermediate estimate of the parameters.

    Args:
        parameters: The parameters.
        free: Estimated parameters, shape (p,); the others are those of the start.
        undetermined: Parameters that the poses do not determine, shape (p,).
        mirrored: Joints whose sign the poses do not determine, shape (nq,).
        kept: Measurements that are used, shape (m,).
    """

    parameters: Parameters
    free: NDArray[np.bool_]
    undetermined: NDArray[np.bool_]
    mirrored: NDArray[np.bool_]
    kept: NDArray[np.bool_]


def _check_repetitions(data: MeasuredPoints, estimate: _Estimate) -> None:
    """Reject an estimate from too few different measurements, which wrong values fit as well as right ones."""
    different = len(np.unique(np.hstack([data.turns, data.points])[estimate.kept], axis=0))
    unknowns = int(estimate.free.sum())
    if 3 * different <= unknowns:
        raise InputError(
            f"{counted(different, 'different measurement')} have {3 * different} coordinates for {unknowns} unknowns; "
            "measure more poses, because repetitions in the same one do not count"
        )


def _fitted(
    data: MeasuredPoints,
    begin: Parameters,
    free: NDArray[np.bool_],
    rows: NDArray[np.bool_],
    loss: float | None,
    *,
    evaluations: int = _EVALUATIONS,
    prior: Array | None = None,
) -> Parameters:
    """Least squares for some parameters over some rows.

    Args:
        data: The measurements.
        begin: Initial parameters.
        free: Parameters to estimate, shape (p,).
        rows: Measurements to use, shape (m,).
        loss: Residual above which residuals count linearly [m]; None: none do.
        evaluations: Largest number of evaluations.
        prior: Residual per difference of each parameter from its initial value, shape (p,) (default: none).
    """
    weights = np.diag(np.zeros(len(free)) if prior is None else prior)[:, free]

    def at(values: Array) -> Parameters:
        full = begin.values.copy()
        full[free] = values
        return replace(begin, values=full)

    @lru_cache(maxsize=1)
    def both(values: bytes) -> tuple[Array, Array]:
        """Residuals and Jacobian, which the solver requests one after the other."""
        now = np.frombuffer(values)
        off, jacobian = data.with_jacobian(at(now))
        measured = jacobian[rows][:, :, free].reshape(-1, int(free.sum()))
        return np.concatenate([off[rows].ravel(), weights @ (now - start)]), np.concatenate([measured, weights])

    def residuals(values: Array) -> Array:
        return both(values.tobytes())[0]

    def jacobian(values: Array) -> Array:
        return both(values.tobytes())[1]

    start = begin.values[free]
    if loss is None:
        return at(least_squares(residuals, start, jacobian, method="lm", max_nfev=evaluations).x)
    return at(least_squares(residuals, start, jacobian, loss="soft_l1", f_scale=loss, max_nfev=evaluations).x)


def _search_signs(data: MeasuredPoints, begin: Parameters, noise: float) -> Parameters:
    """The signs with the best fit, or the first good ones, tried in the order of their fit at the start.

    Each is fitted with a wide loss first, and near the start: a narrow loss, in which nearly all residuals of the start
    are linear, has more local minima (graduated non-convexity: Blake & Zisserman, Visual Reconstruction, 1987).
    """
    every, rows = np.ones(len(begin.values), dtype=bool), np.ones(len(data.positions), dtype=bool)
    loss = _LINEAR * noise
    wide = max(_WIDE * data.spread, loss)
    expected, joints = np.full(len(begin.values), np.inf), len(begin.signs)
    expected[:joints], expected[joints : 2 * joints] = _ZERO_RANGE, _SCALE_RANGE
    signs = [begin.signs * flips for flips in itertools.product((1.0, -1.0), repeat=joints)]
    starts = [data.with_signs(begin, each) for each in signs]
    at_start = [float(np.abs(data.residuals(each)).sum()) for each in starts]
    best, least = begin, np.inf
    for i in np.argsort(at_start, kind="stable"):
        found = _fitted(data, starts[i], every, rows, wide, evaluations=_EVALUATIONS_OF_SIGNS, prior=wide / expected)
        found = _fitted(data, found, every, rows, loss, evaluations=_EVALUATIONS_OF_SIGNS)
        off = np.abs(data.residuals(found))
        # Other signs with some zeros half a turn off may fit equally well.
        cost = _cost(off, loss)
        cost += 0.5 * float((((found.values - begin.values) / expected) ** 2).sum())
        if cost < least:
            best, least = found, cost
        std = _robust_std(off, len(every))
        if std <= _GOOD * noise or (std <= loss and _fits_but_for_outliers(data, found, std, noise)):
            break
    return best


def _fits_but_for_outliers(data: MeasuredPoints, found: Parameters, std: float, noise: float) -> bool:
    """Whether enough measurements fit well if outliers, which bias the first fit, are left out."""
    every = np.ones(len(found.values), dtype=bool)
    kept = np.linalg.norm(data.residuals(found), axis=1) <= _OUTLIER * std
    if _are_few(kept, every):
        return False
    fit = _fitted(data, found, every, kept, None, evaluations=_EVALUATIONS_OF_SIGNS)
    return _robust_std(data.residuals(fit)[kept], len(every)) <= _GOOD * noise


def _are_few(kept: NDArray[np.bool_], free: NDArray[np.bool_]) -> bool:
    """Whether measurements have too few coordinates to recognize that one of them is wrong."""
    return 3 * int(kept.sum()) < 2 * int(free.sum())


def _cost(residuals: Array, loss: float) -> float:
    """Half the sum of squares of residuals in standard deviations, those above `loss` [m] counted linearly."""
    return _LINEAR**2 * float((np.sqrt(1.0 + (residuals / loss) ** 2) - 1.0).sum())


def _nearest_signs(
    data: MeasuredPoints, begin: Parameters, found: Parameters, noise: float
) -> tuple[Parameters, NDArray[np.bool_]]:
    """Of the fits that explain the measurements as well as the one found, the one with most signs of the start.

    An arm with a free base whose axes are parallel, or that only slides, moves its tool in the same way if it is turned
    upside down and joints turn or slide the other way.

    Returns:
        The fit, and the joints that have another sign in one of the others, shape (nq,).
    """
    joints = len(found.signs)
    fits = [found]
    if len(found.values) > 2 * joints:
        fits += _mirrored_fits(data, found, noise)
    signs = np.array([fit.signs * np.sign(fit.values[joints : 2 * joints]) for fit in fits])
    nearest = int(np.argmin((signs != begin.signs).sum(axis=1)))
    return fits[nearest], (signs != signs[nearest]).any(axis=0)


def _mirrored_fits(data: MeasuredPoints, found: Parameters, noise: float) -> Iterator[Parameters]:
    """Fits with other signs and another pose of the base that explain the measurements as well as the one found."""
    joints, loss = len(found.signs), _LINEAR * noise
    every, rows = np.ones(len(found.values), dtype=bool), np.ones(len(data.positions), dtype=bool)
    most = _cost(data.residuals(found), loss) + _AS_GOOD
    for flips in itertools.islice(itertools.product((1.0, -1.0), repeat=joints), 1, None):
        values = found.values.copy()
        values[:joints] *= flips
        values[2 * joints :] = 0.0
        trial = data.with_signs(replace(found, values=values), found.signs * np.array(flips))
        if float(np.median(np.linalg.norm(data.residuals(trial), axis=1))) > _WIDE * data.spread:
            continue
        fit = _fitted(data, trial, every, rows, loss, evaluations=_EVALUATIONS_OF_SIGNS)
        same_signs = (fit.values[joints : 2 * joints] > 0.0).all()
        if same_signs and _cost(data.residuals(fit), loss) <= most:
            yield fit


def _hold_undetermined(
    data: MeasuredPoints, begin: Parameters, found: Parameters, mirrored: NDArray[np.bool_], noise: float
) -> _Estimate:
    """Find undetermined parameters, and fix as few parameters at the start as make the others unique."""
    count, joints = len(begin.values), len(begin.signs)
    kept = np.ones(len(data.positions), dtype=bool)
    residuals, jacobian = data.with_jacobian(found)
    # In rad: units of the zero, and of the angle at the reading farthest from zero.
    units = np.ones(count)
    farthest = np.abs(data.turns).max(axis=0)
    units[joints : 2 * joints] = np.where(farthest > 0.0, farthest, 1.0)
    columns = jacobian.reshape(-1, count) / units
    least = max(_robust_std(residuals, count), _FLOOR * noise) / _UNDETERMINED
    free, undetermined = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    while free.any():
        _, sizes, directions = np.linalg.svd(columns[:, free], full_matrices=False)
        if sizes[-1] >= max(least, _RANK * sizes[0]):
            break
        parts = np.zeros(count)
        parts[free] = np.abs(directions[-1])
        undetermined |= parts > _SHARE * parts.max()
        # Prefer fixing a scale to a zero; the pose of a free base is not fixed.
        parts[joints : 2 * joints] *= 1.0 + _SHARE
        parts[2 * joints :] = 0.0
        free[int(np.argmax(parts))] = False
    if undetermined[: 2 * joints].all() or not free[: 2 * joints].any():
        raise InputError("these measurements determine no joint; move all joints between them")
    values = np.where(free, found.values, begin.values)
    values[2 * joints :] = 0.0
    placed = data.with_signs(replace(found, values=values), found.signs)  # with another pose of a free base
    held = _fitted(data, placed, free, kept, _LINEAR * noise)
    undetermined[:joints] |= mirrored  # zeros belong to a sign
    return _Estimate(held, free, undetermined, mirrored, kept)


def _robust_std(residuals: Array, unknowns: int) -> float:
    """Standard deviation of a coordinate from the median of residuals, which outliers hardly affect [m]."""
    fraction = max(1.0 - unknowns / residuals.size, 1.0 / residuals.size)
    return float(np.median(np.abs(residuals))) / _MEDIAN / math.sqrt(fraction)


def _without_outliers(data: MeasuredPoints, estimate: _Estimate, noise: float) -> _Estimate:
    """Remove measurements that are too far off, fit again, and repeat until the selection is stable."""
    unknowns = int(estimate.free.sum())
    for _ in range(_ROUNDS):
        residuals = data.residuals(estimate.parameters)
        std = max(_robust_std(residuals[estimate.kept], unknowns), _FLOOR * noise)
        kept = np.linalg.norm(residuals, axis=1) <= _OUTLIER * std
        if 3 * int(kept.sum()) <= unknowns:
            raise InputError(
                f"only {int(kept.sum())} of {len(kept)} measurements agree with each other; measure more poses"
            )
        parameters = _fitted(data, estimate.parameters, estimate.free, kept, None)
        done = np.array_equal(kept, estimate.kept)
        estimate = replace(estimate, parameters=parameters, kept=kept)
        if done:
            break
    return estimate


def _result(
    robot: Robot, start: Calibration, data: MeasuredPoints, estimate: _Estimate, noise: float, source: str
) -> Calibration:
    """The calibration, with standard deviations from the Jacobian at the solution and the noise of a coordinate [m]."""
    parameters, free, kept = estimate.parameters, estimate.free, estimate.kept
    residuals, jacobian = data.with_jacobian(parameters)
    columns = jacobian[kept][:, :, free].reshape(-1, int(free.sum()))
    std = np.full(len(free), math.inf)
    std[free] = noise * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    std[estimate.undetermined] = math.inf
    joints: dict[str, JointCalibration] = {}
    undetermined: dict[str, tuple[str, ...]] = {}
    nq = robot.nq
    for i, name in enumerate(robot.joint_names):
        factor, old = float(parameters.values[nq + i]), start.joints[name]
        if abs(factor) < _NO_EFFECT:
            raise InputError(
                f"the readings of joint {name!r} have no effect on the measured positions; check its encoder"
            )
        scale = old.scale / abs(factor)
        sign = int(parameters.signs[i] * math.copysign(1.0, factor))
        zero_std, scale_std = float(std[i]), float(scale * std[nq + i] / abs(factor))
        zero, unit = float(parameters.values[i]), robot.joint(name).unit
        joints[name] = JointCalibration(sign, zero, scale, zero_std, scale_std, unit)
        unknown = ("zero",) * math.isinf(zero_std) + ("scale",) * math.isinf(scale_std)
        unknown += ("sign",) * (math.isinf(scale_std) or bool(estimate.mirrored[i]))
        if unknown:
            undetermined[name] = unknown
    # Joints of fingers, which the robot does not plan for.
    joints |= {name: joint for name, joint in start.joints.items() if name not in joints}
    outliers = tuple(int(row) for row in np.flatnonzero(~kept))
    distances = np.linalg.norm(residuals, axis=1)
    fit = CalibrationFit(distances, outliers, noise, undetermined, data.base_pose(parameters))
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return Calibration(robot.name, joints, start.unit, today, source, fit)
