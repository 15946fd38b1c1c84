"""Second opinions: samples of a motion checked by python-fcl, Coal and MuJoCo, with separate kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, check_callback, counted, items_of, known_name, millimeters, of_kind, positive_number
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.progress import ProgressCallback, fraction_callback
from rr1plan.scene import Scene
from rr1plan.sequences.sequence_plan import SequencePlan
from rr1plan.testing.collision_checkers import ElementChecker, ElementPair, MujocoChecker
from rr1plan.trajectory import Trajectory

CheckerName = Literal["FCL", "Coal", "MuJoCo"]
CHECKERS: tuple[CheckerName, ...] = ("FCL", "Coal", "MuJoCo")
_Key = TypeVar("_Key")


@dataclass(frozen=True)
class SampledContact:
    """Two elements that a checker finds in contact.

    Args:
        checker: "FCL", "Coal" or "MuJoCo".
        pair: The two elements, e.g. ("arm/hand", "shelf").
        first: The first sample in contact [s].
        last: The last sample in contact [s].
        samples: Number of samples in contact.
    """

    checker: str
    pair: ElementPair
    first: float
    last: float
    samples: int


@dataclass(frozen=True)
class Disagreement:
    """Two elements that some checkers find in contact and others do not.

    Args:
        pair: The two elements.
        time: The first sample at which they disagree [s].
        touching: The checkers that find a contact there.
        free: Those that find none.
        distance: Signed distance there by Coal, or MuJoCo's depth if that is larger [m].
        samples: Number of samples at which they disagree in this way.
    """

    pair: ElementPair
    time: float
    touching: tuple[str, ...]
    free: tuple[str, ...]
    distance: float
    samples: int

    def __str__(self) -> str:
        says = f"{' and '.join(self.touching)}: contact, {' and '.join(self.free)}: none"
        where = f"{' and '.join(self.pair)} at {self.time:.5f} s ({millimeters(self.distance)})"
        return f"{where}: {says}; {counted(self.samples, 'sample')}"


@dataclass(frozen=True)
class SecondOpinion:
    """Verdicts of other checkers on a motion; true if all of them find it free of contacts.

    Args:
        checkers: The checkers.
        samples: Number of samples.
        queries: Number of pairs of bodies with intersecting boxes, over all samples, which FCL and Coal checked.
        contacts: Contacts that a checker finds, in order of time.
        disagreements: Contacts that some find and others do not, in order of time.
        grazing: Number of pairs at samples with different verdicts within the tolerance of contact.
    """

    checkers: tuple[str, ...]
    samples: int
    queries: int
    contacts: tuple[SampledContact, ...] = ()
    disagreements: tuple[Disagreement, ...] = ()
    grazing: int = 0

    @property
    def free(self) -> bool:
        """Whether no checker finds a contact."""
        return not self.contacts

    @property
    def agree(self) -> bool:
        """Whether the checkers agree at all samples, except within the tolerance of contact."""
        return not self.disagreements

    def __bool__(self) -> bool:
        """The same as `free`."""
        return self.free

    def first_contact(self, checker: str) -> SampledContact | None:
        """The first contact that one of the checkers finds; None if there is none.

        Raises:
            UnknownNameError: another checker.
        """
        known_name("checker", checker, self.checkers)
        return next((contact for contact in self.contacts if contact.checker == checker), None)

    def __str__(self) -> str:
        verdict = "free of contacts" if self.free else counted(len(self.contacts), "contact")
        agree = "they agree" if self.agree else counted(len(self.disagreements), "disagreement")
        lines = [f"{', '.join(self.checkers)} at {counted(self.samples, 'sample')}: {verdict}, {agree}"]
        says: dict[tuple[ElementPair, float, float], list[str]] = {}
        for c in self.contacts:
            says.setdefault((c.pair, c.first, c.last), []).append(c.checker)
        lines += [
            f"  contact       {' and '.join(pair)} from {first:.5f} s to {last:.5f} s: {', '.join(names)}"
            for (pair, first, last), names in says.items()
        ]
        lines += [f"  disagreement  {difference}" for difference in self.disagreements]
        if self.grazing:
            lines.append(f"  grazing       {self.grazing} contacts judged differently within the tolerance")
        return "\n".join(lines)


def second_opinion(
    motion: Trajectory | Path,
    scene: Scene,
    step: float = 0.001,
    *,
    checkers: Sequence[CheckerName] = CHECKERS,
    tolerance: float = 1e-4,
    progress: ProgressCallback | None = None,
) -> SecondOpinion:
    """Check samples of a motion with python-fcl, Coal and MuJoCo, without the planner's and the referee's code.

    FCL and Coal check the shapes of the description at frames computed by plain NumPy, MuJoCo its own model with its
    own kinematics. All check for contact only, ignoring the paddings of the scene. Between samples nothing is proven:
    that is the referee's task (`validate`).

    Args:
        motion: The motion; arms without columns rest at their configurations in the scene. The "times" of a path are
            indices of its waypoints. In a sequence the scene changes, so that each stage is a motion (see
            `SequencePlan.scenes`).
        scene: The scene of the motion.
        step: No point of a robot moves farther than this between two samples [m].
        checkers: The checkers, of "FCL", "Coal" and "MuJoCo".
        tolerance: Contacts and distances smaller than this count as grazing, not as disagreements [m]: MuJoCo has
            plates 20 µm thick for triangles, and each checker has other tolerances.
        progress: Called about a hundred times; False cancels.

    Raises:
        UnknownNameError: a joint that the scene does not have, or another checker.
        InputError: an arm with only some of its joints, a motion that jumps, a step that needs too many samples, a
            shape that a checker does not support.
        MissingPackageError: python-fcl is not installed.
        BackendError: MuJoCo does not accept the scene.
        CancelledError: `progress` returned False.
    """
    if isinstance(motion, SequencePlan):
        raise InputError(
            "the scene of a sequence changes during its motion; check each stage that moves, whose stage.change is "
            "None: plan.trajectory.cut(stage.begin, stage.end) in its scene of plan.scenes()"
        )
    if not isinstance(motion, Path):
        of_kind("motion", motion, Trajectory)
    of_kind("scene", scene, Scene)
    step, tolerance = positive_number("step", step), positive_number("tolerance", tolerance)
    names = items_of("checkers", checkers, "names")
    for name in names:
        known_name("checker", name, CHECKERS)
    if not names:
        raise InputError("checkers is empty, expected at least one")
    check_callback("progress", progress)
    report = fraction_callback("second opinion", progress)
    if isinstance(motion, Path):
        motion = Trajectory.from_samples(motion.joint_names, np.arange(float(len(motion))), motion.waypoints)
    comparison = _Comparison(scene, motion, tuple(n for n in CHECKERS if n in names), tolerance)
    bodies = comparison.bodies
    times = bodies.sample_times(motion, step)
    pairs = bodies.reachable_pairs(motion, times)
    done, shares = 0, [part for whole in bodies.parts(times) for part in np.array_split(whole, -(-len(whole) // 200))]
    for part in shares:
        comparison.add(part, pairs)
        done += len(part)
        if report is not None:
            report(done / len(times))
    return comparison.opinion(len(times))


@dataclass
class _Seen:
    """Samples with one verdict: times of the first and the last [s], their number, signed distance at the first [m]."""

    first: float
    last: float
    samples: int
    distance: float


class _Comparison:
    """Verdicts of the checkers at the samples seen so far.

    Args:
        scene: The scene.
        motion: The motion.
        names: The checkers.
        tolerance: Contacts and distances smaller than this are grazing [m].
    """

    def __init__(self, scene: Scene, motion: Trajectory, names: tuple[CheckerName, ...], tolerance: float) -> None:
        self._motion, self._names, self._tolerance = motion, names, tolerance
        self._libraries = ElementChecker(scene, motion.joint_names, names)
        self._mujoco = MujocoChecker(scene, motion) if "MuJoCo" in names else None
        self._contacts: dict[tuple[str, ElementPair], _Seen] = {}
        self._differences: dict[tuple[ElementPair, tuple[str, ...]], _Seen] = {}
        self._grazing = 0
        self.bodies = self._libraries.bodies

    def add(self, times: Array, pairs: NDArray[np.int64]) -> None:
        """Check some samples of the motion for contacts of some pairs of bodies."""
        q = self._motion(times)
        for n, touching in enumerate(self._libraries.contacts(q, pairs)):
            deepest = {} if self._mujoco is None else self._mujoco.contacts(float(times[n]))
            for pair in deepest:
                touching.setdefault(pair, set()).add("MuJoCo")
            for pair, names in touching.items():
                for name in (name for name in self._names if name in names):
                    _extend(self._contacts, (name, pair), float(times[n]), 0.0)
                if len(names) < len(self._names):
                    self._disagree(float(times[n]), pair, names, deepest.get(pair, 0.0))

    def _disagree(self, time: float, pair: ElementPair, names: set[str], depth: float) -> None:
        """Record a pair of elements that only some checkers find in contact."""
        by_coal = self._libraries.distance(self._motion(time), pair)
        distance = -depth if depth > abs(by_coal) else by_coal
        if abs(distance) <= self._tolerance:
            self._grazing += 1
        else:
            yes = tuple(name for name in self._names if name in names)
            _extend(self._differences, (pair, yes), time, distance)

    def opinion(self, samples: int) -> SecondOpinion:
        """The result for a number of samples."""
        contacts = [
            SampledContact(name, pair, s.first, s.last, s.samples) for (name, pair), s in self._contacts.items()
        ]
        differences = [
            Disagreement(pair, s.first, yes, tuple(n for n in self._names if n not in yes), s.distance, s.samples)
            for (pair, yes), s in self._differences.items()
        ]
        return SecondOpinion(
            self._names,
            samples,
            self._libraries.queries,
            tuple(sorted(contacts, key=lambda contact: contact.first)),
            tuple(sorted(differences, key=lambda difference: difference.time)),
            self._grazing,
        )


def _extend(table: dict[_Key, _Seen], key: _Key, time: float, distance: float) -> None:
    if key in table:
        table[key].last, table[key].samples = time, table[key].samples + 1
    else:
        table[key] = _Seen(time, time, 1, distance)
