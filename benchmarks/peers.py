"""Other planners as workers, each in a separate virtual environment that is created if missing.

A worker is a script in this folder with the protocol of `worker.py`. It solves one problem after
another, each under a time limit: a worker that does not respond in time, or dies, is terminated and restarted.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import tempfile
import threading
import venv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from shared import console, track

_INSTALL = 1200.0  # time limit of an installation [s]
_START = 120.0  # time limit for loading a worker's libraries [s]


@dataclass(frozen=True)
class Peer:
    """A planner to compare with.

    Args:
        name: Name in reports.
        environment: Name of its virtual environment; peers may share one.
        packages: What pip installs there. Empty: it cannot be installed by pip alone.
        worker: The script that runs it.
        options: Options of its worker.
        note: Note for readers of its results.
    """

    name: str
    environment: str
    packages: tuple[str, ...]
    worker: str
    options: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""


ROBOPLAN = ("roboplan==0.7.0",)
PEERS = (
    Peer("roboplan 0.7.0", "roboplan", ROBOPLAN, "roboplan_worker.py", note="RRT-Connect, its other defaults"),
    Peer(
        "roboplan at 0.01 rad",
        "roboplan",
        ROBOPLAN,
        "roboplan_worker.py",
        {"step": 0.01},
        "its step of collision checks five times as fine as its default",
    ),
    Peer(
        "OMPL 2.0.1 + Pinocchio",
        "ompl",
        ("ompl==2.0.1", "pin==4.1.0", "coal==3.0.3"),
        "ompl_worker.py",
        note="RRT-Connect through a Python callback, naive broad phase, step 0.05 rad; no retiming",
    ),
    Peer(
        "pyroboplan 1.3.1",
        "pyroboplan",
        ("pyroboplan==1.3.1",),
        "pyroboplan_worker.py",
        note="bidirectional RRT-Connect, its other defaults; timed to rest at every waypoint",
    ),
    Peer("MPlib 0.2.1", "mplib", ("mplib==0.2.1",), "mplib_worker.py", note="the defaults of its `plan_qpos`"),
    Peer("VAMP", "vamp", (), "vamp_worker.py", note="plans for its built-in spheres, not for the hulls; no retiming"),
)


class PeerMissing(Exception):
    """A peer cannot be installed, loaded or run; the message gives the reason."""


def interpreter(peer: Peer, folder: Path | None, given: Mapping[str, Path]) -> Path:
    """The Python that runs a peer.

    Args:
        peer: The peer.
        folder: Folder of environments; missing ones are created.
        given: Interpreters by the name of an environment, used before any in the folder.

    Raises:
        PeerMissing: it could not be installed.
    """
    if peer.environment in given:
        return given[peer.environment]
    if folder is None:
        raise PeerMissing("no folder for its environment")
    place = folder / peer.environment
    python = place / ("Scripts" if os.name == "nt" else "bin") / "python"
    if not python.exists():
        if not peer.packages:
            raise PeerMissing("pip alone cannot install it; hand in an interpreter that can import it")
        _install(peer, place, python)
    return python


def _install(peer: Peer, place: Path, python: Path) -> None:
    """Create the environment; remove it on failure."""
    complete = False
    try:
        with console.status(f"installing {' '.join(peer.packages)} into {place}"):
            venv.create(place, with_pip=True)
            command = [str(python), "-m", "pip", "install", "-q", *peer.packages]
            done = subprocess.run(command, capture_output=True, text=True, timeout=_INSTALL, env=_clean())
        complete = done.returncode == 0
        if not complete:
            raise PeerMissing(f"pip could not install it: {_last_line(done.stderr)}")
    except (OSError, subprocess.SubprocessError) as error:
        raise PeerMissing(f"its environment could not be made: {error}") from None
    finally:
        if not complete:
            shutil.rmtree(place, ignore_errors=True)


def _clean() -> dict[str, str]:
    """Environment variables that restrict a worker to its packages and to one thread."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    return clean | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLCONFIGDIR": tempfile.gettempdir()}


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "it printed nothing"


def ask(peer: Peer, python: Path, problems: Sequence[Mapping[str, Any]], seconds: float) -> list[dict[str, Any]]:
    """A peer's results for problems, in their order; see `worker.py` for both.

    Args:
        peer: The peer.
        python: The interpreter that can import it.
        problems: Each with its name, seed, ends, obstacles and robot.
        seconds: Time limit of one search [s]; the worker is terminated after three times that plus a minute.

    Raises:
        PeerMissing: it does not start, or finds no path for any problem.
    """
    limit = 3.0 * seconds + 60.0
    answers = list(_answers(peer, python, problems, seconds, limit))
    if problems and not any("raw" in answer for answer in answers):
        raise PeerMissing(answers[0].get("failure", "no path for any problem"))
    return answers


def _answers(
    peer: Peer, python: Path, problems: Sequence[Mapping[str, Any]], seconds: float, limit: float
) -> Iterator[dict[str, Any]]:
    remaining = track(problems, peer.name)
    first = True
    problem = next(remaining, None)
    while problem is not None:
        with running(peer, python, seconds) as worker:
            if first:
                worker.ask(problem, limit)  # not counted: it loads what is needed once
                first = False
            while problem is not None and worker.alive:
                yield worker.ask(problem, limit)
                problem = next(remaining, None)


@contextmanager
def running(peer: Peer, python: Path, seconds: float) -> Iterator[Worker]:
    """A worker of a peer, as a context manager that ends it.

    Raises:
        PeerMissing: it does not start.
    """
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        worker = Worker(python, peer, seconds, errors)
        try:
            yield worker
        finally:
            worker.end()


class Worker:
    """A running worker; end it.

    Args:
        python: The interpreter that can import the peer.
        peer: The peer.
        seconds: Time limit of one search [s].
        errors: An open file for its standard error.

    Raises:
        PeerMissing: it does not start.
    """

    def __init__(self, python: Path, peer: Peer, seconds: float, errors: IO[str]) -> None:
        self._errors = errors
        script = Path(__file__).parent / peer.worker
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._errors}
        try:
            self._process = subprocess.Popen([python, script], text=True, env=_clean(), **pipes)
        except OSError as error:
            raise PeerMissing(f"its interpreter does not start: {error}") from None
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._listen, daemon=True).start()
        self.alive, self._reason = True, ""
        ready = self._exchange({"seconds": seconds, "options": dict(peer.options)}, _START)
        if ready is None or "failure" in ready:
            self.end()
            raise PeerMissing(self._reason)

    @property
    def ended(self) -> bool:
        """The worker's process has ended."""
        return self._process.poll() is not None

    def ask(self, problem: Mapping[str, Any], limit: float) -> dict[str, Any]:
        """Its result, or a failure if it exceeds the time limit [s] or dies."""
        answer = self._exchange(problem, limit)
        return {"name": problem["name"], "seconds": {}, "failure": self._reason} if answer is None else answer

    def end(self) -> None:
        """End the process in any state."""
        self.alive = False
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):  # discard unread input
                    pipe.close()

    def _exchange(self, message: Mapping[str, Any], limit: float) -> dict[str, Any] | None:
        """Its next line; None if it is dead or silent, after which it is not used again."""
        try:
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()
            line = self._lines.get(timeout=limit)
        except BrokenPipeError:
            line = ""
        except queue.Empty:
            self.alive, self._reason = False, f"no answer within {limit:g} s"
            return None
        if not line:
            self.alive, self._reason = False, self._epitaph()
            return None
        found: dict[str, Any] = json.loads(line)
        return found

    def _listen(self) -> None:
        assert self._process.stdout is not None
        try:
            for line in self._process.stdout:
                self._lines.put(line)
        except ValueError:  # closed by end
            pass
        self._lines.put("")

    def _epitaph(self) -> str:
        code = self._process.wait()
        self._errors.seek(0)
        return f"its worker ended with {code}: {_last_line(self._errors.read())}"
