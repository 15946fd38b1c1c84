"""`rr1plan send`: a dry run by default, refusals by name, and bytes to a port only after the certificate."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, INVALID_PLAN, OK, run
from rr1plan.cli import send as send_command
from rr1plan.interrupts import INTERRUPTED

_CHANNELS = {
    "S1": ("shoulder_joint", 14.0, 6),
    "S2": ("upper_arm_joint", -14.0, 4),
    "E1": ("elbow_joint", -27.0, 2),
    "E2": ("forearm_joint", -42.0, 3),
    "W1": ("wrist_joint", 77.0, 2),
    "W2": ("hand_joint", -43.5, 4),
}


@pytest.fixture
def arm(tmp_path: Path) -> str:
    """A calibration file with numbers that are made up."""
    joints = {
        joint: rp.JointCalibration(1 if per > 0 else -1, 0.0, math.degrees(abs(per)), 1e-3, 1.0)
        for joint, per, _ in _CHANNELS.values()
    }
    file = rp.Calibration("rr1", joints, "steps").save(tmp_path / "arm.toml")
    rows = [f'{n} = {{ joint = "{j}", fast_period = {p}, ramp_steps = 128 }}' for n, (j, _, p) in _CHANNELS.items()]
    file.write_text("\n".join([file.read_text(), "[control_box]", "tick = 0.0006", "[control_box.channels]", *rows]))
    return str(file)


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("send") / "motion.json"
    problem = rp.load_problems("rr1_table")["above_parcel"]
    return str(rp.plan_motion(problem, margin=0.004, rng=0).save(file, embed=True))


def test_without_a_port_an_emulated_box_executes_the_commands(
    motion: str, arm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["send", motion, "--calibration", arm]) == OK
    said = capsys.readouterr().out
    assert "commands for rr1" in said
    assert "certified free of collision, steps and ramps" in said
    assert "dry run: an emulated control box has executed all commands; --port sends" in said
    assert run(["send", motion, "--calibration", arm, "--json"]) == OK
    value = json.loads(capsys.readouterr().out)
    assert value["certified"]
    assert not value["sent"]
    steps = [sum(column) for column in zip(*value["commands"], strict=True)]
    assert [value["end"][n] - value["start"][n] for n in value["end"]] == steps


def test_commands_go_to_the_port_that_is_named(
    motion: str, arm: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened = []

    def open_port(name: str) -> rp.EmulatedSerialLine:
        opened.append(name)
        return rp.EmulatedSerialLine(rp.load_control_box(arm), start)

    start: dict[str, int] = {}
    monkeypatch.setattr(send_command, "open_serial_port", open_port)
    # The emulated arm is not where the motion begins.
    assert run(["send", motion, "--calibration", arm, "--port", "/dev/arm"]) == BAD_INPUT
    assert opened == ["/dev/arm"]
    assert "nothing is sent" in capsys.readouterr().err
    assert run(["send", motion, "--calibration", arm, "--json"]) == OK
    dry = json.loads(capsys.readouterr().out)
    start = {name: count for name, count in dry["start"].items() if name != "G"}
    assert run(["send", motion, "--calibration", arm, "--port", "/dev/arm", "--json"]) == OK
    value = json.loads(capsys.readouterr().out)
    assert value["sent"]
    assert value["end"] == dry["end"]


def test_ctrl_c_says_that_the_arm_finishes_its_command(
    motion: str, arm: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(send_command, "send_commands", interrupted)
    monkeypatch.setattr(send_command, "open_serial_port", lambda name: None)
    assert run(["send", motion, "--calibration", arm, "--port", "/dev/arm"]) == INTERRUPTED
    assert "nothing more is sent, but the arm finishes its current command" in capsys.readouterr().err
    assert run(["send", motion, "--calibration", arm]) == INTERRUPTED
    assert "the arm" not in capsys.readouterr().err


def test_what_would_collide_is_not_sent(motion: str, arm: str, capsys: pytest.CaptureFixture[str]) -> None:
    saved = rp.load_motion(motion)
    tool = saved.scene.link_poses({"rr1": saved.trajectory(saved.trajectory.end_time)})["rr1/tool"]
    rp.save_scene("blocked.toml", saved.scene.with_obstacle("ball", rp.Sphere(0.05), tool[:3, 3]))
    assert run(["send", motion, "--calibration", arm, "--scene", "blocked.toml", "--port", "/dev/none"]) == INVALID_PLAN
    said = capsys.readouterr().out
    assert "NOT CERTIFIED" in said
    assert "ball" in said


def test_a_sequence_is_refused(arm: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = rp.load_scene("rr1_table")
    file = rp.plan_sequence(rp.Sequence(scene, [rp.Pause(0.1)])).save(tmp_path / "pause.json")
    assert run(["send", str(file), "--calibration", arm]) == BAD_INPUT
    assert "holds a sequence, whose scene changes on the way; only single" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["motion.json"], "--calibration"),
        (["MOTION", "--calibration", "none.toml"], "none.toml"),
        (["MOTION", "--calibration", "ARM", "--safety", "none"], "--safety"),
        (["MOTION", "--calibration", "ARM", "--tolerance", "0"], "--tolerance"),
        (["MOTION", "--calibration", "ARM", "--port", "/dev/there/is/none"], "serial port"),
    ],
)
def test_mistakes_are_named(
    words: list[str], message: str, motion: str, arm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [{"MOTION": motion, "ARM": arm}.get(word, word) for word in words]
    assert run(["send", *given]) == BAD_INPUT
    assert message in capsys.readouterr().err
