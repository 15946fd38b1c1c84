"""Planted contacts, each known in closed form: which pair, when, how deep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from concave_meshes import torus

import rr1plan as rp
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.transforms import pose
from rr1plan.validation import certify_path, validate

Make = Callable[..., Any]
BALL = rp.Sphere(0.05)
PLATE = rp.Box((0.001, 2.0, 2.0))


def only(report: rp.Report, kind: str) -> rp.Violation:
    found = [v for v in report.violations if v.kind == kind]
    assert len(found) == 1, str(report)
    return found[0]


def bump(trajectory: Make, top: float, depth: float, seconds: float) -> rp.Trajectory:
    """Rest at x = top - 0.01 but for one parabola to `top` around 0.5 s, the last `depth` of it in `seconds`."""
    a = depth / (0.5 * seconds) ** 2
    w = np.sqrt(0.01 / a)
    up = [top - 0.01, 2.0 * a * w, -a]
    return trajectory(["arm/slide"], [0.0, 0.5 - w, 0.5 + w, 1.0], [[top - 0.01], up, [top - 0.01]])


def test_a_contact_of_half_a_millisecond_is_found_where_it_is(slider: Make, trajectory: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    report = validate(bump(trajectory, 0.5 - 0.0005 - 0.05 + 0.001, 0.001, 0.0005), scene)
    hit = only(report, "collision")
    assert not report.valid
    assert set(hit.subject) == {"arm/carriage", "plate"}
    assert hit.time == pytest.approx(0.5, abs=1e-5)
    assert hit.value == pytest.approx(-0.001, abs=1e-6)
    assert "1.000 mm" in hit.message
    assert "first contact at 0.4997" in hit.message


def test_the_same_motion_a_tenth_of_a_millimeter_away_is_certified(slider: Make, trajectory: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    report = validate(bump(trajectory, 0.5 - 0.0005 - 0.05 - 0.0001, 0.001, 0.0005), scene)
    assert not [v for v in report.violations if v.kind in ("collision", "undecided")]
    assert report.margins["clearance"].value == pytest.approx(1e-4, abs=1e-6)
    assert report.margins["clearance"].time == pytest.approx(0.5, abs=1e-4)
    assert 0.0 < report.margins["clearance_proven"].value <= report.margins["clearance"].value


def test_a_small_ball_at_a_hundred_meters_a_second_does_not_slip_through_a_plate(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(rp.Sphere(0.001))).with_obstacle("plate", PLATE, [0.3, 0.0, 0.0])
    report = validate(quintic(["arm/slide"], [-5.0], [5.0], 0.1), scene)
    hit = only(report, "collision")
    assert hit.value == pytest.approx(-0.0015, abs=1e-5)
    assert not report.certified


@pytest.mark.parametrize(("angle", "touches"), [(0.5, True), (-0.5, False)])
def test_a_turning_needle_meets_a_needle_in_its_sector_only(
    angle: float, touches: bool, gripper: Make, quintic: Make
) -> None:
    needle = rp.Cylinder(0.0002, 0.4)
    scene = rp.Scene().with_arm("arm", gripper(rp.Capsule(0.0002, 0.2)))
    at = [0.5 * np.cos(angle) - 0.05 * np.sin(angle), 0.5 * np.sin(angle) + 0.05 * np.cos(angle), 0.0]
    scene = scene.with_obstacle("needle", needle, at)
    report = validate(quintic(["arm/turn"], [0.0], [1.5]), scene)
    assert bool([v for v in report.violations if v.kind == "collision"]) == touches


@pytest.mark.parametrize(("start", "goal", "time"), [(0.45, 0.0, 0.0), (0.0, 0.45, 1.0)])
def test_touching_only_at_an_end_is_found(start: float, goal: float, time: float, slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5004, 0.0, 0.0])
    hit = only(validate(quintic(["arm/slide"], [start], [goal]), scene), "collision")
    assert hit.time == pytest.approx(time, abs=1e-4)
    assert hit.value == pytest.approx(-0.0001, abs=1e-8)


def test_an_arm_that_is_not_in_the_trajectory_is_hit_where_it_rests(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("a", slider(BALL)).with_arm("b", slider(BALL), q=[1.0])
    report = validate(quintic(["a/slide"], [0.0], [0.95]), scene)
    assert set(only(report, "collision").subject) == {"a/carriage", "b/carriage"}
    assert validate(quintic(["a/slide"], [0.0], [0.85]), scene).certified


def test_an_arm_that_has_finished_can_still_be_hit(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("a", slider(BALL)).with_arm("b", slider(BALL), q=[2.0])
    first = quintic(["a/slide"], [0.0], [1.0], 1.0)
    late = rp.Trajectory.merge(first, quintic(["b/slide"], [2.0], [1.05], 1.0).shifted(2.0))
    hit = only(validate(late, scene), "collision")
    assert hit.time == pytest.approx(3.0, abs=1e-4)
    assert validate(rp.Trajectory.merge(first, quintic(["b/slide"], [2.0], [1.15], 1.0).shifted(2.0)), scene).certified


def test_a_motion_for_another_place_of_the_arm_is_refused(slider: Make, quintic: Make) -> None:
    robot, move = slider(BALL), quintic(["arm/slide"], [0.0], [0.4])
    scene = rp.Scene().with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    assert validate(move, scene.with_arm("arm", robot)).certified
    assert not validate(move, scene.with_arm("arm", robot, [0.06, 0.0, 0.0])).valid
    assert validate(move, scene.with_arm("arm", robot, pose(rpy=[0.0, 0.0, 3.0]))).certified


def test_what_an_arm_holds_is_part_of_it(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    scene = scene.with_obstacle("stick", rp.Capsule(0.01, 0.2), pose([0.1, 0.0, 0.0], rpy=[0.0, np.pi / 2, 0.0]))
    held = scene.attach("stick")
    hit = only(validate(quintic(["arm/slide"], [0.0], [0.3]), held), "collision")
    assert set(hit.subject) == {"stick", "plate"}
    assert hit.value == pytest.approx(-0.0105, abs=1e-5)
    assert validate(quintic(["arm/slide"], [0.0], [0.3]), held.allow("stick", "plate")).certified


def test_fingers_stand_where_they_are_held_and_follow_their_leader(gripper: Make, quintic: Make) -> None:
    robot = gripper(rp.Sphere(0.02))
    # The second finger follows the held one to the other side: it stands at y = -0.06, then at -0.21.
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("wall", rp.Box((0.2, 0.02, 0.2)), [0.5, -0.2, 0.0])
    still = rp.Trajectory.rest(("arm/turn",), [0.0])
    assert validate(still, scene).certified
    wide = scene.with_robot("arm", robot.with_locked_joints({"left_slide": 0.2}))
    assert set(only(validate(still, wide), "collision").subject) == {"arm/right", "wall"}


def test_padding_of_all_and_of_one_pair_is_kept(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    move = quintic(["arm/slide"], [0.0], [0.4475])
    assert validate(move, scene).margins["clearance"].value == pytest.approx(0.002, abs=1e-7)
    assert validate(move, scene.with_padding(0.0015)).margins["clearance"].value == pytest.approx(0.0005, abs=1e-7)
    hit = only(validate(move, scene.with_padding(0.003, "arm", "plate")), "collision")
    assert hit.value == pytest.approx(-0.001, abs=1e-7)
    assert "3 mm is padding" in hit.message


def test_sliding_along_a_wall_at_two_millimeters_raises_no_alarm(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(rp.Box((0.2, 0.1, 0.1))))
    scene = scene.with_obstacle("rail", rp.Box((4.0, 0.1, 0.1)), [0.0, 0.102, 0.0])
    scene = scene.with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.052))
    report = validate(quintic(["arm/slide"], [-1.0], [1.0], 5.0), scene)
    assert report.certified, str(report)
    assert report.margins["clearance"].value == pytest.approx(0.002, abs=1e-9)
    assert report.margins["clearance_proven"].value > 0.0


def test_half_a_micrometer_is_undecided_never_free(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    doubt = only(validate(quintic(["arm/slide"], [0.0], [0.4495 - 5e-7]), scene), "undecided")
    assert doubt.value == pytest.approx(5e-7, abs=1e-9)
    assert doubt.limit == 1e-6


def test_less_than_a_micrometer_is_undecided_where_bounding_volumes_suffice_too(slider: Make) -> None:
    """Two balls, whose distance needs no search, and a mesh near a corner of its bounding box."""
    for shape in (rp.Sphere(0.1), torus(0.1, 0.02)):
        reach = 0.1 if isinstance(shape, rp.Sphere) else float(shape.vertices[:, 0].max())
        scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("other", shape, [1.0, 0.0, 0.0])
        for gap, free in ((5e-7, False), (2e-6, True)):
            still = rp.Trajectory.rest(("arm/slide",), [1.0 - reach - BALL.radius - gap])
            for clearance in (True, False):
                report = validate(still, scene, clearance=clearance)
                assert [v.kind for v in report.violations] == ([] if free else ["undecided"])
            assert not free or validate(still, scene).margins["clearance"].value == pytest.approx(gap, abs=1e-9)


def test_work_without_end_is_given_up_as_undecided(
    slider: Make, quintic: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rr1plan.validation.referee.MOST_SEARCHES", 200)
    scene = rp.Scene().with_arm("arm", slider(rp.Box((0.2, 0.1, 0.1))))
    scene = scene.with_obstacle("rail", rp.Box((4.0, 0.1, 0.1)), [0.0, 0.1 + 1e-5, 0.0])
    doubt = only(validate(quintic(["arm/slide"], [-1.0], [1.0]), scene), "undecided")
    assert "could not be decided" in doubt.message


def test_the_first_contact_is_found_besides_the_worst(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("block", rp.Box((0.4, 1.0, 1.0)), [0.5, 0.0, 0.0])
    move = quintic(["arm/slide"], [0.0], [1.0])
    times = np.linspace(0.0, 1.0, 200_001)
    first = float(times[np.argmax(move(times)[:, 0] > 0.25)])
    hit = only(validate(move, scene), "collision")
    assert hit.value == pytest.approx(-0.25, abs=2e-3)
    assert hit.time == pytest.approx(0.5, abs=0.01)
    assert float(hit.message.split("first contact at ")[1].split()[0]) == pytest.approx(first, abs=2e-5)


def test_only_joints_between_two_bodies_count_against_them(chain: Make, quintic: Make) -> None:
    """The last two links keep still against each other while the base turns: no interval has to be halved."""
    rng = np.random.default_rng(11)
    robot = chain(rng, 4)
    scene = rp.Scene().with_arm("arm", robot)
    moved = np.zeros(4)
    moved[0] = 5.0
    still = validate(quintic(scene.joint_names(), np.zeros(4), np.zeros(4)), scene)
    report = validate(quintic(scene.joint_names(), np.zeros(4), moved), scene)
    assert report.statistics["intervals"] == still.statistics["intervals"]


def test_a_motion_of_no_duration_is_checked_where_it_stands(slider: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    assert validate(rp.Trajectory.rest(("arm/slide",), [0.2]), scene).certified
    assert only(validate(rp.Trajectory.rest(("arm/slide",), [0.5]), scene), "collision").value < -0.05


def test_a_cloud_and_a_concave_mesh_in_the_way_are_found(slider: Make, quintic: Make) -> None:
    points = np.array([[0.505, y, z] for y in np.arange(-0.2, 0.2, 0.02) for z in np.arange(-0.2, 0.2, 0.02)])
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("cloud", rp.PointCloud(points, 0.02))
    assert validate(quintic(["arm/slide"], [0.0], [0.44]), scene).certified
    hit = only(validate(quintic(["arm/slide"], [0.0], [1.0]), scene), "collision")
    assert set(hit.subject) == {"arm/carriage", "cloud"}
    assert hit.time == pytest.approx(0.5, abs=0.05)


def test_a_path_is_certified_between_its_waypoints(slider: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    through = rp.Path(("arm/slide",), [[0.0], [0.0], [1.0]])
    report = certify_path(through, scene)
    assert only(report, "collision").time == pytest.approx(0.5, abs=0.01)
    assert "velocity" in report.not_checked
    assert certify_path(rp.Path(("arm/slide",), [[0.0], [0.4]]), scene).certified
    assert certify_path(rp.Path(("arm/slide",), [[0.4]]), scene).certified
    assert not certify_path(rp.Path(("arm/slide",), [[0.5], [0.5]]), scene).valid
    outside = certify_path(rp.Path(("arm/slide",), [[0.0], [-10.5]]), scene)
    assert only(outside, "position").value == pytest.approx(-10.5)


def test_trajectories_that_do_not_fit_the_scene_are_wrong_calls(slider: Make, chain: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_arm("chain", chain(np.random.default_rng(0)))
    with pytest.raises(UnknownNameError, match="amr"):
        validate(rp.Trajectory.rest(("amr/slide",), [0.0]), scene)
    with pytest.raises(InputError, match="arm/slip"):
        validate(rp.Trajectory.rest(("arm/slip",), [0.0]), scene)
    with pytest.raises(InputError, match="chain/joint2"):
        validate(rp.Trajectory.rest(("chain/joint0", "chain/joint1"), [0.0, 0.0]), scene)
    with pytest.raises(InputError, match="clearance_tolerance"):
        validate(rp.Trajectory.rest(("arm/slide",), [0.0]), scene, clearance_tolerance=0.0)


def test_a_half_space_that_moves_is_a_wrong_call(slider: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(rp.HalfSpace())).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    with pytest.raises(InputError, match="half-space"):
        validate(rp.Trajectory.rest(("arm/slide",), [0.0]), scene)


def test_a_scene_without_pairs_says_that_nothing_can_touch(slider: Make, quintic: Make) -> None:
    report = validate(quintic(["arm/slide"], [0.0], [1.0]), rp.Scene().with_arm("arm", slider(BALL)))
    assert report.certified
    assert "clearance" in report.not_checked
    assert "clearance" not in report.margins


def test_clearance_to_the_surroundings_is_told_apart_from_an_arms_own(rr1: rp.Robot, quintic: Make) -> None:
    scene = rp.Scene().with_arm("rr1", rr1).with_obstacle("far", rp.Sphere(0.1), [0.0, 0.0, 2.0])
    q = scene.configuration()
    move = quintic(scene.joint_names(), q, q + 0.1)
    alone = validate(move, scene.without_obstacle("far"))
    assert "clearance" not in alone.margins
    own = alone.margins["self_clearance"]
    assert own.value < 0.05
    both = validate(move, scene)
    assert both.margins["self_clearance"].value == pytest.approx(own.value, abs=1e-6)
    assert both.margins["self_clearance_proven"].value <= own.value
    assert all(name.startswith("rr1/") for name in both.margins["self_clearance"].subject)
    for name in ("clearance", "clearance_start", "clearance_end"):
        assert both.margins[name].value > 0.5
        assert "far" in both.margins[name].subject
    assert both.margins["clearance_proven"].value >= 0.95 * both.margins["clearance"].value - 1e-9
    sharp = validate(move, scene, clearance_tolerance=1e-4).margins
    assert sharp["clearance_proven"].value >= sharp["clearance"].value - 1e-4 - 1e-9
    assert sharp["clearance"].value == pytest.approx(both.margins["clearance"].value, rel=0.05)
    data = both.to_dict()
    assert rp.Report.from_dict(data).margins["self_clearance"] == both.margins["self_clearance"]
    assert "margin       self_clearance" in str(both)


def test_beside_a_contact_no_clearance_is_told_that_was_not_looked_for(rr1: rp.Robot, quintic: Make) -> None:
    scene = rp.Scene().with_arm("rr1", rr1)
    q = scene.configuration()
    tool = scene.link_poses({"rr1": q + 0.05})["rr1/tool"][:3, 3]
    report = validate(quintic(scene.joint_names(), q, q + 0.1), scene.with_obstacle("ball", rp.Sphere(0.05), tool))
    assert not report.valid
    assert report.margins["clearance"].value < 0.0
    assert "ball" in report.margins["clearance_start"].subject
    assert not [name for name in report.margins if name.startswith("self_clearance")]


def test_another_arm_is_of_the_surroundings_and_a_held_object_of_the_arm(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("a", slider(BALL)).with_arm("b", slider(BALL), [0.0, 0.3, 0.0])
    move = quintic(["a/slide"], [0.0], [0.4])
    report = validate(move, scene)
    assert set(report.margins["clearance"].subject) == {"a/carriage", "b/carriage"}
    assert "self_clearance" not in report.margins
    held = scene.with_obstacle("stick", rp.Sphere(0.01), [0.0, 0.1, 0.0]).attach("stick", "b", "base")
    report = validate(quintic(["a/slide"], [5.0], [5.4]), held)
    assert set(report.margins["self_clearance"].subject) == {"b/carriage", "stick"}
    assert report.margins["self_clearance"].value == pytest.approx(0.2 - BALL.radius - 0.01, abs=1e-6)
    assert report.margins["clearance"].value > 4.0


def test_columns_may_come_in_any_order(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("a", slider(BALL)).with_arm("b", slider(BALL), q=[1.0])
    assert validate(quintic(["b/slide", "a/slide"], [1.0, 0.0], [1.0, 0.85]), scene).certified
    assert not validate(quintic(["b/slide", "a/slide"], [1.0, 0.0], [1.0, 0.95]), scene).valid


def test_the_verdict_alone_is_the_same_and_takes_fewer_searches(rr1: rp.Robot, quintic: Make) -> None:
    scene = rp.Scene().with_arm("rr1", rr1).with_obstacle("ball", rp.Sphere(0.1), [0.0, 0.0, 2.0])
    q = scene.configuration()
    move = quintic(scene.joint_names(), q, q + 0.1)
    whole, verdict = validate(move, scene), validate(move, scene, clearance=False)
    assert verdict.certified
    assert verdict.not_checked["clearance"] == "not asked for (option clearance)"
    assert not [name for name in verdict.margins if "clearance" in name]
    assert verdict.statistics["searches"] < 0.5 * whole.statistics["searches"]
    tool = scene.link_poses({"rr1": q + 0.05})["rr1/tool"][:3, 3]
    blocked = scene.with_obstacle("ball", rp.Sphere(0.05), tool)
    hits = [[v.subject for v in validate(move, blocked, clearance=c).violations] for c in (True, False)]
    assert hits[0] == hits[1] != []
    path = rp.Path(scene.joint_names(), [q, q + 0.1])
    assert "clearance" not in certify_path(path, scene, clearance=False).margins


def test_progress_rises_to_one(slider: Make, quintic: Make) -> None:
    seen: list[float] = []
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    validate(quintic(["arm/slide"], [0.0], [0.4]), scene, progress=lambda p: seen.append(p.fraction))
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


def test_a_cancelled_certificate_claims_nothing(slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    report = validate(quintic(["arm/slide"], [0.0], [0.4]), scene, progress=lambda _: False)
    assert not report.certified
    assert "cancelled" in report.not_checked["collision"]
    assert "clearance_proven" not in report.margins


def test_a_clock_far_from_zero_changes_nothing(slider: Make, trajectory: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("plate", PLATE, [0.5, 0.0, 0.0])
    late = bump(trajectory, 0.4505, 0.001, 0.0005).shifted(1e6)
    assert only(validate(late, scene), "collision").value == pytest.approx(-0.001, abs=1e-5)
