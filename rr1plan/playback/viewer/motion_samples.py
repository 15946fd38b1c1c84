"""Values along a motion that a page cannot compute: torques, clearances, tracking errors, positions of contacts.

The page computes positions and their derivatives itself from the polynomials of the motion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array
from rr1plan.playback.simulation.replay import Replay
from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from rr1plan.collision import CollisionChecker

_TORQUE_SAMPLES = 600
_MOST_NUMBERS = 60_000  # at most, of torques and of tracking errors
_CLEARANCE_SAMPLES = 120
_USUAL_WORK = 40_000  # distances between solids, about 0.1 s of processor time
_FEWEST_SAMPLES = 12  # of clearances: fewer do not make a curve
_FEW_ARMS = 4  # with more, clearances are sampled on demand only
_MOST_PLACES = 40  # contacts of a report whose positions are computed


def torque_samples(scene: Scene, trajectory: Trajectory, columns: ArrayLike) -> dict[str, object]:
    """Torques by inverse dynamics, as the referee computes them.

    Args:
        scene: The arms, and the objects that they hold.
        trajectory: The motion; its derivatives are exact.
        columns: Column of the page of each of its joints.

    Returns:
        Times [s], shape (n,), torques [Nm or N], shape (n, joints), the columns, and a remark on masses.
    """
    from rr1plan.model.forward_kinematics import Kinematics

    times, names = _torque_times(trajectory), trajectory.joint_names
    motion = [trajectory(times, k) for k in range(3)]
    torques = np.empty_like(motion[0])
    # Arm by arm: the torques of an arm do not depend on the others, and Pinocchio's data grow with the square of the
    # arms.
    for arm in trajectory.arms:
        own = [names.index(name) for name in scene.joint_names([arm])]
        held = {name: thing for name, thing in scene.attachments.items() if thing.arm == arm}
        torques[:, own] = Kinematics(Scene({arm: scene.arms[arm]}, attachments=held)).inverse_dynamics(
            *(values[:, own] for values in motion)
        )
    unknown = [name for name, thing in scene.attachments.items() if thing.mass is None and thing.arm in trajectory.arms]
    remarks = [f"without the mass of {', '.join(unknown)}"] if unknown else []
    if any(scene.arms[arm].robot.links_of_assumed_mass for arm in trajectory.arms):
        remarks.append("masses estimated from shapes")
    return {
        "times": pack_array(times, "f8"),
        "values": pack_array(torques),
        "columns": np.asarray(columns).tolist(),
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
    scene: Scene, trajectory: Trajectory, *, thorough: bool | None = None
) -> dict[str, object] | None:
    """Clearances along a motion and their nearest points, of each arm to its surroundings and among its own links.

    Args:
        scene: The arms and obstacles.
        trajectory: The motion.
        thorough: True: 120 samples whatever they cost; False: none; None: as many as take about 0.1 s, none for many
            arms.

    Returns:
        Times [s], shape (n,); for each moving arm the clearances beyond the padding [m], shape (n, arms, 2), first to
        obstacles and other arms, then among its links and held objects, infinite if no pair is near; the pair of each
        clearance, and its nearest points in world coordinates [m], shape (n, arms, 2, 6). None if nothing is sampled.
    """
    from rr1plan.collision import CollisionChecker

    arms = trajectory.arms
    if thorough is False or (thorough is None and len(scene.arms) > _FEW_ARMS):
        return None
    checker = CollisionChecker(scene, arms)
    work = len(checker.solid_pairs)
    count = _CLEARANCE_SAMPLES if thorough else min(_CLEARANCE_SAMPLES, _USUAL_WORK // max(1, work))
    if not work or count < _FEWEST_SAMPLES:
        return None
    members = _members(checker, arms)
    # The checker does not contain pairs that are always farther apart.
    reach = checker.geometry.least_gap - float(checker.solid_padding.max())
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
                if clearances[least] > reach:
                    continue
                values[i, k, own], pairs[i, k, own] = clearances[least], checker.solid_owner[least]
                points[i, k, own] = np.concatenate(checker.solid_points(q, least))
    used, pairs = np.unique(pairs, return_inverse=True)
    return {
        "times": pack_array(times, "f8"),
        "arms": list(arms),
        "values": pack_array(values),
        "names": [list(checker.pairs[pair]) for pair in used],
        "pairs": pack_array(pairs.reshape(values.shape), "u4"),
        "points": pack_array(points),
    }


def _members(checker: CollisionChecker, arms: tuple[str, ...]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """For each arm, its pairs of solids with other elements, and its own self pairs."""
    held = {name: attachment.arm for name, attachment in checker.scene.attachments.items()}
    sides = np.array([[held.get(name, name.split("/", 1)[0]) for name in pair] for pair in checker.pairs])
    one, two = sides[checker.solid_owner].T
    found = []
    for arm in arms:
        first, second = one == arm, two == arm
        found.append((np.flatnonzero(first ^ second), np.flatnonzero(first & second)))
    return found


def tracking_errors(replay: Replay, columns: ArrayLike) -> dict[str, object] | None:
    """Positions minus set-points of a replay [rad or m], thinned if there are very many instants.

    Args:
        replay: The replay.
        columns: Column of the page of each of its joints.

    Returns:
        Times [s], shape (n,), errors, shape (n, joints), and the columns; None for a kinematic replay, which has no
        errors.
    """
    if replay.mode != "dynamic":
        return None
    record = replay.record
    stride = max(1, -(-record.actual.size // _MOST_NUMBERS))
    kept = np.unique(np.append(np.arange(0, len(record.times), stride), len(record.times) - 1))
    return {
        "times": pack_array(record.times[kept], "f8"),
        "values": pack_array(record.actual[kept] - record.desired[kept]),
        "columns": np.asarray(columns).tolist(),
    }


def violation_places(scene: Scene, trajectory: Trajectory, report: Report) -> list[list[float] | None]:
    """World position of each violation of a report [m]: halfway between two bodies in contact; None for others."""
    touching = [v.kind == "collision" and v.time is not None for v in report.violations]
    places: list[list[float] | None] = [None] * len(touching)
    if not any(touching):
        return places
    for i in np.flatnonzero(touching)[:_MOST_PLACES].tolist():
        violation = report.violations[i]
        assert violation.time is not None, "of those that touch"
        places[i] = _contact_place(scene, trajectory, violation.time, violation.subject)
    return places


def _contact_place(scene: Scene, trajectory: Trajectory, time: float, pair: tuple[str, ...]) -> list[float] | None:
    """Position halfway between two elements in contact at a time [m]; None if they are not in contact in this scene."""
    from rr1plan.collision import CollisionChecker

    held = {name: attachment.arm for name, attachment in scene.attachments.items()}
    owners = {held.get(name, name.split("/", 1)[0]) for name in pair}
    arms = [arm for arm in trajectory.arms if arm in owners]
    # Without the other arms: tables for a hundred would take longer than the rest of the page.
    for arm in set(scene.arms) - owners:
        scene = scene.without_arm(arm)
    order = [trajectory.joint_names.index(name) for name in scene.joint_names(arms)]
    contacts = CollisionChecker(scene, arms).contacts(trajectory(time)[order])
    return next((c.point.tolist() for c in contacts if {c.a, c.b} == set(pair)), None)
