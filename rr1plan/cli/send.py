"""`send`: a saved motion to RR1's control box, by default to an emulated one."""

from __future__ import annotations

from argparse import Namespace

from rr1plan.calibration.joint_calibration import load_calibration
from rr1plan.cli.console import Console, progress_callback
from rr1plan.cli.exit_codes import INVALID_PLAN, OK
from rr1plan.cli.saved_motions import about, single_motion
from rr1plan.hardware.box_emulator import EmulatedSerialLine
from rr1plan.hardware.command_plan import plan_commands
from rr1plan.hardware.command_sender import SerialPort, open_serial_port, send_commands
from rr1plan.hardware.control_box import load_control_box
from rr1plan.hardware.control_box_frames import CHANNELS


def send(options: Namespace, console: Console) -> int:
    """Convert a saved motion to commands, certify the executed motion, and send the commands if a port is named."""
    calibration, box = load_calibration(options.calibration), load_control_box(options.calibration)
    motion, trajectory = single_motion(options.motion, options, console, "sent")
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
        return INVALID_PLAN
    with console.progress("sending" if options.port else "emulating") as advance:
        if options.port is None:
            start = {name: count for name, count in zip(CHANNELS, plan.start, strict=True) if name in box.channels}
            port: SerialPort = EmulatedSerialLine(box, start)
        else:
            port = open_serial_port(options.port)
        try:
            end = send_commands(plan, port, progress=progress_callback(advance))
        except KeyboardInterrupt:
            if options.port is not None:
                console.warn("nothing more is sent, but the arm finishes its current command")
            raise
    if options.port is None:
        console.say("dry run: an emulated control box has executed all commands; --port sends them to a real one")
    else:
        console.say(f"sent: the control box has executed all commands, its step counters are {end.position}")
    console.result({**values, "sent": options.port is not None, "end": dict(zip(CHANNELS, end.position, strict=True))})
    return OK
