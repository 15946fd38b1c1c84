"""Planning of sequences: every kind of segment, the choice among candidates, failures, repetition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sequences.conftest import tool_down

import rr1plan as rp
from rr1plan.sequences.stage_validation import validate_stages


def plan_of(scene: rp.Scene, *segments: object, **options: object) -> rp.SequencePlan:
    return rp.plan_sequence(rp.Sequence(scene, segments), **{"rng": 0, "budget": rp.Budget(seconds=100.0), **options})


# ---- segments ------------------------------------------------------------------------------------


def test_all_segments_are_on_one_clock_and_certified(moved: rp.SequencePlan) -> None:
    assert moved, moved
    assert moved.report.certified
    assert len(moved.stages) == len(moved.sequence.segments)
    assert moved.stages[0].begin == 0.0
    assert moved.stages[-1].end == moved.trajectory.end_time
    assert all(a.end == b.begin for a, b in zip(moved.stages, moved.stages[1:], strict=False))
    assert [event.label for event in moved.events] == ["attach 'block'", "detach 'block'"]
    assert all(event.begin == event.end for event in moved.events)
    assert moved.trajectory.joint_names == moved.scene.joint_names()
    assert moved.trajectory.joint_names[-1] == "arm/finger_joint"


def test_the_block_is_taken_carried_level_and_left_where_it_should_be(moved: rp.SequencePlan, table: rp.Scene) -> None:
    taken, left = (event.begin for event in moved.events)
    times = [0.0, taken, 0.5 * (taken + left), left, moved.trajectory.end_time]
    poses = moved.object_poses("block", times)
    np.testing.assert_allclose(poses[1], table.obstacles["block"].pose, atol=1e-9)
    assert np.linalg.norm(poses[2][:3, 3] - poses[0][:3, 3]) > 0.05
    np.testing.assert_allclose(poses[3:, :3, 3], [[-0.28, -0.12, 0.03]] * 2, atol=1e-3)
    np.testing.assert_array_equal(poses[3], poses[4])
    # It moves with the hand.
    hands = [moved.scene.with_configuration("arm", moved.trajectory(t)).link_poses()["arm/tool"] for t in times[1:4]]
    grips = [np.linalg.inv(hand) @ pose for hand, pose in zip(hands, poses[1:4], strict=True)]
    np.testing.assert_allclose(grips, [grips[0]] * 3, atol=1e-9)


def test_a_line_by_an_offset_is_straight_and_keeps_the_orientation(table: rp.Scene) -> None:
    start = rp.FreeMotion(tool_down(-0.3, 0.0, 0.15))
    plan = plan_of(
        table, start, rp.StraightLine(offset=[-0.03, 0.04, 0.0]), rp.StraightLine(offset=[0, 0, -0.02], axes="tool")
    )
    assert plan, plan
    kinematics = rp.Kinematics(plan.scene)
    poses = [
        kinematics.pose(plan.trajectory(t), "tool") for t in np.linspace(plan.stages[1].begin, plan.stages[1].end, 20)
    ]
    np.testing.assert_allclose(poses[-1][:3, 3] - poses[0][:3, 3], [-0.03, 0.04, 0.0], atol=1e-4)
    away = np.array([p[:3, 3] - poses[0][:3, 3] for p in poses])
    direction = np.array([-0.03, 0.04, 0.0]) / 0.05
    assert np.linalg.norm(away - np.outer(away @ direction, direction), axis=1).max() < 1.1e-3
    np.testing.assert_allclose([p[:3, :3] for p in poses], [poses[0][:3, :3]] * 20, atol=2e-2)
    # Along the tool's own axis, which points down, and backwards.
    end = kinematics.pose(plan.trajectory(plan.trajectory.end_time), "tool")
    np.testing.assert_allclose(end[:3, 3] - poses[-1][:3, 3], [0, 0, 0.02], atol=1e-3)


def test_a_gripper_moves_while_its_arm_stands_still(table: rp.Scene) -> None:
    plan = plan_of(
        table, rp.MoveGripper("open", seconds=0.7), rp.MoveGripper(0.2), rp.MoveGripper(0.2), rp.MoveGripper(width=0.04)
    )
    assert plan, plan
    assert [stage.label for stage in plan.stages[:2]] == ["gripper to 'open'", "gripper joint to 0.2 rad"]
    ends = [plan.trajectory(stage.end) for stage in plan.stages]
    np.testing.assert_allclose([q[-1] for q in ends[:3]], [0.9, 0.2, 0.2])
    assert plan.stages[0].end == pytest.approx(0.7)
    assert plan.stages[2].end - plan.stages[2].begin == pytest.approx(0.4)
    arms = plan.trajectory(np.linspace(0, plan.trajectory.end_time, 50))[:, :-1]
    np.testing.assert_array_equal(arms, [plan.scene.arms["arm"].q[:-1]] * 50)


def test_a_gripper_that_is_already_there_takes_its_time(table: rp.Scene) -> None:
    closed = table.arms["arm"].robot.locked_joints["finger_joint"]
    plan = plan_of(table, rp.MoveGripper(closed, seconds=1.0), rp.MoveGripper(closed, seconds=0.0))
    assert plan, plan
    assert [stage.end for stage in plan.stages] == [1.0, 1.0]
    wall = table.with_obstacle("wall", rp.Box((0.1, 0.1, 0.1)), table.link_poses()["arm/tool"][:3, 3])
    assert "the start is in collision" in plan_of(wall, rp.MoveGripper(closed)).reason


def test_a_width_is_that_of_a_block_between_the_fingers(table: rp.Scene, moved: rp.SequencePlan) -> None:
    """Closing on a block 40 mm wide goes beyond the width of 40 mm by the squeeze."""
    closed = moved.trajectory(moved.events[0].begin)[-1]
    width = plan_of(table, rp.MoveGripper(width=0.04)).trajectory
    at_width = width(width.end_time)[-1]
    assert 0.0 < at_width - closed < 0.05
    other = [
        replace(s, squeeze=0.0) if isinstance(s, rp.MoveGripper) and s.around else s for s in moved.sequence.segments
    ]
    gentle = plan_of(table, *other)
    assert gentle.trajectory(gentle.events[0].begin)[-1] == pytest.approx(at_width, abs=2e-3)


def test_a_pause_is_a_rest(table: rp.Scene) -> None:
    plan = plan_of(table, rp.Pause(0.25), rp.FreeMotion("raised"), rp.Pause(0.5))
    assert plan
    assert plan.stages[0].end == 0.25
    last = plan.stages[-1]
    assert last.end - last.begin == pytest.approx(0.5)
    np.testing.assert_array_equal(plan.trajectory(last.begin), plan.trajectory(last.end))
    np.testing.assert_allclose(plan.trajectory(last.end), table.arms["arm"].robot.configurations["raised"])


def test_two_arms_move_at_once(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", rr1).with_arm("right", rr1, [0.0, 1.5, 0.0])
    plan = plan_of(scene, rp.FreeMotion({"left": "raised", "right": "zero"}), rp.FreeMotion("home", arm="right"))
    assert plan, plan
    both = plan.trajectory(plan.stages[0].end)
    np.testing.assert_allclose(both, [*rr1.configurations["raised"], *rr1.configurations["zero"]])
    np.testing.assert_allclose(plan.trajectory(plan.trajectory.end_time)[6:], rr1.home)


def test_an_object_goes_from_one_hand_to_the_other(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", rr1).with_arm("right", rr1, [0.0, 1.5, 0.0])
    tool = scene.link_poses()["left/tool"]
    scene = scene.with_obstacle("ring", rp.Sphere(0.007), tool)
    segments = [rp.Attach("ring", arm="left"), rp.FreeMotion("raised", arm="left"), rp.Detach("ring")]
    plan = plan_of(scene, *segments, rp.Attach("ring", arm="right"), rp.FreeMotion("raised", arm="right"))
    assert plan, plan
    holders = [held.arm for s in plan.scenes() for held in s.attachments.values()]
    assert holders == ["left", "left", "right", "right"]
    taken, given = plan.object_poses("ring", [plan.stages[1].end, plan.stages[3].begin])
    np.testing.assert_allclose(taken, given, atol=1e-9)


# ---- candidates ----------------------------------------------------------------------------------


def test_where_the_line_after_the_nearest_goal_is_blocked_the_next_goal_is_taken(table: rp.Scene) -> None:
    """A post is under the nearer goal, so the tool can only descend from the other one."""
    near, far = tool_down(-0.3, 0.0, 0.2), tool_down(-0.3, -0.15, 0.2)
    down = rp.StraightLine(offset=[0.0, 0.0, -0.1])
    free = plan_of(table, rp.FreeMotion([near, far]), down)
    assert free, free
    kinematics = rp.Kinematics(free.scene)
    np.testing.assert_allclose(
        kinematics.pose(free.trajectory(free.stages[0].end), "tool")[:3, 3], near.position, atol=1e-3
    )
    blocked = table.with_obstacle("post", rp.Box((0.05, 0.05, 0.1)), [-0.3, 0.0, 0.05])
    assert not plan_of(blocked, rp.FreeMotion(near), down).found
    plan = plan_of(blocked, rp.FreeMotion([near, far]), down)
    assert plan, plan
    np.testing.assert_allclose(
        kinematics.pose(plan.trajectory(plan.stages[0].end), "tool")[:3, 3], far.position, atol=1e-3
    )


def test_a_grasp_is_chosen_for_what_comes_after_it(table: rp.Scene) -> None:
    """At its new place the block is between two walls, where fingers fit along x only."""
    place = rp.transforms.pose([-0.3, -0.1, 0.03])
    slot = table
    for side in (-1, 1):
        slot = slot.with_obstacle(f"wall{side}", rp.Box((0.1, 0.02, 0.06)), [-0.3, -0.1 + side * 0.036, 0.03])
    grasps = rp.top_grasps(slot, "block")
    along_y = [goal for goal in grasps if abs(goal.rotation[1, 0]) > 0.9]
    along_x = [goal for goal in grasps if abs(goal.rotation[0, 0]) > 0.9]
    assert len(along_x) + len(along_y) == len(grasps)
    hopeless = plan_of(slot, *rp.pick_and_place(slot, "block", place, grasps=along_y))
    assert not hopeless.found
    assert hopeless.failed in (7, 9)
    plan = plan_of(slot, *rp.pick_and_place(slot, "block", place, grasps=[*along_y, *along_x]))
    assert plan, plan


def inside_the_hand(rr1: rp.Robot, touch: tuple[str, ...]) -> rp.Scene:
    """An arm that holds a box, which overlaps its wrist too."""
    scene = rp.Scene().with_arm("arm", rr1)
    scene = scene.with_obstacle("box", rp.Box((0.05, 0.05, 0.05)), scene.link_poses()["arm/hand_link"])
    return scene.attach("box", touch=touch)


def test_a_release_at_the_end_is_checked(rr1: rp.Robot) -> None:
    scene = inside_the_hand(rr1, rr1.link_names)
    plan = plan_of(scene, rp.FreeMotion("raised"), rp.Detach("box"))
    assert not plan.found
    assert plan.failed == 1
    assert "'arm/wrist_link' and 'box' overlap" in plan.reason
    # While the object is held, the wrist may touch it.
    assert plan_of(scene, rp.FreeMotion("raised"))
    assert plan_of(scene.allow("arm/wrist_link", "box"), rp.FreeMotion("raised"), rp.Detach("box"))


@pytest.mark.parametrize("segments", [[rp.Attach("block")], [rp.Attach("block"), rp.Detach("block")]])
def test_a_sequence_without_motion_is_checked(table: rp.Scene, segments: list[rp.Segment]) -> None:
    plan = rp.plan_sequence(rp.Sequence(table, segments), rng=0)
    assert plan.found
    assert plan.report.valid
    assert "collision" in plan.report.checked
    inside = table.with_obstacle("wall", rp.Box((0.3, 0.3, 0.3)), [0.0, 0.0, 0.4])
    blocked = rp.plan_sequence(rp.Sequence(inside, segments), rng=0)
    assert not blocked.found
    assert blocked.failed == len(segments) - 1
    assert "'wall' overlap" in blocked.reason
    report = validate_stages(plan.trajectory, inside, plan.stages)
    assert "collision" in {violation.kind for violation in report.violations}


def test_fingers_may_squeeze_what_they_release_at_the_end(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    ring = scene.with_obstacle("ring", rp.Sphere(0.02), scene.link_poses()["arm/tool"])
    hand = ("finger_link", "opposite_finger_link", "hand_link")
    assert plan_of(ring.attach("ring", touch=hand), rp.FreeMotion("raised"), rp.Detach("ring"))
    assert not plan_of(ring.attach("ring", touch=hand), rp.FreeMotion("raised"), rp.Detach("ring"), rp.Pause(0.1)).found


def test_a_pause_in_collision_leads_to_the_next_goal(table: rp.Scene) -> None:
    """The nearer goal is inside a jig that the arm may touch during the motion, but not during the pause."""
    near, far = tool_down(-0.3, 0.0, 0.2), tool_down(-0.3, -0.15, 0.2)
    jig = table.with_obstacle("jig", rp.Box((0.05, 0.05, 0.05)), [-0.3, 0.0, 0.2])
    plan = plan_of(jig, rp.FreeMotion([near, far], allow=[("arm", "jig")]), rp.Pause(0.1))
    assert plan, plan
    end = rp.Kinematics(plan.scene).pose(plan.trajectory(plan.trajectory.end_time), "tool")
    np.testing.assert_allclose(end[:3, 3], far.position, atol=1e-3)


def test_a_pose_is_reached_a_turn_away_where_the_way_to_the_nearest_configurations_is_blocked() -> None:
    arm = rp.planar_arm("RR", limits=[(-6.2, 6.2)] * 2)
    scene = rp.Scene().with_arm("arm", arm, q=[0.1, 0.1]).with_obstacle("post", rp.Sphere(0.05), [0.3, 0.3, 0.0])
    tip = arm.link_poses([2.0, 0.4])[arm.tool][:3, 3]
    plan = plan_of(scene, rp.FreeMotion(rp.PoseGoal("tool", tip)), rp.Pause(0.1))
    assert plan, plan
    assert plan.trajectory(plan.trajectory.end_time)[0] < -np.pi
    # A configuration is reached as it is.
    there = plan_of(scene, rp.FreeMotion([2.0, 0.4]))
    assert not there.found
    assert "joint 'arm/joint1' cannot pass" in there.reason


# ---- failures ------------------------------------------------------------------------------------


def test_a_wall_before_a_chosen_configuration_is_no_proof_for_its_pose() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r_limited"), q=(0.8, 0.0))
    scene = scene.with_obstacle("wall", rp.Box((0.1, 0.02, 0.4)), (0.35, 0.0, 0.0))
    behind = [-0.7, 0.1]
    tool = rp.Kinematics(scene).pose(behind, "tool")[:3, 3]
    proof = "no path exists: joint 'arm/joint1' cannot pass"
    for goal, says in ((behind, proof), (rp.PoseGoal("tool", tool), f"to the configuration that was chosen, {proof}")):
        plan = plan_of(scene, rp.FreeMotion(goal))
        assert plan.status is rp.PlanStatus.INFEASIBLE
        assert f"not found: {says}" in plan.reason


def test_a_failure_names_the_segment_and_the_reason(table: rp.Scene) -> None:
    plan = plan_of(
        table, rp.FreeMotion(tool_down(-0.3, 0.0, 0.2)), rp.Pause(0.1), rp.StraightLine(offset=[0.0, 0.0, -0.3])
    )
    assert not plan.found
    assert not plan.valid
    assert not plan
    assert plan.failed == 2
    assert plan.status is rp.PlanStatus.INFEASIBLE
    assert plan.reason.startswith("segment 3 (straight line 300 mm down) not found: ")
    assert "'table'" in plan.reason
    assert str(plan) == f"no plan (infeasible): {plan.reason}"
    for ask in (lambda: plan.trajectory, lambda: plan.report, plan.scenes, plan.size):
        with pytest.raises(rp.NoPlanError, match="segment 3"):
            ask()


@pytest.mark.parametrize(
    ("segments", "failed", "said"),
    [
        ([rp.FreeMotion(tool_down(-2.0, 0.0, 0.2))], 0, "out of reach"),
        ([rp.FreeMotion([tool_down(-2.0, 0.0, 0.2), tool_down(-3.0, 0.0, 0.2)])], 0, "of 2 goals, the first"),
        ([rp.Pause(0.1), rp.MoveGripper(around="block")], 1, "fingers close without touching"),
        ([rp.MoveGripper(width=0.5)], 0, "do not open for 500 mm"),
        ([rp.Attach("table"), rp.FreeMotion("raised")], 1, "start is in collision"),
    ],
)
def test_reasons(table: rp.Scene, segments: list, failed: int, said: str) -> None:
    plan = plan_of(table, *segments)
    assert plan.failed == failed
    assert said in plan.reason
    assert plan.reason.startswith(f"segment {failed + 1} (")


def test_fingers_that_open_against_a_neighbor_are_refused(table: rp.Scene) -> None:
    T = table.link_poses()["arm/tool"]
    beside = table.with_obstacle("wall", rp.Box((0.01, 0.05, 0.05)), T @ rp.transforms.pose([0.041, 0.0, 0.02]))
    plan = plan_of(beside, rp.MoveGripper("open"))
    assert plan.reason.startswith("segment 1 (gripper to 'open') not found: collision: ")
    assert "'wall'" in plan.reason
    assert plan_of(beside, rp.MoveGripper("open", allow=[("arm", "wall")]))


@pytest.mark.parametrize(
    "segment", [rp.MoveGripper("open"), rp.FreeMotion("home"), rp.StraightLine(offset=[0, 0, 0.02])]
)
def test_a_start_in_collision_is_named(
    table: rp.Scene, segment: rp.MoveGripper | rp.FreeMotion | rp.StraightLine
) -> None:
    T = table.link_poses()["arm/tool"]
    plan = plan_of(table.with_obstacle("wall", rp.Box((0.3, 0.3, 0.02)), T[:3, 3]), segment)
    assert plan.status is rp.PlanStatus.INVALID_START
    assert "the start is in collision: " in plan.reason
    assert "'wall'" in plan.reason


def test_a_sequence_may_be_longer_than_the_stack_is_deep(table: rp.Scene) -> None:
    """Every segment of a sequence is a choice, and Python allows 1000 nested calls by default."""
    pauses = [rp.Pause(0.01)] * 995
    plan = rp.plan_sequence(rp.Sequence(table, [*pauses, rp.FreeMotion("raised")]), rng=0)
    assert plan.found, plan.reason
    assert len(plan.stages) == 996


def test_a_budget_ends_the_search(table: rp.Scene) -> None:
    segments = rp.pick_and_place(table, "block", [-0.28, -0.12, 0.03])
    plan = plan_of(table, *segments, budget=rp.Budget(np.inf, iterations=1))
    assert plan.status is rp.PlanStatus.TIMEOUT
    assert "out of budget" in plan.reason


def test_progress_names_segments_and_cancels(table: rp.Scene) -> None:
    stages: list[str] = []

    def watch(progress: rp.Progress) -> bool:
        stages.append(progress.stage)
        return "segment 2" not in progress.stage

    plan = plan_of(table, rp.FreeMotion("raised"), rp.FreeMotion("home"), progress=watch)
    assert plan.status is rp.PlanStatus.CANCELLED
    assert stages[0] == "segment 1 (free motion to 'raised')"
    assert not plan.found


def test_the_same_seed_gives_the_same_motion(table: rp.Scene, moved: rp.SequencePlan) -> None:
    again = rp.plan_sequence(moved.sequence, rng=0, budget=rp.Budget(np.inf, iterations=1_000_000))
    np.testing.assert_array_equal(again.trajectory.breaks, moved.trajectory.breaks)
    np.testing.assert_array_equal(again.trajectory.coefficients, moved.trajectory.coefficients)
    assert [s.label for s in again.stages] == [s.label for s in moved.stages]


def test_jerk_limits_are_kept_where_the_retiming_does(table: rp.Scene) -> None:
    plan = plan_of(table, rp.FreeMotion("raised"), rp.MoveGripper("open"), retiming="ruckig")
    assert plan, plan
    assert "jerk" in plan.report.checked


def test_a_free_motion_that_is_not_found_is_named_when_the_budget_ends() -> None:
    """The goal of the lesson without a path is free, so only the budget ends the rounds."""
    scene = rp.load_scene("planar2r_no_path")
    problem = next(iter(rp.load_problems("planar2r_no_path").values()))
    arm = problem.arms[0]
    start = scene.with_configuration(arm, problem.start)
    budget = rp.Budget(np.inf, iterations=20_000)
    plan = plan_of(start, rp.Pause(0.1), rp.FreeMotion(list(problem.goal[arm])), budget=budget)
    assert plan.status is rp.PlanStatus.TIMEOUT
    assert plan.failed == 1
    assert plan.reason.startswith("segment 2 (free motion to a configuration) not found: ")
    assert "out of budget" in plan.reason


def test_pauses_too_short_for_the_clock_are_planned(table: rp.Scene) -> None:
    plan = plan_of(table, rp.Pause(1.0), rp.Pause(1e-20), rp.MoveGripper(0.0, seconds=1e-20), rp.Pause(1.0))
    assert plan, plan
    assert plan.trajectory.duration == 2.0
    assert len(plan.stages) == 4


def test_a_gripper_that_is_nearly_at_its_position_moves_for_its_least_duration(table: rp.Scene) -> None:
    plan = plan_of(table, rp.Pause(1.0), rp.MoveGripper(1e-13, seconds=0.3))
    assert plan, plan
    assert plan.trajectory.duration == pytest.approx(1.3)


def test_alternatives_may_be_arrays(table: rp.Scene) -> None:
    robot = table.arms["arm"].robot
    beyond, near = robot.home.copy(), robot.home.copy()
    beyond[0], near[0] = 9.0, 0.3
    goals = [beyond, near]
    assert rp.FreeMotion(goals).label == "free motion to one of 2 goals"
    assert len(rp.Problem(table, None, {"arm": goals}).goal["arm"]) == 2
    for goal in (goals, {"arm": goals}):
        plan = plan_of(table, rp.FreeMotion(goal))
        assert plan, plan
        np.testing.assert_allclose(plan.trajectory(plan.trajectory.end_time), near, atol=1e-9)
