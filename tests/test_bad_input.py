"""Wrong calls through the public names: each raises our own error, whose message names the fault."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp

NAN = float("nan")
BOX = rp.Box((0.1, 0.1, 0.1))


@pytest.fixture
def scene(planar2r: rp.Robot) -> rp.Scene:
    return rp.Scene().with_arm("arm", planar2r)


def resting(scene: rp.Scene, seconds: float) -> rp.Trajectory:
    return rp.Trajectory.rest(scene.joint_names(), scene.configuration(), duration=seconds)


WRONG: dict[str, tuple[Callable[[rp.Scene], Any], type[Exception], str]] = {
    "goal_of_nan": (lambda s: rp.Problem(s, "home", [NAN, 0]), rp.InputError, "joint joint1"),
    "goal_of_text": (lambda s: rp.Problem(s, "home", rp.JointGoal(["1", "2"])), rp.InputError, "joint1, joint2"),
    "goal_beyond_reason": (lambda s: rp.Problem(s, "home", [1e300, 0]), rp.InputError, "joint joint1"),
    "no_scene": (lambda s: rp.Problem("rr1_table", "home", "home"), rp.InputError, "; load one with load_scene"),
    "kinematics_of_text": (lambda s: rp.Kinematics("rr1"), rp.InputError, "expected Scene; load one with load_scene"),
    "ik_of_a_robot": (
        lambda s: rp.solve_ik(s.arms["arm"].robot, rp.PoseGoal("tool", [0, 0, 0])),
        rp.InputError,
        r"expected Kinematics, e.g. Kinematics\(scene\)",
    ),
    "replay_of_a_file": (lambda s: rp.simulate("m.json", s), rp.InputError, "load one with load_motion"),
    "segments_alone": (lambda s: rp.plan_sequence([]), rp.InputError, r"e.g. Sequence\(scene, segments\)"),
    "budget_of_many": (lambda s: rp.plan_many([], budget=2.0), rp.InputError, r"e.g. Budget\(seconds=5\)"),
    "name_as_q": (
        lambda s: rp.CollisionChecker(s).is_free("home"),
        rp.InputError,
        r"'home'; robot.configuration\(name\) has the numbers",
    ),
    "columns_of_a_robot": (
        lambda s: rp.validate(rp.Trajectory.rest(["joint1", "joint2"], [0, 0]), s),
        rp.InputError,
        "a joint is named 'arm/joint1'; see scene.joint_names",
    ),
    "points_as_obstacle": (
        lambda s: s.with_obstacle("scan", np.zeros((5, 3))),
        rp.InputError,
        r"PointCloud\(points, resolution\)",
    ),
    "complex_start": (lambda s: rp.Problem(s, [1j, 0], "home"), rp.InputError, "joint joint1"),
    "complex_pose": (lambda s: rp.PoseGoal("tool", [1j, 0, 0]), rp.InputError, "not an array of numbers"),
    "start_of_a_generator": (lambda s: rp.Problem(s, (k for k in "ab"), "home"), rp.InputError, "is <generator"),
    "start_by_joint": (lambda s: rp.Problem(s, {"joint1": 0.1}, "home"), rp.InputError, "names the joint 'joint1'"),
    "goal_by_joint": (
        lambda s: rp.Problem(s, "home", {"arm/joint1": 0.1}),
        rp.InputError,
        r"goal names the joint 'arm/joint1', expected a mapping from arm .* \{'arm': ",
    ),
    "goal_position": (lambda s: rp.Problem(s, "home", [1.0, 0.5, 0.0]), rp.InputError, "position .* give PoseGoal"),
    "goal_matrix": (
        lambda s: rp.Problem(s, "home", np.eye(4)),
        rp.InputError,
        r"pose give PoseGoal\('tool', ...\), in a scene file { frame = \"tool\", position = ",
    ),
    "arms_number": (lambda s: rp.Problem(s, "home", "home", arms=3), rp.InputError, "sequence of names"),
    "checker_of_no_arms": (lambda s: rp.CollisionChecker(rp.Scene()), rp.InputError, "the scene has no arm"),
    "kinematics_of_no_arms": (lambda s: rp.Kinematics(rp.Scene()), rp.InputError, "the scene has no arm"),
    "arms_of_model": (lambda s: rp.CollisionChecker(s, 3), rp.InputError, "sequence of names"),
    "roadmap_arms": (lambda s: rp.Roadmap(s, 3), rp.InputError, "sequence of names"),
    "flat_mesh_in_the_hand": (
        lambda s: rp.CollisionChecker(
            s.with_obstacle("sheet", rp.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2]])).attach("sheet")
        ),
        rp.InputError,
        "shape of 'sheet'.*flat",
    ),
    "no_problem": (lambda s: rp.plan_motion(None), rp.InputError, "expected Problem"),
    "usd_robot": (lambda s: rp.load_robot("a.usd"), rp.InputError, "'.usd', expected .urdf, .xacro or .xml .*export"),
    "sdf_scene": (lambda s: rp.load_scene("a.sdf"), rp.InputError, "'.sdf', expected one of .toml.*sdformat-mjcf"),
    "sdf_robot": (lambda s: rp.load_robot("a.sdf"), rp.InputError, "'.sdf', expected .urdf.*sdformat-mjcf"),
    "budget_text": (lambda s: rp.Budget("5"), rp.InputError, "seconds of the budget .* '5'"),
    "configuration_durations": (
        lambda s: rp.load_robot("rr1").configuration([np.timedelta64(1, "s")] * 6),
        rp.InputError,
        "expected finite numbers",
    ),
    "far_configuration": (
        lambda s: s.arms["arm"].robot.configuration(np.array([0, 1e9])),
        rp.InputError,
        r"configuration is \[0.0, 1000000000.0\], expected finite numbers within",
    ),
    "nested_step": (lambda s: resting(s, 1.0).sample([[0.1]]), rp.InputError, r"shape \(1, 1\), expected a number"),
    "derivative_duration": (
        lambda s: rp.Trajectory.rest(["a/x"], [0.0])(0.0, np.timedelta64(1, "s")),
        rp.InputError,
        "expected a whole number",
    ),
    "budget_duration": (lambda s: rp.Budget(np.timedelta64(1, "s")), rp.InputError, "budget is not a number"),
    "budget_fraction": (lambda s: rp.Budget(1, 1.5), rp.InputError, "iterations of the budget is 1.5"),
    "budget_true": (lambda s: rp.Budget(1, True), rp.InputError, "iterations of the budget is True"),
    "budget_number": (lambda s: rp.plan(rp.Problem(s, "home", "zero"), budget=5), rp.InputError, "expected Budget"),
    "planner_none": (lambda s: rp.plan(rp.Problem(s, "home", "zero"), planner=None), rp.InputError, "planner"),
    "far_pose": (lambda s: rp.PoseGoal("tool", [1e300, 0, 0]), rp.InputError, "goal position"),
    "far_obstacle": (lambda s: s.with_obstacle("box", BOX, [1e10, 0, 0]), rp.InputError, "at most 10000"),
    "huge_box": (lambda s: rp.Box((1e7, 1, 1)), rp.InputError, "box size"),
    "huge_normal": (lambda s: rp.HalfSpace((0, 0, 1e200)), rp.InputError, "expected a direction"),
    "shape_of_text": (lambda s: s.with_obstacle("box", "box"), rp.InputError, "got 'box' .*expected a shape"),
    "shape_of_a_file": (lambda s: s.with_obstacle("mug", Path("mug.stl")), rp.InputError, "load_mesh reads"),
    "shape_of_numbers": (lambda s: s.with_obstacle("b", (0.1, 0.1, 0.1)), rp.InputError, r"got \(0.1, 0.1, 0.1\)"),
    "shape_obstacle": (
        lambda s: s.with_obstacle("box", rp.Obstacle([rp.Geometry("box", rp.Sphere(0.1), np.eye(4))])),
        rp.InputError,
        r"with_obstacles\({name: obstacle}\) adds an Obstacle",
    ),
    "none_in_a_shape": (lambda s: rp.Box((0.1, None, 0.1)), rp.InputError, r"size\[1\] is None, expected a finite"),
    "none_in_a_pose": (lambda s: rp.transforms.as_pose([0, None, 0]), rp.InputError, r"pose\[1\] is None, expected"),
    "shape_none": (lambda s: s.with_obstacle("box", None), rp.InputError, "expected a shape"),
    "bare_shapes": (lambda s: s.with_obstacle("box", [BOX]), rp.InputError, "expected a shape"),
    "name_with_nul": (lambda s: s.with_obstacle("a\0b", BOX), rp.InputError, "printable"),
    "no_robot": (lambda s: s.with_arm("other", "rr1"), rp.InputError, "expected Robot; load one with load_robot"),
    "padding_of_an_element_and_itself": (
        lambda s: s.with_padding(0.1, "arm/link1", "arm/link1"),
        rp.InputError,
        "the element 'arm/link1' twice",
    ),
    "class_of_a_controller": (
        lambda s: rp.Simulation(s).activate(rp.JointTrajectoryController),
        rp.InputError,
        r"the class JointTrajectoryController, expected an object of it, as JointTrajectoryController\(...\)",
    ),
    "padding_text": (lambda s: s.with_padding("1"), rp.InputError, "padding"),
    "allow_itself": (lambda s: s.allow("arm", "arm"), rp.InputError, "twice"),
    "limits_none": (lambda s: s.arms["arm"].robot.with_limits(None), rp.InputError, "preset"),
    "limits_text": (lambda s: rp.Limits(["a"], [1], [1], [1], [1], [1]), rp.InputError, "lower"),
    "limits_short": (
        lambda s: replace(s.arms["arm"].robot.limits, jerk=[5.0]),
        rp.InputError,
        "jerk has 1 number, expected 2, as lower has",
    ),
    "limits_scalar": (
        lambda s: replace(s.arms["arm"].robot.limits, jerk=5.0),
        rp.InputError,
        "jerk is 5.0, expected a list of numbers",
    ),
    "validate_path": (
        lambda s: rp.validate(rp.Path(s.joint_names(), [[0, 0]]), s),
        rp.InputError,
        "expected Trajectory",
    ),
    "timed_scene": (lambda s: rp.TimedChecker(s, {}), rp.InputError, r"e.g. CollisionChecker\(scene\)"),
    "opinion_on_a_plan": (
        lambda s: rp.second_opinion(rp.plan_motion(rp.Problem(s, "home", "zero"), rng=0), s),
        rp.InputError,
        "expected Trajectory; pass its attribute 'trajectory'",
    ),
    "validate_nowhere": (lambda s: rp.validate(resting(s, 1.0), "x"), rp.InputError, "expected Scene"),
    "replay_nowhere": (lambda s: rp.simulate(resting(s, 1.0), None), rp.InputError, "expected Scene"),
    "endless_replay": (lambda s: rp.simulate(resting(s, 1e6), s), rp.InputError, "longer steps"),
    "samples_too_fine": (lambda s: resting(s, 1.0).sample(1e-300), rp.InputError, "samples"),
    "half_derivative": (lambda s: resting(s, 1.0)(0.0, 1.5), rp.InputError, "derivative"),
    "far_waypoint": (lambda s: rp.Path(s.joint_names(), [[1e300, 0]]), rp.InputError, "waypoints"),
    "validate_no_problem": (lambda s: rp.validate(resting(s, 1.0), s, 3), rp.InputError, "expected Problem"),
    "certify_number": (lambda s: rp.certify_path(3, s), rp.InputError, "expected Path"),
    "planner_of_text": (lambda s: rp.OmplPlanner("rrt").plan("x"), rp.InputError, "expected Problem"),
    "line_of_nothing": (lambda s: rp.CartesianPlanner().plan(None), rp.InputError, "expected Problem"),
    "page_of_text": (lambda s: rp.save_html("a.html", "rr1"), rp.InputError, "'rr1' has no page, expected a scene"),
    "page_of_an_arm": (
        lambda s: rp.show(rp.Problem(s, "home", "zero")),
        rp.InputError,
        "attribute 'scene'",
    ),
    "page_of_nothing": (lambda s: rp.show(None), rp.InputError, "expected Scene"),
    "page_of_a_path": (
        lambda s: rp.save_html("a.html", s, trajectory=rp.Path(s.joint_names(), [[0, 0]])),
        rp.InputError,
        "expected Trajectory",
    ),
    "picture_of_text": (lambda s: rp.cspace("rr1"), rp.InputError, "expected Scene"),
    "goal_of_nothing": (lambda s: rp.solve_ik(None, rp.PoseGoal("tool", [0, 0, 0])), rp.InputError, "Kinematics"),
    "result_of_no_problem": (
        lambda s: rp.cspace(s, result=rp.plan(rp.Problem(s, "home", "zero"), rng=0)),
        rp.InputError,
        "a result is drawn with its problem",
    ),
    "attempts_text": (
        lambda s: rp.solve_ik(rp.Kinematics(s), rp.PoseGoal("tool", [0, 0, 0]), attempts="9"),
        rp.InputError,
        "attempts is '9'",
    ),
    "retiming_number": (lambda s: rp.plan_motion(rp.Problem(s, "home", "zero"), retiming=3), rp.InputError, "retiming"),
    "joints_number": (lambda s: rp.load_robot("rr1", joints=3), rp.InputError, "joints is 3"),
    "panels_number": (lambda s: rp.save_html("a.html", s, options=rp.ViewOptions(panels=3)), rp.InputError, "panels"),
    "folder_missing": (
        lambda s: rp.load_robot("rr1", package_dirs=["not_there"]),
        rp.InputError,
        "package_dirs names 'not_there', which is not a folder",
    ),
    "folders_text": (lambda s: rp.load_robot("rr1", package_dirs="here"), rp.InputError, "list of folders"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_call_is_refused_in_words(case: str, scene: rp.Scene) -> None:
    call, error, words = WRONG[case]
    with pytest.raises(error, match=words):
        call(scene)


FILE_VERBS: dict[str, Callable[[Any, rp.Scene], Any]] = {
    "load_robot": lambda f, s: rp.load_robot(f),
    "load_scene": lambda f, s: rp.load_scene(f),
    "load_problems": lambda f, s: rp.load_problems(f),
    "load_motion": lambda f, s: rp.load_motion(f),
    "load_csv": lambda f, s: rp.load_csv(f),
    "srdf": lambda f, s: rp.load_robot("rr1", srdf=f),
    "save_motion": lambda f, s: rp.save_motion(f, s),
    "save_csv": lambda f, s: rp.save_csv(f, resting(s, 1.0)),
    "save_scene": lambda f, s: rp.save_scene(f, s),
    "save_html": lambda f, s: rp.save_html(f, s),
    "save_mjcf": lambda f, s: rp.save_mjcf(f, s),
    "save_rosbag": lambda f, s: rp.save_rosbag(f, resting(s, 1.0)),
    "save_glb": lambda f, s: rp.save_glb(f, s),
    "video_of": lambda f, s: rp.save_video("a.gif", f),
    "video_to": lambda f, s: rp.save_video(f, "a.html"),
    "screenshot_of": lambda f, s: rp.screenshot("a.png", f),
    "screenshot_to": lambda f, s: rp.screenshot(f, "a.html"),
}


@pytest.mark.parametrize("verb", FILE_VERBS)
def test_what_is_no_file_name_is_refused_in_words(verb: str, scene: rp.Scene, tmp_path: Path) -> None:
    wrong = [3, 1.5, [1], b"x", "", "a\0b", tmp_path / ("x" * 300)]
    # Without an SRDF argument, the file next to the robot is used.
    for name in wrong if verb == "srdf" else [None, *wrong]:
        with pytest.raises(rp.InputError, match="file name"):
            FILE_VERBS[verb](name, scene)


@pytest.mark.parametrize("verb", [name for name in FILE_VERBS if name not in ("screenshot_to", "video_to")])
def test_a_folder_is_no_file(verb: str, scene: rp.Scene, tmp_path: Path) -> None:
    with pytest.raises(rp.InputError):
        FILE_VERBS[verb](tmp_path, scene)
    assert not list(tmp_path.iterdir())


def test_an_obstacle_may_be_called_world_in_the_replay(scene: rp.Scene) -> None:
    for name in ("world", "world#"):
        scene = scene.with_obstacle(name, BOX, [0, 0, 3])
    assert rp.simulate(resting(scene, 0.1), scene).free


def test_a_body_without_extent_can_be_replayed(tmp_path: Path) -> None:
    file = tmp_path / "point.urdf"
    file.write_text("""<robot name="point"><link name="base"/><link name="tip"><inertial><mass value="1e-9"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
      <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
      <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>""")
    scene = rp.Scene().with_arm("arm", rp.load_robot(file))
    assert rp.simulate(resting(scene, 0.1), scene).max_error.max() < 1e-6


def test_values_survive_the_way_to_another_process(scene: rp.Scene, tmp_path: Path) -> None:
    problem = rp.Problem(scene, "zero", [0.5, 0.5])
    motion = rp.plan_motion(problem, rng=0)
    file = tmp_path / "values.pickle"
    file.write_bytes(pickle.dumps((problem, motion.path, motion.trajectory, motion.report)))
    code = (
        "import pickle, sys, rr1plan as rp\n"
        "problem, path, trajectory, report = pickle.load(open(sys.argv[1], 'rb'))\n"
        "assert not path.waypoints.flags.writeable\n"
        "assert rp.validate(trajectory, problem.scene, problem).valid == report.valid\n"
        "print(problem.scene.content_hash)"
    )
    told = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == scene.content_hash


def test_a_seed_and_iterations_give_the_same_motion_in_two_processes() -> None:
    code = (
        "import hashlib, rr1plan as rp\n"
        "scene = rp.load_scene('rr1_table')\n"
        "problem = rp.Problem(scene, 'home', rp.PoseGoal('tool', [-0.30, 0.25, 0.20]))\n"
        "motion = rp.plan_motion(problem, rng=3, budget=rp.Budget(float('inf'), 5000))\n"
        "t = motion.trajectory\n"
        "print(hashlib.sha256(t.breaks.tobytes() + t.coefficients.tobytes()).hexdigest())"
    )
    told = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(2)]
    assert told[0].stdout == told[1].stdout != ""


def test_a_motion_of_nothing_is_solved_at_once(scene: rp.Scene) -> None:
    motion = rp.plan_motion(rp.Problem(scene, np.zeros(2), np.zeros(2)), rng=0)
    assert motion.valid
    assert motion.trajectory.duration == 0.0


def test_an_error_names_the_attribute_that_holds_the_wanted_value() -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    motion = rp.plan_motion(rp.Problem(scene, [0.0, 0.5], [1.0, 1.0]), planner="many_arms", rng=0)
    with pytest.raises(rp.InputError, match="expected Trajectory; pass its attribute 'trajectory'"):
        rp.validate(motion, scene)
    with pytest.raises(rp.InputError, match="expected ManyArmsResult; pass its attribute 'many_arms'"):
        rp.plan_graph(motion)


def test_a_scene_of_a_robot_says_how_an_arm_is_added() -> None:
    with pytest.raises(rp.InputError, match=r"expected arms by name: try Scene\(\)\.with_arm\('arm', robot\)"):
        rp.Scene(rp.load_robot("planar2r"))


def test_an_error_names_the_method_that_keeps_the_motion(tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    motion = rp.plan_motion(rp.Problem(scene, [0.0, 0.5], [1.0, 1.0]), rng=0)
    with pytest.raises(rp.InputError, match="expected Scene; call its method 'save' instead"):
        rp.save_motion(tmp_path / "a.json", motion)
    with pytest.raises(rp.InputError, match="expected Scene; call its method 'show' instead"):
        rp.show(motion)
    with pytest.raises(rp.InputError, match="expected Scene; pass its attribute 'scene'"):
        rp.simulate(motion.trajectory, motion)


def test_a_page_is_written_from_any_value_that_has_one(tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    motion = rp.plan_motion(rp.Problem(scene, [0.0, 0.5], [1.0, 1.0]), rng=0)
    page = rp.save_html(tmp_path / "a.html", motion)
    assert page.read_bytes() == motion.save_html(tmp_path / "b.html").read_bytes()
    with pytest.raises(rp.InputError, match="trajectory is given together with a MotionPlan"):
        rp.save_html(page, motion, trajectory=motion.trajectory)
    with pytest.raises(rp.InputError, match="has no page"):
        rp.save_html(page, motion.trajectory)
