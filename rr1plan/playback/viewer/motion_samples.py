"""Values along a motion that a page cannot compute itself: torques, clearances, tracking errors, places of contacts.

Positions and their derivatives are not among them: the page has the motion's own polynomials.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array
from rr1plan.playback.simulation.replay import Replay
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from rr1plan.collision import CollisionChecker

Pack = Callable[..., dict[str, Any]]

_TORQUE_SAMPLES = 600
_MOST_NUMBERS = 60_000  # sent of torques, and of tracking errors
_CLEARANCE_SAMPLES = 120
_USUAL_WORK = 40_000  # distances between solids, about 0.1 s of processor time
_FEWEST_SAMPLES = 12  # of clearances: fewer are no curve
_MOST_PLACES = 40  # contacts of a report whose places are computed


def torque_samples(scene: Scene, trajectory: Trajectory, columns: ArrayLike, pack: Pack) -> dict[str, Any]:
    """Torques by inverse dynamics, as the referee computes them.

    Args:
        scene: The arms; objects that they hold have no mass here.
        trajectory: The motion; its derivatives are exact.
        columns: Column of the page of each of its joints.
        pack: Turns an array into what JSON can hold.

    Returns:
        Times [s], shape (n,), torques [Nm or N], shape (n, joints), the columns, and a remark on
        masses.
    """
    from rr1plan.model.forward_kinematics import Kinematics

    arms, names = trajectory.arms, trajectory.joint_names
    kinematics = Kinematics(scene, arms)
    order = [names.index(name) for name in scene.joint_names(arms)]
    times = _torque_times(trajectory)
    torques = kinematics.inverse_dynamics(*(trajectory(times, k)[:, order] for k in range(3)))
    remarks = ["without the mass of held objects"] if scene.attachments else []
    if any(scene.arms[arm].robot.links_of_assumed_mass for arm in arms):
        remarks.append("masses estimated from shapes")
    return {
        "times": pack(times, "f8"),
        "values": pack(torques),
        "columns": np.asarray(columns)[order].tolist(),
        "remark": ", ".join(remarks),
    }


def _torque_times(trajectory: Trajectory) -> Array:
    """Evenly spaced instants, and both sides of each break, where torques may jump."""
    most = int(np.clip(_MOST_NUMBERS // max(1, len(trajectory.joint_names)), 30, _TORQUE_SAMPLES))
    times = np.linspace(trajectory.start_time, trajectory.end_time, most)
    inner = trajectory.breaks[1:-1]
    if 2 * len(inner) <= most:
        times = np.concatenate([times, inner, np.nextafter(inner, -np.inf)])
    return np.unique(times)


def clearance_samples(
    scene: Scene, trajectory: Trajectory, pack: Pack, *, thorough: bool | None = None
) -> dict[str, Any] | None:
    """Clearances along a motion and their nearest points, of each arm to what surrounds it and among its own links.

    Args:
        scene: The arms and obstacles.
        trajectory: The motion.
        pack: Turns an array into what JSON can hold.
        thorough: 120 samples whatever they cost, or none; None: as many as take about 0.1 s, or none.

    Returns:
        Times [s], shape (n,); for each arm that moves clearances beyond the padding [m], shape (n, arms, 2), to
        obstacles and other arms first, then among its links and what it holds, infinite where there is no such pair;
        the pair of each, and its nearest points in the world [m], shape (n, arms, 2, 6). None where nothing is sampled.
    """
    from rr1plan.collision import CollisionChecker

    if thorough is False:
        return None
    arms = trajectory.arms
    checker = CollisionChecker(scene, arms)
    work = len(checker.solid_pairs)
    count = _CLEARANCE_SAMPLES if thorough else min(_CLEARANCE_SAMPLES, _USUAL_WORK // max(1, work))
    if not work or count < _FEWEST_SAMPLES:
        return None
    members = _members(checker, arms)
    order = [trajectory.joint_names.index(name) for name in checker.joint_names]
    times = np.linspace(trajectory.start_time, trajectory.end_time, count)
    values = np.full((count, len(arms), 2), np.inf)
    pairs = np.zeros((count, len(arms), 2), dtype=np.int64)
    points = np.zeros((count, len(arms), 2, 6))
    for i, q in enumerate(trajectory(times)[:, order]):
        clearances = checker.solid_distances(q) - checker.solid_padding
        for k, kinds in enumerate(members):
            for own, among in enumerate(kinds):
                if not len(among):
                    continue
                least = int(among[np.argmin(clearances[among])])
                values[i, k, own], pairs[i, k, own] = clearances[least], checker.solid_owner[least]
                points[i, k, own] = np.concatenate(checker.solid_points(q, least))
    used, pairs = np.unique(pairs, return_inverse=True)
    return {
        "times": pack(times, "f8"),
        "arms": list(arms),
        "values": pack(values),
        "names": [list(checker.pairs[pair]) for pair in used],
        "pairs": pack(pairs.reshape(values.shape), "u4"),
        "points": pack(points),
    }


def _members(checker: CollisionChecker, arms: tuple[str, ...]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Of each arm the pairs of solids it is in with something else, and those within it."""
    held = {name: attachment.arm for name, attachment in checker.scene.attachments.items()}
    sides = np.array([[held.get(name, name.split("/", 1)[0]) for name in pair] for pair in checker.pairs])
    one, two = sides[checker.solid_owner].T
    found = []
    for arm in arms:
        first, second = one == arm, two == arm
        found.append((np.flatnonzero(first ^ second), np.flatnonzero(first & second)))
    return found


def tracking_errors(replay: Replay, columns: ArrayLike, pack: Pack) -> dict[str, Any] | None:
    """Positions less set-points of a replay [rad or m], at some of its instants where there are very many.

    Args:
        replay: The replay.
        columns: Column of the page of each of its joints.
        pack: Turns an array into what JSON can hold.

    Returns:
        Times [s], shape (n,), errors, shape (n, joints), and the columns; None of a kinematic replay, which has none.
    """
    if replay.mode != "dynamic":
        return None
    record = replay.record
    stride = max(1, -(-record.actual.size // _MOST_NUMBERS))
    kept = np.unique(np.append(np.arange(0, len(record.times), stride), len(record.times) - 1))
    return {
        "times": pack(record.times[kept], "f8"),
        "values": pack(record.actual[kept] - record.desired[kept]),
        "columns": np.asarray(columns).tolist(),
    }


def violation_places(scene: Scene, trajectory: Trajectory, report: Report) -> list[list[float] | None]:
    """Where each violation of a report is in the world [m]: halfway between two bodies that touch; None elsewhere."""
    touching = [v.kind == "collision" and v.time is not None for v in report.violations]
    places: list[list[float] | None] = [None] * len(touching)
    if not any(touching):
        return places
    from rr1plan.collision import CollisionChecker

    checker = CollisionChecker(scene, trajectory.arms)
    order = [trajectory.joint_names.index(name) for name in checker.joint_names]
    for i in np.flatnonzero(touching)[:_MOST_PLACES].tolist():
        violation = report.violations[i]
        assert violation.time is not None, "of those that touch"
        contacts = checker.contacts(trajectory(violation.time)[order])
        places[i] = next((c.point.tolist() for c in contacts if {c.a, c.b} == set(violation.subject)), None)
    return places
