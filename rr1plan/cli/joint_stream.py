"""`mirror`: incoming joint states, compared with a plan."""

from __future__ import annotations

from argparse import Namespace

import rr1plan as rp
from rr1plan.cli.console import Console
from rr1plan.cli.exit_codes import INVALID_PLAN, OK
from rr1plan.cli.saved_motions import single_motion
from rr1plan.cli.scene_options import check_scene_name
from rr1plan.cli.served_page import announce, live_options
from rr1plan.errors import InputError, Rr1PlanError
from rr1plan.scene.model_library import load_scene

_SERIAL = "serial:"


def mirror(options: Namespace, console: Console) -> int:
    """Show a stream of joint states live, and compare it with a plan."""
    scene, plan = _scene_and_plan(options, console)
    with console.progress("certifying the corridor"):
        follower = rp.Mirror(
            scene,
            plan,
            start=options.start,
            record=options.record,
            on_event=lambda event: console.say(str(event)),
        )
    # Not earlier, because messages that arrive while the corridor is computed would count as late.
    with follower, _stream(options) as stream:
        if not options.no_page:
            announce(follower.show(options=live_options(options)), options, console, "press Ctrl-C to end")
        try:
            report = follower.run(stream, duration=options.duration)
        except Rr1PlanError:  # e.g. an unplugged port: what came before is not lost
            console.say(str(follower.report()))
            raise
    console.say(str(report))
    console.result(
        {
            "messages": report.messages,
            "rate": report.rate,
            "delays": list(report.delays),
            "max_deviation": dict(report.max_deviation),
            "outside": [list(interval) for interval in report.outside],
            "faults": dict(report.faults),
            "contacts": [[*pair, count] for pair, count in report.contacts.items()],
            "unmeasured": list(report.unmeasured),
            "unchecked_links": list(report.unchecked_links),
        }
    )
    return OK if report else INVALID_PLAN


def _stream(options: Namespace) -> rp.StateStream:
    """The joint states of the source."""
    if not options.source.startswith(_SERIAL):
        if options.calibration is not None:
            raise InputError(f"--calibration has no effect: {options.source} is not a serial port")
        return rp.read_states(options.source, silence=options.silence, topic=options.topic)
    if options.calibration is None:
        raise InputError("telemetry of a control box needs a calibration: use option calibration")
    if options.topic is not None:
        raise InputError(f"--topic has no effect: {options.source} is not a bag")
    calibration, box = rp.load_calibration(options.calibration), rp.load_control_box(options.calibration)
    port = rp.open_serial_port(options.source.removeprefix(_SERIAL))
    return rp.read_telemetry(port, calibration, box, silence=options.silence)


def _scene_and_plan(options: Namespace, console: Console) -> tuple[rp.Scene, rp.Trajectory | None]:
    """The scene, and the motion with which the stream is compared."""
    if options.plan is None:
        if options.scene is None:
            raise InputError("a mirror needs a motion or a scene: use option plan or option scene")
        check_scene_name(options.scene)
        return load_scene(options.scene), None
    # The topic is that of the source.
    own = Namespace(scene=options.scene, topic=None)
    motion, trajectory = single_motion(options.plan, own, console, "mirrored")
    return motion.scene, trajectory
