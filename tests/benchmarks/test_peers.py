"""Peers: the protocol of their workers, time limits, and the report on a peer that does not run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

_FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
_WORKER = """
import os, sys, time
sys.path.insert(0, {folder!r})
from worker import serve

def load(robot, task):
    print("libraries print what they like")
    return task["options"]

def solve(options, problem, answer):
    with answer.stage("plan"):
        sum(range(10_000))
    if problem["name"] == "impossible":
        raise RuntimeError("no way")
    if problem["name"] == "deadly":
        print("out of memory", file=sys.stderr, flush=True)
        os._exit(7)
    if problem["name"] == "endless":
        time.sleep(60)
    answer.keep("raw", [problem["start"], problem["goal"]])
    answer.data["told"] = options

serve(load, solve)
"""


@pytest.fixture
def peers(script):
    return script("peers")


@pytest.fixture
def canned(peers, tmp_path):
    """A peer that joins start and goal with a line, in this interpreter."""
    file = tmp_path / "canned_worker.py"
    file.write_text(_WORKER.format(folder=str(_FOLDER)))
    return peers.Peer("canned 1.0", "canned", ("canned==1.0",), str(file), {"step": 0.5})


def _problem(name):
    return {"name": name, "start": [0.0, 0.0], "goal": [3.0, 4.0], "robot": {"urdf": "arm.urdf"}}


def test_a_worker_answers_one_line_for_one_problem(peers, canned):
    answers = peers.ask(canned, Path(sys.executable), [_problem("a"), _problem("impossible"), _problem("b")], 1.0)
    assert [a["name"] for a in answers] == ["a", "impossible", "b"]
    assert all(a["seconds"]["plan"] >= 0.0 for a in answers)
    assert answers[0]["raw"] == [[0.0, 0.0], [3.0, 4.0]]
    assert answers[0]["told"] == {"step": 0.5}
    assert answers[1]["failure"] == "RuntimeError: no way"
    assert "raw" not in answers[1]


def test_a_worker_that_dies_is_started_afresh(peers, canned):
    answers = peers.ask(canned, Path(sys.executable), [_problem(n) for n in ("a", "deadly", "b")], 1.0)
    assert answers[1]["failure"] == "its worker ended with 7: out of memory"
    assert answers[2]["raw"]


def test_a_worker_that_does_not_answer_in_time_is_ended(peers, canned):
    with peers.running(canned, Path(sys.executable), 1.0) as worker:
        answer = worker.ask(_problem("endless"), 0.2)
        assert answer["failure"] == "no answer within 0.2 s"
        assert not worker.alive
    assert worker.ended


def test_an_interrupt_ends_the_worker(peers, canned):
    with pytest.raises(KeyboardInterrupt), peers.running(canned, Path(sys.executable), 1.0) as worker:
        raise KeyboardInterrupt
    assert worker.ended


def test_a_worker_whose_packages_are_missing_tells_which(peers, canned, tmp_path):
    (tmp_path / "canned_worker.py").write_text("import a_package_that_nobody_has\n")
    with pytest.raises(peers.PeerMissing, match="No module named 'a_package_that_nobody_has'"):
        peers.ask(canned, Path(sys.executable), [_problem("a")], 1.0)


def test_a_peer_without_any_path_is_missing(peers, canned):
    with pytest.raises(peers.PeerMissing, match="no way"):
        peers.ask(canned, Path(sys.executable), [_problem("impossible")], 1.0)


def test_an_interpreter_that_is_not_there_is_told(peers, canned, tmp_path):
    with pytest.raises(peers.PeerMissing, match="interpreter does not start"):
        peers.ask(canned, tmp_path / "python", [_problem("a")], 1.0)


def test_an_environment_that_exists_is_used_as_it_is(peers, canned, tmp_path, monkeypatch):
    monkeypatch.setattr(peers.venv, "create", None)
    python = tmp_path / "canned" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    python.parent.mkdir(parents=True)
    python.touch()
    assert peers.interpreter(canned, tmp_path, {}) == python
    assert peers.interpreter(canned, None, {"canned": Path("mine")}) == Path("mine")


def test_an_installation_that_fails_leaves_nothing_behind(peers, canned, tmp_path, monkeypatch):
    def fail(command, **_):
        assert command[1:] == ["-m", "pip", "install", "-q", "canned==1.0"]
        return subprocess.CompletedProcess(command, 1, "", "ERROR: there is none\nERROR: No matching distribution\n")

    monkeypatch.setattr(peers.venv, "create", lambda place, with_pip: place.mkdir())
    monkeypatch.setattr(peers.subprocess, "run", fail)
    with pytest.raises(peers.PeerMissing, match="pip could not install it: ERROR: No matching distribution"):
        peers.interpreter(canned, tmp_path, {})
    assert not (tmp_path / "canned").exists()


def test_what_pip_cannot_install_needs_an_interpreter(peers, tmp_path):
    vamp = next(peer for peer in peers.PEERS if not peer.packages)
    with pytest.raises(peers.PeerMissing, match="hand in an interpreter"):
        peers.interpreter(vamp, tmp_path, {})


def test_every_peer_has_its_worker_and_exact_versions(peers):
    names = [peer.name for peer in peers.PEERS]
    assert len(set(names)) == len(names)
    for peer in peers.PEERS:
        assert (_FOLDER / peer.worker).is_file()
        assert all("==" in package for package in peer.packages)
