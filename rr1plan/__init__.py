"""rr1plan: certified motion planning for robot arms.

    import rr1plan as rp

    scene = rp.load_scene("rr1_table")
    problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
    motion = rp.plan_motion(problem, rng=0)
    print(motion.report)
    motion.show().wait()

Where to begin; `help(rp.load_robot)` and so on show arguments, units, shapes and errors:

    robots      load_robot, robot_names, installed_robot_names, planar_arm, Robot, Limits
    scenes      Scene, load_scene, save_scene, scene_names, Box, Sphere, Cylinder, Capsule, HalfSpace, load_mesh
    problems    Problem, JointGoal, PoseGoal, RegionGoal, load_problems
    kinematics  Kinematics, solve_ik, dh_table
    collisions  CollisionChecker, TimedChecker, cover_with_spheres, second_opinion
    planning    plan_motion, plan_many, plan_many_arms, plan, shorten, retime, Budget, planner_names, retiming_names
    sequences   plan_sequence, Sequence, pick_and_place, simulate_sequence
    proofs      validate, certify_path, assert_valid, Report
    simulation  simulate, Simulation, JointTrajectoryController, assert_replays
    pictures    show, save_html, ViewOptions, screenshot, save_video, cspace, timeline, lesson
    files       load_motion, save_csv, save_joint_trajectory, save_rosbag, save_mjcf, save_glb
    real arms   calibrate, Mirror, plan_commands, send_commands

Units are SI and radians, quaternions are wxyz, numbers of a configuration are in the order of
`robot.joint_names`. A wrong argument raises an `InputError` that names it. The guide is docs/guide.md.
"""

# All names below are imported lazily. `import rr1plan` does not even import `typing`, because the
# command line cannot handle Ctrl-C before it is done.

from __future__ import annotations

import sys
import time

from rr1plan.import_clock import import_clock

TYPE_CHECKING = False
if TYPE_CHECKING:
    from rr1plan import transforms as transforms
    from rr1plan.batch import BatchResult as BatchResult
    from rr1plan.batch import PlanFailure as PlanFailure
    from rr1plan.batch import plan_many as plan_many
    from rr1plan.calibration.calibrate import calibrate as calibrate
    from rr1plan.calibration.calibrate import expected_calibration as expected_calibration
    from rr1plan.calibration.joint_calibration import Calibration as Calibration
    from rr1plan.calibration.joint_calibration import CalibrationFit as CalibrationFit
    from rr1plan.calibration.joint_calibration import JointCalibration as JointCalibration
    from rr1plan.calibration.joint_calibration import ZeroShift as ZeroShift
    from rr1plan.calibration.joint_calibration import load_calibration as load_calibration
    from rr1plan.calibration.measurement_poses import propose_calibration_poses as propose_calibration_poses
    from rr1plan.checks import Array as Array
    from rr1plan.checks import Seed as Seed
    from rr1plan.collision import CollisionChecker as CollisionChecker
    from rr1plan.collision import Contact as Contact
    from rr1plan.collision import ElementCover as ElementCover
    from rr1plan.collision import FirstContact as FirstContact
    from rr1plan.collision import Nearest as Nearest
    from rr1plan.collision import TimedChecker as TimedChecker
    from rr1plan.collision import TimedContact as TimedContact
    from rr1plan.collision import cover_with_spheres as cover_with_spheres
    from rr1plan.collision.edge_kernel import EdgeCounters as EdgeCounters
    from rr1plan.errors import BackendError as BackendError
    from rr1plan.errors import CancelledError as CancelledError
    from rr1plan.errors import ControllerError as ControllerError
    from rr1plan.errors import FormatError as FormatError
    from rr1plan.errors import HardwareError as HardwareError
    from rr1plan.errors import InputError as InputError
    from rr1plan.errors import InstallationError as InstallationError
    from rr1plan.errors import MissingPackageError as MissingPackageError
    from rr1plan.errors import NoPlanError as NoPlanError
    from rr1plan.errors import PlannerError as PlannerError
    from rr1plan.errors import RetimingError as RetimingError
    from rr1plan.errors import Rr1PlanError as Rr1PlanError
    from rr1plan.errors import SerialLineError as SerialLineError
    from rr1plan.errors import StalledJointError as StalledJointError
    from rr1plan.errors import UnknownNameError as UnknownNameError
    from rr1plan.experiments.run_experiments import ExperimentReport as ExperimentReport
    from rr1plan.experiments.run_experiments import run_experiments as run_experiments
    from rr1plan.export.controller_rules import check_joint_trajectory as check_joint_trajectory
    from rr1plan.export.csv_files import load_csv as load_csv
    from rr1plan.export.csv_files import save_csv as save_csv
    from rr1plan.export.glb_files import save_glb as save_glb
    from rr1plan.export.plan_files import save_motion as save_motion
    from rr1plan.export.robot_formats import save_mjcf as save_mjcf
    from rr1plan.export.robot_formats import save_rosbag as save_rosbag
    from rr1plan.export.ros_trajectories import load_joint_trajectory as load_joint_trajectory
    from rr1plan.export.ros_trajectories import save_joint_trajectory as save_joint_trajectory
    from rr1plan.hardware.box_emulator import BoxEmulator as BoxEmulator
    from rr1plan.hardware.box_emulator import EmulatedSerialLine as EmulatedSerialLine
    from rr1plan.hardware.command_plan import CommandPlan as CommandPlan
    from rr1plan.hardware.command_plan import plan_commands as plan_commands
    from rr1plan.hardware.command_sender import SerialPort as SerialPort
    from rr1plan.hardware.command_sender import open_serial_port as open_serial_port
    from rr1plan.hardware.command_sender import send_commands as send_commands
    from rr1plan.hardware.control_box import BoxChannel as BoxChannel
    from rr1plan.hardware.control_box import ControlBox as ControlBox
    from rr1plan.hardware.control_box import load_control_box as load_control_box
    from rr1plan.hardware.control_box_frames import BoxCommand as BoxCommand
    from rr1plan.hardware.control_box_frames import Telemetry as Telemetry
    from rr1plan.hardware.telemetry_states import read_telemetry as read_telemetry
    from rr1plan.lessons.arm_kinematics import DhRow as DhRow
    from rr1plan.lessons.arm_kinematics import DhTable as DhTable
    from rr1plan.lessons.arm_kinematics import dh_table as dh_table
    from rr1plan.lessons.figure_set import figure_names as figure_names
    from rr1plan.lessons.figure_set import save_figures as save_figures
    from rr1plan.lessons.lesson import Lesson as Lesson
    from rr1plan.lessons.lesson import LessonStep as LessonStep
    from rr1plan.lessons.lesson_catalog import lesson as lesson
    from rr1plan.lessons.lesson_catalog import lesson_names as lesson_names
    from rr1plan.lessons.phase_plane import PathGrid as PathGrid
    from rr1plan.lessons.phase_plane import PhasePlane as PhasePlane
    from rr1plan.lessons.phase_plane import phase_plane as phase_plane
    from rr1plan.lessons.search.lattice_search import search_lattice as search_lattice
    from rr1plan.lessons.search.roadmap_growth import grow_prm as grow_prm
    from rr1plan.lessons.search.search_record import SearchEvent as SearchEvent
    from rr1plan.lessons.search.search_record import SearchRecord as SearchRecord
    from rr1plan.lessons.search.tree_growth import grow_rrt as grow_rrt
    from rr1plan.lessons.search.tree_growth import grow_rrt_connect as grow_rrt_connect
    from rr1plan.lessons.search.tree_growth import grow_rrt_star as grow_rrt_star
    from rr1plan.lessons.seven_phases import SevenPhases as SevenPhases
    from rr1plan.lessons.seven_phases import seven_phases as seven_phases
    from rr1plan.mirror.corridor import Corridor as Corridor
    from rr1plan.mirror.corridor import CorridorPosition as CorridorPosition
    from rr1plan.mirror.corridor import certified_corridor as certified_corridor
    from rr1plan.mirror.joint_states import StateMessage as StateMessage
    from rr1plan.mirror.joint_states import StateStream as StateStream
    from rr1plan.mirror.joint_states import StreamError as StreamError
    from rr1plan.mirror.joint_states import read_states as read_states
    from rr1plan.mirror.mirror import Mirror as Mirror
    from rr1plan.mirror.mirror_report import MirrorEvent as MirrorEvent
    from rr1plan.mirror.mirror_report import MirrorReport as MirrorReport
    from rr1plan.mirror.mirror_report import MirrorState as MirrorState
    from rr1plan.model import IkResult as IkResult
    from rr1plan.model import Kinematics as Kinematics
    from rr1plan.model import copies_within_limits as copies_within_limits
    from rr1plan.model import solve_ik as solve_ik
    from rr1plan.motion_plan import MotionPlan as MotionPlan
    from rr1plan.multi.execution.added_motions import AddedMotion as AddedMotion
    from rr1plan.multi.execution.added_motions import add_motion as add_motion
    from rr1plan.multi.execution.plan_execution import ArmDelay as ArmDelay
    from rr1plan.multi.execution.plan_execution import PlanExecution as PlanExecution
    from rr1plan.multi.execution.plan_execution import execute_plan as execute_plan
    from rr1plan.multi.execution.route import Route as Route
    from rr1plan.multi.execution.running_plan import Part as Part
    from rr1plan.multi.execution.running_plan import RunningPlan as RunningPlan
    from rr1plan.multi.execution.saved_plan_graph import load_plan_graph as load_plan_graph
    from rr1plan.multi.execution.saved_plan_graph import save_plan_graph as save_plan_graph
    from rr1plan.multi.execution.temporal_plan_graph import Dependency as Dependency
    from rr1plan.multi.execution.temporal_plan_graph import Node as Node
    from rr1plan.multi.execution.temporal_plan_graph import PlanGraph as PlanGraph
    from rr1plan.multi.execution.temporal_plan_graph import plan_graph as plan_graph
    from rr1plan.multi.many_arms_result import GroupResult as GroupResult
    from rr1plan.multi.many_arms_result import ManyArmsResult as ManyArmsResult
    from rr1plan.multi.plan_quality import PlanQuality as PlanQuality
    from rr1plan.multi.portfolio import plan_many_arms as plan_many_arms
    from rr1plan.multi.scenarios.problems import dual_arm_shelf as dual_arm_shelf
    from rr1plan.multi.scenarios.problems import random_grid as random_grid
    from rr1plan.multi.scenarios.problems import reach_grid as reach_grid
    from rr1plan.multi.scenarios.problems import ring_swap as ring_swap
    from rr1plan.multi.scenarios.workcell_problems import conveyor_line as conveyor_line
    from rr1plan.multi.scenarios.workcell_problems import handover_window as handover_window
    from rr1plan.multi.scenarios.workcell_problems import shared_bin as shared_bin
    from rr1plan.multi.scenarios.workcell_problems import shelf_rows as shelf_rows
    from rr1plan.multi.timing.schedule import Leg as Leg
    from rr1plan.multi.timing.schedule import Schedule as Schedule
    from rr1plan.path import Path as Path
    from rr1plan.pipeline import plan_motion as plan_motion
    from rr1plan.pipeline import warm_up as warm_up
    from rr1plan.planners import AnytimePlanner as AnytimePlanner
    from rr1plan.planners import CartesianPlanner as CartesianPlanner
    from rr1plan.planners import OmplPlanner as OmplPlanner
    from rr1plan.planners import Roadmap as Roadmap
    from rr1plan.planners import RoadmapPlanner as RoadmapPlanner
    from rr1plan.planners import RrtConnect as RrtConnect
    from rr1plan.planners import plan as plan
    from rr1plan.planners import planner_names as planner_names
    from rr1plan.planners import register_planner as register_planner
    from rr1plan.planners.shortcut import shorten as shorten
    from rr1plan.planning import Budget as Budget
    from rr1plan.planning import Planner as Planner
    from rr1plan.planning import PlanResult as PlanResult
    from rr1plan.planning import PlanStatus as PlanStatus
    from rr1plan.planning import SearchTree as SearchTree
    from rr1plan.planning import Wait as Wait
    from rr1plan.playback.cspace.configuration_space import CSpace as CSpace
    from rr1plan.playback.cspace.configuration_space import cspace as cspace
    from rr1plan.playback.cspace.cspace_decomposition import Decomposition as Decomposition
    from rr1plan.playback.cspace.cspace_grid import CSpaceGrid as CSpaceGrid
    from rr1plan.playback.schedules.coordination_diagram import CoordinationDiagram as CoordinationDiagram
    from rr1plan.playback.schedules.timeline import Timeline as Timeline
    from rr1plan.playback.schedules.timeline import timeline as timeline
    from rr1plan.playback.search_trees import DrawnTree as DrawnTree
    from rr1plan.playback.simulation.arm_variation import ArmVariation as ArmVariation
    from rr1plan.playback.simulation.contact_points import ContactPoint as ContactPoint
    from rr1plan.playback.simulation.controllers import Controller as Controller
    from rr1plan.playback.simulation.controllers import ForwardPositionController as ForwardPositionController
    from rr1plan.playback.simulation.controllers import ForwardVelocityController as ForwardVelocityController
    from rr1plan.playback.simulation.controllers import JointInfo as JointInfo
    from rr1plan.playback.simulation.controllers import JointState as JointState
    from rr1plan.playback.simulation.controllers import SetPoint as SetPoint
    from rr1plan.playback.simulation.gripper_controller import GripperController as GripperController
    from rr1plan.playback.simulation.gripper_controller import GripperStatus as GripperStatus
    from rr1plan.playback.simulation.manual_controller import ManualController as ManualController
    from rr1plan.playback.simulation.recorder import Recorder as Recorder
    from rr1plan.playback.simulation.replay import BodyMotion as BodyMotion
    from rr1plan.playback.simulation.replay import Replay as Replay
    from rr1plan.playback.simulation.replay import ReplayContact as ReplayContact
    from rr1plan.playback.simulation.replay import ReplayRecord as ReplayRecord
    from rr1plan.playback.simulation.replay_trajectory import simulate as simulate
    from rr1plan.playback.simulation.simulation import Simulation as Simulation
    from rr1plan.playback.simulation.state_broadcaster import JointStateBroadcaster as JointStateBroadcaster
    from rr1plan.playback.simulation.trajectory_controller import Execution as Execution
    from rr1plan.playback.simulation.trajectory_controller import ExecutionStatus as ExecutionStatus
    from rr1plan.playback.simulation.trajectory_controller import JointTrajectoryController as JointTrajectoryController
    from rr1plan.playback.viewer import Panel as Panel
    from rr1plan.playback.viewer import Viewer as Viewer
    from rr1plan.playback.viewer import ViewOptions as ViewOptions
    from rr1plan.playback.viewer import pack_array as pack_array
    from rr1plan.playback.viewer import save_html as save_html
    from rr1plan.playback.viewer import save_video as save_video
    from rr1plan.playback.viewer import screenshot as screenshot
    from rr1plan.playback.viewer import show as show
    from rr1plan.playback.viewer.page_content import HasPage as HasPage
    from rr1plan.progress import Progress as Progress
    from rr1plan.progress import ProgressCallback as ProgressCallback
    from rr1plan.report import Margin as Margin
    from rr1plan.report import Report as Report
    from rr1plan.report import Violation as Violation
    from rr1plan.retiming import point_to_point as point_to_point
    from rr1plan.retiming import retime as retime
    from rr1plan.retiming import retiming_names as retiming_names
    from rr1plan.retiming.path_blends import CurveChecker as CurveChecker
    from rr1plan.robot import Geometry as Geometry
    from rr1plan.robot import Inertial as Inertial
    from rr1plan.robot import Joint as Joint
    from rr1plan.robot import Link as Link
    from rr1plan.robot import Mimic as Mimic
    from rr1plan.robot import Robot as Robot
    from rr1plan.robot.contact_bands import ContactBand as ContactBand
    from rr1plan.robot.disabled_collisions import PairProposal as PairProposal
    from rr1plan.robot.disabled_collisions import propose_disabled_collisions as propose_disabled_collisions
    from rr1plan.robot.joint_limits import Limits as Limits
    from rr1plan.robot.planar_arm import planar_arm as planar_arm
    from rr1plan.saved_motion import load_motion as load_motion
    from rr1plan.scene import Arm as Arm
    from rr1plan.scene import Attachment as Attachment
    from rr1plan.scene import Obstacle as Obstacle
    from rr1plan.scene import Scene as Scene
    from rr1plan.scene import scene_differences as scene_differences
    from rr1plan.scene.loose_bodies import load_body as load_body
    from rr1plan.scene.loose_bodies import stack_bodies as stack_bodies
    from rr1plan.scene.model_library import installed_robot_names as installed_robot_names
    from rr1plan.scene.model_library import load_problems as load_problems
    from rr1plan.scene.model_library import load_robot as load_robot
    from rr1plan.scene.model_library import load_scene as load_scene
    from rr1plan.scene.model_library import robot_names as robot_names
    from rr1plan.scene.model_library import scene_names as scene_names
    from rr1plan.scene.placement import place_grid as place_grid
    from rr1plan.scene.placement import place_ring as place_ring
    from rr1plan.scene.polygon_prism import polygon_prism as polygon_prism
    from rr1plan.scene.problem import Goal as Goal
    from rr1plan.scene.problem import JointGoal as JointGoal
    from rr1plan.scene.problem import PoseGoal as PoseGoal
    from rr1plan.scene.problem import Problem as Problem
    from rr1plan.scene.problem import RegionGoal as RegionGoal
    from rr1plan.scene.saved_scenes import save_scene as save_scene
    from rr1plan.sequences.pick_and_place import pick_and_place as pick_and_place
    from rr1plan.sequences.plan_sequence import plan_sequence as plan_sequence
    from rr1plan.sequences.segments import Attach as Attach
    from rr1plan.sequences.segments import Detach as Detach
    from rr1plan.sequences.segments import FreeMotion as FreeMotion
    from rr1plan.sequences.segments import MoveGripper as MoveGripper
    from rr1plan.sequences.segments import Pause as Pause
    from rr1plan.sequences.segments import StraightLine as StraightLine
    from rr1plan.sequences.sequence import Sequence as Sequence
    from rr1plan.sequences.sequence_files import load_sequence as load_sequence
    from rr1plan.sequences.sequence_plan import SequencePlan as SequencePlan
    from rr1plan.sequences.sequence_replay import CarriedObject as CarriedObject
    from rr1plan.sequences.sequence_replay import SequenceReplay as SequenceReplay
    from rr1plan.sequences.sequence_toml import load_segments as load_segments
    from rr1plan.sequences.simulate_sequence import simulate_sequence as simulate_sequence
    from rr1plan.sequences.stages import SequenceStage as SequenceStage
    from rr1plan.sequences.top_grasps import top_grasps as top_grasps
    from rr1plan.shapes import Box as Box
    from rr1plan.shapes import Capsule as Capsule
    from rr1plan.shapes import Color as Color
    from rr1plan.shapes import Cylinder as Cylinder
    from rr1plan.shapes import HalfSpace as HalfSpace
    from rr1plan.shapes import Mesh as Mesh
    from rr1plan.shapes import PointCloud as PointCloud
    from rr1plan.shapes import Shape as Shape
    from rr1plan.shapes import Sphere as Sphere
    from rr1plan.shapes.convex_decomposition import convex_pieces as convex_pieces
    from rr1plan.shapes.mesh_files import load_mesh as load_mesh
    from rr1plan.shapes.point_cloud_files import load_point_cloud as load_point_cloud
    from rr1plan.testing.assertions import assert_replays as assert_replays
    from rr1plan.testing.assertions import assert_valid as assert_valid
    from rr1plan.testing.replay_variations import ReplayVariations as ReplayVariations
    from rr1plan.testing.replay_variations import VariedReplays as VariedReplays
    from rr1plan.testing.second_opinion import Disagreement as Disagreement
    from rr1plan.testing.second_opinion import SampledContact as SampledContact
    from rr1plan.testing.second_opinion import SecondOpinion as SecondOpinion
    from rr1plan.testing.second_opinion import second_opinion as second_opinion
    from rr1plan.trajectory import Trajectory as Trajectory
    from rr1plan.validation import certify_path as certify_path
    from rr1plan.validation import validate as validate

__version__ = "0.1.0"

# A test checks that these names and the imports above agree.
_EXPORTS = {
    "rr1plan.batch": ("BatchResult", "PlanFailure", "plan_many"),
    "rr1plan.calibration.calibrate": ("calibrate", "expected_calibration"),
    "rr1plan.calibration.joint_calibration": (
        "Calibration",
        "CalibrationFit",
        "JointCalibration",
        "ZeroShift",
        "load_calibration",
    ),
    "rr1plan.calibration.measurement_poses": ("propose_calibration_poses",),
    "rr1plan.checks": ("Array", "Seed"),
    "rr1plan.collision": (
        "CollisionChecker",
        "Contact",
        "ElementCover",
        "FirstContact",
        "Nearest",
        "TimedChecker",
        "TimedContact",
        "cover_with_spheres",
    ),
    "rr1plan.collision.edge_kernel": ("EdgeCounters",),
    "rr1plan.errors": (
        "BackendError",
        "CancelledError",
        "ControllerError",
        "FormatError",
        "HardwareError",
        "InputError",
        "InstallationError",
        "MissingPackageError",
        "NoPlanError",
        "PlannerError",
        "RetimingError",
        "Rr1PlanError",
        "SerialLineError",
        "StalledJointError",
        "UnknownNameError",
    ),
    "rr1plan.experiments.run_experiments": ("ExperimentReport", "run_experiments"),
    "rr1plan.export.controller_rules": ("check_joint_trajectory",),
    "rr1plan.export.csv_files": ("load_csv", "save_csv"),
    "rr1plan.export.glb_files": ("save_glb",),
    "rr1plan.export.plan_files": ("save_motion",),
    "rr1plan.export.robot_formats": ("save_mjcf", "save_rosbag"),
    "rr1plan.export.ros_trajectories": ("load_joint_trajectory", "save_joint_trajectory"),
    "rr1plan.hardware.box_emulator": ("BoxEmulator", "EmulatedSerialLine"),
    "rr1plan.hardware.command_plan": ("CommandPlan", "plan_commands"),
    "rr1plan.hardware.command_sender": ("SerialPort", "open_serial_port", "send_commands"),
    "rr1plan.hardware.control_box": ("BoxChannel", "ControlBox", "load_control_box"),
    "rr1plan.hardware.control_box_frames": ("BoxCommand", "Telemetry"),
    "rr1plan.hardware.telemetry_states": ("read_telemetry",),
    "rr1plan.lessons.arm_kinematics": ("DhRow", "DhTable", "dh_table"),
    "rr1plan.lessons.figure_set": ("figure_names", "save_figures"),
    "rr1plan.lessons.lesson": ("Lesson", "LessonStep"),
    "rr1plan.lessons.lesson_catalog": ("lesson", "lesson_names"),
    "rr1plan.lessons.phase_plane": ("PathGrid", "PhasePlane", "phase_plane"),
    "rr1plan.lessons.search.lattice_search": ("search_lattice",),
    "rr1plan.lessons.search.roadmap_growth": ("grow_prm",),
    "rr1plan.lessons.search.search_record": ("SearchEvent", "SearchRecord"),
    "rr1plan.lessons.search.tree_growth": ("grow_rrt", "grow_rrt_connect", "grow_rrt_star"),
    "rr1plan.lessons.seven_phases": ("SevenPhases", "seven_phases"),
    "rr1plan.mirror.corridor": ("Corridor", "CorridorPosition", "certified_corridor"),
    "rr1plan.mirror.joint_states": ("StateMessage", "StateStream", "StreamError", "read_states"),
    "rr1plan.mirror.mirror": ("Mirror",),
    "rr1plan.mirror.mirror_report": ("MirrorEvent", "MirrorReport", "MirrorState"),
    "rr1plan.model": ("IkResult", "Kinematics", "copies_within_limits", "solve_ik"),
    "rr1plan.motion_plan": ("MotionPlan",),
    "rr1plan.multi.execution.added_motions": ("AddedMotion", "add_motion"),
    "rr1plan.multi.execution.plan_execution": ("ArmDelay", "PlanExecution", "execute_plan"),
    "rr1plan.multi.execution.route": ("Route",),
    "rr1plan.multi.execution.running_plan": ("Part", "RunningPlan"),
    "rr1plan.multi.execution.saved_plan_graph": ("load_plan_graph", "save_plan_graph"),
    "rr1plan.multi.execution.temporal_plan_graph": ("Dependency", "Node", "PlanGraph", "plan_graph"),
    "rr1plan.multi.many_arms_result": ("GroupResult", "ManyArmsResult"),
    "rr1plan.multi.plan_quality": ("PlanQuality",),
    "rr1plan.multi.portfolio": ("plan_many_arms",),
    "rr1plan.multi.scenarios.problems": ("dual_arm_shelf", "random_grid", "reach_grid", "ring_swap"),
    "rr1plan.multi.scenarios.workcell_problems": ("conveyor_line", "handover_window", "shared_bin", "shelf_rows"),
    "rr1plan.multi.timing.schedule": ("Leg", "Schedule"),
    "rr1plan.path": ("Path",),
    "rr1plan.pipeline": ("plan_motion", "warm_up"),
    "rr1plan.planners": (
        "AnytimePlanner",
        "CartesianPlanner",
        "OmplPlanner",
        "Roadmap",
        "RoadmapPlanner",
        "RrtConnect",
        "plan",
        "planner_names",
        "register_planner",
    ),
    "rr1plan.planners.shortcut": ("shorten",),
    "rr1plan.planning": ("Budget", "PlanResult", "PlanStatus", "Planner", "SearchTree", "Wait"),
    "rr1plan.playback.cspace.configuration_space": ("CSpace", "cspace"),
    "rr1plan.playback.cspace.cspace_decomposition": ("Decomposition",),
    "rr1plan.playback.cspace.cspace_grid": ("CSpaceGrid",),
    "rr1plan.playback.schedules.coordination_diagram": ("CoordinationDiagram",),
    "rr1plan.playback.schedules.timeline": ("Timeline", "timeline"),
    "rr1plan.playback.search_trees": ("DrawnTree",),
    "rr1plan.playback.simulation.arm_variation": ("ArmVariation",),
    "rr1plan.playback.simulation.contact_points": ("ContactPoint",),
    "rr1plan.playback.simulation.controllers": (
        "Controller",
        "ForwardPositionController",
        "ForwardVelocityController",
        "JointInfo",
        "JointState",
        "SetPoint",
    ),
    "rr1plan.playback.simulation.gripper_controller": ("GripperController", "GripperStatus"),
    "rr1plan.playback.simulation.manual_controller": ("ManualController",),
    "rr1plan.playback.simulation.recorder": ("Recorder",),
    "rr1plan.playback.simulation.replay": ("BodyMotion", "Replay", "ReplayContact", "ReplayRecord"),
    "rr1plan.playback.simulation.replay_trajectory": ("simulate",),
    "rr1plan.playback.simulation.simulation": ("Simulation",),
    "rr1plan.playback.simulation.state_broadcaster": ("JointStateBroadcaster",),
    "rr1plan.playback.simulation.trajectory_controller": ("Execution", "ExecutionStatus", "JointTrajectoryController"),
    "rr1plan.playback.viewer": (
        "Panel",
        "ViewOptions",
        "Viewer",
        "pack_array",
        "save_html",
        "save_video",
        "screenshot",
        "show",
    ),
    "rr1plan.playback.viewer.page_content": ("HasPage",),
    "rr1plan.progress": ("Progress", "ProgressCallback"),
    "rr1plan.report": ("Margin", "Report", "Violation"),
    "rr1plan.retiming": ("point_to_point", "retime", "retiming_names"),
    "rr1plan.retiming.path_blends": ("CurveChecker",),
    "rr1plan.robot": ("Geometry", "Inertial", "Joint", "Link", "Mimic", "Robot"),
    "rr1plan.robot.contact_bands": ("ContactBand",),
    "rr1plan.robot.disabled_collisions": ("PairProposal", "propose_disabled_collisions"),
    "rr1plan.robot.joint_limits": ("Limits",),
    "rr1plan.robot.planar_arm": ("planar_arm",),
    "rr1plan.saved_motion": ("load_motion",),
    "rr1plan.scene": ("Arm", "Attachment", "Obstacle", "Scene", "scene_differences"),
    "rr1plan.scene.loose_bodies": ("load_body", "stack_bodies"),
    "rr1plan.scene.model_library": (
        "installed_robot_names",
        "load_problems",
        "load_robot",
        "load_scene",
        "robot_names",
        "scene_names",
    ),
    "rr1plan.scene.placement": ("place_grid", "place_ring"),
    "rr1plan.scene.polygon_prism": ("polygon_prism",),
    "rr1plan.scene.problem": ("Goal", "JointGoal", "PoseGoal", "Problem", "RegionGoal"),
    "rr1plan.scene.saved_scenes": ("save_scene",),
    "rr1plan.sequences.pick_and_place": ("pick_and_place",),
    "rr1plan.sequences.plan_sequence": ("plan_sequence",),
    "rr1plan.sequences.segments": ("Attach", "Detach", "FreeMotion", "MoveGripper", "Pause", "StraightLine"),
    "rr1plan.sequences.sequence": ("Sequence",),
    "rr1plan.sequences.sequence_files": ("load_sequence",),
    "rr1plan.sequences.sequence_plan": ("SequencePlan",),
    "rr1plan.sequences.sequence_replay": ("CarriedObject", "SequenceReplay"),
    "rr1plan.sequences.sequence_toml": ("load_segments",),
    "rr1plan.sequences.simulate_sequence": ("simulate_sequence",),
    "rr1plan.sequences.stages": ("SequenceStage",),
    "rr1plan.sequences.top_grasps": ("top_grasps",),
    "rr1plan.shapes": ("Box", "Capsule", "Color", "Cylinder", "HalfSpace", "Mesh", "PointCloud", "Shape", "Sphere"),
    "rr1plan.shapes.convex_decomposition": ("convex_pieces",),
    "rr1plan.shapes.mesh_files": ("load_mesh",),
    "rr1plan.shapes.point_cloud_files": ("load_point_cloud",),
    "rr1plan.testing.assertions": ("assert_replays", "assert_valid"),
    "rr1plan.testing.replay_variations": ("ReplayVariations", "VariedReplays"),
    "rr1plan.testing.second_opinion": ("Disagreement", "SampledContact", "SecondOpinion", "second_opinion"),
    "rr1plan.trajectory": ("Trajectory",),
    "rr1plan.validation": ("certify_path", "validate"),
}
_SUBMODULES = ("transforms",)
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = ["__version__", *_SUBMODULES, *_HOME]

if not TYPE_CHECKING:  # so that type checkers reject names that are not listed above

    def __getattr__(name: str) -> object:
        """Load a public name on first use."""
        if name not in _SUBMODULES and name not in _HOME:
            raise AttributeError(f"module 'rr1plan' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
        from importlib import import_module

        from rr1plan.errors import missing_libraries_named
        from rr1plan.held_interrupts import interrupts_held

        began = time.perf_counter()
        # Some libraries turn a Ctrl-C during their import into an ImportError, or lose it.
        with missing_libraries_named(), interrupts_held():
            module = import_module(_HOME.get(name, f"rr1plan.{name}"))
        value = module if name in _SUBMODULES else getattr(module, name)
        import_clock.seconds += time.perf_counter() - began
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """All public names, loaded or not."""
    return sorted(__all__)
