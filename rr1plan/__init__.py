"""rr1plan: certified motion planning for robot arms.

    import rr1plan as rp

    scene = rp.load_scene("rr1_table")
    problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
    motion = rp.plan_motion(problem, rng=0)
    print(motion.report)
    motion.show().wait()

All names below are imported lazily. `import rr1plan` does not even import `typing`, because the
command line cannot handle Ctrl-C before it is done.
"""

from __future__ import annotations

import sys
import time

from rr1plan.imports import import_clock

TYPE_CHECKING = False
if TYPE_CHECKING:
    import typing

    from rr1plan import multi as multi
    from rr1plan import playback as playback
    from rr1plan import retiming as retiming
    from rr1plan import transforms as transforms
    from rr1plan.batch import PlanFailure as PlanFailure
    from rr1plan.batch import plan_many as plan_many
    from rr1plan.collision import CollisionChecker as CollisionChecker
    from rr1plan.collision import Contact as Contact
    from rr1plan.collision import ElementCover as ElementCover
    from rr1plan.collision import FirstContact as FirstContact
    from rr1plan.collision import Nearest as Nearest
    from rr1plan.collision import cover_with_spheres as cover_with_spheres
    from rr1plan.errors import BackendError as BackendError
    from rr1plan.errors import CancelledError as CancelledError
    from rr1plan.errors import FormatError as FormatError
    from rr1plan.errors import InputError as InputError
    from rr1plan.errors import MissingPackageError as MissingPackageError
    from rr1plan.errors import NoPlanError as NoPlanError
    from rr1plan.errors import RetimingError as RetimingError
    from rr1plan.errors import Rr1PlanError as Rr1PlanError
    from rr1plan.errors import UnknownNameError as UnknownNameError
    from rr1plan.formats.convex_pieces import convex_pieces as convex_pieces
    from rr1plan.formats.csv_files import load_csv as load_csv
    from rr1plan.formats.csv_files import save_csv as save_csv
    from rr1plan.formats.meshes import load_mesh as load_mesh
    from rr1plan.formats.plan_files import save_motion as save_motion
    from rr1plan.formats.point_files import load_point_cloud as load_point_cloud
    from rr1plan.formats.ros_files import load_joint_trajectory as load_joint_trajectory
    from rr1plan.formats.srdf_proposal import propose_never_collide as propose_never_collide
    from rr1plan.kinematics import IkResult as IkResult
    from rr1plan.kinematics import Kinematics as Kinematics
    from rr1plan.kinematics import copies_within_limits as copies_within_limits
    from rr1plan.kinematics import solve_ik as solve_ik
    from rr1plan.library import installed_robot_names as installed_robot_names
    from rr1plan.library import load_problems as load_problems
    from rr1plan.library import load_robot as load_robot
    from rr1plan.library import load_scene as load_scene
    from rr1plan.library import robot_names as robot_names
    from rr1plan.library import save_scene as save_scene
    from rr1plan.library import scene_names as scene_names
    from rr1plan.limits import Limits as Limits
    from rr1plan.loading import load_motion as load_motion
    from rr1plan.multi import place_grid as place_grid
    from rr1plan.multi import place_ring as place_ring
    from rr1plan.path import Path as Path
    from rr1plan.pipeline import MotionPlan as MotionPlan
    from rr1plan.pipeline import plan_motion as plan_motion
    from rr1plan.pipeline import set_up as set_up
    from rr1plan.planners import Roadmap as Roadmap
    from rr1plan.planners import make_planner as make_planner
    from rr1plan.planners import plan as plan
    from rr1plan.planners import planner_names as planner_names
    from rr1plan.planners.shortcut import shorten as shorten
    from rr1plan.planning import Budget as Budget
    from rr1plan.planning import PlanResult as PlanResult
    from rr1plan.planning import PlanStatus as PlanStatus
    from rr1plan.playback import cspace as cspace
    from rr1plan.playback import save_html as save_html
    from rr1plan.playback import screenshot as screenshot
    from rr1plan.playback import show as show
    from rr1plan.playback import simulate as simulate
    from rr1plan.problem import JointGoal as JointGoal
    from rr1plan.problem import PoseGoal as PoseGoal
    from rr1plan.problem import Problem as Problem
    from rr1plan.problem import RegionGoal as RegionGoal
    from rr1plan.report import Margin as Margin
    from rr1plan.report import Report as Report
    from rr1plan.report import Violation as Violation
    from rr1plan.retiming import point_to_point as point_to_point
    from rr1plan.retiming import retime as retime
    from rr1plan.retiming import retiming_names as retiming_names
    from rr1plan.robot import Robot as Robot
    from rr1plan.scene import Arm as Arm
    from rr1plan.scene import Scene as Scene
    from rr1plan.scene import scene_differences as scene_differences
    from rr1plan.shapes import Box as Box
    from rr1plan.shapes import Capsule as Capsule
    from rr1plan.shapes import Cylinder as Cylinder
    from rr1plan.shapes import HalfSpace as HalfSpace
    from rr1plan.shapes import Mesh as Mesh
    from rr1plan.shapes import PointCloud as PointCloud
    from rr1plan.shapes import Sphere as Sphere
    from rr1plan.trajectory import Trajectory as Trajectory
    from rr1plan.validation import certify_path as certify_path
    from rr1plan.validation import validate as validate

__version__ = "0.1.0"

# A test checks that these names and the imports above agree.
_EXPORTS = {
    "rr1plan.batch": ("PlanFailure", "plan_many"),
    "rr1plan.collision": (
        "CollisionChecker",
        "Contact",
        "ElementCover",
        "FirstContact",
        "Nearest",
        "cover_with_spheres",
    ),
    "rr1plan.errors": (
        "BackendError",
        "CancelledError",
        "FormatError",
        "InputError",
        "MissingPackageError",
        "NoPlanError",
        "RetimingError",
        "Rr1PlanError",
        "UnknownNameError",
    ),
    "rr1plan.formats.csv_files": ("load_csv", "save_csv"),
    "rr1plan.formats.meshes": ("load_mesh",),
    "rr1plan.formats.convex_pieces": ("convex_pieces",),
    "rr1plan.formats.plan_files": ("save_motion",),
    "rr1plan.formats.point_files": ("load_point_cloud",),
    "rr1plan.formats.ros_files": ("load_joint_trajectory",),
    "rr1plan.formats.srdf_proposal": ("propose_never_collide",),
    "rr1plan.kinematics": ("IkResult", "Kinematics", "copies_within_limits", "solve_ik"),
    "rr1plan.library": (
        "installed_robot_names",
        "load_problems",
        "load_robot",
        "load_scene",
        "robot_names",
        "save_scene",
        "scene_names",
    ),
    "rr1plan.limits": ("Limits",),
    "rr1plan.loading": ("load_motion",),
    "rr1plan.multi": ("place_grid", "place_ring"),
    "rr1plan.path": ("Path",),
    "rr1plan.pipeline": ("MotionPlan", "plan_motion", "set_up"),
    "rr1plan.planners": ("Roadmap", "make_planner", "plan", "planner_names"),
    "rr1plan.planners.shortcut": ("shorten",),
    "rr1plan.planning": ("Budget", "PlanResult", "PlanStatus"),
    "rr1plan.playback": ("cspace", "save_html", "screenshot", "show", "simulate"),
    "rr1plan.problem": ("JointGoal", "PoseGoal", "Problem", "RegionGoal"),
    "rr1plan.report": ("Margin", "Report", "Violation"),
    "rr1plan.retiming": ("point_to_point", "retime", "retiming_names"),
    "rr1plan.robot": ("Robot",),
    "rr1plan.scene": ("Arm", "Scene", "scene_differences"),
    "rr1plan.shapes": ("Box", "Capsule", "Cylinder", "HalfSpace", "Mesh", "PointCloud", "Sphere"),
    "rr1plan.trajectory": ("Trajectory",),
    "rr1plan.validation": ("certify_path", "validate"),
}
_SUBMODULES = ("multi", "playback", "retiming", "transforms")
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = ["__version__", *_SUBMODULES, *_HOME]


def __getattr__(name: str) -> typing.Any:
    """Load a public name on first use."""
    if name not in _SUBMODULES and name not in _HOME:
        raise AttributeError(f"module 'rr1plan' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    from importlib import import_module

    began = time.perf_counter()
    if name in _SUBMODULES:
        value: typing.Any = import_module(f"rr1plan.{name}")
    else:
        value = getattr(import_module(_HOME[name]), name)
    import_clock.seconds += time.perf_counter() - began
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """All public names, loaded or not."""
    return sorted(__all__)
