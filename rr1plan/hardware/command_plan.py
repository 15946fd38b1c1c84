"""Plans of commands for the control box: the motion that the box will execute, certified before sending."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rr1plan.calibration.joint_calibration import Calibration
from rr1plan.checks import Array, Value, counted, known_name, of_kind, positive_number, read_only
from rr1plan.errors import InputError
from rr1plan.hardware.box_emulator import BoxEmulator
from rr1plan.hardware.control_box import ControlBox, StepScale
from rr1plan.hardware.control_box_frames import CHANNELS, MOST_STEPS_SAFELY, BoxCommand, Safety
from rr1plan.hardware.motion_law import SpeedProfile
from rr1plan.motion_plan import MotionPlan
from rr1plan.path import Path
from rr1plan.report import Report
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.scene.joint_units import joint_units
from rr1plan.trajectory import Trajectory, of_joints
from rr1plan.validation import certify_path, validate

# Samples of a motion from which its segments are computed, and of each of its pieces, however short, at least.
_SAMPLES, _PIECE_SAMPLES = 4000, 10
# Pieces of a ramp in the trajectory.
_RAMP_PIECES = 12
# Knots closer than this are merged [ticks].
_LEAST_PIECE = 1e-3
# How often the tolerance is halved if the arm would collide.
_MOST_HALVINGS = 4
# More commands than this would take hours.
_MOST_COMMANDS = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class CommandPlan(Value):
    """A motion as commands of the control box, and the resulting motion of the arm.

    Args:
        arm: The arm.
        commands: The commands, each from rest to rest.
        ticks: Duration of each command with the rest after it [ticks], shape (n,).
        start: Required step counters of the seven channels at the beginning, including those of locked joints.
        trajectory: The motion by the firmware's motion law, with its sine ramps.
        path: Configurations after every single step of every motor, from the emulated firmware.
        report: The referee's report on the trajectory: collisions, limits.
        path_report: The referee's report on the path: collisions, position limits.
        deviation: Largest distance of any joint in the trajectory from its emulated steps [rad or m], shape (nq,).
        box: The control box.
        robot: The arm's robot.
        unchecked: Values of locked joints that no channel drives [rad or m], by name: the certificate assumes them,
            and sending cannot check them.
    """

    arm: str
    commands: tuple[BoxCommand, ...]
    ticks: Array
    start: tuple[int, ...]
    trajectory: Trajectory
    path: Path
    report: Report
    path_report: Report
    deviation: Array
    box: ControlBox
    robot: Robot
    unchecked: Mapping[str, float]

    def __post_init__(self) -> None:
        for name in ("ticks", "deviation"):
            read_only(getattr(self, name))
        object.__setattr__(self, "unchecked", MappingProxyType(dict(self.unchecked)))

    @property
    def certified(self) -> bool:
        """Whether the referee certifies both the trajectory and the steps."""
        return self.report.certified and self.path_report.certified

    def __bool__(self) -> bool:
        """The same as `certified`."""
        return self.certified

    @property
    def problems(self) -> tuple[str, ...]:
        """The violations found by the referee, in words."""
        found = [*self.report.violations, *self.path_report.violations]
        return tuple(dict.fromkeys(f"{violation.kind}: {violation.message}" for violation in found))

    def __repr__(self) -> str:
        verdict = "certified" if self.certified else "not certified"
        return f"CommandPlan({self.arm!r}, {counted(len(self.commands), 'command')}, {verdict})"

    def __str__(self) -> str:
        seconds = float(self.ticks.sum()) * self.box.tick
        lines = [f"{counted(len(self.commands), 'command')} for {self.arm}, {seconds:.1f} s of motion"]
        lines.append("  command  " + "".join(f"{channel:>7}" for channel in CHANNELS) + "      time")
        for number, (command, ticks) in enumerate(zip(self.commands, self.ticks, strict=True), 1):
            row = "".join(f"{steps:7d}" for steps in command.steps)
            lines.append(f"  {number:7d}  {row}  {ticks * self.box.tick:6.2f} s")
        lines.append(f"  steps deviate from the sine ramps by {' and '.join(self._deviations())}")
        lines += [
            f"  {name} is assumed at {value:g} {self.robot.joint(name).unit}: no channel drives it, so that it is not "
            "checked"
            for name, value in self.unchecked.items()
        ]
        if not self.certified:
            verdict = "NOT CERTIFIED"
        elif self.report.unchecked_links:
            verdict = f"steps and ramps: {self.report.verdict}"
        else:
            verdict = "certified free of collision, steps and ramps"
        return "\n".join([*lines, f"  {verdict}", *(f"  {problem}" for problem in self.problems)])

    def _deviations(self) -> Iterator[str]:
        """The largest deviation of the turning joints and that of the sliding ones, with their joints."""
        joints = [self.robot.joint(name) for name in self.robot.joint_names]
        for unit, factor, called in (("rad", math.degrees(1.0), "degrees"), ("m", 1000.0, "mm")):
            columns = [j for j, joint in enumerate(joints) if joint.unit == unit]
            if columns:
                most = max(columns, key=lambda j: self.deviation[j])
                yield f"{factor * self.deviation[most]:.3f} {called} at most ({self.trajectory.joint_names[most]})"


def plan_commands(
    motion: MotionPlan | Trajectory,
    calibration: Calibration,
    box: ControlBox,
    *,
    scene: Scene | None = None,
    tolerance: float = 0.01,
    safety: Safety = "high",
) -> CommandPlan:
    """Convert a motion of one arm to commands of its control box, and certify the executed motion.

    The box supports neither times nor paths: a command moves all joints by relative steps from rest to rest, each with
    its own sine ramps, stretched to the slowest joint. The motion therefore becomes straight segments in joint space,
    one command each; an emulation of the firmware computes every step of every motor, and the referee checks them.

    Args:
        motion: The motion; only one arm moves.
        calibration: The arm's calibration in steps.
        box: The arm's control box.
        scene: The scene (default: that of the `MotionPlan`).
        tolerance: Largest distance of the segments from the motion [rad or m]; larger values give fewer commands. It is
            halved, up to four times, if the arm would collide.
        safety: "high": segments are split into commands of at most 1024 steps for each joint, because the box ignores
            more at this level; "low": they are not.

    Returns:
        The plan; it is true if it is certified, and `send_commands` sends certified plans only.

    Raises:
        InputError: no scene, several arms that move, a joint without channel, a channel without measured calibration
            (of a locked joint, too), a step larger than the tolerance, too many commands.
        UnknownNameError: another safety level.
    """
    of_kind("calibration", calibration, Calibration)
    of_kind("box", box, ControlBox)
    of_kind("scene", scene, Scene, optional=True)
    known_name("safety level", safety, ("high", "low"))
    tolerance = positive_number("tolerance", tolerance)
    if not isinstance(motion, MotionPlan | Trajectory):
        raise InputError(f"motion is of type {type(motion).__name__}, expected MotionPlan or Trajectory")
    if isinstance(motion, MotionPlan) and scene is None:
        scene = motion.scene
    if scene is None:
        raise InputError("a trajectory does not hold its scene; give the scene too (option scene)")
    arm, scene, moved = _only_moving_arm(motion if isinstance(motion, Trajectory) else motion.trajectory, scene)
    scale = StepScale(scene.arms[arm].robot, calibration, box)
    _check_step_sizes(scale, scene, arm, tolerance)
    q = moved(_sample_times(moved))
    for halvings in range(_MOST_HALVINGS + 1):
        corners = scale.counters(q[_segment_corners(q, tolerance * 0.5**halvings)])
        commands = tuple(_commands(corners, scale.joints, safety))
        if len(commands) > _MOST_COMMANDS:
            raise InputError(
                f"the motion takes {len(commands)} commands, more than {_MOST_COMMANDS}; raise the tolerance"
            )
        plan = _command_plan(commands, corners[0], arm, scene, scale, box)
        if not any(v.kind in ("collision", "undecided") for v in plan.report.violations + plan.path_report.violations):
            break
    return plan


def _check_step_sizes(scale: StepScale, scene: Scene, arm: str, tolerance: float) -> None:
    """Reject steps too large for the motion, which would be rounded away."""
    names = scene.joint_names([arm])
    sizes = np.abs(scale.positions(np.ones((1, len(names)))) - scale.positions(np.zeros((1, len(names)))))[0]
    largest = int(np.argmax(sizes))
    if sizes[largest] > tolerance:
        (unit,) = joint_units([names[largest]], scene)
        raise InputError(
            f"a step of {names[largest]!r} is {sizes[largest]:.3g} {unit}, more than the tolerance {tolerance:g}: "
            f"check the scale of its calibration, in steps per {unit}, or raise the tolerance"
        )


def _command_plan(
    commands: tuple[BoxCommand, ...], start: Array, arm: str, scene: Scene, scale: StepScale, box: ControlBox
) -> CommandPlan:
    """The motion of the arm under the commands, from step counters (nq,) on, and the referee's verdict."""
    names = scene.joint_names([arm])
    motions = _emulate(commands, start, scale, box)
    trajectory = _law_trajectory(motions, start, names, scale, box.tick)
    path = Path(names, scale.positions(np.concatenate([start[None], *(m.counters for m in motions)])))
    ticks = np.array([motion.duration for motion in motions])
    begins = np.cumsum(ticks) - ticks
    times = np.concatenate([np.zeros(1), *(since + m.times for since, m in zip(begins, motions, strict=True))])
    still = scene.with_configuration(arm, path.waypoints[0])
    counters = scale.locked | dict(zip(scale.joints, start.astype(int).tolist(), strict=True))
    return CommandPlan(
        arm,
        commands,
        ticks,
        tuple(counters.get(name, 0) for name in CHANNELS),
        trajectory,
        path,
        validate(trajectory, still),
        certify_path(path, still),
        np.abs(trajectory(times * box.tick) - path.waypoints).max(axis=0),
        box,
        scene.arms[arm].robot,
        scale.unchecked,
    )


def _only_moving_arm(trajectory: Trajectory, scene: Scene) -> tuple[str, Scene, Trajectory]:
    """The moving arm, the scene with the others at their configurations in the trajectory, and the arm's motion."""
    if not trajectory.arms:
        raise InputError("the trajectory has no joints, expected those of an arm")
    by_arm = {arm: _joints_in_order(trajectory, scene, arm) for arm in trajectory.arms}
    moving = [arm for arm, own in by_arm.items() if np.abs(own.coefficients[:, 1:]).max(initial=0.0) > 0.0]
    if len(moving) > 1:
        raise InputError(f"{' and '.join(moving)} move; a control box drives one arm, export them one by one")
    arm = moving[0] if moving else trajectory.arms[0]
    for name, own in by_arm.items():
        scene = scene.with_configuration(name, own(own.start_time))
    return arm, scene, by_arm[arm]


def _joints_in_order(trajectory: Trajectory, scene: Scene, arm: str) -> Trajectory:
    scene.arm(arm)
    names, own = scene.joint_names([arm]), trajectory.select(arm)
    if set(names) != set(own.joint_names):
        raise InputError(f"the trajectory does not have all joints of {arm!r}: {', '.join(names)}")
    return of_joints(own, names)


def _sample_times(trajectory: Trajectory) -> Array:
    """The same number of times in each piece, and the end [s]: a long pause does not thin out the samples elsewhere."""
    breaks = trajectory.breaks
    count = max(_PIECE_SAMPLES, math.ceil(_SAMPLES / len(breaks)))
    within = np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, count, endpoint=False)
    return np.append((breaks[:-1, None] + within).ravel(), trajectory.end_time)


def _segment_corners(q: Array, tolerance: float) -> list[int]:
    """Indices of samples (n, nq) that straight lines may connect within a tolerance of all (Douglas, Peucker 1973).

    Samples along a line may not go back by more than the tolerance: otherwise a motion to and fro would be lost.
    """
    kept, open_parts = {0, len(q) - 1}, [(0, len(q) - 1)]
    while open_parts:
        a, b = open_parts.pop()
        if b - a < 2:
            continue
        chord = q[b] - q[a]
        length = float(chord @ chord)
        share = np.clip((q[a + 1 : b] - q[a]) @ chord / length, 0.0, 1.0) if length > 0.0 else np.zeros(b - a - 1)
        off = np.abs(q[a + 1 : b] - q[a] - share[:, None] * chord).max(axis=1)
        back = (np.maximum.accumulate(share) - share) * np.abs(chord).max()
        off = np.maximum(off, back)
        if off.max() > tolerance:
            middle = a + 1 + int(off.argmax())
            kept.add(middle)
            open_parts += [(a, middle), (middle, b)]
    return sorted(kept)


def _commands(corners: Array, channels: list[str], safety: Safety) -> Iterator[BoxCommand]:
    """Commands from corner to corner, given as step counters (n, nq)."""
    now = corners[0].copy()
    for corner in corners[1:]:
        parts = max(1, math.ceil(np.abs(corner - now).max() / MOST_STEPS_SAFELY)) if safety == "high" else 1
        begin = now.copy()
        for k in range(1, parts + 1):
            steps = np.rint(begin + (corner - begin) * (k / parts)) - now
            # The firmware never finishes a single step: it is left for the next command.
            steps[np.abs(steps) == 1.0] = 0.0
            if steps.any():
                now += steps
                by_channel = dict(zip(channels, steps.astype(int).tolist(), strict=True))
                yield BoxCommand(tuple(by_channel.get(name, 0) for name in CHANNELS), safety)


@dataclass(frozen=True, eq=False)
class _Motion:
    """One emulated command.

    Args:
        begin: Step counters of the planning joints before it, shape (nq,).
        steps: Its steps, shape (nq,).
        profiles: Speed profiles of the moving joints, by column.
        duration: Time until the box is idle, at least until the end of the ramps [ticks].
        times: Ticks at which a motor stepped, shape (n,).
        counters: Step counters after each, shape (n, nq).
    """

    begin: Array
    steps: Array
    profiles: dict[int, SpeedProfile]
    duration: float
    times: Array
    counters: Array


def _emulate(commands: Sequence[BoxCommand], start: Array, scale: StepScale, box: ControlBox) -> list[_Motion]:
    emulator, begin, motions = BoxEmulator(box), start, []
    for command in commands:
        steps = np.array([command.steps[CHANNELS.index(name)] for name in scale.joints], dtype=np.float64)
        since = emulator.ticks
        stepped = emulator.run(command)
        profiles = {j: emulator.joints[name].profile for j, name in enumerate(scale.joints) if name in stepped}
        duration = max(emulator.ticks - since, *(profile.total_time for profile in profiles.values()))
        at = [np.array(stepped.get(name, ()), dtype=np.float64) for name in scale.joints]
        joint = np.repeat(np.arange(len(at)), [len(one) for one in at])
        order = np.argsort(np.concatenate(at), kind="stable")
        times, moves = np.concatenate(at)[order], np.zeros((len(order), len(at)))
        moves[np.arange(len(order)), joint[order]] = np.sign(steps)[joint[order]]
        last = np.append(np.diff(times) > 0.0, True)  # steps at the same tick are merged
        counters = begin + np.cumsum(moves, axis=0)
        motions.append(_Motion(begin, steps, profiles, float(duration), times[last], counters[last]))
        begin = begin + steps
    return motions


def _law_trajectory(
    motions: Sequence[_Motion], start: Array, names: Sequence[str], scale: StepScale, tick: float
) -> Trajectory:
    """The motion by the sine ramps of all commands, one after the other."""
    times, since = [np.zeros(1)], 0.0
    rows = [np.stack([start, np.zeros_like(start), np.zeros_like(start)])[:, None]]
    for motion in motions:
        t = _knots(motion)[1:]
        values = np.zeros((3, len(t), len(start)))
        values[0] = motion.begin
        for j, profile in motion.profiles.items():
            values[:, :, j] += motion.steps[j] * _share(t, float(profile.ramp_time), float(profile.total_time))
        times.append(since + t)
        rows.append(values)
        since += motion.duration
    counters, speeds, accelerations = np.concatenate(rows, axis=1)
    per_step = scale.positions(np.ones((1, len(start)))) - scale.positions(np.zeros((1, len(start))))
    q = scale.positions(counters)
    return Trajectory.from_samples(
        names, np.concatenate(times) * tick, q, speeds * per_step / tick, accelerations * per_step / tick**2
    )


def _knots(motion: _Motion) -> Array:
    """Knots [ticks] between which quintics follow the ramps of all joints, shape (k,)."""
    knots = [np.array([0.0, motion.duration])]
    for profile in motion.profiles.values():
        ramp = np.linspace(0.0, float(profile.ramp_time), _RAMP_PIECES + 1)
        knots += [ramp, profile.total_time - ramp]
    found = np.unique(np.concatenate(knots))
    return np.asarray(found[np.append(True, np.diff(found) > _LEAST_PIECE)])


def _share(t: Array, ramp: float, total: float) -> Array:
    """The completed share of a motion at ticks t, and its first and second derivative, shape (3, n)."""
    late = t > 0.5 * total
    since = np.where(late, np.maximum(total - t, 0.0), t)  # the second half mirrors the first
    angle = (np.minimum(since, ramp) / ramp - 0.5) * np.pi
    way = 0.5 * (np.minimum(since, ramp) - ramp / np.pi * np.cos(angle)) + np.maximum(since - ramp, 0.0)
    speed = 0.5 * (np.sin(angle) + 1.0)
    gain = np.where(since < ramp, 0.5 * np.pi / ramp * np.cos(angle), 0.0)
    whole = total - ramp
    return np.asarray(np.stack([np.where(late, whole - way, way), speed, np.where(late, -gain, gain)]) / whole)
