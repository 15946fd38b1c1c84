"""The options of each command."""

from __future__ import annotations

from collections.abc import Mapping

from rr1plan.cli.arguments import Parser
from rr1plan.cli.option_types import count, distance, file_name, file_of, finite, named_file, positive, seed, time_limit

EXIT_CODES = "exit codes: 0 done, 2 bad input, 3 no plan, 4 invalid plan or failed replay, 130 interrupted"

_FILE = (
    "a file that plan wrote, a trajectory (.json, .csv), a ROS JointTrajectory (.yaml), or a ROS bag; - is standard "
    "input (no bags)"
)
_MOTION = f"a motion: {_FILE}"

# Planners of `plan` that make trajectories, not paths.
_MANY_ARMS = {
    "many_arms": "a path for each of many arms, and a schedule without collisions between them",
    "many_arms_anytime *": "many_arms, then better schedules and paths",
}


def demo_options(parser: Parser) -> None:
    """Add the options of `rr1plan demo`."""
    parser.add_argument(
        "--output",
        type=named_file,
        default="rr1plan-demo",
        metavar="FOLDER",
        help="folder for the files (%(default)s)",
    )
    parser.add_argument("--scene", default="rr1_cluttered", help="a scene with a query (%(default)s)")
    parser.add_argument("--query", help="a query of that scene (default: its first)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the planner (%(default)s)")
    _view_from(parser, "of the page")


def plan_options(parser: Parser) -> None:
    """Add the options of `rr1plan plan`."""
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
        type=distance,
        metavar="D",
        help="distance to keep beyond the scene's padding [m], reduced where there is less room (default: 0.002)",
    )
    parser.add_argument("--torque-limits", action="store_true", help="also keep the joints' effort limits")
    parser.add_argument("--seconds", type=time_limit, default=10.0, help="budget of wall time [s] (%(default)s)")
    parser.add_argument(
        "--iterations", type=count, help="budget of iterations; with --seconds inf the plan repeats to the byte"
    )
    parser.add_argument("--seed", type=seed, default=0, help="seed of the planner (%(default)s)")
    parser.add_argument("--limits", help="limit preset of every arm, e.g. sim or hardware")
    parser.add_argument(
        "--output", type=file_name, metavar="FILE", help="save the motion as JSON (- writes it to standard output)"
    )
    parser.add_argument(
        "--embed", action="store_true", help="with --output: put meshes into the file, not into the folder geometry"
    )
    parser.add_argument(
        "--csv", type=file_name, metavar="FILE", help="save the trajectory as CSV (- writes it to standard output)"
    )
    parser.add_argument("--html", type=named_file, metavar="FILE", help="save a page that plays the motion offline")
    parser.add_argument("--spheres", action="store_true", help="with --html: show the spheres that contain each link")
    _view_from(parser, "of the page, with --html")
    figure = file_of(".png", ".svg", ".pdf")
    parser.add_argument(
        "--timeline", type=figure, metavar="FILE", help="draw when each arm moves, waits or touches another one"
    )
    parser.add_argument(
        "--diagram", type=figure, metavar="FILE", help="of many_arms: draw the coordination diagram of two arms"
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
    parser.details = lambda: f"{_planners(_MANY_ARMS)}\n\n{_retimings()}\n\n{EXIT_CODES}"


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
    group.add_argument("--position", nargs=3, type=finite, metavar=("X", "Y", "Z"), help="goal of the frame [m]")
    group.add_argument("--quaternion", nargs=4, type=finite, metavar=("W", "X", "Y", "Z"), help="its orientation")
    group.add_argument("--frame", help="the frame that --position is for (tool)")
    parser.at_most_one("--query", "--goal", "--position")
    parser.needs("--arm", "--goal", "--position")
    parser.needs("--quaternion", "--position")
    parser.needs("--frame", "--position")


def validate_options(parser: Parser) -> None:
    """Add the options of `rr1plan validate`."""
    parser.add_argument("motion", metavar="MOTION", help=_MOTION)
    parser.add_argument("--scene", help="the scene to check it in (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument("--torque-limits", action="store_true", help="also check the joints' effort limits")
    parser.add_argument("--jerk-limits", action="store_true", help="also check the joints' jerk limits")


def _topic(parser: Parser) -> None:
    """The option that selects the topic of a bag."""
    parser.add_argument("--topic", help="the topic of a bag (default: the only one that holds a JointTrajectory)")


def play_options(parser: Parser) -> None:
    """Add the options of `rr1plan play`."""
    parser.add_argument("motion", metavar="MOTION", help=_MOTION)
    parser.add_argument("--scene", help="the scene to replay it in (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument(
        "--mode",
        choices=("dynamic", "kinematic"),
        default="dynamic",
        help="dynamic: servos drive the joints; kinematic: the joints have their planned positions (%(default)s)",
    )
    parser.add_argument("--timestep", type=positive, default=0.002, help="step of the simulator [s] (%(default)s)")
    parser.add_argument(
        "--html",
        type=named_file,
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
        "--video", type=file_of(".mp4", ".gif", ".webp"), metavar="FILE", help=f"film {of} (.mp4, .gif or .webp)"
    )
    parser.add_argument("--fps", type=positive, default=30.0, help="pictures per second of the video (%(default)g)")
    parser.add_argument("--speed", type=positive, default=1.0, help="speed of the video (%(default)g)")
    parser.add_argument(
        "--size", type=count, nargs=2, default=(1280, 800), metavar=("W", "H"), help="picture size [px] (1280 800)"
    )
    parser.add_argument("--bare", action="store_true", help="without the cards of the page")
    parser.needs("--fps", "--video")
    parser.needs("--speed", "--video")


def send_options(parser: Parser) -> None:
    """Add the options of `rr1plan send`."""
    parser.add_argument("motion", metavar="MOTION", help=_MOTION)
    parser.add_argument(
        "--calibration",
        type=named_file,
        required=True,
        metavar="FILE",
        help="the arm's calibration in steps, with its control box (.toml)",
    )
    parser.add_argument(
        "--port", type=named_file, help="the serial port of the box, e.g. /dev/ttyACM0 (default: a dry run)"
    )
    parser.add_argument("--scene", help="the scene to certify it in (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument(
        "--tolerance",
        type=positive,
        default=0.01,
        help="how far segments may leave the motion [rad], halved where the arm would collide (%(default)s)",
    )
    parser.add_argument(
        "--safety", choices=("high", "low"), default="high", help="high: at most 1024 steps a command (%(default)s)"
    )


def mirror_options(parser: Parser) -> None:
    """Add the options of `rr1plan mirror`."""
    parser.add_argument(
        "source",
        metavar="SOURCE",
        help="joint states: udp://HOST:PORT, serial:PORT of a control box, a file (.jsonl), or a ROS bag",
    )
    parser.add_argument("--calibration", metavar="FILE", help="with serial: calibration of the arm and its channels")
    parser.add_argument("--plan", metavar="MOTION", help=f"the planned motion: {_FILE}")
    parser.add_argument("--scene", help="the scene (default: the one that the motion's file holds)")
    parser.add_argument("--topic", help="the topic of a SOURCE bag (default: the only one with such messages)")
    parser.add_argument(
        "--start", type=finite, help="when the plan begins, on the sender's clock [s] (default: at the first message)"
    )
    parser.add_argument("--record", type=named_file, metavar="FILE", help="write all messages to a file (.jsonl)")
    parser.add_argument("--duration", type=positive, help="how long to listen [s] (default: to the end, or Ctrl-C)")
    parser.add_argument(
        "--silence", type=positive, default=1.0, help="report a socket that is silent for this long [s] (%(default)s)"
    )
    parser.add_argument("--port", type=count, help="first port to try for the page on this machine (default: 7000)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.add_argument("--no-page", action="store_true", help="only print events and the report")
    parser.excludes("--no-page", "--port", "--no-browser")
    parser.different_files(("source", "--calibration", "--plan", "--scene"), "--record")


def view_options(parser: Parser) -> None:
    """Add the options of `rr1plan view`."""
    parser.add_argument("what", metavar="WHAT", help=f"a scene or a robot, by name or file, or {_MOTION}")
    parser.add_argument("--scene", help="the scene of the motion (default: the one that the file holds)")
    _topic(parser)
    parser.add_argument("--port", type=count, help="first port to try for the page on this machine (default: 7000)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.add_argument("--html", type=named_file, metavar="FILE", help="write an offline page instead of serving one")
    parser.add_argument("--png", type=file_of(".png"), metavar="FILE", help="write a picture (needs Chromium)")
    parser.add_argument("--time", type=finite, metavar="T", help="with --png: time [s] (default: the start)")
    _video(parser, "the motion")
    parser.add_argument(
        "--glb", type=file_of(".glb"), metavar="FILE", help="write an animated 3-D model, for Blender, Unity or VR"
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
    # The 3-D model has the scene and the motion only, nothing of the page.
    parser.excludes("--glb", "--spheres", "--view", "--compare", unless=files[:-1])
    parser.needs("--side-by-side", "--compare")
    parser.needs("--time", "--png")
    parser.needs("--size", "--png", "--video")
    parser.needs("--bare", "--png", "--video")
    parser.different_files(("what", "--scene", "--compare"), *files)


def cspace_options(parser: Parser) -> None:
    """Add the options of `rr1plan cspace`."""
    parser.add_argument("scene", metavar="SCENE", help="a shipped scene or a scene file")
    parser.add_argument("--query", help="a query of the scene, by name (default: its first of a two-joint arm, if any)")
    parser.add_argument("--arm", help="the arm (default: the only one)")
    parser.add_argument(
        "--joints", nargs=2, metavar=("A", "B"), help="two of its joints (default: the first two); the others are fixed"
    )
    parser.add_argument(
        "--at",
        nargs="+",
        metavar="Q",
        help="positions of the other joints: a configuration's name, or its numbers [rad or m] (default: the scene's)",
    )
    parser.add_argument("--resolution", type=count, default=360, help="cells along each axis, 8 to 2000 (%(default)s)")
    parser.add_argument("--planner", default="rrt_connect", help="planner of the path and tree drawn (%(default)s)")
    parser.add_argument(
        "--seconds", type=positive, default=5.0, help="the planner's budget of wall time [s] (%(default)s)"
    )
    parser.add_argument("--seed", type=seed, default=0, help="seed of the planner (%(default)s)")
    parser.add_argument(
        "--png", type=file_of(".png"), metavar="FILE.png", help="write the picture (default: SCENE-cspace.png)"
    )
    parser.add_argument("--svg", type=file_of(".svg"), metavar="FILE.svg", help="write the picture for slides")
    parser.add_argument("--pdf", type=file_of(".pdf"), metavar="FILE.pdf", help="write the picture for papers")
    parser.add_argument("--html", type=file_of(".html"), metavar="FILE.html", help="write an offline page with sliders")
    _video(parser, "the path, or the growing tree where there is none")
    parser.needs("--size", "--video")
    parser.needs("--bare", "--video")
    _view_from(parser, "of the page, with --html", "from above for a planar arm, else one that shows the motion")
    parser.needs("--view", "--html")
    parser.details = lambda: f"{_planners()}\n\n{EXIT_CODES}"


def lesson_options(parser: Parser) -> None:
    """Add the options of `rr1plan lesson`."""
    parser.add_argument("lesson", metavar="LESSON", nargs="?", help="a lesson, by name (default: list them)")
    parser.add_argument("--scene", help="your own arm and obstacles: a shipped scene or a scene file")
    parser.add_argument("--query", help="with --scene: a query of that scene, by name, for lessons that have one")
    parser.add_argument("--html", type=file_of(".html"), metavar="FILE.html", help="write the page, for offline use")
    parser.add_argument(
        "--figure", type=file_of(".png", ".svg", ".pdf"), metavar="FILE", help="write the picture: .png, .svg or .pdf"
    )
    _video(parser, "what a step animates")
    parser.add_argument("--step", type=count, help="with --video: the step of the lesson (default: the first)")
    parser.add_argument("--port", type=count, help="first port to try for the page on this machine (default: 7000)")
    parser.add_argument("--no-browser", action="store_true", help="only print the page's address")
    parser.needs("--query", "--scene")
    for option in ("--step", "--size", "--bare"):
        parser.needs(option, "--video")
    for file in ("--html", "--figure", "--video"):
        parser.excludes(file, "--port", "--no-browser")


def figures_options(parser: Parser) -> None:
    """Add the options of `rr1plan figures`."""
    parser.add_argument("names", metavar="FIGURE", nargs="*", help="figures by name (default: all)")
    parser.add_argument("--out", type=named_file, required=True, metavar="DIR", help="folder for the files")


def experiment_options(parser: Parser) -> None:
    """Add the options of `rr1plan experiment`."""
    parser.add_argument(
        "experiment",
        metavar="EXPERIMENT",
        nargs="+",
        choices=("static", "dynamic", "multi", "latency", "all"),
        help="static: an arm among stationary boats; dynamic: a falling tower of boats; multi: arms that follow "
        "seven poses; latency: messages to the viewer; all",
    )
    parser.add_argument("--out", type=named_file, required=True, metavar="DIR", help="folder for the files")
    parser.add_argument("--quick", action="store_true", help="few and short measurements, in less than half a minute")
    parser.add_argument(
        "--arms", type=count, nargs="+", metavar="N", help="numbers of arms of multi (default: 1 to 120)"
    )
    parser.add_argument("--seed", type=seed, default=0, help="seed of boats and messages (%(default)s)")


def robots_options(parser: Parser) -> None:
    """Add the options of `rr1plan robots`."""
    parser.add_argument(
        "robot", metavar="ROBOT", nargs="?", help="a shipped or installed robot, or a URDF, xacro or MJCF file"
    )


def scenes_options(parser: Parser) -> None:
    """Add the options of `rr1plan scenes`."""
    parser.add_argument("scene", metavar="SCENE", nargs="?", help="a shipped scene, or a scene file")


def no_options(parser: Parser) -> None:
    """A command with the common options only."""


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
