"""`send`: a saved motion to RR1's control box, by default to an emulated one."""

from __future__ import annotations

from argparse import Namespace

from rr1plan.calibration.joint_calibration import load_calibration
from rr1plan.cli.console import Console
from rr1plan.cli.plan import told_to
from rr1plan.cli.saved_motions import about, saved_motion, say_changes
from rr1plan.errors import InputError, NoPlanError
from rr1plan.hardware.box_emulator import EmulatedSerialLine
from rr1plan.hardware.command_plan import plan_commands
from rr1plan.hardware.command_sender import SerialPort, open_serial_port, send_commands
from rr1plan.hardware.control_box import load_control_box
from rr1plan.hardware.control_box_frames import CHANNELS
from rr1plan.motion_plan import MotionPlan


def send(options: Namespace, console: Console) -> int:
    """Turn a saved motion into commands, certify what the arm will do, and send them if a port is named."""
    calibration, box = load_calibration(options.calibration), load_control_box(options.calibration)
    motion = saved_motion(options.motion, options, console)
    if not isinstance(motion, MotionPlan):
        raise InputError(f"{options.motion} holds a sequence, whose scene changes on the way; send single motions")
    try:
        trajectory = motion.trajectory
    except NoPlanError as error:
        raise InputError(f"{error}; only a motion with times can be sent") from error
    say_changes(motion, console)
    plan = plan_commands(
        trajectory, calibration, box, scene=motion.scene, tolerance=options.tolerance, safety=options.safety
    )
    console.say(str(plan))
    values = {
        "arm": plan.arm,
        "certified": plan.certified,
        "problems": list(plan.problems),
        "start": dict(zip(CHANNELS, plan.start, strict=True)),
        "commands": [list(command.steps) for command in plan.commands],
        "seconds": float(plan.ticks.sum()) * box.tick,
        **about(motion),
    }
    if not plan.certified:
        console.result({**values, "sent": False})
        return 4
    with console.progress("sending" if options.port else "emulating") as advance:
        if options.port is None:
            start = {name: count for name, count in zip(CHANNELS, plan.start, strict=True) if name in box.channels}
            port: SerialPort = EmulatedSerialLine(box, start)
        else:
            port = open_serial_port(options.port)
        end = send_commands(plan, port, progress=told_to(advance))
    if options.port is None:
        console.say("dry run: an emulated control box has executed all commands; --port sends them to a real one")
    else:
        console.say(f"sent: the control box has executed all commands, its step counters are {end.position}")
    console.result({**values, "sent": options.port is not None, "end": dict(zip(CHANNELS, end.position, strict=True))})
    return 0
