"""Planted violations of every limit: joint, time and amount; and the tolerance for rounding."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.validation import validate

Make = Callable[..., Any]


def only(report: rp.Report) -> rp.Violation:
    assert len(report.violations) == 1, str(report)
    return report.violations[0]


def scene_of(robot: rp.Robot) -> rp.Scene:
    return rp.Scene().with_arm("arm", robot)


@pytest.mark.parametrize(("kind", "peak"), [("velocity", 1.875), ("acceleration", 10.0 / np.sqrt(3.0))])
def test_a_peak_between_samples_is_caught_to_a_millionth(kind: str, peak: float, slider: Make, quintic: Make) -> None:
    move = quintic(["arm/slide"], [0.0], [1.0])
    over = only(validate(move, scene_of(slider(rp.Sphere(0.1), **{kind: peak / (1.0 + 1e-6)}))))
    assert (over.kind, over.subject) == (kind, ("arm/slide",))
    assert over.value == pytest.approx(peak, rel=1e-12)
    assert over.limit == pytest.approx(peak, rel=2e-6)
    assert "(+0.0001 %)" in over.message
    much = only(validate(move, scene_of(slider(rp.Sphere(0.1), **{kind: peak / 40.0}))))
    assert "(+3900 %)" in much.message
    times = {"velocity": (0.5,), "acceleration": (0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6)}[kind]
    assert min(abs(over.time - t) for t in times) < 1e-5
    held = validate(move, scene_of(slider(rp.Sphere(0.1), **{kind: peak / (1.0 + 1e-12)})))
    assert held.valid
    assert held.margins[kind].value == pytest.approx(1.0, abs=1e-9)
    assert held.margins[kind].subject == ("arm/slide",)


def test_jerk_is_checked_on_request_and_else_named_as_not_checked(slider: Make, quintic: Make) -> None:
    move, scene = quintic(["arm/slide"], [0.0], [1.0]), scene_of(slider(rp.Sphere(0.1), jerk=59.9))
    report = validate(move, scene)
    assert report.valid
    assert "option jerk_limits" in report.not_checked["jerk"]
    over = only(validate(move, scene, jerk_limits=True))
    assert (over.kind, over.value) == ("jerk", pytest.approx(60.0))
    assert validate(move, scene_of(slider(rp.Sphere(0.1), jerk=60.0)), jerk_limits=True).valid


def test_a_jump_of_acceleration_is_an_infinite_jerk(slider: Make, trajectory: Make) -> None:
    ramps = trajectory(["arm/slide"], [0.0, 1.0, 2.0], [[0.0, 0.0, 0.5], [0.5, 1.0, -0.5]])
    assert validate(ramps, scene_of(slider(rp.Sphere(0.1)))).valid
    assert validate(ramps, scene_of(slider(rp.Sphere(0.1), jerk=5.0))).valid
    over = only(validate(ramps, scene_of(slider(rp.Sphere(0.1), jerk=5.0)), jerk_limits=True))
    assert (over.kind, over.time, over.value) == ("jerk", 1.0, pytest.approx(2.0))


def test_limits_nobody_gave_are_named_as_not_checked(slider: Make, quintic: Make) -> None:
    report = validate(quintic(["arm/slide"], [0.0], [1.0]), scene_of(slider(rp.Sphere(0.1))), jerk_limits=True)
    assert report.not_checked["acceleration"] == report.not_checked["jerk"] == "no joint has a limit for it"
    assert "velocity" in report.checked


@pytest.mark.parametrize(("sign", "side"), [(1.0, "above its upper"), (-1.0, "below its lower")])
def test_a_position_beyond_its_limit_between_samples_is_caught(
    sign: float, side: str, slider: Make, trajectory: Make
) -> None:
    # A quartic that rests at 0 and 1 s and reaches sign * 2 in between.
    hump = trajectory(["arm/slide"], [0.0, 1.0], [[0.0, 0.0, sign * 32.0, sign * -64.0, sign * 32.0]])
    over = only(validate(hump, scene_of(slider(rp.Sphere(0.1), lower=-2.0 + 1e-8, upper=2.0 - 1e-8))))
    assert (over.kind, over.time) == ("position", pytest.approx(0.5, abs=1e-4))
    assert over.value == pytest.approx(sign * 2.0, rel=1e-12)
    assert side in over.message
    assert " m " in over.message
    held = validate(hump, scene_of(slider(rp.Sphere(0.1), lower=-2.0, upper=2.0)))
    assert held.valid
    assert held.margins["position"].value == pytest.approx(1.0)


@pytest.mark.parametrize(("unit", "is_hinted"), [(np.degrees(1.0), True), (2.0, False)])
def test_positions_that_seem_to_be_degrees_are_recognized(unit: float, is_hinted: bool, quintic: Make) -> None:
    scene = scene_of(rp.load_robot("planar2r_limited"))
    report = validate(quintic(["arm/joint1", "arm/joint2"], [0.0, 0.0], [2.0 * unit, 0.0]), scene)
    (over,) = (v for v in report.violations if v.kind == "position")
    assert over.message.endswith("(angles are in radians: are these degrees?)") == is_hinted


def test_a_continuous_joint_has_no_position_limits(gripper: Make, quintic: Make) -> None:
    report = validate(quintic(["arm/turn"], [0.0], [100.0]), scene_of(gripper(rp.Sphere(0.01))))
    assert report.valid
    assert "position" not in report.margins


@pytest.mark.parametrize(("jump", "what"), [([0.5 + 1e-6, 1.0, -0.5], "m "), ([0.5, 1.0 + 1e-5, -0.5], "m/s")])
def test_a_jump_between_pieces_is_caught(jump: list[float], what: str, slider: Make, trajectory: Make) -> None:
    broken = trajectory(["arm/slide"], [0.0, 1.0, 2.0], [[0.0, 0.0, 0.5], jump])
    report = validate(broken, scene_of(slider(rp.Sphere(0.1))))
    found = [v for v in report.violations if v.kind == "continuity"]
    assert [(v.subject, v.time) for v in found] == [(("arm/slide",), 1.0)]
    assert what in found[0].message
    assert found[0].value == pytest.approx(max(abs(jump[0] - 0.5), abs(jump[1] - 1.0)), rel=1e-3)


def test_rounding_at_a_break_is_no_jump(slider: Make, trajectory: Make) -> None:
    fine = trajectory(["arm/slide"], [0.0, 1.0, 2.0], [[0.0, 0.0, 0.5], [0.5 + 1e-13, 1.0 + 1e-12, -0.5]])
    assert validate(fine, scene_of(slider(rp.Sphere(0.1)))).valid


def test_a_motion_that_does_not_start_or_end_at_rest_is_caught(slider: Make, trajectory: Make) -> None:
    scene = scene_of(slider(rp.Sphere(0.1)))
    start = only(validate(trajectory(["arm/slide"], [0.0, 1.0], [[0.0, 1.0, -0.5]]), scene))
    assert (start.kind, start.time, start.value) == ("rest", 0.0, 1.0)
    end = only(validate(trajectory(["arm/slide"], [0.0, 1.0], [[0.0, 0.0, 0.5]]), scene))
    assert (end.kind, end.time, end.value) == ("rest", 1.0, 1.0)


@pytest.mark.parametrize("seconds", [1e7, 1.7e9, -1.7e9])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_times_since_1970_are_rounded_without_a_violation(
    seconds: float, factor: float, slider: Make, trajectory: Make
) -> None:
    rows = [[-6.0, 0.0, 0.0, 1.0], [-5.0, 3.0, 3.0, -1.0], [0.0, 6.0, 0.0, -1.0], [5.0, 3.0, -3.0, 1.0]]
    move = trajectory(["arm/slide"], [0.0, 1.0, 2.0, 3.0, 4.0], rows).stretched(factor / 4.0)
    peaks = {"velocity": 24.0 / factor, "acceleration": 96.0 / factor**2}
    late = move.shifted(seconds)
    assert validate(late, scene_of(slider(rp.Sphere(0.1), **peaks))).valid
    for kind, peak in peaks.items():
        over = only(validate(late, scene_of(slider(rp.Sphere(0.1), **peaks | {kind: peak / 1.001}))))
        assert over.kind == kind


@pytest.mark.parametrize("seconds", [1.7e9, 1e15])
@pytest.mark.parametrize(("row", "kind"), [([0.5, 1.001, -0.5], "continuity"), ([0.5, 1.0, -0.499], "rest")])
def test_jumps_and_speeds_at_the_end_are_caught_at_any_time(
    seconds: float, row: list[float], kind: str, slider: Make, trajectory: Make
) -> None:
    broken = trajectory(["arm/slide"], [seconds, seconds + 1.0, seconds + 2.0], [[0.0, 0.0, 0.5], row])
    found = validate(broken, scene_of(slider(rp.Sphere(0.1)))).violations
    assert kind in {v.kind for v in found}


def forged(move: rp.Trajectory, **changes: Any) -> rp.Trajectory:
    """A trajectory that bypassed the constructor, as one from a pickle may."""
    out = pickle.loads(pickle.dumps(move))
    for name, value in changes.items():
        object.__setattr__(out, name, value)
    return out


@pytest.mark.parametrize(
    ("breaks", "kind"),
    [
        ([0.0, 0.5, 0.5], "clock"),
        ([0.0, 0.7, 0.5], "clock"),
        ([0.0, np.nan, 1.0], "finite"),
        ([0.0, 0.5], "clock"),
        ([[0.0], [0.5], [1.0]], "clock"),
    ],
)
def test_a_forged_clock_is_caught_and_nothing_else_is_claimed(
    breaks: Any, kind: str, slider: Make, trajectory: Make
) -> None:
    move = trajectory(["arm/slide"], [0.0, 1.0, 2.0], [[0.0, 0.0, 0.5], [0.5, 1.0, -0.5]])
    report = validate(forged(move, breaks=np.array(breaks)), scene_of(slider(rp.Sphere(0.1))))
    assert only(report).kind == kind
    assert report.checked == ("clock", "finite")
    assert "collision" in report.not_checked
    assert not report.certified


def test_a_number_that_is_not_finite_names_its_joint(slider: Make, quintic: Make) -> None:
    move = quintic(["arm/slide"], [0.0], [1.0])
    poisoned = move.coefficients.copy()
    poisoned[0, 3, 0] = np.inf
    bad = only(validate(forged(move, coefficients=poisoned), scene_of(slider(rp.Sphere(0.1)))))
    assert (bad.kind, bad.subject) == ("finite", ("arm/slide",))


@pytest.mark.parametrize("size", [1e9, 1e300])
def test_positions_beyond_all_reason_are_refused_at_once(size: float, slider: Make, trajectory: Make) -> None:
    report = validate(trajectory(["arm/slide"], [0.0, 10.0], [[0.0, 0.0, size]]), scene_of(slider(rp.Sphere(0.1))))
    assert (only(report).kind, only(report).subject) == ("finite", ("arm/slide",))
    assert not report.certified


def test_a_trajectory_without_columns_is_a_scene_at_rest(slider: Make) -> None:
    still = rp.Trajectory((), np.array([0.0, 1.0]), np.zeros((1, 1, 0)))
    assert validate(still, rp.Scene()).valid
    scene = scene_of(slider(rp.Sphere(0.1))).with_obstacle("wall", rp.Box((1.0, 1.0, 1.0)), [0.55, 0.0, 0.0])
    assert {v.kind for v in validate(still, scene).violations} == {"collision"}


def test_torques_are_held_to_their_limits_on_request_and_said_to_be_sampled(rr1: rp.Robot, quintic: Make) -> None:
    scene = rp.Scene().with_arm("rr1", rr1)
    move = quintic(scene.joint_names(), rr1.home, rr1.home + 0.3, 2.0)
    assert "option torque_limits" in validate(move, scene).not_checked["torque"]
    weak = rr1.with_limits(replace(rr1.limits, effort=np.full(rr1.nq, 1e-3)))
    report = validate(move, scene.with_robot("rr1", weak), torque_limits=True)
    found = {v.subject[0]: v for v in report.violations if v.kind == "torque"}
    q, qd, qdd = (move(found["rr1/shoulder_joint"].time, k) for k in range(3))
    want = abs(rp.Kinematics(scene).inverse_dynamics(q, qd, qdd))
    j = scene.joint_names().index("rr1/shoulder_joint")
    assert found["rr1/shoulder_joint"].value == pytest.approx(float(want[j]))
    assert found["rr1/shoulder_joint"].value / 1e-3 <= report.margins["torque"].value * (1.0 + 1e-12)
    assert "sampled every" in report.not_checked["torque between samples"]
    free = rr1.with_limits(replace(rr1.limits, effort=np.full(rr1.nq, np.inf)))
    assert "no joint" in validate(move, scene.with_robot("rr1", free), torque_limits=True).not_checked["torque"]


def test_scenes_with_other_limits_configurations_or_places_are_not_taken_for_each_other(
    slider: Make, trajectory: Make
) -> None:
    slow, fast = (slider(rp.Sphere(0.1), velocity=v) for v in (0.9, 1.1))
    ramp = trajectory(["arm/slide"], [0.0, 1.0, 2.0], [[0.0, 0.0, 0.5], [0.5, 1.0, -0.5]])
    wall = rp.Box((0.2, 1.0, 1.0))
    for _ in range(2):
        assert only(validate(ramp, scene_of(slow))).kind == "velocity"
        assert validate(ramp, scene_of(fast)).valid
        for base, meets in (([0.0, 0.0, 0.0], True), ([0.0, 3.0, 0.0], False)):
            scene = rp.Scene().with_arm("arm", fast, base).with_obstacle("wall", wall, [0.5, 0.0, 0.0])
            assert validate(ramp, scene).valid is not meets
        for rest, meets in ((0.5, True), (3.0, False)):
            scene = scene_of(fast).with_arm("other", fast, [0.0, 0.05, 0.0], q=[rest])
            assert validate(ramp, scene).valid is not meets


def test_a_motion_that_is_absurdly_fast_is_refused_without_much_work() -> None:
    scene = rp.load_scene("planar2r_path")
    spin = rp.Trajectory(scene.joint_names(), [0.0, 0.5], [[[0.0, 0.0], [1e5, 0.0]]])
    report = validate(spin, scene)
    assert {"velocity", "rest"} <= {violation.kind for violation in report.violations}
    assert report.statistics["searches"] < 40_000
