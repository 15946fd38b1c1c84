"""The command line if its output cannot be written, and if it is interrupted."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import rr1plan
from rr1plan.cli import BAD_INPUT, INTERRUPTED, NO_PLAN, OK
from rr1plan.scene.model_library import installed_robot_names, load_problems, robot_names, scene_names

RR1PLAN = f"{sys.executable} -m rr1plan"
NO_PATH = "plan planar2r_no_path --seconds 0.3"


def shell(line: str) -> subprocess.CompletedProcess[str]:
    """Run a line of bash whose exit code is that of its first command."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    line = f"{line}; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False, env=environment)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    return done


@pytest.mark.parametrize("command", ["scenes", "robots", "scenes rr1_table", "scenes rr1_table --json", "--version"])
@pytest.mark.parametrize("where", ["> /dev/full", ">&-"])
@pytest.mark.parametrize("unbuffered", ["", "PYTHONUNBUFFERED=1 "])
def test_output_that_cannot_be_written_is_an_error(command: str, where: str, unbuffered: str) -> None:
    done = shell(f"{unbuffered}{RR1PLAN} {command} {where}")
    assert done.returncode == BAD_INPUT
    assert re.fullmatch("rr1plan: cannot write to standard output: .*\n", done.stderr)


@pytest.mark.parametrize("where", ["> /dev/full", ">&-"])
def test_an_error_that_cannot_be_json_is_a_line(where: str) -> None:
    done = shell(f"{RR1PLAN} scenes nowhere --json {where}")
    assert done.returncode == BAD_INPUT
    assert done.stderr.startswith("rr1plan: unknown scene 'nowhere'")


@pytest.mark.parametrize(("command", "code"), [("scenes nowhere", BAD_INPUT), (NO_PATH, NO_PLAN)])
@pytest.mark.parametrize("where", ["2> /dev/full", "2>&-"])
def test_errors_that_cannot_be_written_still_have_their_exit_code(command: str, code: int, where: str) -> None:
    done = shell(f"{RR1PLAN} {command} {where}")
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("robots rr1 | head -1", OK),
        ("scenes --json | true", OK),
        ("plan --help | true", OK),
        (f"{NO_PATH} --json | true", NO_PLAN),
    ],
)
def test_a_reader_that_leaves_changes_nothing(command: str, code: int) -> None:
    done = shell(f"{RR1PLAN} {command}")
    assert done.returncode == code
    # The first compilation says so, whatever is planned first.
    assert [line for line in done.stderr.splitlines() if "compiling for this machine" not in line] == []


def test_a_command_whose_reader_left_does_its_work(tmp_path: Path) -> None:
    assert shell(f"{RR1PLAN} demo --scene planar2r_path --output {tmp_path}/out | head -1").stdout == "rr1plan demo\n"
    assert (tmp_path / "out" / "trajectory.csv").exists()


def test_a_character_that_the_terminal_lacks_is_no_error() -> None:
    done = shell(f"PYTHONIOENCODING=ascii {RR1PLAN} plan rr1_table --arm é")
    assert done.returncode == BAD_INPUT
    Path("ä.toml").write_text("description = 'größer'\n[arms.a]\nrobot = 'planar2r'\n")
    assert "gr\\xf6\\xdfer" in shell(f"PYTHONIOENCODING=ascii {RR1PLAN} scenes ä.toml").stdout


def test_a_table_in_a_pipe_has_a_whole_line_for_each_row() -> None:
    lines = shell(f"{RR1PLAN} scenes").stdout.splitlines()[1:]
    assert [line.split()[0] for line in lines] == list(scene_names())
    for name, line in zip(scene_names(), lines, strict=True):
        assert ", ".join(load_problems(name)) in line
        assert line == line.rstrip()


def test_quiet_lists_are_names_for_scripts() -> None:
    robots = shell(f"{RR1PLAN} robots --quiet").stdout.splitlines()
    assert robots == [*robot_names(), *installed_robot_names()]
    assert shell(f"{RR1PLAN} scenes --quiet").stdout.splitlines() == list(scene_names())
    assert shell(f"{RR1PLAN} robots rr1 --quiet").stdout == ""
    assert json.loads(shell(f"{RR1PLAN} robots --quiet --json").stdout)


def on_a_terminal(command: list[str], **variables: str) -> tuple[int, str]:
    """The exit code of a command on a terminal, and what it writes there."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"COLUMNS": "80", "TERM": "xterm"} | variables
    child = subprocess.Popen(command, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    said = b""
    try:
        while block := os.read(ours, 65536):
            said += block
    except OSError:
        # The terminal is closed with its last user.
        pass
    finally:
        os.close(ours)
    return child.wait(), said.decode()


# A decomposition that takes long.
_SLOW_PIECES = """
import time
import numpy as np, trimesh
import rr1plan as rp
from rr1plan.shapes import convex_decomposition

def slow(vertices, faces, options, seconds, wait):
    for k in range(3):
        time.sleep(0.01)
        wait()
    return [vertices]

convex_decomposition.coacd_pieces, convex_decomposition._ANNOUNCED = slow, 0.0
ring = trimesh.creation.annulus(0.5, 1.0, 0.2)
mesh = rp.Mesh(ring.vertices, ring.faces)
print(len(rp.convex_pieces(mesh{more})), "piece")
"""


def test_a_long_decomposition_draws_a_bar_on_a_terminal_only(tmp_path: Path) -> None:
    def run_it(folder: str, more: str = "") -> tuple[int, str]:
        script = _SLOW_PIECES.replace("{more}", more)
        return on_a_terminal([sys.executable, "-c", script], RR1PLAN_CACHE=str(tmp_path / folder))

    code, said = run_it("a")
    assert code == OK, said
    assert "\x1b[?25l" in said, said
    assert "cutting a mesh into convex pieces" in said
    assert "━" in said
    assert said.count("\x1b[?25h") >= 1
    code, said = run_it("b", ", progress=lambda share: None")
    assert (code, "━" in said) == (OK, False), said
    script = _SLOW_PIECES.replace("{more}", "")
    environment = os.environ | {"RR1PLAN_CACHE": str(tmp_path / "c")}
    piped = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment)
    assert piped.stdout == "1 piece\n"
    assert "━" not in piped.stderr


def test_a_terminal_that_cannot_move_its_cursor_gets_no_bar_and_no_empty_lines() -> None:
    command = [*RR1PLAN.split(), "plan", "planar2r_path"]
    code, said = on_a_terminal(command, TERM="dumb")
    assert code == OK, said
    assert "\x1b" not in said
    assert all(said.splitlines()), said
    assert "━" in on_a_terminal(command)[1]


def test_a_table_on_a_narrow_terminal_has_whole_names() -> None:
    code, text = on_a_terminal([*RR1PLAN.split(), "scenes"])
    assert code == OK
    assert "…" not in text
    for name in scene_names():
        assert name in text
        assert all(query in text for query in load_problems(name))


# Prints from inside `main`, which first imports the command line: a signal sent
# while the interpreter itself is starting is not ours to answer.
_TELLS_THAT_IT_RUNS = """
import sys
import rr1plan.__main__ as command

class Tells:
    def find_spec(self, name, path=None, target=None):
        if name == "rr1plan.cli":
            print("started", flush=True)

sys.meta_path.insert(0, Tells())
command.main()
"""


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.4, 0.7, 1.0, 1.5, 3.0])
def test_ctrl_c_at_any_moment_ends_with_130_and_no_traceback(delay: float) -> None:
    command = [sys.executable, "-c", _TELLS_THAT_IT_RUNS, "plan", "planar2r_no_path", "--seconds", "60"]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "started\n"
    time.sleep(delay)
    os.kill(child.pid, signal.SIGINT)
    _, said = child.communicate(timeout=30)
    assert (child.returncode, said) == (INTERRUPTED, "rr1plan: interrupted\n")


# Interrupts itself as it begins to import a module.
_INTERRUPTS_ITSELF = """
import os, signal, sys
import rr1plan.__main__ as command

class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, {handler})
sys.meta_path.insert(0, Interrupts())
command.main()
"""


@pytest.mark.parametrize("module", ["rr1plan.cli", "argparse", "rich.console", "numpy", "rr1plan.pipeline"])
def test_ctrl_c_while_the_command_line_and_its_libraries_load_is_one_line(module: str) -> None:
    script = _INTERRUPTS_ITSELF.format(module=module, handler="signal.default_int_handler")
    done = subprocess.run(
        [sys.executable, "-c", script, "plan", "nowhere"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (INTERRUPTED, "rr1plan: interrupted\n")


def test_ctrl_c_while_a_command_imports_the_simulator_is_one_line() -> None:
    script = _INTERRUPTS_ITSELF.format(module="mujoco._structs", handler="signal.default_int_handler")
    command = [sys.executable, "-c", script, "play", "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (INTERRUPTED, "rr1plan: interrupted\n")


def test_ctrl_c_while_a_command_imports_the_reader_of_meshes_is_not_lost(tmp_path: Path) -> None:
    (tmp_path / "stone.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    scene = tmp_path / "scene.toml"
    scene.write_text('[arms.arm]\nrobot = "rr1"\n\n[obstacles.stone]\nmesh = "stone.obj"\nposition = [2, 0, 0]\n')
    script = _INTERRUPTS_ITSELF.format(module="scipy.ndimage", handler="signal.default_int_handler")
    command = [sys.executable, "-c", script, "plan", str(scene), "--goal", "ready"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (INTERRUPTED, "rr1plan: interrupted\n")


def test_a_job_in_the_background_that_ignores_ctrl_c_goes_on() -> None:
    for module in ("rr1plan.cli", "numpy"):
        script = _INTERRUPTS_ITSELF.format(module=module, handler="signal.SIG_IGN")
        done = subprocess.run([sys.executable, "-c", script, "scenes"], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (OK, "")


def test_little_is_imported_before_ctrl_c_is_handled() -> None:
    root = Path(rr1plan.__file__).parents[1]
    script = f"import sys; sys.path.insert(0, {str(root)!r}); import rr1plan.__main__; print(*sys.modules)"
    # Without `site`, whose .pth files import much before any program begins.
    done = subprocess.run([sys.executable, "-I", "-S", "-c", script], capture_output=True, text=True, check=True)
    heavy = {"typing", "contextlib", "threading", "argparse", "logging", "rich", "numpy", "rr1plan.cli"}
    assert heavy.isdisjoint(done.stdout.split())


@pytest.mark.parametrize(
    ("number", "handler"),
    [
        (signal.SIGINT, "default_int_handler"),
        (signal.SIGTERM, "default_int_handler"),
        (signal.SIGHUP, "default_int_handler"),
        # As of a job in the background of a script.
        (signal.SIGTERM, "SIG_IGN"),
    ],
)
def test_a_page_ends_in_order_when_its_process_is_told_to_end(number: signal.Signals, handler: str) -> None:
    script = f"import signal; signal.signal(signal.SIGINT, signal.{handler}); import rr1plan.__main__ as m; m.main()"
    command = [sys.executable, "-c", script, "view", "planar2r_path", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline().startswith("page: ")
        time.sleep(0.5)
        child.send_signal(number)
        _, said = child.communicate(timeout=30)
    assert (child.returncode, said) == (OK, "")
