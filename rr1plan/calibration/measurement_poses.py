"""Poses in which to measure for a calibration: I-optimal among random free configurations.

An I-optimal design minimizes the variance of predictions, here that of joint positions, summed over joints and averaged
over their ranges. The largest standard deviations are those of the joints with the shortest levers, and smaller than in
a D-optimal design, which weighs all parameters alike, by a tenth for zeros and a quarter for positions.

Sources: Fedorov, Theory of Optimal Experiments, 1972 (exchange algorithm); Atkinson, Donev & Tobias, Optimum
Experimental Designs, 2007 (criteria); Borm & Menq, Determination of Optimal Measurement Configurations for Robot
Calibration, IJRR 1991; Daney et al., Choosing Measurement Poses for Robot Calibration, IJRR 2005.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.calibration.measured_points import point_jacobians
from rr1plan.checks import Array, Seed, as_generator, finite_array, of_kind, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.model import Kinematics
from rr1plan.robot import Robot
from rr1plan.robot.contact_bands import sampling_bounds
from rr1plan.scene import Scene

_CANDIDATES = 1000
_DRAWS_EACH = 50
_ROUNDS = 5
# Configurations from which the pair is found that is in contact most often.
_CONTACT_SAMPLES = 100
# Prior information that keeps determinants positive: a standard deviation of 1 rad, compared with 1 mm of noise.
_PRIOR = 1e-6


def propose_calibration_poses(
    scene: Scene,
    count: int = 20,
    *,
    arm: str | None = None,
    point: ArrayLike = (0.0, 0.0, 0.0),
    rng: Seed = None,
) -> Array:
    """Poses that determine the zeros and scales of an arm's joints well: I-optimal among random free configurations.

    Move between them with planned motions: the poses are free of collision, but straight lines between them may not be.
    An arm whose zeros are unknown deviates from them: pad the scene by how far it may be off (`Scene.with_padding`).
    `expected_calibration` computes the standard deviations that they allow; no poses allow less for the last joint than
    noise / (lever * sqrt(count)): 0.13 degrees for 20 poses, 1 mm of noise and a lever of 0.1 m.

    Args:
        scene: The arm and its surroundings.
        count: Number of poses.
        arm: The arm (default: the only one).
        point: The point that will be measured, in the frame of the tool [m], shape (3,).
        rng: Generator or seed.

    Returns:
        Configurations [rad or m], each followed by a near one, shape (count, nq).

    Raises:
        InputError: a wrong count or point, several arms and no name, or no free configurations found.
        UnknownNameError: no such arm.
    """
    of_kind("scene", scene, Scene)
    arm = scene.only_arm(arm)
    whole_number("count", count, 1, _CANDIDATES)
    offset, generator = finite_array("point", point, (3,)), as_generator(rng)
    checker, robot = CollisionChecker(scene, [arm]), scene.arms[arm].robot
    candidates = _free_configurations(checker, robot, generator)
    if len(candidates) < count:
        often = _most_frequent_contact(checker, robot, generator)
        raise InputError(
            f"found {len(candidates)} free configurations of {arm!r}, fewer than {count}; clear the scene: most often "
            f"{often} touch or are nearer than their padding"
        )
    kinematics = Kinematics(scene).for_arm(arm)
    lower, upper = sampling_bounds(robot)
    turns = (candidates - 0.5 * (lower + upper)) / np.maximum(upper - lower, 1e-9)
    jacobians = point_jacobians(kinematics, candidates, np.broadcast_to(offset, (len(candidates), 3)))[1]
    chosen = _optimal(np.concatenate([jacobians, jacobians * turns[:, None, :]], axis=2), count)
    return _in_short_order(candidates[chosen], scene.arms[arm].q)


def _free_configurations(checker: CollisionChecker, robot: Robot, rng: np.random.Generator) -> Array:
    """Random free configurations of the moving arm of a checker, shape (n, nq)."""
    lower, upper = sampling_bounds(robot)
    found: list[Array] = []
    for _ in range(_CANDIDATES * _DRAWS_EACH):
        q = rng.uniform(lower, upper)
        if checker.is_free(q):
            found.append(q)
            if len(found) == _CANDIDATES:
                break
    return np.array(found).reshape(-1, len(lower))


def _most_frequent_contact(checker: CollisionChecker, robot: Robot, rng: np.random.Generator) -> str:
    """The two elements in contact in most random configurations of the moving arm of a checker."""
    samples = rng.uniform(*sampling_bounds(robot), (_CONTACT_SAMPLES, robot.nq))
    pairs = Counter(f"{contact.a!r} and {contact.b!r}" for q in samples for contact in checker.contacts(q))
    return max(pairs, key=lambda pair: pairs[pair], default="its links")


def _optimal(rows: Array, count: int) -> list[int]:
    """Indices of candidates with a small variance of the joint positions: greedy choice, then exchanges.

    Args:
        rows: Derivatives of the measurement of each candidate by the zeros in the middle of the ranges and by the
            widths of the ranges, shape (n, 3, 2 nq).
        count: Number of candidates to choose.
    """
    information = rows.transpose(0, 2, 1) @ rows
    total = _PRIOR * np.eye(rows.shape[2])
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(_best(rows, total, chosen))
        total = total + information[chosen[-1]]
    for _ in range(_ROUNDS):
        before = list(chosen)
        for i in range(count):
            total = total - information[chosen[i]]
            chosen[i] = _best(rows, total, chosen[:i] + chosen[i + 1 :])
            total = total + information[chosen[i]]
        if chosen == before:
            break
    return chosen


def _best(rows: Array, total: Array, taken: list[int]) -> int:
    """The candidate that decreases the variance of joint positions, averaged over their ranges, most."""
    covariance = np.linalg.inv(total)
    gains = rows @ covariance
    innovation = np.linalg.inv(np.eye(3) + gains @ rows.transpose(0, 2, 1))
    decrease = np.einsum("nap,nab,nbp->np", gains, innovation, gains)
    joints = rows.shape[2] // 2
    # Positions are uniformly distributed over a range of width 1, whose variance is 1/12.
    total_decrease = (decrease[:, :joints] + decrease[:, joints:] / 12.0).sum(axis=1)
    total_decrease[taken] = -np.inf
    return int(np.argmax(total_decrease))


def _in_short_order(configurations: Array, start: Array) -> Array:
    """The same rows in greedy nearest-neighbor order, beginning near a configuration."""
    left, ordered, now = list(configurations), [], start
    while left:
        i = int(np.argmin([np.abs(q - now).max() for q in left]))
        now = left.pop(i)
        ordered.append(now)
    return np.array(ordered)
