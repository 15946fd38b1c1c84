"""Targets of a joint state broadcaster: opened when they are used, errors with their names."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest

import rr1plan as rp

ARM = [f"rr1/{name}" for name in rp.load_robot("rr1").joint_names]


@pytest.fixture
def sim() -> rp.Simulation:
    return rp.Simulation(rp.load_scene("rr1_table"))


def test_a_state_that_no_datagram_holds_names_target_and_size() -> None:
    scene = rp.Scene().with_arm("a" * 12_000, rp.load_robot("rr1"))
    sim = rp.Simulation(scene)
    with rp.JointStateBroadcaster(scene.joint_names(), ("127.0.0.1", 9000)) as broadcaster:
        broadcaster.attach(sim)
        with pytest.raises(rp.InputError, match=r"6 joints \(72\d{3} bytes\) to udp://127.0.0.1:9000: .*fewer joints"):
            sim.run(duration=0.1)


@pytest.mark.parametrize("host", ["nohost.invalid", "", "a" * 70, "a\0b"])
def test_an_unknown_host_is_refused_at_once(host: str) -> None:
    with pytest.raises(rp.InputError, match=r"host .* is unknown: .*try an address"):
        rp.JointStateBroadcaster(ARM, (host, 9000))


def test_an_address_of_read_states_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(rp.InputError, match=r"'udp://127.0.0.1:9000', expected .* such as \('127.0.0.1', 9000\)"):
        rp.JointStateBroadcaster(ARM, "udp://127.0.0.1:9000")


@pytest.mark.parametrize("port", [True, 0, 65536, "9000"])
def test_other_values_are_no_port(port: object) -> None:
    with pytest.raises(rp.InputError, match="expected a host and a port"):
        rp.JointStateBroadcaster(ARM, ("127.0.0.1", port))


@pytest.mark.parametrize(
    ("family", "host"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET, "localhost"), (socket.AF_INET6, "::1")]
)
def test_states_are_sent_to_names_and_addresses(sim: rp.Simulation, family: int, host: str) -> None:
    with socket.socket(family, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind((host, 0))
        except OSError:
            pytest.skip("this machine has no IPv6")
        receiver.settimeout(5.0)
        with rp.JointStateBroadcaster(ARM, (host, receiver.getsockname()[1])) as broadcaster:
            broadcaster.attach(sim)
            sim.run(duration=0.03)
        assert json.loads(receiver.recv(65536))["name"] == ARM


def test_a_file_is_emptied_only_when_states_follow(sim: rp.Simulation, tmp_path: Path) -> None:
    file = tmp_path / "states.jsonl"
    file.write_text("precious\n")
    with (
        rp.JointStateBroadcaster(["rr1/no_joint"], file) as broadcaster,
        pytest.raises(rp.UnknownNameError, match="no_joint"),
    ):
        broadcaster.attach(sim)
    assert file.read_text() == "precious\n"
    with rp.JointStateBroadcaster(ARM, file) as broadcaster:
        assert file.read_text() == "precious\n"
        broadcaster.attach(sim)
        sim.run(duration=0.1)
    assert [json.loads(line)["name"] for line in file.read_text().splitlines()] == [ARM] * 5


def test_states_after_a_reset_have_the_times_of_the_first_run(sim: rp.Simulation) -> None:
    times: list[float] = []
    with rp.JointStateBroadcaster(ARM, lambda state: times.append(state.time), rate=100.0) as broadcaster:
        broadcaster.attach(sim)
        sim.run(duration=0.1)
        first = times.copy()
        sim.reset()
        sim.run(duration=0.1)
    assert times == first * 2


def test_a_file_that_cannot_be_written_is_named(sim: rp.Simulation, tmp_path: Path) -> None:
    broadcaster = rp.JointStateBroadcaster(ARM, tmp_path / "gone" / "states.jsonl")
    with pytest.raises(rp.InputError, match=r"cannot write .*states\.jsonl: No such file"):
        broadcaster.attach(sim)
    sim.run(duration=0.1)  # nothing is attached


@pytest.mark.parametrize("states", [5, 500])
def test_a_full_disk_is_named(sim: rp.Simulation, states: int) -> None:
    """When the file is closed, or already during the run."""
    broadcaster = rp.JointStateBroadcaster(sim.joint_names, "/dev/full", rate=1.0 / sim.dt)
    broadcaster.attach(sim)
    with pytest.raises(rp.InputError, match="cannot write /dev/full: No space left on device"), broadcaster:
        sim.step(states)


def test_a_broadcaster_is_attached_instead_of_activated(sim: rp.Simulation) -> None:
    broadcaster: Any = rp.JointStateBroadcaster(sim.joint_names, print)
    with pytest.raises(rp.InputError, match="expected Controller; call its method 'attach' instead"):
        sim.activate(broadcaster)


def test_a_closed_broadcaster_is_not_attached(sim: rp.Simulation, tmp_path: Path) -> None:
    file = tmp_path / "states.jsonl"
    for to in (file, ("127.0.0.1", 9000), print):
        broadcaster = rp.JointStateBroadcaster(ARM, to)
        broadcaster.close()
        broadcaster.close()
        with pytest.raises(rp.InputError, match="the broadcaster is closed"):
            broadcaster.attach(sim)
    sim.run(duration=0.1)
    assert not file.exists()
