"""All commands and their options."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping
from typing import Any

import rr1plan
from rr1plan.cli.arguments import Parser, Show

_EXIT_CODES = "exit codes: 0 done, 2 bad input, 3 no plan, 4 invalid plan or failed replay, 130 interrupted"

_FILE = "a file that plan wrote, a trajectory (.json, .csv), a ROS JointTrajectory (.yaml), or a ROS bag"
_MOTION = f"a motion: {_FILE}"


def build_parser() -> tuple[Parser, dict[str, Parser]]:
    """The parser of the whole command line, and that of each command."""
    parser = Parser(
        prog="rr1plan",
        description="Certified motion planning for robot arms.",
        epilog=_examples(
            "rr1plan demo",
            "rr1plan scenes",
            "rr1plan plan rr1_table --html plan.html",
            "rr1plan plan cell.toml --position -0.3 0.25 0.2 --output motion.json",
            "rr1plan validate motion.json",
            "rr1plan COMMAND --help",
        ),
    )
    parser.details = lambda: _EXIT_CODES
    version = f"rr1plan {rr1plan.__version__}\n"
    parser.add_argument("--version", action=Show, text=lambda: version, help="show the version and exit")
    rows = parser.add_subparsers(title="commands", required=True, metavar="COMMAND", dest="name")
    commands = {}
    for name, (run, text, examples, add) in _COMMANDS.items():
        command = rows.add_parser(
            name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=_examples(*examples)
        )
        command.set_defaults(command=run)
        command.add_argument("--json", action="store_true", help="print the result as JSON and nothing else")
        quiet = "print nothing but errors" + ", and the names of a list" * (name in _LISTS)
        command.add_argument("--quiet", action="store_true", help=quiet)
        command.details = lambda: _EXIT_CODES
        add(command)
        commands[name] = command
    return parser, commands


def _examples(*lines: str) -> str:
    return "\n  ".join(["examples:", *lines])


def _demo(parser: Parser) -> None:
    parser.add_argument(
        "--output",
        type=_named_file,
        default="rr1plan-demo",
        metavar="FOLDER",
        help="folder for the files (%(default)s)",
    )
    parser.add_argument("--scene", default="rr1_cluttered", help="a scene with a query (%(default)s)")
    parser.add_argument("--query", help="a query of that scene (default: its first)")
    parser.add_argument("--seed", type=_seed, default=0, help="seed of the planner (%(default)s)")
    _view_from(parser, "of the page")


def _plan(parser: Parser) -> None:
    parser.add_argument(
        "scene", metavar="SCENE", help="a shipped scene, a scene file, or a sequence file (.toml with segments)"
    )
    _query(parser)
    parser.add_argument(
        "--planner", help="one of the planners below (rrt_connect, for three moving arms and more many_arms)"
    )
    parser.add_argument("--retiming", default="blend", help="one of the retimings below (%(default)s)")
    parser.add_argument("--no-shorten", action="store_true", help="keep the planner's path as it is")
    parser.add_argument(
        "--margin",
        type=_distance,
        metavar="D",
        help="distance to keep beyond the scene's padding [m], reduced where start or goal are closer (default: 0.002)",
    )
    parser.add_argument("--torque-limits", action="store_true", help="also keep the joints' effort limits")
    parser.add_argument("--seconds", type=_positive, default=10.0, help="budget of wall time [s] (%(default)s)")
    parser.add_argument("--iterations", type=_count, help="budget of iterations, for plans that repeat to the byte")
    parser.add_argument("--seed", type=_seed, default=0, help="seed of the planner (%(default)s)")
    parser.add_argument("--limits", help="limit preset of every arm, e.g. sim or hardware")
    parser.add_argument(
        "--output", type=_file, metavar="FILE", help="save the motion as JSON (- writes it to standard output)"
    )
    parser.add_argument(
        "--embed", action="store_true", help="with --output: put meshes into the file, not into the folder geometry"
    )
    parser.add_argument(
        "--csv", type=_file, metavar="FILE", help="save the trajectory as CSV (- writes it to standard output)"
    )
    parser.add_argument("--html", type=_named_file, metavar="FILE", help="save a page that plays the motion offline")
    parser.add_argument("--spheres", action="store_true", help="with --html: show the spheres that contain each link")
    _view_from(parser, "of the page, with --html")
    figure = _file_of(".png", ".svg", ".pdf")
    parser.add_argument(
        "--timeline", type=figure, metavar="FILE", help="draw which arm moves, waits or touches another one when"
    )
    parser.add_argument(
        "--diagram", type=figure, metavar="FILE", help="of many_arms: draw how two arms are timed on their paths"
    )
    parser.add_argument(
        "--pair",
        nargs=2,
        metavar=("ARM", "ARM"),
        help="with --diagram: the two arms (default: the one that waits longest, and the one it waits for)",
    )
    parser.needs("--pair", "--diagram")
    parser.needs("--spheres", "--html")
    parser.needs("--view", "--html")
    parser.needs("--embed", "--output")
    parser.different_files(("scene",), "--output", "--csv", "--html", "--timeline", "--diagram")
    parser.details = lambda: f"{_planners(_MANY_ARMS)}\n\n{_retimings()}\n\n{_EXIT_CODES}"


def _view_from(parser: Parser, of: str, default: str = "one that shows the motion") -> None:
    """The option for the initial view of a page."""
    parser.add_argument(
        "--view",
        nargs="+",
        metavar="V",
        help=f"first view {of}: front, back, left, right, top or corner; azimuth and elevation [rad]; or a direction "
        f"x y z (default: {default})",
    )


def _query(parser: Parser) -> None:
    group = parser.add_argument_group("the query (default: the scene's first)")
    group.add_argument("--query", help="a query of the scene, by name")
    group.add_argument("--arm", help="the arm that --goal or --position is for (default: the only one)")
    group.add_argument("--start", nargs="+", metavar="Q", help="a configuration's name, or its numbers [rad or m]")
    group.add_argument("--goal", nargs="+", metavar="Q", help="a configuration's name, or its numbers [rad or m]")
    group.add_argument("--position", nargs=3, type=_finite, metavar=("X", "Y", "Z"), help="goal of the frame [m]")
    group.add_argument("--quaternion", nargs=4, type=_finite, metavar=("W", "X", "Y", "Z"), help="its orientation")
    group.add_argument("--frame", help="the frame that --position is for (tool)")
    parser.at_most_one("--query", "--goal", "--position")
    parser.needs("--arm", "--goal", "--position")
    parser.needs("--quaternion", "--position")
    parser.needs("--frame", "--position")


def _validate(parser: Parser) -> None:
    parser.add_argument("motion", metavar="MOTION", help=_MOTION)
    parser.add_argument("--scene", help="the scene to check it in (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument("--torque-limits", action="store_true", help="also check the joints' effort limits")
    parser.add_argument("--jerk-limits", action="store_true", help="also check the joints' jerk limits")


def _topic(parser: Parser) -> None:
    """The option that selects the topic of a bag."""
    parser.add_argument("--topic", help="the topic of a bag (default: the only one that holds a JointTrajectory)")


def _play(parser: Parser) -> None:
    parser.add_argument("motion", metavar="MOTION", help=_MOTION)
    parser.add_argument("--scene", help="the scene to replay it in (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument(
        "--mode",
        choices=("dynamic", "kinematic"),
        default="dynamic",
        help="dynamic: servos drive the joints; kinematic: the joints have their planned positions (%(default)s)",
    )
    parser.add_argument("--timestep", type=_positive, default=0.002, help="step of the simulator [s] (%(default)s)")
    parser.add_argument(
        "--html",
        type=_named_file,
        metavar="FILE",
        help="write a page that plays what was planned and what was simulated",
    )
    parser.add_argument(
        "--side-by-side", action="store_true", help="both in their own pictures, with the same camera and on one clock"
    )
    _video(parser, "what the simulation did")
    parser.needs("--side-by-side", "--html", "--video")
    parser.needs("--size", "--video")
    parser.needs("--bare", "--video")
    parser.different_files(("motion",), "--html", "--video")


def _video(parser: Parser, of: str) -> None:
    """The options of videos and of pictures."""
    parser.add_argument(
        "--video", type=_file_of(".mp4", ".gif", ".webp"), metavar="FILE", help=f"film {of} (.mp4, .gif or .webp)"
    )
    parser.add_argument("--fps", type=_positive, default=30.0, help="pictures per second of the video (%(default)g)")
    parser.add_argument("--speed", type=_positive, default=1.0, help="speed of the video (%(default)g)")
    parser.add_argument(
        "--size", type=_count, nargs=2, default=(1280, 800), metavar=("W", "H"), help="its size [px] (1280 800)"
    )
    parser.add_argument("--bare", action="store_true", help="without the cards around the picture")
    parser.needs("--fps", "--video")
    parser.needs("--speed", "--video")


def _send(parser: Parser) -> None:
    parser.add_argument("motion", metavar="MOTION", help=_MOTION)
    parser.add_argument(
        "--calibration",
        type=_named_file,
        required=True,
        metavar="FILE",
        help="the arm's calibration in steps, with its control box (.toml)",
    )
    parser.add_argument(
        "--port", type=_named_file, help="the serial port of the box, e.g. /dev/ttyACM0 (default: a dry run)"
    )
    parser.add_argument("--scene", help="the scene to certify it in (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument(
        "--tolerance",
        type=_positive,
        default=0.01,
        help="how far segments may leave the motion [rad], halved where the arm would collide (%(default)s)",
    )
    parser.add_argument(
        "--safety", choices=("high", "low"), default="high", help="high: at most 1024 steps a command (%(default)s)"
    )


def _mirror(parser: Parser) -> None:
    parser.add_argument(
        "source",
        metavar="SOURCE",
        help="joint states: udp://HOST:PORT, serial:PORT of a control box, a file (.jsonl), or a ROS bag",
    )
    parser.add_argument("--calibration", metavar="FILE", help="with serial: calibration of the arm and its channels")
    parser.add_argument("--plan", metavar="MOTION", help=f"the planned motion: {_FILE}")
    parser.add_argument("--scene", help="the scene (default: the one that the motion's file holds)")
    parser.add_argument("--topic", help="the topic of a bag (default: the only one that holds such messages)")
    parser.add_argument(
        "--start", type=_finite, help="when the plan begins, on the sender's clock [s] (default: at the first message)"
    )
    parser.add_argument("--record", type=_named_file, metavar="FILE", help="write all messages to a file (.jsonl)")
    parser.add_argument("--duration", type=_positive, help="how long to listen [s] (default: to the end, or Ctrl-C)")
    parser.add_argument(
        "--silence", type=_positive, default=1.0, help="report a socket that is silent for this long [s] (%(default)s)"
    )
    parser.add_argument("--port", type=_count, help="port of the page on this machine (default: the next free one)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.add_argument("--no-page", action="store_true", help="only print what is noticed")
    parser.excludes("--no-page", "--port", "--no-browser")
    parser.different_files(("source", "--calibration", "--plan", "--scene"), "--record")


def _view(parser: Parser) -> None:
    parser.add_argument("what", metavar="WHAT", help=f"a scene or a robot, by name or file, or {_MOTION}")
    parser.add_argument("--scene", help="the scene of the motion (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument("--port", type=_count, help="port of the page on this machine (default: the next free one)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.add_argument("--html", type=_named_file, metavar="FILE", help="write an offline page instead of serving one")
    parser.add_argument("--png", type=_file_of(".png"), metavar="FILE", help="write a picture (needs Chromium)")
    parser.add_argument("--time", type=_finite, metavar="T", help="its moment of the motion [s] (default: the start)")
    _video(parser, "the motion")
    parser.add_argument(
        "--glb", type=_file_of(".glb"), metavar="FILE", help="write an animated 3-D model, for Blender, Unity or VR"
    )
    parser.add_argument("--spheres", action="store_true", help="show the spheres that contain each link")
    parser.add_argument("--compare", metavar="MOTION", help="another motion file, drawn over the motion on one clock")
    parser.add_argument(
        "--side-by-side",
        action="store_true",
        help="with --compare: each motion in its own picture, with the same camera",
    )
    _view_from(parser, "of the page")
    files = ("--html", "--png", "--video", "--glb")
    for option in files:
        parser.excludes(option, "--port", "--no-browser")
    parser.needs("--side-by-side", "--compare")
    parser.needs("--time", "--png")
    parser.needs("--size", "--png", "--video")
    parser.needs("--bare", "--png", "--video")
    parser.different_files(("what", "--scene", "--compare"), *files)


def _cspace(parser: Parser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="a shipped scene or a scene file")
    parser.add_argument("--query", help="a query of the scene, by name (default: its first of a two-joint arm, if any)")
    parser.add_argument("--arm", help="the arm (default: the only one)")
    parser.add_argument(
        "--joints", nargs=2, metavar=("A", "B"), help="two of its joints (default: the first two); the others rest"
    )
    parser.add_argument(
        "--at",
        nargs="+",
        metavar="Q",
        help="positions of the other joints: a configuration's name, or its numbers [rad or m] (default: the scene's)",
    )
    parser.add_argument("--resolution", type=_count, default=360, help="cells along each axis, 8 to 2000 (%(default)s)")
    parser.add_argument("--planner", default="rrt_connect", help="planner of the path and tree drawn (%(default)s)")
    parser.add_argument(
        "--seconds", type=_positive, default=5.0, help="the planner's budget of wall time [s] (%(default)s)"
    )
    parser.add_argument("--seed", type=_seed, default=0, help="seed of the planner (%(default)s)")
    parser.add_argument(
        "--png", type=_file_of(".png"), metavar="FILE.png", help="write the picture (default: SCENE-cspace.png)"
    )
    parser.add_argument("--svg", type=_file_of(".svg"), metavar="FILE.svg", help="write the picture for slides")
    parser.add_argument("--pdf", type=_file_of(".pdf"), metavar="FILE.pdf", help="write the picture for papers")
    parser.add_argument(
        "--html", type=_file_of(".html"), metavar="FILE.html", help="write an offline page with sliders"
    )
    _video(parser, "the path, or the growing tree where there is none")
    parser.needs("--size", "--video")
    parser.needs("--bare", "--video")
    _view_from(parser, "of the page, with --html", "from above for a planar arm, else one that shows the motion")
    parser.needs("--view", "--html")
    parser.details = lambda: f"{_planners()}\n\n{_EXIT_CODES}"


def _lesson(parser: Parser) -> None:
    parser.add_argument("lesson", metavar="LESSON", nargs="?", help="a lesson, by name (default: list them)")
    parser.add_argument("--scene", help="your own arm and obstacles: a shipped scene or a scene file")
    parser.add_argument("--query", help="with --scene: a query of that scene, by name, for lessons that have one")
    parser.add_argument("--html", type=_file_of(".html"), metavar="FILE.html", help="write the page, for offline use")
    parser.add_argument(
        "--figure", type=_file_of(".png", ".svg"), metavar="FILE", help="write the picture for slides: .png or .svg"
    )
    _video(parser, "what a step animates")
    parser.add_argument("--step", type=_count, help="with --video: the step of the lesson (default: the first)")
    parser.add_argument("--port", type=_count, help="port of the page on this machine (default: the next free one)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.needs("--query", "--scene")
    for option in ("--step", "--size", "--bare"):
        parser.needs(option, "--video")
    for file in ("--html", "--figure", "--video"):
        parser.excludes(file, "--port", "--no-browser")


def _figures(parser: Parser) -> None:
    parser.add_argument("names", metavar="FIGURE", nargs="*", help="figures by name (default: all)")
    parser.add_argument("--out", type=_named_file, required=True, metavar="DIR", help="folder for the files")


def _experiment(parser: Parser) -> None:
    parser.add_argument(
        "experiment",
        metavar="EXPERIMENT",
        nargs="+",
        choices=("static", "dynamic", "multi", "latency", "all"),
        help="static: an arm among stationary boats; dynamic: a falling tower of boats; multi: arms that follow "
        "seven poses; latency: messages to the viewer; all",
    )
    parser.add_argument("--out", type=_named_file, required=True, metavar="DIR", help="folder for the files")
    parser.add_argument("--quick", action="store_true", help="few and short measurements, in less than half a minute")
    parser.add_argument(
        "--arms", type=_count, nargs="+", metavar="N", help="numbers of arms of multi (default: 1 to 120)"
    )
    parser.add_argument("--seed", type=_seed, default=0, help="seed of boats and messages (%(default)s)")


def _robots(parser: Parser) -> None:
    parser.add_argument(
        "robot", metavar="ROBOT", nargs="?", help="a shipped or installed robot, or a URDF, xacro or MJCF file"
    )


def _scenes(parser: Parser) -> None:
    parser.add_argument("scene", metavar="SCENE", nargs="?", help="a shipped scene, or a scene file")


def _no_options(parser: Parser) -> None:
    """A command with the common options only."""


# For each command: "module.function" under `rr1plan.cli`, loaded when it is run; help; examples; its options.
_COMMANDS: dict[str, tuple[str, str, tuple[str, ...], Callable[[Parser], None]]] = {
    "demo": (
        "view.demo",
        "plan, prove, replay and show a motion of RR1 among clutter",
        ("rr1plan demo", "rr1plan demo --scene rr1_window --query through --output window"),
        _demo,
    ),
    "plan": (
        "plan_segments.plan_any",
        "plan a motion or a sequence and prove it",
        (
            "rr1plan plan rr1_table",
            "rr1plan plan rr1_table --query above_parcel --html plan.html",
            "rr1plan plan rr1_table --position -0.3 0.25 0.2 --output motion.json --csv motion.csv",
            "rr1plan plan cell.toml --start home --goal 0.5 0.4 -0.9 --planner anytime --seconds 1",
            "rr1plan plan rr1_pair --arm left --goal zero --limits hardware",
            "rr1plan plan rr1_ring --timeline timeline.svg --diagram diagram.svg",
            "rr1plan plan pick.toml --output pick.json --html pick.html",
        ),
        _plan,
    ),
    "validate": (
        "saved_motions.validate",
        "check a saved motion with the referee",
        (
            "rr1plan validate motion.json",
            "rr1plan validate motion.json --scene changed.toml",
            "rr1plan validate samples.csv --scene cell.toml --torque-limits",
        ),
        _validate,
    ),
    "play": (
        "saved_motions.play",
        "replay a saved motion in MuJoCo",
        (
            "rr1plan play motion.json",
            "rr1plan play motion.json --mode kinematic",
            "rr1plan play motion.json --video motion.mp4",
            "rr1plan play motion.json --html both.html --side-by-side",
        ),
        _play,
    ),
    "send": (
        "send.send",
        "send a saved motion to RR1's control box, or without a port to an emulated one (a dry run)",
        (
            "rr1plan send motion.json --calibration arm.toml",
            "rr1plan send motion.json --calibration arm.toml --port /dev/ttyACM0",
        ),
        _send,
    ),
    "view": (
        "view.view",
        "look at a scene, a robot or a saved motion in the browser",
        (
            "rr1plan view rr1_shelf",
            "rr1plan view rr1",
            "rr1plan view motion.json --html motion.html",
            "rr1plan view motion.json --video motion.gif --size 640 400 --fps 20 --bare",
            "rr1plan view motion.json --png start.png --glb motion.glb",
            "rr1plan view motion.json --compare other.json --side-by-side",
        ),
        _view,
    ),
    "mirror": (
        "joint_stream.mirror",
        "show live joint states, compared with a plan and its certified corridor",
        (
            "rr1plan mirror udp://127.0.0.1:9000 --plan motion.json --record run.jsonl",
            "rr1plan mirror run.jsonl --plan motion.json --no-page",
        ),
        _mirror,
    ),
    "cspace": (
        "cspace_command.cspace",
        "draw the configuration space of two joints, and plan a query in it or prove that no path exists",
        (
            "rr1plan cspace planar2r_path",
            "rr1plan cspace planar2r_no_path --svg figure.svg --html page.html",
            "rr1plan cspace rr1_table --joints shoulder_joint elbow_joint --at zero --resolution 120",
        ),
        _cspace,
    ),
    "lesson": (
        "lesson_command.lesson",
        "list the lessons, open one, or write its page and its figure for slides",
        (
            "rr1plan lesson",
            "rr1plan lesson workspace",
            "rr1plan lesson workspace --html workspace.html --figure workspace.svg",
            "rr1plan lesson workspace --scene planar2r_path",
        ),
        _lesson,
    ),
    "figures": (
        "lesson_command.figures",
        "write the figures of the lessons and the pictures of the README",
        ("rr1plan figures --out figures", "rr1plan figures workspace no_path --out figures"),
        _figures,
    ),
    "experiment": (
        "experiment.experiment",
        "measure the simulator and the viewer, compared with the figures of the thesis",
        (
            "rr1plan experiment all --out results --quick",
            "rr1plan experiment dynamic --out results",
            "rr1plan experiment multi --out results --arms 120 250 500 1000",
        ),
        _experiment,
    ),
    "robots": (
        "info.robots",
        "list the robots, or describe one",
        (
            "rr1plan robots",
            "rr1plan robots --quiet",
            "rr1plan robots rr1",
            "rr1plan robots arm.urdf",
            "rr1plan robots arm.xml",
        ),
        _robots,
    ),
    "scenes": (
        "info.scenes",
        "list the scenes, or describe one",
        ("rr1plan scenes", "rr1plan scenes rr1_table", "rr1plan scenes cell.toml"),
        _scenes,
    ),
    "doctor": (
        "info.doctor",
        "show versions, and what is missing",
        ("rr1plan doctor", "rr1plan doctor --json"),
        _no_options,
    ),
}


# Commands that list names if none is given.
_LISTS = ("robots", "scenes", "lesson")


# Planners of `plan` that make trajectories, not paths.
_MANY_ARMS = {
    "many_arms": "a path for each of many arms, and a schedule without collisions between them",
    "many_arms_anytime *": "many_arms, then better schedules and paths",
}


def _planners(more: Mapping[str, str] | None = None) -> str:
    from rr1plan.planners import planner_table

    rows = {row.name + " *" * row.optimizing: row.description for row in planner_table()} | dict(more or {})
    return _listed("planners (* improves its path until the budget ends)", rows)


def _retimings() -> str:
    from rr1plan.retiming import retiming_table

    return _listed("retimings", retiming_table())


def _listed(title: str, rows: Mapping[str, str]) -> str:
    width = max(map(len, rows))
    return "\n  ".join([f"{title}:", *(f"{name:<{width}}  {text}" for name, text in rows.items())])


def _file(text: str) -> str:
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError(f"{text!r} is not a file name")
    return text


def _named_file(text: str) -> str:
    """A file or folder other than standard output."""
    if _file(text) == "-":
        raise argparse.ArgumentTypeError("'-' is standard output, expected a name")
    return text


def _file_of(*suffixes: str) -> Callable[[str], str]:
    """A file name that ends in one of some suffixes."""

    def check(text: str) -> str:
        if not _file(text).lower().endswith(suffixes):
            raise argparse.ArgumentTypeError(f"{text!r} does not end in {' or '.join(suffixes)}")
        return text

    return check


def _number(text: str, kind: Callable[[str], float], accept: Callable[[float], bool], wanted: str) -> Any:
    try:
        value = kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not {wanted}") from None
    if not math.isfinite(value) or not accept(value):
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not {wanted}")
    return value


def _finite(text: str) -> float:
    return float(_number(text, float, lambda v: True, "a finite number"))


def _positive(text: str) -> float:
    return float(_number(text, float, lambda v: v > 0.0, "a number above zero"))


def _distance(text: str) -> float:
    return float(_number(text, float, lambda v: v >= 0.0, "a distance >= 0"))


def _count(text: str) -> int:
    return int(_number(text, int, lambda v: v > 0, "a whole number above zero"))


def _seed(text: str) -> int:
    return int(_number(text, int, lambda v: v >= 0, "a seed, a whole number >= 0"))
