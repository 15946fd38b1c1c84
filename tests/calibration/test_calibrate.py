"""Calibration: signs, zeros and scales are recovered from noisy measurements, and unobservable parameters are named."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.calibration.joint_calibration import CalibrationFit
from rr1plan.calibration.measured_points import MeasuredPoints, Parameters

POINT = np.array([0.1, 0.0, 0.0])
SIGNS = np.array([1.0, -1.0, -1.0, -1.0, 1.0, -1.0])


@dataclass
class Bench:
    """A robot with known signs, zeros and scales, and measurements of it."""

    robot: rp.Robot
    zeros: np.ndarray
    scales: np.ndarray
    q: np.ndarray

    def readings(self) -> np.ndarray:
        return np.round((self.q - self.zeros) * SIGNS * self.scales)

    def positions(self, point: np.ndarray = POINT, noise: float = 1e-3, seed: int = 5) -> np.ndarray:
        """By plain numpy kinematics, which share nothing with the estimation."""
        poses = np.array([self.robot.link_poses(q)[self.robot.tool] for q in self.q])
        exact = poses[:, :3, :3] @ point + poses[:, :3, 3]
        return exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)

    def start(self) -> rp.Calibration:
        return rp.Calibration.assumed(self.robot, 2000.0, unit="steps")


def bench(robot: rp.Robot, seed: int = 0, poses: int = 20) -> Bench:
    rng = np.random.default_rng(seed)
    zeros, scales = np.radians(rng.uniform(-30, 30, robot.nq)), 2000.0 * rng.uniform(0.8, 1.2, robot.nq)
    return Bench(robot, zeros, scales, rng.uniform(robot.limits.lower, robot.limits.upper, (poses, robot.nq)))


@pytest.fixture(scope="module")
def ur_like(tmp_path_factory: pytest.TempPathFactory) -> rp.Robot:
    """An arm with the dimensions of a UR5."""
    origins = ["0 0 .089", "0 .136 0", "0 -.12 .425", "0 0 .392", "0 .093 0", "0 0 .095"]
    axes = ["0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0"]
    parts = ['<link name="l0"/>']
    for i, (origin, axis) in enumerate(zip(origins, axes, strict=True)):
        reach = 3.14159 if i == 2 else 6.28318
        parts.append(
            f'<link name="l{i + 1}"/><joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{origin}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-reach}" upper="{reach}" velocity="3" effort="100"/></joint>'
        )
    tip = '<link name="tip"/><joint name="tip" type="fixed"><parent link="l6"/><child link="tip"/>'
    text = f'<robot name="ur">{"".join(parts)}{tip}<origin xyz="0 .082 0"/></joint></robot>'
    file = tmp_path_factory.mktemp("ur") / "ur.urdf"
    file.write_text(text)
    return rp.load_robot(file)


def fit(calibration: rp.Calibration) -> CalibrationFit:
    assert calibration.fit is not None
    return calibration.fit


def columns(calibration: rp.Calibration, *names: str) -> tuple[np.ndarray, ...]:
    return tuple(np.array([getattr(joint, name) for joint in calibration.joints.values()]) for name in names)


@pytest.mark.parametrize("seed", [4, 8])
def test_signs_come_back_from_coarse_measurements(rr1: rp.Robot, seed: int) -> None:
    """Wrong signs of the last joints, whose levers are ten times the noise, fit within three standard deviations."""
    arm = bench(rr1, seed, 12)
    found = rp.calibrate(rr1, arm.readings(), arm.positions(noise=1e-2), start=arm.start(), point=POINT, noise=1e-2)
    np.testing.assert_array_equal(columns(found, "sign")[0], SIGNS)
    assert not fit(found).undetermined


@pytest.mark.parametrize("seed", range(3))
def test_signs_zeros_and_scales_come_back_within_their_uncertainty(rr1: rp.Robot, seed: int) -> None:
    arm = bench(rr1, seed)
    found = rp.calibrate(rr1, arm.readings(), arm.positions(), start=arm.start(), point=POINT)
    signs, zeros, scales = columns(found, "sign", "zero", "scale")
    zero_stds, scale_stds = columns(found, "zero_std", "scale_std")
    np.testing.assert_array_equal(signs, SIGNS)
    assert (np.abs(zeros - arm.zeros) < 4.0 * zero_stds).all()
    assert (np.abs(scales - arm.scales) < 4.0 * scale_stds).all()
    assert zero_stds.max() < math.radians(0.3)
    assert fit(found).noise == pytest.approx(1e-3, rel=0.3)
    assert not fit(found).outliers
    assert not fit(found).undetermined
    # Positions of joints between the measured ones are right too.
    np.testing.assert_allclose(found.positions(arm.readings()), arm.q, atol=math.radians(0.6))


def test_exact_measurements_give_exact_values(planar2r: rp.Robot) -> None:
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (8, 2))
    poses = np.array([planar2r.link_poses(each)[planar2r.tool] for each in q])
    found = rp.calibrate(planar2r, -(q - 0.1), poses[:, :3, 3])
    signs, zeros, scales = columns(found, "sign", "zero", "scale")
    np.testing.assert_array_equal(signs, -1)
    np.testing.assert_allclose(zeros, 0.1, atol=1e-9)
    np.testing.assert_allclose(scales, 1.0, atol=1e-9)


def test_the_jacobian_is_that_of_the_residuals(rr1: rp.Robot) -> None:
    arm = bench(rr1, 3, 4)
    data = MeasuredPoints(rr1, arm.start(), arm.readings(), arm.positions(), np.broadcast_to(POINT, (4, 3)))
    rng = np.random.default_rng(0)
    values = np.concatenate([arm.zeros, rng.uniform(0.8, 1.2, 6), rng.uniform(-0.7, 0.7, 6)])
    at = Parameters(SIGNS, values, rp.transforms.pose((0.1, 0.2, 0.3), rpy=(0.3, 0.2, 0.1)))
    jacobian = data.with_jacobian(at)[1]
    for k in range(len(values)):
        step = 1e-6 * (np.arange(len(values)) == k)
        ahead, behind = (data.residuals(replace(at, values=values + s)) for s in (step, -step))
        np.testing.assert_allclose(jacobian[:, :, k], (ahead - behind) / 2e-6, atol=1e-7)


def test_wrong_measurements_are_left_out_and_named(rr1: rp.Robot) -> None:
    arm = bench(rr1, 4)
    positions = arm.positions()
    positions[[3, 11]] += [[0.05, 0.0, 0.02], [0.0, -0.3, 0.0]]
    found = rp.calibrate(rr1, arm.readings(), positions, start=arm.start(), point=POINT)
    assert fit(found).outliers == (3, 11)
    assert np.abs(columns(found, "zero")[0] - arm.zeros).max() < math.radians(0.8)
    assert "left out: row 11" in str(found)


@pytest.mark.parametrize("seed", [0, 2])
def test_few_measurements_that_disagree_are_refused(rr1: rp.Robot, seed: int) -> None:
    arm = bench(rr1, seed, poses=6)
    positions = arm.positions()
    positions[2] += [0.04, 0.0, -0.03]
    with pytest.raises(rp.InputError, match=r"too few to tell which of them is wrong; measure at least 1[12] poses"):
        rp.calibrate(rr1, arm.readings(), positions, start=arm.start(), point=POINT)
    assert fit(rp.calibrate(rr1, arm.readings(), positions, start=arm.start(), point=POINT, noise=0.01)).noise > 1e-3


def test_the_joint_whose_zero_moved_is_named(rr1: rp.Robot) -> None:
    arm = bench(rr1, 6)
    before = rp.calibrate(rr1, arm.readings(), arm.positions(), start=arm.start(), point=POINT)
    arm.zeros[3] += math.radians(2.0)
    after = rp.calibrate(rr1, arm.readings(), arm.positions(seed=8), start=before, point=POINT)
    shifts = after.zero_shifts(before)
    assert shifts[0].joint == "forearm_joint"
    assert math.degrees(shifts[0].shift) == pytest.approx(2.0, abs=0.6)
    assert shifts[0].significance > 6.0
    assert max(shift.significance for shift in shifts[1:]) < 4.0
    assert str(shifts[0]).startswith("forearm_joint: +")


def test_what_poses_do_not_determine_is_named(rr1: rp.Robot) -> None:
    arm = bench(rr1, 7)
    # The tool is on the axis of the last joint.
    on_axis = rp.calibrate(rr1, arm.readings(), arm.positions(np.zeros(3)), start=arm.start())
    assert fit(on_axis).undetermined == {"hand_joint": ("zero", "scale", "sign")}
    assert math.isinf(on_axis.joints["hand_joint"].zero_std)
    assert on_axis.joints["wrist_joint"].zero_std < 0.02
    # A joint that does not move.
    arm.q[:, 2] = 0.4
    still = rp.calibrate(rr1, arm.readings(), arm.positions(), start=arm.start(), point=POINT)
    assert set(fit(still).undetermined) == {"elbow_joint"}
    assert "not determined by these poses" in str(still)


@pytest.mark.parametrize("name", ["rr1", "planar2r"])
def test_poses_that_determine_no_joint_are_refused(name: str) -> None:
    """The arm was not moved between the measurements."""
    robot = rp.load_robot(name)
    readings, position = np.full((20, robot.nq), 0.3), robot.link_poses(np.full(robot.nq, 0.3))[robot.tool][:3, 3]
    with pytest.raises(rp.InputError, match="determine no joint; move all joints"):
        rp.calibrate(robot, readings, np.tile(position, (20, 1)))


def test_repeated_measurements_do_not_replace_poses(rr1: rp.Robot) -> None:
    """Four poses have as many coordinates as there are unknowns, so that wrong values fit exactly."""
    arm = bench(rr1, 9, poses=4)
    readings, positions = (np.repeat(rows, 5, axis=0) for rows in (arm.readings(), arm.positions()))
    with pytest.raises(rp.InputError, match="4 different measurements have 12 coordinates for 12 unknowns"):
        rp.calibrate(rr1, readings, positions, start=arm.start(), point=POINT)
    with pytest.raises(rp.InputError, match="4 different measurements have 12 coordinates"):
        rp.expected_calibration(rr1, np.repeat(arm.q, 5, axis=0), start=arm.start(), point=POINT)


@pytest.mark.parametrize("free_base", [False, True])
def test_the_accuracy_of_poses_is_computed_before_they_are_measured(rr1: rp.Robot, free_base: bool) -> None:
    arm = bench(rr1, 10)
    found = rp.calibrate(rr1, arm.readings(), arm.positions(), start=arm.start(), point=POINT, free_base=free_base)
    ahead = rp.expected_calibration(rr1, arm.q, start=found, point=POINT, noise=fit(found).noise, free_base=free_base)
    for name in ("sign", "zero", "scale"):
        np.testing.assert_array_equal(columns(ahead, name), columns(found, name))
    # The configurations differ from those by the calibration by its errors.
    for name in ("zero_std", "scale_std"):
        np.testing.assert_allclose(columns(ahead, name), columns(found, name), rtol=0.05)
    twice = rp.expected_calibration(rr1, np.tile(arm.q, (2, 1)), start=found, point=POINT, free_base=free_base)
    once = rp.expected_calibration(rr1, arm.q, start=found, point=POINT, free_base=free_base)
    np.testing.assert_allclose(columns(twice, "zero_std")[0], columns(once, "zero_std")[0] / math.sqrt(2.0), rtol=1e-9)


def test_fingers_are_calibrated_by_a_point_on_a_finger() -> None:
    """Their robot's tool is the finger, although another link is named "tool"."""
    robot = rp.load_robot("rr1", groups=[("base_link", "finger_link")])
    assert robot.joint_names[-1] == "finger_joint"
    limits = robot.limits
    q = np.random.default_rng(0).uniform(limits.lower, limits.upper, (25, robot.nq))
    point = [0.02, 0.0, -0.06]
    found = rp.expected_calibration(robot, q, point=point).joints["finger_joint"]
    assert 0.0 < found.zero_std < 0.02
    assert 0.0 < found.scale_std < 0.02
    scene = rp.Scene().with_arm("arm", robot)
    poses = rp.propose_calibration_poses(scene, 12, point=point, rng=0)
    assert np.ptp(poses[:, -1]) > 0.9 * (limits.upper - limits.lower)[-1]


def test_joints_that_are_not_estimated_are_kept(rr1: rp.Robot) -> None:
    """The fingers, whose calibration a control box needs as well."""
    measured = bench(rr1)
    finger = rp.JointCalibration(-1, 0.02, 1700.0, 1e-3, 1.0, "rad")
    start = replace(measured.start(), joints={"finger_joint": finger, **measured.start().joints})
    found = rp.calibrate(rr1, measured.readings(), measured.positions(), start=start, point=POINT)
    assert found.joints["finger_joint"] == finger
    alone = rp.calibrate(rr1, measured.readings(), measured.positions(), start=measured.start(), point=POINT)
    assert dict(found.joints) == {**alone.joints, "finger_joint": finger}
    assert "finger_joint" in {shift.joint for shift in found.zero_shifts(start)}


def test_poses_that_would_not_determine_a_joint_are_known_before(rr1: rp.Robot) -> None:
    arm = bench(rr1, 7)
    ahead = rp.expected_calibration(rr1, arm.q)
    assert np.isinf(columns(ahead, "zero_std")[0]).tolist() == [False] * 5 + [True]
    with pytest.raises(rp.InputError, match="determine no joint; move all joints"):
        rp.expected_calibration(rr1, np.full((20, 6), 0.3), point=POINT)
    with pytest.raises(rp.InputError, match="at least 5 poses"):
        rp.expected_calibration(rr1, arm.q[:4], point=POINT)


def test_few_poses_of_an_arm_with_ranges_of_two_turns_determine_its_signs(ur_like: rp.Robot) -> None:
    """Readings at both ends of these ranges are wrong by up to 72 degrees at first."""
    for seed in range(4):
        arm = bench(ur_like, seed, 8)
        found = rp.calibrate(ur_like, arm.readings(), arm.positions(), start=arm.start(), point=POINT)
        np.testing.assert_array_equal(columns(found, "sign")[0], SIGNS)
        np.testing.assert_allclose(columns(found, "zero")[0], arm.zeros, atol=math.radians(2.0))


def test_a_free_base_hides_the_zero_of_the_first_joint_only(rr1: rp.Robot) -> None:
    arm = bench(rr1, 8)
    table = rp.transforms.pose((1.0, 2.0, 0.5), rpy=(0.1, 0.2, 2.0))
    positions = arm.positions() @ table[:3, :3].T + table[:3, 3]
    found = rp.calibrate(rr1, arm.readings(), positions, start=arm.start(), point=POINT, free_base=True)
    assert fit(found).undetermined == {"shoulder_joint": ("zero",)}
    zeros, scales = columns(found, "zero", "scale")
    np.testing.assert_allclose(zeros[1:], arm.zeros[1:], atol=math.radians(0.8))
    np.testing.assert_allclose(scales, arm.scales, rtol=0.02)
    # A rotation of the base about the first axis and that zero cannot be told apart: only their sum is known.
    turned = rp.transforms.rotation_about([0, 0, 1], zeros[0] - arm.zeros[0])
    np.testing.assert_allclose(fit(found).T_measured_base[:3, :3] @ turned, table[:3, :3], atol=0.02)


def test_readings_that_cannot_be_explained_are_refused(rr1: rp.Robot) -> None:
    arm = bench(rr1, 9)
    readings, positions, start = arm.readings(), arm.positions(), arm.start()
    shuffled = np.random.default_rng(0).permutation(positions)
    refusals = {
        "near the start explain": (readings, shuffled, start),
        "got 4 measurements of 3 coordinates for 12 unknowns": (readings[:4], positions[:4], start),
        r"readings\[2, 1\] is nan": (np.where(np.arange(120).reshape(20, 6) == 13, np.nan, readings), positions, start),
        "positions has shape": (readings, positions[:-1], start),
        "positions holds 1e": (readings, positions + 1e9, start),
        "readings, divided by the scales of start, holds": (readings * 1e9, positions, start),
        "start has no joint 'elbow_joint'": (
            readings,
            positions,
            replace(start, joints={n: j for n, j in start.joints.items() if n != "elbow_joint"}),
        ),
    }
    for words, (some, measured, begin) in refusals.items():
        with pytest.raises(rp.InputError, match=words):
            rp.calibrate(rr1, some, measured, start=begin, point=POINT)


@pytest.mark.parametrize("free_base", [False, True])
def test_likely_wrong_units_are_named(rr1: rp.Robot, *, free_base: bool) -> None:
    arm = bench(rr1, 9)
    degrees = arm.q * 180.0 / math.pi
    for words, readings, positions in (
        ("^positions seem to be in mm instead of m", arm.q, 1e3 * arm.positions()),
        ("^readings, .* seem to be in degrees instead of rad: .* its range is 4.71 rad", degrees, arm.positions()),
        ("^readings, .* seem to be in steps or counts .* instead of rad", arm.readings(), arm.positions()),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.calibrate(rr1, readings, positions, point=POINT, free_base=free_base)
    with pytest.raises(rp.InputError, match="poses seem to be in degrees instead of rad"):
        rp.expected_calibration(rr1, degrees, point=POINT, free_base=free_base)


def test_a_few_readings_and_positions_in_other_units_are_outliers(rr1: rp.Robot) -> None:
    arm = bench(rr1, 9)
    readings, positions = arm.readings(), arm.positions()
    readings[3] *= 60.0
    positions[7] *= 1e3
    found = rp.calibrate(rr1, readings, positions, start=arm.start(), point=POINT)
    assert fit(found).outliers == (3, 7)


def test_proposed_poses_are_free_and_tell_more_than_random_ones(rr1_table: rp.Scene) -> None:
    poses = rp.propose_calibration_poses(rr1_table, 20, point=POINT, rng=0)
    np.testing.assert_array_equal(poses, rp.propose_calibration_poses(rr1_table, 20, point=POINT, rng=0))
    checker = rp.CollisionChecker(rr1_table)
    assert all(checker.is_free(q) for q in poses)
    robot = rr1_table.arms["rr1"].robot
    zeros = {
        name: columns(rp.expected_calibration(robot, q, point=POINT), "zero_std")[0]
        for name, q in {"proposed": poses, "random": bench(robot, 0).q}.items()
    }
    assert zeros["proposed"].mean() < 0.75 * zeros["random"].mean()
    # The last joint moves the point on a circle of 0.1 m; no other poses determine it better than by 2 percent.
    assert zeros["proposed"].argmax() == 5
    assert zeros["proposed"][5] < 1.02 * 1e-3 / (0.1 * math.sqrt(20))
    blocked = rr1_table.with_obstacle("block", rp.Box((3, 3, 3)), [0, 0, 1.6])
    with pytest.raises(rp.InputError, match=r"fewer than 20; clear the scene: most often 'rr1/.*' and 'block' touch"):
        rp.propose_calibration_poses(blocked, 20)


@pytest.mark.parametrize(
    ("joints", "signs", "fitting"),
    [
        ("RR", (-1, 1), [(-1, 1), (1, -1)]),
        ("RR", (1, -1), [(-1, 1), (1, -1)]),
        ("PP", (1, 1), [(1, 1), (1, -1), (-1, 1), (-1, -1)]),
        ("RP", (1, 1), [(-1, 1)]),
    ],
)
def test_signs_of_an_arm_that_may_be_upside_down_are_not_determined(
    joints: str, signs: tuple[int, ...], fitting: list[tuple[int, ...]]
) -> None:
    """Seen from an unknown place, a planar arm moves like its mirror image."""
    arm, point = rp.planar_arm(joints), [0.1, 0.03, 0.02]
    q = np.random.default_rng(1).uniform([-2.5, 0.2], [2.5, 1.5], (20, 2))
    T = rp.Kinematics(arm).poses_batch(q)
    positions, camera = T[:, :3, :3] @ point + T[:, :3, 3], rp.transforms.pose([0.3, -0.2, 0.5], rpy=[0.4, 2.0, -1.0])
    seen, readings = positions @ camera[:3, :3].T + camera[:3, 3], (q - 0.1) * [-900.0, 1100.0]
    nominal = [rp.JointCalibration(sign, 0.0, 1000.0) for sign in signs]
    start = rp.Calibration(arm.name, dict(zip(arm.joint_names, nominal, strict=True)))
    found = rp.calibrate(arm, readings, seen, start=start, point=point, free_base=True)
    assert found.fit is not None
    assert found.fit.residuals.max() < 1e-6
    assert [joint.scale for joint in found.joints.values()] == pytest.approx([900.0, 1100.0])
    assert tuple(joint.sign for joint in found.joints.values()) == (signs if signs in fitting else fitting[0])
    unknown = len(fitting) > 1
    expected = rp.expected_calibration(arm, q, start=found, point=point, free_base=True)
    for name, joint in found.joints.items():
        assert ("sign" in found.fit.undetermined.get(name, ())) == unknown
        if unknown:  # zeros belong to a sign
            assert (joint.zero_std, expected.joints[name].zero_std) == (math.inf, math.inf)
    fixed = rp.calibrate(arm, readings, positions, start=start, point=point)
    assert fixed.fit is not None
    assert not fixed.fit.undetermined
