"""All commands and their options."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

import rr1plan

_EPILOG = "exit codes: 0 done, 2 bad input, 3 no plan, 4 invalid plan, 130 interrupted"


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="rr1plan", description="Certified motion planning for robot arms.", epilog=_EPILOG
    )
    parser.add_argument("--version", action="version", version=f"rr1plan {rr1plan.__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _demo(_command(commands, "demo", "showing.demo", "plan, prove, replay and show a motion of RR1 among clutter"))
    _plan(_command(commands, "plan", "planning.plan", "plan a motion and prove it"))
    _validate(_command(commands, "validate", "planning.validate", "check a saved motion with the referee"))
    _play(_command(commands, "play", "planning.play", "replay a saved motion in MuJoCo"))
    _view(_command(commands, "view", "showing.view", "look at a scene or a saved motion in the browser"))
    _cspace(_command(commands, "cspace", "showing.cspace", "draw the configuration space of a two-joint arm"))
    _robots(_command(commands, "robots", "looking.robots", "list the robots, or describe one"))
    _scenes(_command(commands, "scenes", "looking.scenes", "list the scenes, or describe one"))
    _doctor(_command(commands, "doctor", "looking.doctor", "versions, and what is missing"))
    return parser


def _command(commands: Any, name: str, run: str, text: str) -> argparse.ArgumentParser:
    """A command; `run` is "module.function" under `rr1plan.cli`, loaded when the command is run."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=text[0].upper() + text[1:] + ".", epilog=_EPILOG
    )
    parser.set_defaults(command=run)
    parser.add_argument("--json", action="store_true", help="print the result as JSON and nothing else")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return parser


def _demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--output", default="rr1plan-demo", metavar="FOLDER", help="where to write (%(default)s)")
    parser.add_argument("--scene", default="rr1_cluttered", help="a scene with a query (%(default)s)")
    parser.add_argument("--query", help="a query of that scene (default: its first)")
    parser.add_argument("--seed", type=_seed, default=0, help="seed of the planner (%(default)s)")


def _plan(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="a shipped scene or a scene file")
    _query(parser)
    parser.add_argument("--planner", default="rrt_connect", help="a planner's name (%(default)s)")
    parser.add_argument("--retiming", default="blend", help="a retiming's name (%(default)s)")
    parser.add_argument("--no-shorten", action="store_true", help="keep the planner's path as it is")
    parser.add_argument("--torque-limits", action="store_true", help="also keep the joints' effort limits")
    parser.add_argument("--seconds", type=_positive, default=10.0, help="budget of wall time (%(default)s)")
    parser.add_argument("--iterations", type=_count, help="budget of iterations, for plans that repeat to the byte")
    parser.add_argument("--seed", type=_seed, default=0, help="seed of the planner (%(default)s)")
    parser.add_argument("--limits", help="limit preset of every arm, e.g. sim or hardware")
    parser.add_argument("--output", metavar="FILE", help="save the motion as JSON")
    parser.add_argument("--csv", metavar="FILE", help="save the trajectory as CSV")
    parser.add_argument("--html", metavar="FILE", help="save a page that plays the motion offline")
    parser.add_argument("--spheres", action="store_true", help="with --html: show the spheres that contain each link")


def _query(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("the question (default: the scene's first query)")
    group.add_argument("--query", help="a query of the scene, by name")
    group.add_argument("--arm", help="the arm that moves (default: the only one)")
    group.add_argument("--start", nargs="+", metavar="Q", help="a configuration's name, or its numbers [rad]")
    group.add_argument("--goal", nargs="+", metavar="Q", help="a configuration's name, or its numbers [rad]")
    group.add_argument("--position", nargs=3, type=_finite, metavar=("X", "Y", "Z"), help="goal of the frame [m]")
    group.add_argument("--quaternion", nargs=4, type=_finite, metavar=("W", "X", "Y", "Z"), help="its orientation")
    group.add_argument("--frame", default="tool", help="the frame that --position means (%(default)s)")


def _validate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("motion", help="a file written by plan --output")
    parser.add_argument("--scene", help="the scene to check it in (default: the one it was planned in)")
    parser.add_argument("--torque-limits", action="store_true", help="also check the joints' effort limits")
    parser.add_argument("--jerk-limits", action="store_true", help="also check the joints' jerk limits")


def _play(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("motion", help="a file written by plan --output")
    parser.add_argument("--scene", help="the scene to replay it in (default: the one it was planned in)")
    parser.add_argument("--mode", choices=("dynamic", "kinematic"), default="dynamic", help="(%(default)s)")
    parser.add_argument("--timestep", type=_positive, default=0.002, help="step of the simulator [s] (%(default)s)")


def _view(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("what", help="a shipped scene, a scene file, or a file written by plan --output")
    parser.add_argument("--port", type=_count, help="port of the page on this machine (default: the next free one)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.add_argument("--html", metavar="FILE", help="write an offline page instead of serving one")
    parser.add_argument("--spheres", action="store_true", help="show the spheres that contain each link")


def _cspace(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", help="a shipped scene or a scene file")
    parser.add_argument("--query", help="a query of the scene, by name (default: its first, where it has one)")
    parser.add_argument("--arm", help="the arm (default: the only one)")
    parser.add_argument("--joints", nargs=2, metavar=("A", "B"), help="two of its joints (default: the first two)")
    parser.add_argument("--resolution", type=_count, default=360, help="cells along each axis (%(default)s)")
    parser.add_argument("--planner", default="rrt_connect", help="planner of the path and tree drawn (%(default)s)")
    parser.add_argument("--seed", type=_seed, default=0, help="seed of the planner (%(default)s)")
    parser.add_argument("--png", metavar="FILE", help="write the picture (default: SCENE-cspace.png)")
    parser.add_argument("--svg", metavar="FILE", help="write the picture for slides")
    parser.add_argument("--html", metavar="FILE", help="write an offline page with sliders and click-to-pose")


def _robots(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("robot", nargs="?", help="a shipped robot, or a URDF or xacro file")


def _scenes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", nargs="?", help="a shipped scene, or a scene file")


def _doctor(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--warm", action="store_true", help="compile and cache the kernels now")


def _number(text: str, kind: Callable[[str], float], accept: Callable[[float], bool], wanted: str) -> Any:
    try:
        value = kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}") from None
    if not math.isfinite(value) or not accept(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}")
    return value


def _finite(text: str) -> float:
    return float(_number(text, float, lambda v: True, "a finite number"))


def _positive(text: str) -> float:
    return float(_number(text, float, lambda v: v > 0.0, "a number above zero"))


def _count(text: str) -> int:
    return int(_number(text, int, lambda v: v > 0, "a whole number above zero"))


def _seed(text: str) -> int:
    return int(_number(text, int, lambda v: v >= 0, "a seed, a whole number >= 0"))
