"""Every argument of every public function gets a list of wrong values: each is accepted, or raises our own error.

The calls below name each public function with valid arguments; a new public function has to be added. Then each
argument in turn is replaced by each wrong value. No function may raise an error of a library, write a message longer
than a page, or run for seconds.
"""

from __future__ import annotations

import contextlib
import enum
import inspect
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import rr1plan as rp
from rr1plan import planners, transforms

Call = tuple[Callable[..., Any], dict[str, Any]]


class InThisThread(Executor):
    """Runs a task immediately."""

    def submit(self, function: Any, /, *args: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*args, **options))
        return future


def deep_list(depth: int) -> list[Any]:
    nest: list[Any] = []
    for _ in range(depth):
        nest = [nest]
    return nest


ITSELF: list[Any] = []
ITSELF.append(ITSELF)

WRONG: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "True": lambda: True,
    "-1": lambda: -1,
    "0": lambda: 0,
    "1": lambda: 1,
    "2**31": lambda: 2**31,
    "2**63": lambda: 2**63,
    "10**5000": lambda: 10**5000,
    "0.5": lambda: 0.5,
    "nan": lambda: float("nan"),
    "inf": lambda: float("inf"),
    "1e300": lambda: 1e300,
    "1j": lambda: 1j,
    "empty text": lambda: "",
    "text": lambda: "nobody.txt",
    "long text": lambda: "x" * 100_000,
    "NUL": lambda: "a\0b",
    "half a character": lambda: "\ud800",
    "bytes": lambda: b"x",
    "object": object,
    "class": lambda: int,
    "empty list": list,
    "empty mapping": dict,
    "mapping": lambda: {"a": 1},
    "set": lambda: {1},
    "ragged list": lambda: [1, [2, 3]],
    "texts": lambda: ["a", "b"],
    "mixed": lambda: [1, "a", None],
    "itself": lambda: ITSELF,
    "deep list": lambda: deep_list(3000),
    "iterator": lambda: iter([1, 2]),
    "array of objects": lambda: np.array([None, {}], dtype=object),
    "array of NaN": lambda: np.full(2, np.nan),
    "empty array": lambda: np.zeros(0),
    "array of three axes": lambda: np.zeros((2, 3, 4)),
    "long array": lambda: np.zeros(100_000),
    "masked": lambda: np.ma.masked,
    "date": lambda: np.datetime64("2020-01-01"),
}
# Labels that only messages use.
_LABELS = {("transforms.as_pose", "name"), ("Robot.configuration", "name")}
# Names of robots, in arguments that are robots elsewhere.
_ROBOT_NAMES = {("Calibration", "robot")}


def teaching_calls() -> dict[str, Call]:
    """Calls of the functions behind lessons."""
    robot = rp.load_robot("planar2r")
    scene, q = rp.Scene().with_arm("arm", robot), np.zeros(2)
    problem = rp.Problem(scene, "home", [0.5, 0.5])
    path = rp.Path(scene.joint_names(), [[0.0, 0.0], [0.5, 0.5]])
    table, motion = rp.dh_table(robot), rp.seven_phases(1.0, 2.0, 8.0, 80.0)
    grown = {"problem": problem, "step": 0.3, "samples": 3, "rng": 0}
    return {
        "dh_table": (rp.dh_table, {"robot": robot}),
        "DhRow.matrix": (table.rows[0].matrix, {"value": 0.3}),
        "DhTable.frames": (table.frames, {"q": q}),
        "DhTable.pose": (table.pose, {"q": q}),
        "seven_phases": (rp.seven_phases, {"distance": 1.0, "velocity": 2.0, "acceleration": 8.0, "jerk": 80.0}),
        "SevenPhases.state": (motion.state, {"times": [0.0, 0.1]}),
        "phase_plane": (
            rp.phase_plane,
            {"path": path, "scene": scene, "max_blend": 0.1, "velocity_scale": 1.0, "acceleration_scale": 1.0},
        ),
        "search_lattice": (rp.search_lattice, {"problem": problem, "cells": 12, "weight": 1.0}),
        "grow_rrt": (rp.grow_rrt, grown | {"goal_bias": 0.1}),
        "grow_rrt_connect": (rp.grow_rrt_connect, grown),
        "grow_rrt_star": (rp.grow_rrt_star, grown | {"goal_bias": 0.1}),
        "grow_prm": (rp.grow_prm, {"problem": problem, "neighbors": 3, "longest": 1.0, "samples": 3, "rng": 0}),
    }


def calibration_calls(folder: Path) -> dict[str, Call]:
    """Calls of calibration functions."""
    robot = rp.load_robot("planar2r")
    scene, q = rp.Scene().with_arm("arm", robot), np.zeros(2)
    planar_q = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 2))
    planar_tools = np.array([robot.link_poses(each)[robot.tool][:3, 3] for each in planar_q])
    steps = rp.Calibration.assumed(robot)
    steps.save(folder / "c.toml")
    return {
        "calibrate": (
            rp.calibrate,
            {"robot": robot, "readings": planar_q, "positions": planar_tools, "start": None, "point": [0.0, 0.0, 0.0]}
            | {"noise": 1e-3, "free_base": False},
        ),
        "expected_calibration": (
            rp.expected_calibration,
            {"robot": robot, "poses": planar_q, "start": None, "point": [0.0, 0.0, 0.0], "noise": 1e-3}
            | {"free_base": False},
        ),
        "propose_calibration_poses": (
            rp.propose_calibration_poses,
            {"scene": scene, "count": 3, "arm": None, "point": [0.0, 0.0, 0.0], "rng": 0},
        ),
        "JointCalibration": (
            rp.JointCalibration,
            {"sign": 1, "zero": 0.0, "scale": 1.0, "zero_std": 0.1, "scale_std": 0.1, "position_unit": "m"},
        ),
        "Calibration": (
            rp.Calibration,
            {"robot": "a", "joints": dict(steps.joints), "unit": "rad", "date": "", "source": "", "fit": None},
        ),
        "Calibration.assumed": (rp.Calibration.assumed, {"robot": robot, "scale": 1.0, "unit": "rad"}),
        "Calibration.positions": (steps.positions, {"readings": q, "joint_names": None}),
        "Calibration.readings": (steps.readings, {"positions": q, "joint_names": None}),
        "Calibration.zero_shifts": (steps.zero_shifts, {"earlier": steps}),
        "Calibration.save": (steps.save, {"file": folder / "c2.toml"}),
        "load_calibration": (rp.load_calibration, {"file": folder / "c.toml"}),
    }


def silent() -> rp.ViewOptions:
    """Options of live pages that no browser opens."""
    return rp.ViewOptions(quiet=True)


def mirror_calls(scene: rp.Scene, trajectory: rp.Trajectory, folder: Path) -> dict[str, Call]:
    """Calls of mirrors and of manual control."""
    names, q = scene.joint_names(), np.zeros(2)
    state, corridor = rp.StateMessage(0.0, names, q), rp.certified_corridor(scene, trajectory)
    with rp.Mirror(scene, trajectory, record=folder / "mirror.jsonl") as mirror:
        mirror.receive(state)
    mirror = rp.Mirror(scene, trajectory)

    def taken(verb: str, **options: Any) -> None:
        hand = rp.ManualController(names)
        rp.Simulation(scene).activate(hand)
        getattr(hand, verb)(**options)

    def mirrored(**options: Any) -> None:
        rp.Mirror(**options).close()

    def mirror_shown(**options: Any) -> None:
        with rp.Mirror(scene) as shown:
            shown.show(**options)

    def listened(**options: Any) -> None:
        with rp.read_states(**options) as stream:
            next(stream)

    return {
        "ManualController": (rp.ManualController, {"joint_names": names, "speed": 0.5, "step": 0.1}),
        "ManualController.command": (partial(taken, "command"), {"positions": q}),
        "ManualController.move": (partial(taken, "move"), {"joint": names[0], "position": 0.1}),
        "ManualController.press": (partial(taken, "press"), {"key": "+"}),
        "StateMessage": (
            rp.StateMessage,
            {"time": 0.0, "joint_names": names, "positions": q, "received": None},
        ),
        "read_states": (listened, {"source": folder / "mirror.jsonl", "silence": 0.1, "topic": None}),
        "certified_corridor": (rp.certified_corridor, {"scene": scene, "trajectory": trajectory}),
        "Corridor.position": (corridor.position, {"q": q, "displacement": 0.0}),
        "Corridor.deviation": (corridor.deviation, {"q": q, "planned": q}),
        "Mirror": (
            mirrored,
            {"scene": scene, "plan": trajectory, "corridor": None, "start": None, "record": folder / "m.jsonl"}
            | {"on_event": None},
        ),
        "Mirror.receive": (mirror.receive, {"item": state}),
        "Mirror.run": (mirror.run, {"stream": [state], "duration": None}),
        "Mirror.show": (mirror_shown, {"options": silent()}),
    }


BOX = """
format = "rr1plan calibration"
version = 1
[control_box]
tick = 0.0006
[control_box.channels.S1]
joint = "joint1"
fast_period = 2
ramp_steps = 8
"""


def asserted(check: Callable[..., Any], **options: Any) -> None:
    """The motion fails, not the argument."""
    with contextlib.suppress(AssertionError):
        check(**options)


def cancelled(function: Callable[..., Any], **options: Any) -> None:
    """Arguments are checked, but no work is done: the progress callback cancels."""
    if options["progress"] is None:  # valid, and does not cancel
        return
    with contextlib.suppress(rp.CancelledError):
        function(**options)


def calls(folder: Path) -> dict[str, Call]:
    """Public functions by name, each with valid arguments."""
    robot = rp.load_robot("planar2r")
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("box", rp.Box((0.1, 0.1, 0.1)), [0, 0, 0.5])
    problem = rp.Problem(scene, "home", [0.5, 0.5])
    motion = rp.plan_motion(problem, rng=0)
    path, trajectory = motion.path, motion.trajectory
    pair = rp.plan_motion(rp.random_grid(rp.load_robot("rr1"), 3, 2.0, rng=0), rng=0)
    line, diagram = pair.timeline(), _a_diagram()
    checker = rp.CollisionChecker(scene)
    timed_checker = rp.TimedChecker(checker, {})
    kinematics = rp.Kinematics(scene)
    q, T, names, budget = np.zeros(2), transforms.identity(), scene.joint_names(), rp.Budget(0.2)
    cover = next(iter(rp.cover_with_spheres(robot).values()))
    base, link = (f"arm/{robot.links[k].name}" for k in (0, 1))
    rp.save_motion(folder / "m.json", scene, path=path, trajectory=trajectory)
    rp.save_csv(folder / "t.csv", trajectory)
    rp.save_scene(folder / "s.toml", scene)
    (folder / "j.yaml").write_text(
        "joint_names: [a]\npoints:\n- {positions: [0.0], time_from_start: {sec: 0, nanosec: 0}}\n"
        "- {positions: [1.0], time_from_start: {sec: 1, nanosec: 0}}\n"
    )
    np.save(folder / "p.npy", np.eye(3))
    trimesh.creation.box((1, 1, 1)).export(folder / "a.stl")
    mesh = rp.load_mesh(folder / "a.stl")
    many = rp.plan_many_arms(problem, rng=0)
    graph, running = rp.plan_graph(many), rp.RunningPlan.of(many)
    rp.save_plan_graph(folder / "g.json", graph, many.trajectory, scene)
    rr1 = rp.Scene().with_arm("arm", rp.load_robot("rr1"))
    with_block = rr1.with_obstacle("block", rp.Sphere(0.02), [-0.3, 0, 0.1])
    steps = rp.plan_sequence(rp.Sequence(scene, [rp.FreeMotion(q + 0.1), rp.Pause(0.1)]), rng=0)
    steps.save(folder / "q.json")
    (folder / "sequence.toml").write_text('scene = "rr1_table"\n[[segments]]\npause = 1\n')
    shown = dict.fromkeys(("trajectory", "path", "problem", "report", "replay", "options"))
    live = {"options": silent()}
    picture = rp.cspace(scene, problem, resolution=8)
    lesson = rp.lesson("workspace")
    pose_goal = rp.PoseGoal("tool", [0.3, 0.2, 0.0])

    crate = rp.Obstacle([rp.Geometry("crate", rp.Box((0.1, 0.1, 0.1)), np.eye(4))], [0, 0, 2], mass=1.0, friction=0.5)
    loose_bodies = rp.Simulation(scene.with_obstacles({"crate": crate}))
    arm_names = list(names)
    simulation = rp.Simulation(scene)
    stepper, drift = rp.ForwardPositionController(arm_names), rp.ForwardVelocityController(arm_names)
    follower, grip = rp.JointTrajectoryController(arm_names), rp.GripperController(arm_names)

    def commanded(controller: Any, **options: Any) -> None:
        rp.Simulation(scene).activate(controller)
        controller.command(**options)

    def sent(**options: Any) -> None:
        rp.Simulation(scene).activate(follower)
        follower.send(**options)

    def run(**options: Any) -> None:
        rp.Simulation(scene).run(**options)

    def deactivated(**options: Any) -> None:
        simulation.activate(stepper)
        simulation.deactivate(**options)

    def broadcast(**options: Any) -> None:
        rp.JointStateBroadcaster(**options).close()

    def shown_page(**options: Any) -> None:
        rp.show(**options).close()

    def in_viewer(verb: str, **options: Any) -> None:
        own = rp.ViewOptions(panels=[rp.Panel("own", "Own")])
        with rp.Viewer(scene, options=own) as viewer:
            getattr(viewer, verb)(**options)

    def registered(**options: Any) -> None:
        before = dict(planners._registered)
        try:
            rp.register_planner(**options)
        finally:
            planners._registered.clear()
            planners._registered.update(before)

    channels = {name: rp.BoxChannel(joint, 2.0, 8) for name, joint in zip(("S1", "S2"), robot.joint_names, strict=True)}
    box, command = rp.ControlBox(channels, 0.0006), rp.BoxCommand((4, 0, 0, 0, 0, 0, 0))
    rows = {joint: rp.JointCalibration(1, 0.0, 500.0, 0.1, 0.1) for joint in robot.joint_names}
    calibration = rp.Calibration(robot.name, rows, "steps")
    resting = rp.Trajectory.rest(names, q)
    commands = rp.plan_commands(resting, calibration, box, scene=rp.Scene().with_arm("arm", robot))
    (folder / "box.toml").write_text(BOX)

    return {
        "plan_many": (
            rp.plan_many,
            {"problems": [problem], "executor": InThisThread(), "workers": None, "rng": 0, "full": False}
            | {"planner": "rrt_connect", "retiming": "blend", "budget": budget, "progress": None},
        ),
        "CollisionChecker": (rp.CollisionChecker, {"scene": scene, "arms": None, "margin": 0.01, "tolerance": 1e-6}),
        **{
            f"CollisionChecker.{verb}": (getattr(checker, verb), {"q": q})
            for verb in (
                *("checked", "contacts", "distances", "is_free", "is_free_slowly", "limit_violations", "nearest"),
                "within_limits",
            )
        },
        "CollisionChecker.clearance": (checker.clearance, {"q": q, "most": 1.0}),
        "CollisionChecker.moving_clearance": (checker.moving_clearance, {"q": q, "most": 1.0}),
        "CollisionChecker.solid_distances": (checker.solid_distances, {"q": q, "pairs": None}),
        "CollisionChecker.solid_points": (checker.solid_points, {"q": q, "pair": 0}),
        "ElementCover.at": (cover.at, {"level": 0}),
        **{
            f"CollisionChecker.{verb}": (getattr(checker, verb), {"q0": q, "q1": q + 0.1})
            for verb in ("edge_is_free", "edge_is_free_slowly")
        },
        "CollisionChecker.are_free": (checker.are_free, {"q": [q, q + 0.1]}),
        "CollisionChecker.edges_are_free": (checker.edges_are_free, {"q0": [q, q], "q1": [q, q + 0.1]}),
        "CollisionChecker.first_contact": (checker.first_contact, {"q0": q, "q1": q + 0.1, "precision": 1e-9}),
        "TimedChecker": (rp.TimedChecker, {"checker": checker, "motions": {}}),
        **{
            f"TimedChecker.{verb}": (
                getattr(timed_checker, verb),
                {"q_from": q, "q_to": q + 0.1, "t_from": 0.0, "t_to": 1.0},
            )
            for verb in ("edge_is_free", "first_contact")
        },
        **{
            f"TimedChecker.{verb}": (
                getattr(timed_checker, verb),
                {"trajectory": trajectory, "t_from": None, "t_to": None},
            )
            for verb in ("trajectory_is_free", "first_contact_of")
        },
        "CollisionChecker.keep_margin": (checker.keep_margin, {"margin": 0.0}),
        "CollisionChecker.move_obstacle": (
            rp.CollisionChecker(scene).move_obstacle,
            {"name": "box", "pose": [0, 0, 0.5]},
        ),
        "CollisionChecker.is_free_ignoring": (checker.is_free_ignoring, {"q": q, "arms": frozenset({"arm"})}),
        "CollisionChecker.path_is_free": (checker.path_is_free, {"waypoints": [q, q + 0.1]}),
        **{
            f"CollisionChecker.{verb}": (getattr(checker, verb), {"coefficients": [q, q + 0.1], "duration": 1.0})
            for verb in ("polynomial_is_free", "first_contact_on")
        },
        "cover_with_spheres": (rp.cover_with_spheres, {"thing": robot}),
        "load_csv": (rp.load_csv, {"file": folder / "t.csv"}),
        "save_csv": (rp.save_csv, {"file": folder / "o.csv", "trajectory": trajectory, "dt": 0.01}),
        "load_mesh": (rp.load_mesh, {"file": folder / "a.stl", "scale": 1.0, "hull": False}),
        "load_point_cloud": (rp.load_point_cloud, {"file": folder / "p.npy", "resolution": 0.02}),
        "convex_pieces": (rp.convex_pieces, {"mesh": mesh, "seconds": 5.0, "progress": None}),
        "load_motion": (
            rp.load_motion,
            {
                "file": folder / "m.json",
                "scene": None,
                "topic": None,
                "torque_limits": False,
                "jerk_limits": False,
                "progress": None,
            },
        ),
        "load_joint_trajectory": (rp.load_joint_trajectory, {"file": folder / "j.yaml", "topic": None}),
        "save_joint_trajectory": (
            rp.save_joint_trajectory,
            {"file": folder / "o.yaml", "trajectory": resting, "dt": 0.1, "lead": 0.0, "rename": None},
        ),
        "check_joint_trajectory": (
            rp.check_joint_trajectory,
            {"message": folder / "j.yaml", "joint_names": None, "topic": None, "allow_partial_joints": False}
            | {"allow_final_velocity": False},
        ),
        "save_motion": (
            rp.save_motion,
            {"file": folder / "o.json", "scene": scene, "embed": False}
            | dict.fromkeys(("path", "trajectory", "report", "problem", "plan_graph")),
        ),
        "propose_disabled_collisions": (rp.propose_disabled_collisions, {"robot": robot, "samples": 3, "rng": 0}),
        "Kinematics": (rp.Kinematics, {"scene_or_robot": scene, "arms": None}),
        "Kinematics.for_arm": (kinematics.for_arm, {"arm": None}),
        "Kinematics.frame": (kinematics.frame, {"frame": "tool"}),
        "Kinematics.gravity": (kinematics.gravity, {"q": q}),
        "Kinematics.inverse_dynamics": (kinematics.inverse_dynamics, {"q": q, "qd": q, "qdd": q}),
        **{
            f"Kinematics.{verb}": (getattr(kinematics, verb), {"q": q, "frame": "tool"})
            for verb in ("jacobian", "manipulability", "pose")
        },
        "Kinematics.mass_matrix": (kinematics.mass_matrix, {"q": q}),
        "Kinematics.pose_and_jacobian": (kinematics.pose_and_jacobian, {"q": q, "index": 1}),
        "Kinematics.poses": (kinematics.poses, {"q": q, "frames": ["tool"]}),
        "Kinematics.poses_batch": (kinematics.poses_batch, {"qs": [q, q], "frame": "tool"}),
        "copies_within_limits": (rp.copies_within_limits, {"robot": robot, "q": q, "near": q, "reach": 6.3}),
        "solve_ik": (
            rp.solve_ik,
            {"kinematics": kinematics, "goal": pose_goal, "seeds": None, "rng": 0, "attempts": 5}
            | dict.fromkeys(("accept", "max_solutions", "patience")),
        ),
        "load_problems": (rp.load_problems, {"name_or_file": folder / "s.toml"}),
        "load_robot": (
            rp.load_robot,
            {"name_or_file": "planar2r", "package_dirs": (), "convex": "hull"}
            | dict.fromkeys(("srdf", "groups", "joints", "tool", "xacro_arguments")),
        ),
        "load_scene": (rp.load_scene, {"name_or_file": folder / "s.toml"}),
        "save_scene": (
            rp.save_scene,
            {"file": folder / "o.toml", "scene": scene, "problems": None, "robots": None},
        ),
        "Limits": (rp.Limits, dict.fromkeys(("lower", "upper", "velocity", "acceleration", "jerk", "effort"), q + 1)),
        "Limits.scaled": (robot.limits.scaled, {"velocity": 1.0, "acceleration": 1.0, "jerk": 1.0}),
        "Limits.stack": (rp.Limits.stack, {"parts": [robot.limits, robot.limits]}),
        "place_grid": (
            rp.place_grid,
            {"robot": robot, "rows": 1, "columns": 2, "spacing": 3.0, "pose": [0, 0, 0], "q": "home"}
            | {"scene": None, "prefix": "arm"},
        ),
        "plan_many_arms": (
            rp.plan_many_arms,
            {"problem": problem, "margin": 0.001, "budget": budget, "rng": 0, "progress": None}
            | {"improvement": budget, "method": "portfolio", "retiming": "blend", "torque_limits": False},
        ),
        "plan_graph": (rp.plan_graph, {"plan": many, "progress": None}),
        "FreeMotion": (rp.FreeMotion, {"goal": q, "arm": None, "allow": [], "stop": True}),
        "StraightLine": (
            rp.StraightLine,
            {"goal": None, "offset": [0.1, 0.0, 0.0], "axes": "world", "arm": None, "allow": [("arm", "box")]}
            | {"stop": False},
        ),
        "MoveGripper": (
            rp.MoveGripper,
            {"position": 0.1, "width": None, "around": None, "squeeze": 0.0, "seconds": 0.1, "arm": None, "allow": []},
        ),
        "Attach": (rp.Attach, {"obstacle": "box", "arm": None, "link": None, "touch": []}),
        "Detach": (rp.Detach, {"name": "box"}),
        "Pause": (rp.Pause, {"seconds": 0.1}),
        "Sequence": (rp.Sequence, {"scene": scene, "segments": [rp.FreeMotion(q)]}),
        "SequenceStage": (
            rp.SequenceStage,
            {"label": "rest", "begin": 0.0, "end": 0.0, "allowed": frozenset(), "change": rp.Detach("box")},
        ),
        "plan_sequence": (
            rp.plan_sequence,
            {"sequence": steps.sequence, "planner": "rrt_connect", "retiming": "blend", "budget": budget, "rng": 0}
            | {"progress": None},
        ),
        "SequencePlan.object_poses": (steps.object_poses, {"name": "box", "times": [0.0, 0.1]}),
        "SequencePlan.save": (steps.save, {"file": folder / "o.json", "embed": False}),
        "SequencePlan.page_content": (steps.page_content, {"options": None}),
        "SequencePlan.save_html": (steps.save_html, {"file": folder / "o.html", "replay": None, "options": None}),
        "SequencePlan.show": (
            lambda **options: steps.show(**options).close(),
            live | {"replay": None},
        ),
        "load_segments": (rp.load_segments, {"file": folder / "sequence.toml"}),
        "load_sequence": (
            rp.load_sequence,
            {"file": folder / "q.json", "scene": None, "torque_limits": False, "jerk_limits": False, "progress": None},
        ),
        "simulate_sequence": (
            rp.simulate_sequence,
            {"plan": steps, "dt": 0.01, "record_dt": 0.1, "stiffness": 50.0, "hold": 0.0, "progress": None},
        ),
        "top_grasps": (rp.top_grasps, {"scene": with_block, "obstacle": "block", "arm": None, "yaws": 4}),
        "pick_and_place": (
            rp.pick_and_place,
            {"scene": with_block, "obstacle": "block", "place": [-0.3, -0.1, 0.03], "arm": None}
            | {"grasps": None, "supports": None, "height": 0.05, "stop": False},
        ),
        "PlanGraph.waits_for": (graph.waits_for, {"arm": "arm"}),
        "ArmDelay": (rp.ArmDelay, {"start": 0.1, "slowdown": 0.1, "pauses": [(0.1, 0.2)]}),
        "execute_plan": (
            rp.execute_plan,
            {"graph": graph, "scene": scene, "delays": {"arm": rp.ArmDelay(0.1)}, "gap": 0.1},
        ),
        "save_plan_graph": (
            rp.save_plan_graph,
            {"file": folder / "o.json", "graph": graph, "trajectory": many.trajectory, "scene": scene}
            | {"problem": problem, "embed": False},
        ),
        "load_plan_graph": (rp.load_plan_graph, {"file": folder / "g.json", "scene": None}),
        "RunningPlan.of": (rp.RunningPlan.of, {"result": many}),
        "RunningPlan.configuration": (running.configuration, {"arm": "arm", "time": 0.1}),
        "RunningPlan.velocity": (running.velocity, {"arm": "arm", "time": 0.1}),
        "RunningPlan.without_past": (running.without_past, {"time": 0.1}),
        "RunningPlan.goal": (running.goal, {"arm": "arm"}),
        "add_motion": (
            rp.add_motion,
            {"plan": running, "arm": "arm", "goal": q, "at": 0.1, "freeze": 0.1, "budget": budget, "rng": 0},
        ),
        "random_grid": (rp.random_grid, {"robot": rp.load_robot("rr1"), "count": 2, "spacing": 3.0, "rng": 0}),
        "ring_swap": (
            rp.ring_swap,
            {"robot": rp.load_robot("rr1"), "count": 2, "radius": 0.42, "step": 1, "rng": 2, "front": None},
        ),
        "reach_grid": (rp.reach_grid, {"robot": rp.load_robot("rr1"), "count": 2, "spacing": 2.0, "rng": 0}),
        "handover_window": (
            rp.handover_window,
            {"robot": rp.load_robot("rr1"), "width": 0.2, "rng": 0, "gap": 0.05},
        ),
        "shared_bin": (rp.shared_bin, {"robot": rp.load_robot("rr1"), "count": 2, "rng": 0}),
        "conveyor_line": (rp.conveyor_line, {"robot": rp.load_robot("rr1"), "count": 2, "rng": 0}),
        "shelf_rows": (rp.shelf_rows, {"robot": rp.load_robot("rr1"), "count": 2, "rng": 0}),
        "dual_arm_shelf": (rp.dual_arm_shelf, {"robot": rp.load_robot("rr1"), "spacing": 0.6, "rng": 0, "front": None}),
        "place_ring": (
            rp.place_ring,
            {"robot": robot, "count": 2, "radius": 3.0, "facing": "center", "front": [1, 0, 0], "pose": [0, 0, 0]}
            | {"q": "home", "scene": None, "prefix": "arm"},
        ),
        "Path": (rp.Path, {"joint_names": names, "waypoints": [q, q + 0.1]}),
        "Path.allclose": (path.allclose, {"other": path, "atol": 1e-9}),
        "Path.sample": (path.sample, {"step": 0.1}),
        "MotionPlan.save": (motion.save, {"file": folder / "o.json", "embed": False}),
        "MotionPlan.coordination_diagram": (pair.coordination_diagram, {"one": "arm01", "two": "arm02"}),
        "CoordinationDiagram.curve": (diagram.curve, {"axes": "time"}),
        "CoordinationDiagram.scales": (diagram.scales, {"axes": "time"}),
        "CoordinationDiagram.figure": (diagram.figure, {"axes": "time", "width": 5.0, "dark": False}),
        "CoordinationDiagram.save": (diagram.save, {"file": folder / "o.svg", "axes": "time", "dark": False}),
        "timeline": (
            rp.timeline,
            {"trajectory": trajectory, "scene": scene, "report": None, "waits": [], "undelayed": {}},
        ),
        "Timeline.arrival": (line.arrival, {"arm": "arm01"}),
        "Timeline.figure": (line.figure, {"width": 5.0, "dark": False}),
        "Timeline.save": (line.save, {"file": folder / "o.svg", "dark": False}),
        "MotionPlan.page_content": (motion.page_content, {"options": None}),
        "MotionPlan.save_html": (motion.save_html, {"file": folder / "o.html", "replay": None, "options": None}),
        "MotionPlan.show": (lambda **o: motion.show(**o).close(), live | {"replay": None}),
        "plan_motion": (
            rp.plan_motion,
            {"problem": problem, "planner": "rrt_connect", "retiming": "blend", "shorten": True, "margin": 0.002}
            | {"torque_limits": False, "budget": budget, "rng": 0, "progress": None},
        ),
        "warm_up": (rp.warm_up, {"problem": problem, "progress": None}),
        "Roadmap": (rp.Roadmap, {"scene": scene, "arms": None, "samples": 5}),
        "Roadmap.grow": (rp.Roadmap(scene, samples=5).grow, {"samples": 1}),
        "Roadmap.plan": (
            rp.Roadmap(scene, samples=5).plan,
            {"problem": problem, "budget": budget, "rng": 0, "progress": None},
        ),
        "RrtConnect": (rp.RrtConnect, {"range": 0.1, "tree": False}),
        "AnytimePlanner": (rp.AnytimePlanner, {"range": 0.1}),
        "RoadmapPlanner": (rp.RoadmapPlanner, {"samples": 10}),
        "CartesianPlanner": (rp.CartesianPlanner, {"tolerance": 1e-3, "orientation_tolerance": 1e-2}),
        "OmplPlanner": (rp.OmplPlanner, {"name": "rrt", "tree": False, "settings": {"range": 0.1}}),
        **{
            f"{kind.__name__}.plan": (kind().plan, {"problem": problem, "budget": budget, "rng": 0, "progress": None})
            for kind in (rp.RrtConnect, rp.AnytimePlanner, rp.RoadmapPlanner, rp.OmplPlanner)
        },
        "CartesianPlanner.plan": (
            rp.CartesianPlanner().plan,
            {"problem": rp.Problem(scene, "home", pose_goal), "budget": budget, "rng": 0, "progress": None},
        ),
        "register_planner": (
            registered,
            {"name": "own", "factory": rp.RrtConnect, "description": "", "optimizing": False},
        ),
        "plan": (
            rp.plan,
            {"problem": problem, "planner": "rrt_connect", "budget": budget, "rng": 0, "progress": None},
        ),
        "shorten": (
            rp.shorten,
            {"path": path, "scene": scene, "checker": checker, "rng": 0, "iterations": 4, "seconds": 0.2, "smooth": 0},
        ),
        "BoxChannel": (
            rp.BoxChannel,
            {"joint": "joint1", "fast_period": 2.0, "ramp_steps": 8, "counts_per_step": None},
        ),
        "ControlBox": (rp.ControlBox, {"channels": dict(box.channels), "tick": 0.0006}),
        "load_control_box": (rp.load_control_box, {"file": folder / "box.toml"}),
        "BoxCommand": (rp.BoxCommand, {"steps": command.steps, "safety": "high"}),
        "BoxCommand.decode": (rp.BoxCommand.decode, {"frame": command.encode()}),
        "Telemetry.decode": (rp.Telemetry.decode, {"frame": rp.EmulatedSerialLine(box).telemetry().encode()}),
        "BoxEmulator": (rp.BoxEmulator, {"box": box}),
        "BoxEmulator.command": (rp.BoxEmulator(box).command, {"command": command}),
        "BoxEmulator.advance": (rp.BoxEmulator(box).advance, {"ticks": 3}),
        "BoxEmulator.run": (rp.BoxEmulator(box).run, {"command": command}),
        "EmulatedSerialLine": (rp.EmulatedSerialLine, {"box": box, "position": None, "switches": {}}),
        "EmulatedSerialLine.read": (rp.EmulatedSerialLine(box).read, {"size": 5}),
        "EmulatedSerialLine.write": (rp.EmulatedSerialLine(box).write, {"data": b""}),
        "read_telemetry": (
            lambda **options: next(rp.read_telemetry(**options)),
            {"port": rp.EmulatedSerialLine(box), "calibration": calibration, "box": box, "silence": 0.1},
        ),
        "plan_commands": (
            rp.plan_commands,
            {"motion": trajectory, "calibration": calibration, "box": box, "scene": scene, "tolerance": 0.01}
            | {"safety": "high"},
        ),
        "send_commands": (
            rp.send_commands,
            {"plan": commands, "port": rp.EmulatedSerialLine(box), "silence": 1.0, "progress": None},
        ),
        "Budget": (rp.Budget, {"seconds": 1.0, "iterations": None}),
        "cspace": (
            rp.cspace,
            {"scene": scene, "resolution": 8} | dict.fromkeys(("problem", "result", "arm", "joints", "at", "progress")),
        ),
        "save_html": (rp.save_html, {"file": folder / "o.html", "scene": scene} | shown),
        "show": (shown_page, {"scene": scene} | shown | live),
        "screenshot": (
            rp.screenshot,
            {"file": folder / "o.png", "page": folder / "none.html", "size": (9, 9), "time": None}
            | {"step": None, "bare": False},
        ),
        "save_video": (
            rp.save_video,
            {"file": folder / "o.gif", "page": folder / "none.html", "size": (9, 9), "fps": 10.0, "speed": 1.0}
            | {"step": None, "bare": False, "progress": None},
        ),
        "save_glb": (
            rp.save_glb,
            {"file": folder / "o.glb", "what": scene, "trajectory": trajectory, "rate": 10.0},
        ),
        "simulate": (
            rp.simulate,
            {"trajectory": trajectory, "scene": scene, "mode": "kinematic", "dt": 0.002, "record_dt": 0.01}
            | {"stiffness": 80.0, "hold": 0.0, "variation": None, "progress": None},
        ),
        "Simulation": (
            rp.Simulation,
            {"scene": scene, "dt": 0.002, "stiffness": 80.0, "threads": 1, "solver": "newton"} | {"variation": None},
        ),
        "Simulation.update_scene": (rp.Simulation(scene).update_scene, {"scene": scene}),
        "Simulation.contact_points": (loose_bodies.contact_points, {"name": "crate"}),
        "Simulation.body_pose": (loose_bodies.body_pose, {"name": "crate"}),
        "Simulation.body_coordinates": (loose_bodies.body_coordinates, {"name": "crate"}),
        "Simulation.body_velocity": (loose_bodies.body_velocity, {"name": "crate"}),
        "Simulation.place_body": (
            loose_bodies.place_body,
            {"name": "crate", "pose": [0, 0, 2], "velocity": np.zeros(6)},
        ),
        "Recorder": (rp.Recorder, {"sim": loose_bodies, "dt": 0.02}),
        "load_body": (
            rp.load_body,
            {"file": folder / "a.stl", "scale": 1.0, "convex": "hull", "density": 1000.0, "mass": None}
            | {"friction": 1.0, "pose": None},
        ),
        "run_experiments": (
            partial(cancelled, rp.run_experiments),
            {"experiments": ["latency"], "folder": folder, "quick": True, "seed": 0, "arms": None}
            | {"progress": lambda _: False},
        ),
        "save_figures": (
            partial(cancelled, rp.save_figures),
            {"folder": folder, "names": ["no_path"], "progress": lambda _: False},
        ),
        "stack_bodies": (
            rp.stack_bodies,
            {"body": crate, "count": 3, "columns": (1, 1), "gap": 0.001, "pose": None, "prefix": "body"},
        ),
        "ArmVariation": (rp.ArmVariation, {"payload": 0.1, "mass": 1.1, "friction": 0.01}),
        "ReplayVariations": (
            rp.ReplayVariations,
            {"payload": 0.1, "mass": 0.1, "friction": 0.01, "count": 2, "rng": 0},
        ),
        "assert_valid": (
            partial(asserted, rp.assert_valid),
            {"motion": motion, "scene": scene, "problem": None, "torque_limits": False, "jerk_limits": False},
        ),
        "assert_replays": (
            partial(asserted, rp.assert_replays),
            {"motion": motion, "scene": scene, "tolerance": 1.0, "goal_tolerance": 1.0, "variations": None}
            | {"dt": 0.002},
        ),
        "second_opinion": (
            rp.second_opinion,
            {"motion": trajectory, "scene": scene, "step": 0.05, "checkers": ("Coal",), "tolerance": 1e-4}
            | {"progress": None},
        ),
        "SecondOpinion.first_contact": (rp.SecondOpinion(("Coal",), 1, 0).first_contact, {"checker": "Coal"}),
        "Simulation.step": (simulation.step, {"count": 1}),
        "Simulation.run": (run, {"until": None, "duration": 0.01, "speed": 1.0}),
        "Simulation.place": (simulation.place, {"joint_names": arm_names, "positions": q, "velocities": None}),
        "Simulation.activate": (simulation.activate, {"controller": stepper, "replace": False}),
        "Simulation.deactivate": (deactivated, {"controller": stepper}),
        "Simulation.on_step": (rp.Simulation(scene).on_step, {"callback": print}),
        "Simulation.configuration": (simulation.configuration, {"arms": None}),
        "Simulation.state": (simulation.state, {"joint_names": arm_names}),
        "ForwardPositionController": (rp.ForwardPositionController, {"joint_names": arm_names}),
        "ForwardPositionController.command": (partial(commanded, stepper), {"positions": q}),
        "ForwardVelocityController": (rp.ForwardVelocityController, {"joint_names": arm_names}),
        "ForwardVelocityController.command": (partial(commanded, drift), {"velocities": q}),
        "GripperController": (
            rp.GripperController,
            {"joint_names": arm_names, "speed": 1.0, "tolerance": 0.01, "stall_speed": 0.002, "stall_time": 0.05},
        ),
        "GripperController.command": (partial(commanded, grip), {"positions": q}),
        "JointTrajectoryController": (
            rp.JointTrajectoryController,
            {"joint_names": arm_names, "start_tolerance": 0.01, "path_tolerance": 1.0, "goal_tolerance": 0.01}
            | {"goal_time": 1.0},
        ),
        "JointTrajectoryController.send": (sent, {"trajectory": trajectory, "at": None}),
        "JointStateBroadcaster": (broadcast, {"joint_names": arm_names, "to": folder / "states.jsonl", "rate": 50.0}),
        "JointStateBroadcaster.attach": (rp.JointStateBroadcaster(arm_names, print).attach, {"sim": simulation}),
        **calibration_calls(folder),
        **teaching_calls(),
        **mirror_calls(scene, trajectory, folder),
        "SearchTree": (rp.SearchTree, {"vertices": [[0.0, 0.0], [1.0, 0.0]], "edges": [[0, 1]]}),
        "JointGoal": (rp.JointGoal, {"q": q}),
        "PoseGoal": (
            rp.PoseGoal,
            {"frame": "tool", "position": [0, 0, 0], "quaternion": None, "position_tolerance": 1e-4}
            | {"orientation_tolerance": 1e-3},
        ),
        "RegionGoal": (
            rp.RegionGoal,
            {"frame": "tool", "lower": [0, 0, 0], "upper": [1, 1, 1], "quaternion": None}
            | {"orientation_tolerance": 1e-3},
        ),
        "Problem": (rp.Problem, {"scene": scene, "start": "home", "goal": "zero", "arms": None}),
        "point_to_point": (
            rp.point_to_point,
            {"joint_names": names, "start": q, "end": q + 0.1, "limits": robot.limits},
        ),
        "retime": (
            rp.retime,
            {"path": path, "scene": scene, "method": "blend", "checker": checker, "torque_limits": False}
            | {"velocity_scale": 1.0, "acceleration_scale": 1.0, "max_blend": 1.0},
        ),
        "Problem.in_scene": (problem.in_scene, {"scene": scene}),
        "Problem.with_margin": (problem.with_margin, {"distance": 0.01}),
        "scene_differences": (rp.scene_differences, {"before": scene, "after": scene}),
        "Robot.configuration": (robot.configuration, {"value": "home", "name": "x"}),
        "Robot.joint": (robot.joint, {"name": "joint1"}),
        "Robot.joint_values": (robot.joint_values, {"q": q}),
        "Robot.link": (robot.link, {"name": robot.links[0].name}),
        "Robot.link_poses": (robot.link_poses, {"q": q}),
        "Robot.with_locked_joints": (robot.with_locked_joints, {"values": {}}),
        "Robot.with_limits": (robot.with_limits, {"limits": robot.limits}),
        "Arm": (rp.Arm, {"robot": robot, "base": T, "q": "home"}),
        "Scene": (
            rp.Scene,
            {"arms": scene.arms, "obstacles": scene.obstacles, "attachments": {}, "allowed": (), "padding": 0.0}
            | {"pair_padding": {}, "name": "s", "description": ""},
        ),
        "Scene.allow": (scene.allow, {"a": "box", "b": base}),
        "Scene.arm": (scene.arm, {"name": "arm"}),
        **{
            f"Scene.{verb}": (getattr(scene, verb), {"arms": None})
            for verb in ("arm_names", "configuration", "joint_names", "limits")
        },
        "Scene.attach": (scene.attach, {"obstacle": "box", "arm": None, "link": None, "touch": (), "pose": None}),
        "Scene.detach": (scene.attach("box").detach, {"name": "box"}),
        "Scene.link_poses": (scene.link_poses, {"configurations": {"arm": q}}),
        "Scene.may_touch": (scene.may_touch, {"a": "box", "b": link}),
        "Scene.only_arm": (scene.only_arm, {"name": None}),
        "Scene.owner": (scene.owner, {"element": "box"}),
        "Scene.padding_of": (scene.padding_of, {"a": "box", "b": link}),
        "Scene.split": (scene.split, {"q": q, "arms": None}),
        "Scene.with_arm": (scene.with_arm, {"name": "b", "robot": robot, "base": None, "q": "home"}),
        "Scene.with_margin": (scene.with_margin, {"distance": 0.01}),
        "Scene.with_obstacle": (
            scene.with_obstacle,
            {"name": "o", "shape": rp.Sphere(0.1), "pose": None, "color": None, "mass": None, "friction": 1.0},
        ),
        "Scene.with_padding": (scene.with_padding, {"distance": 0.01, "a": None, "b": None}),
        "Scene.with_configuration": (scene.with_configuration, {"name": "arm", "q": q}),
        "Scene.with_robot": (scene.with_robot, {"name": "arm", "robot": robot}),
        "Scene.without_arm": (scene.without_arm, {"name": "arm"}),
        "Scene.with_obstacles": (scene.with_obstacles, {"obstacles": {"crate": crate}}),
        "Scene.with_obstacle_at": (scene.with_obstacle_at, {"name": "box", "pose": [0, 0, 0.5]}),
        "Scene.without_obstacle": (scene.without_obstacle, {"name": "box"}),
        "Box": (rp.Box, {"size": (1, 1, 1)}),
        "Capsule": (rp.Capsule, {"radius": 1, "length": 1}),
        "Cylinder": (rp.Cylinder, {"radius": 1, "length": 1}),
        "HalfSpace": (rp.HalfSpace, {"normal": (0, 0, 1), "offset": 0}),
        "Mesh": (rp.Mesh, {"vertices": mesh.vertices, "faces": mesh.faces, "convex": False}),
        "PointCloud": (rp.PointCloud, {"points": [[0, 0, 0]], "resolution": 0.1}),
        "Sphere": (rp.Sphere, {"radius": 1}),
        "Trajectory": (
            rp.Trajectory,
            {"joint_names": names, "breaks": trajectory.breaks, "coefficients": trajectory.coefficients},
        ),
        "Trajectory.__call__": (trajectory, {"t": 0.0, "derivative": 0}),
        "Trajectory.allclose": (trajectory.allclose, {"other": trajectory, "atol": 1e-9}),
        "Trajectory.derivative_coefficients": (trajectory.derivative_coefficients, {"derivative": 1}),
        "Trajectory.from_samples": (
            rp.Trajectory.from_samples,
            {"times": [0, 1], "q": [q, q + 0.1], "qd": None, "qdd": None, "joint_names": names},
        ),
        "Trajectory.merge": (lambda part: rp.Trajectory.merge(part), {"part": trajectory}),
        "Trajectory.rest": (rp.Trajectory.rest, {"joint_names": names, "q": q, "start": 0.0, "duration": 1.0}),
        "Trajectory.sample": (trajectory.sample, {"dt": 0.1}),
        "Trajectory.sample_times": (trajectory.sample_times, {"dt": 0.1}),
        "Trajectory.select": (trajectory.select, {"arm": "arm"}),
        "Trajectory.cut": (trajectory.cut, {"begin": 0.1, "end": 0.2}),
        "Trajectory.shifted": (trajectory.shifted, {"seconds": 1.0}),
        "Trajectory.stretched": (trajectory.stretched, {"factor": 2.0}),
        "certify_path": (
            rp.certify_path,
            {"path": path, "scene": scene, "clearance": True, "clearance_tolerance": 2e-4, "progress": None},
        ),
        "validate": (
            rp.validate,
            {"trajectory": trajectory, "scene": scene, "problem": None, "torque_limits": False}
            | {"jerk_limits": False, "clearance": True, "clearance_tolerance": 2e-4, "progress": None},
        ),
        "ViewOptions": (
            rp.ViewOptions,
            {"title": "x", "view": None, "spheres": False, "panels": (), "play": True, "planner": True}
            | {"compare": {"other": trajectory}, "side_by_side": False, "tree": None, "clearances": None}
            | {"port": 7000, "quiet": False},
        ),
        "Viewer.load": (partial(in_viewer, "load"), {"scene": scene} | shown),
        "Viewer.update": (partial(in_viewer, "update"), {"q": q}),
        "Viewer.page_content": (partial(in_viewer, "page_content"), {"options": None}),
        "Viewer.update_panel": (partial(in_viewer, "update_panel"), {"name": "own", "data": {"a": 1}}),
        "Viewer.on_slider": (partial(in_viewer, "on_slider"), {"callback": print}),
        "Viewer.seek": (partial(in_viewer, "seek"), {"t": 0.0}),
        "Viewer.set_speed": (partial(in_viewer, "set_speed"), {"speed": 1.0}),
        **{
            f"CSpaceGrid.{verb}": (getattr(picture.grid, verb), {"q": q})
            for verb in ("cell", "component_of", "holds", "wrapped")
        },
        "CSpaceGrid.connected": (picture.grid.connected, {"a": q, "b": q}),
        "CSpaceGrid.shortest_path": (picture.grid.shortest_path, {"a": q, "b": q}),
        "CSpace.figure": (picture.figure, {"width": 13.0}),
        "CSpace.save_svg": (picture.save_svg, {"file": folder / "o.svg"}),
        "CSpace.save_pdf": (picture.save_pdf, {"file": folder / "o.pdf"}),
        "CSpace.save": (picture.save, {"file": folder / "o.svg"}),
        "CSpace.save_png": (picture.save_png, {"file": folder / "o.png", "dpi": 20}),
        "CSpace.page_content": (picture.page_content, {"options": None}),
        "CSpace.save_html": (picture.save_html, {"file": folder / "o.html", "trajectory": None, "options": None}),
        "CSpace.show": (lambda **o: picture.show(**o).close(), live | {"trajectory": None}),
        "CSpace.with_result": (picture.with_result, {"result": motion.result}),
        "lesson": (rp.lesson, {"name": "workspace", "scene": None, "problem": None}),
        "LessonStep": (rp.LessonStep, {"name": "a", "title": "A", "text": "<p>a</p>", "q": q}),
        "Lesson.figure": (lesson.figure, {"width": 13.0}),
        "Lesson.save_png": (lesson.save_png, {"file": folder / "l.png"}),
        "Lesson.save_svg": (lesson.save_svg, {"file": folder / "l.svg"}),
        "Lesson.save_pdf": (lesson.save_pdf, {"file": folder / "l.pdf"}),
        "Lesson.save": (lesson.save, {"file": folder / "l.pdf"}),
        "Lesson.save_html": (lesson.save_html, {"file": folder / "l.html", "options": None}),
        "Lesson.page_content": (lesson.page_content, {"options": None}),
        "Lesson.show": (lambda **o: lesson.show(**o).close(), live),
        "planar_arm": (
            rp.planar_arm,
            {"joints": "RR", "lengths": (1.0, 0.8), "width": 0.08, "limits": [(-1.0, 1.0), None], "name": "mine"},
        ),
        "polygon_prism": (
            rp.polygon_prism,
            {"corners": [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], "height": 0.2, "color": (1.0, 0.0, 0.0, 1.0)},
        ),
        "save_mjcf": (rp.save_mjcf, {"file": folder / "o.xml", "scene": scene}),
        "save_rosbag": (
            rp.save_rosbag,
            {"folder": folder / "bag", "trajectory": resting, "dt": 0.1, "lead": 0.0, "rename": None}
            | {"storage": "mcap"},
        ),
        "Panel": (
            rp.Panel,
            {"name": "x", "title": "x", "html": "", "css": "", "script": "", "width": 420},
        ),
        "pack_array": (rp.pack_array, {"array": [1.0], "dtype": "f4"}),
        "transforms.as_pose": (transforms.as_pose, {"value": T, "name": "x"}),
        "transforms.inverse": (transforms.inverse, {"T": T}),
        "transforms.position_and_quaternion": (transforms.position_and_quaternion, {"T": T}),
        "transforms.pose": (transforms.pose, {"xyz": [0, 0, 0], "rpy": None, "quaternion": None}),
        "transforms.quaternion_from_rotation": (transforms.quaternion_from_rotation, {"R": np.eye(3)}),
        "transforms.rotation_about": (transforms.rotation_about, {"axis": [0, 0, 1], "angle": 1.0}),
        "transforms.rotation_angle": (transforms.rotation_angle, {"R": np.eye(3)}),
        "transforms.rotation_from_quaternion": (transforms.rotation_from_quaternion, {"wxyz": [1, 0, 0, 0]}),
        "transforms.rotation_from_rpy": (transforms.rotation_from_rpy, {"roll": 0.0, "pitch": 0.0, "yaw": 0.0}),
        "transforms.unit_quaternion": (transforms.unit_quaternion, {"wxyz": [1, 0, 0, 0]}),
    }


def _a_diagram() -> rp.CoordinationDiagram:
    steps = np.array([0.0, 1.0])
    places = np.array([[0.0, 0.0], [1.0, 1.0]])
    return rp.CoordinationDiagram(
        ("a", "b"), (0, 1), np.zeros((3, 3), np.uint8), (steps,) * 2, (steps,) * 2, steps, places
    )


# Arguments that accept anything: JSON rejects invalid values when the page is built.
_ANYTHING = {"Panel": {"data"}}
# Result types, which users do not construct; documented ways past the checks; functions without arguments.
_NOT_CALLED = {
    *(
        "PlanFailure",
        "GroupResult",
        "Leg",
        "Schedule",
        "Schedule.instants",
        "Schedule.leg_duration",
        "CollisionChecker.memory_image",
        "CollisionChecker.change_to",
        "CollisionChecker.run_edge_kernel",
        "CollisionChecker.run_exact_kernel",
        "CoordinationDiagram",
        "StateStream",
        "Timeline",
        "Wait",
        "ManyArmsResult",
        "Contact",
        "ElementCover",
        "FirstContact",
        "TimedContact",
        "Nearest",
        "IkResult",
        "MotionPlan",
        "PlanQuality",
        "PlanResult",
    ),
    *("Controller", "Controller.activate", "Controller.update", "Controller.check_positions", "Execution"),
    *("Controller.preview", "Controller.passed"),
    *("JointInfo", "JointState", "SetPoint"),
    *("CalibrationFit", "ZeroShift", "Corridor", "CorridorPosition", "StreamError"),
    *("MirrorEvent", "MirrorReport", "MirrorState"),
    *(
        f"{kind}Controller.{name}"
        for kind in ("ForwardPosition", "ForwardVelocity", "Gripper", "JointTrajectory", "Manual")
        for name in ("activate", "update", "preview", "passed", "check_positions")
    ),
    *("HasPage", "HasPage.page_content"),
    *("CommandPlan", "SerialPort", "SerialPort.read", "SerialPort.write", "Telemetry", "open_serial_port"),
    *("DhRow", "DhTable", "PathGrid", "PhasePlane", "SearchEvent", "SearchRecord", "SearchRecord.count", "SevenPhases"),
    *("Disagreement", "SampledContact", "SecondOpinion", "VariedReplays", "Calibration", "JointCalibration"),
    "ExperimentReport",
    *("Margin", "Report", "Report.from_dict", "Violation", "Path.trusted", "Trajectory.trusted", "Robot"),
    *(
        "CSpace",
        "CSpaceGrid",
        "Decomposition",
        "DrawnTree",
        "Replay",
        "ReplayContact",
        "ContactPoint",
        "ContactPoint.turned",
        "ReplayRecord",
        "ContactBand",
        "PairProposal",
        "BodyMotion",
    ),
    *("SequencePlan", "SequenceReplay", "CarriedObject", "Lesson"),
    *("ReplayRecord", "CurveChecker", "CurveChecker.polynomial_is_free", "EdgeCounters"),
    *("Progress", "Viewer", "Viewer.wait", "Planner", "Planner.plan"),
    *("AddedMotion", "Dependency", "Node", "PlanExecution", "Part", "Part.shifted", "Part.until"),
    *("PlanGraph", "PlanGraph.from_dict"),
    *("PlanGraph.with_times", "Route", "RunningPlan", "RunningPlan.part_at", "RunningPlan.with_parts"),
    *("PairProposal.get", "Geometry", "Inertial", "Joint", "Joint.motion", "Link", "Mimic", "Attachment", "Obstacle"),
}


def public_functions() -> Iterator[tuple[str, Any]]:
    """Every public function, constructor and method by its public name."""
    for name in rp.__all__:
        value = getattr(rp, name)
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value) and not issubclass(value, Exception | enum.Enum):
            yield name, value
            for verb, raw in inspect.getmembers_static(value):
                if not verb.startswith("_") and (
                    inspect.isfunction(raw) or isinstance(raw, staticmethod | classmethod)
                ):
                    yield f"{name}.{verb}", getattr(value, verb)
    for module in (transforms,):
        own = module.__name__.removeprefix("rr1plan.")
        for name in getattr(module, "__all__", vars(module)):
            value = getattr(module, name)
            of_ours = getattr(value, "__module__", "").startswith(module.__name__) and not name.startswith("_")
            if of_ours and name not in rp.__all__ and (inspect.isfunction(value) or inspect.isclass(value)):
                yield f"{own}.{name}", value


def takes_arguments(function: Any) -> bool:
    return any(name != "self" for name in inspect.signature(function).parameters)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Call]:
    return calls(tmp_path_factory.mktemp("arguments"))


NAMES = sorted(
    {name for name, function in public_functions() if takes_arguments(function)} - _NOT_CALLED | {"Trajectory.__call__"}
)


def test_no_argument_is_forgotten(table: dict[str, Call]) -> None:
    missing = []
    for name, function in public_functions():
        if name in table:
            parameters = inspect.signature(function).parameters.values()
            named = {p.name for p in parameters if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)} - {"self"}
            missing += [f"{name}({a}=)" for a in named - set(table[name][1]) - _ANYTHING.get(name, set())]
    assert not missing


@pytest.fixture
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some wrong values are valid names of output files; no browser opens, not even for pages with default options."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda url: True)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.usefixtures("_in_an_empty_folder")
def test_every_argument_is_checked(name: str, table: dict[str, Call]) -> None:
    function, right = table[name]
    if name not in ("screenshot", "save_video"):  # its page does not exist
        function(**right)
    for argument in right:
        for wrong, make in WRONG.items():
            if (name, argument) in _LABELS or (argument in _CALLBACKS and wrong == "class"):
                continue
            problem = refusal_of(function, {**right, argument: make()})
            assert problem is None, f"{name}({argument}={wrong}): {problem}"


# A class is callable, too; exceptions of the caller's functions are passed on.
_CALLBACKS = ("progress", "accept", "factory", "callback", "to", "on_event")


def refusal_of(function: Callable[..., Any], arguments: dict[str, Any]) -> str | None:
    """What is wrong with the error of a call; None if the error is right or the call succeeds."""
    try:
        function(**arguments)
    except rp.Rr1PlanError as error:
        return None if 10 < len(str(error)) < 3000 else f"a message of {len(str(error))} characters"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    return None


KINDS = {"scene": rp.Scene, "robot": rp.Robot, "trajectory": rp.Trajectory, "problem": rp.Problem, "limits": rp.Limits}
KINDS |= {"budget": rp.Budget, "path": rp.Path, "report": rp.Report}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.usefixtures("_in_an_empty_folder")
def test_a_value_of_another_kind_is_never_taken(name: str, table: dict[str, Call]) -> None:
    function, right = table[name]
    for argument in set(right) & {*KINDS, "progress", "accept"}:
        if (name, argument) in _ROBOT_NAMES:
            continue
        for wrong in (3, "nobody", [], object(), np.zeros(2)):
            with pytest.raises(rp.Rr1PlanError):
                function(**{**right, argument: wrong})
