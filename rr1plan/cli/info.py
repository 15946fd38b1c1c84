"""`robots`, `scenes` and `doctor`: information about robots, scenes and the installation."""

from __future__ import annotations

import importlib.metadata
import platform
import sys
from argparse import Namespace
from functools import cache
from typing import Any

import numpy as np

import rr1plan
from rr1plan.checks import counted
from rr1plan.cli.console import Console
from rr1plan.cli.exit_codes import BAD_INPUT, OK
from rr1plan.errors import InputError
from rr1plan.robot import Robot
from rr1plan.robot.joint_limits import LIMIT_NAMES
from rr1plan.robot.robot_packages import PACKAGE, installed_robots
from rr1plan.scene.model_library import load_arm_robot, load_robot, load_scene_file, robot_names, scene_names
from rr1plan.scene.scene_toml import SceneFile

_REQUIRED = (
    "numpy", "scipy", "pin", "coal", "python-fcl", "ompl", "toppra", "ruckig", "mujoco", "meshcat", "tornado",
    "trimesh", "pycollada", "coacd", "matplotlib", "msgspec", "pyyaml", "rich",
)  # fmt: skip
_OPTIONAL = {
    "xacrodoc": "xacro",
    "rosbags": "ros",
    "pyserial": "serial",
    "example-robot-data": "robots",
    "playwright": "video",
    "av": "video",
    "distributed": "batch",
}


def robots(options: Namespace, console: Console) -> int:
    """List the robots, or describe one."""
    if options.robot is not None:
        if options.robot in scene_names():
            raise InputError(
                f"{options.robot} is a scene, expected a robot; to describe the scene: rr1plan scenes {options.robot}"
            )
        with console.progress(f"loading {options.robot}"):
            robot = load_robot(options.robot)
        _say_robot(robot, console)
        console.result(_robot_values(robot))
        return OK
    values = [_robot_values(load_robot(name)) for name in robot_names()]
    rows = [(v["name"], str(len(v["joints"])), str(v["links"]), ", ".join(v["presets"]) or "-") for v in values]
    console.table(("robot", "joints", "links", "limit presets"), rows)
    installed = installed_robots()
    if installed:
        console.say(f"\nof the package {PACKAGE} {_version(PACKAGE)}:")
        console.paragraph(", ".join(installed))
    else:
        console.say("\nmore come with: pip install 'rr1plan[robots]'")
    console.names([*(v["name"] for v in values), *installed])
    console.result([*values, *({"name": name, "source": str(robot.urdf)} for name, robot in installed.items())])
    return OK


def _robot_values(robot: Robot) -> dict[str, Any]:
    limits = robot.limits
    joints = [
        {
            "name": name,
            "kind": robot.joint(name).kind,
            **{k: _finite(getattr(limits, k)[i]) for k in LIMIT_NAMES},
        }
        for i, name in enumerate(robot.joint_names)
    ]
    return {
        "name": robot.name,
        "joints": joints,
        "links": len(robot.links),
        "tool": robot.tool,
        "mass": float(sum(link.inertial.mass for link in robot.links if link.inertial is not None)),
        "locked_joints": dict(robot.locked_joints),
        "configurations": {name: q.tolist() for name, q in robot.configurations.items()},
        "presets": list(robot.presets),
        # URDF and MJCF have no such limits, only the presets of a shipped robot do.
        "assumed_limits": [] if robot.presets else ["acceleration", "jerk"],
        "source": robot.source,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _say_robot(robot: Robot, console: Console) -> None:
    values = _robot_values(robot)
    estimated = (
        f" ({counted(len(robot.links_of_assumed_mass), 'link')} estimated)" if robot.links_of_assumed_mass else ""
    )
    console.say(
        f"{robot.name}: {counted(len(robot.links), 'link')}, {values['mass']:.2f} kg{estimated}, tool {robot.tool}"
    )
    rows = [
        (j["name"], j["kind"], *("-" if j[c] is None else f"{j[c]:.4g}" for c in LIMIT_NAMES)) for j in values["joints"]
    ]
    console.table(("joint", "kind", *LIMIT_NAMES), rows)
    console.say("units: rad, s and Nm; of prismatic joints m, s and N")
    if assumed := values["assumed_limits"]:
        console.say(f"{' and '.join(assumed)} are assumed: the robot's file has no such limits")
    console.say(f"configurations: {', '.join(robot.configurations)}")
    if robot.locked_joints:
        console.say(
            "locked joints: " + ", ".join(f"{name} at {value:g}" for name, value in robot.locked_joints.items())
        )
    if robot.presets:
        console.say(f"limit presets: {', '.join(robot.presets)}")


def scenes(options: Namespace, console: Console) -> int:
    """List the scenes, or describe one."""
    if options.scene is not None:
        # The list does not need the readers of motions that this imports.
        from rr1plan.cli.scene_options import check_scene_name

        check_scene_name(options.scene)
        with console.progress(f"loading {options.scene}"):
            values = _scene_values(load_scene_file(options.scene))
        console.say(": ".join(filter(None, (values["name"], values["description"]))))
        for kind in ("arms", "obstacles", "attachments", "queries"):
            console.say(f"{kind}: {', '.join(values[kind]) or '-'}")
        console.result(values)
        return OK
    # Most scenes have the same few robots.
    robot_loader = cache(load_arm_robot)
    every = [_scene_values(load_scene_file(name, robot_loader)) for name in scene_names()]
    rows = [
        (v["name"], str(len(v["arms"])), str(len(v["obstacles"])), ", ".join(v["queries"]) or "-", v["description"])
        for v in every
    ]
    console.table(("scene", "arms", "obstacles", "queries", "description"), rows)
    console.names([v["name"] for v in every])
    console.result(every)
    return OK


def _scene_values(file: SceneFile) -> dict[str, Any]:
    scene = file.scene
    return {
        "name": scene.name,
        "description": scene.description,
        "arms": list(scene.arms),
        "obstacles": list(scene.obstacles),
        "attachments": list(scene.attachments),
        "queries": list(file.problems),
    }


def doctor(options: Namespace, console: Console) -> int:
    """Versions, the compiled kernels, and what is missing."""
    from rr1plan.planners.ompl_planners import WITHOUT_RELEASE
    from rr1plan.playback.viewer.page_capture import GET_BROWSER, find_browser

    required = {name: _version(name) for name in _REQUIRED if not (name == "ompl" and WITHOUT_RELEASE)}
    optional = {name: _version(name) for name in _OPTIONAL}
    missing = [name for name, version in required.items() if version is None]
    browser = find_browser()
    console.say(f"rr1plan {rr1plan.__version__}, Python {platform.python_version()}, {platform.platform()}")
    rows = [(name, version or "MISSING") for name, version in required.items()]
    if WITHOUT_RELEASE:
        rows.append(("ompl", "no release for this Python: its planners are not available"))
    rows += [
        (name, version or f"not installed (pip install 'rr1plan[{_OPTIONAL[name]}]')")
        for name, version in optional.items()
    ]
    console.table(("package", "version"), rows)
    console.say(f"browser for screenshots: {browser or f'none found (optional: {GET_BROWSER})'}")
    kernels = {} if missing else _kernels()
    if kernels:
        console.say("compiled kernels: " + ", ".join(f"{name} {variant}" for name, variant in kernels.items()))
    console.result(
        {
            "rr1plan": rr1plan.__version__,
            "python": platform.python_version(),
            "executable": sys.executable,
            "platform": platform.platform(),
            "required": required,
            "optional": optional,
            "missing": missing,
            "browser": browser,
            "kernels": kernels,
        }
    )
    if missing:
        console.error(f"missing: {', '.join(missing)}; try: pip install --upgrade rr1plan", BAD_INPUT)
        return BAD_INPUT
    console.say("all that is required is here")
    return OK


def _kernels() -> dict[str, str]:
    """The variant of the compiled kernels that this processor runs, by library.

    Raises:
        InstallationError: a library is missing or cannot be loaded.
    """
    from rr1plan.kernels.planner_kernels import LIBRARY
    from rr1plan.validation import referee_kernels as native

    libraries = {"planning": LIBRARY, "referee": native.LIBRARY}
    return {name: library.variants[0] for name, library in libraries.items() if library.fastest}


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
