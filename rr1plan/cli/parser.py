"""All commands: their help, examples and options."""

from __future__ import annotations

from collections.abc import Callable

import rr1plan
from rr1plan.cli import command_options as options
from rr1plan.cli.arguments import Parser, Show


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
    parser.details = lambda: options.EXIT_CODES
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
        command.details = lambda: options.EXIT_CODES
        add(command)
        commands[name] = command
    return parser, commands


def _examples(*lines: str) -> str:
    return "\n  ".join(["examples:", *lines])


# For each command: "module.function" under `rr1plan.cli`, loaded when it is run; help; examples; its options.
_COMMANDS: dict[str, tuple[str, str, tuple[str, ...], Callable[[Parser], None]]] = {
    "demo": (
        "view.demo",
        "plan, prove, replay and show a motion of RR1 among clutter",
        ("rr1plan demo", "rr1plan demo --scene rr1_window --query through --output window"),
        options.demo_options,
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
        options.plan_options,
    ),
    "validate": (
        "saved_motions.validate",
        "check a saved motion with the referee",
        (
            "rr1plan validate motion.json",
            "rr1plan validate motion.json --scene changed.toml",
            "rr1plan validate samples.csv --scene cell.toml --torque-limits",
        ),
        options.validate_options,
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
        options.play_options,
    ),
    "send": (
        "send.send",
        "send a saved motion to RR1's control box, or without a port to an emulated one (a dry run)",
        (
            "rr1plan send motion.json --calibration arm.toml",
            "rr1plan send motion.json --calibration arm.toml --port /dev/ttyACM0",
        ),
        options.send_options,
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
        options.view_options,
    ),
    "mirror": (
        "joint_stream.mirror",
        "show live joint states, compared with a plan and its certified corridor",
        (
            "rr1plan mirror udp://127.0.0.1:9000 --plan motion.json --record run.jsonl",
            "rr1plan mirror run.jsonl --plan motion.json --no-page",
        ),
        options.mirror_options,
    ),
    "cspace": (
        "cspace_command.cspace",
        "draw the configuration space of two joints, and plan a query in it or prove that no path exists",
        (
            "rr1plan cspace planar2r_path",
            "rr1plan cspace planar2r_no_path --svg figure.svg --html page.html",
            "rr1plan cspace rr1_table --joints shoulder_joint elbow_joint --at zero --resolution 120",
        ),
        options.cspace_options,
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
        options.lesson_options,
    ),
    "figures": (
        "lesson_command.figures",
        "write the figures of the lessons and the pictures of the README",
        ("rr1plan figures --out figures", "rr1plan figures workspace no_path --out figures"),
        options.figures_options,
    ),
    "experiment": (
        "experiment.experiment",
        "measure the simulator and the viewer, and compare them with the thesis behind this project",
        (
            "rr1plan experiment all --out results --quick",
            "rr1plan experiment dynamic --out results",
            "rr1plan experiment multi --out results --arms 120 250 500 1000",
        ),
        options.experiment_options,
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
        options.robots_options,
    ),
    "scenes": (
        "info.scenes",
        "list the scenes, or describe one",
        ("rr1plan scenes", "rr1plan scenes rr1_table", "rr1plan scenes cell.toml"),
        options.scenes_options,
    ),
    "doctor": (
        "info.doctor",
        "show versions, and what is missing",
        ("rr1plan doctor", "rr1plan doctor --json"),
        options.no_options,
    ),
}


# Commands that list names if none is given.
_LISTS = ("robots", "scenes", "lesson")
