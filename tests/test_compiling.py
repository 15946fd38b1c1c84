from __future__ import annotations

import importlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from rr1plan import compiling
from rr1plan._kernels import code_folder as folders
from rr1plan._kernels import jit
from rr1plan._kernels.rrt_connect import grow
from rr1plan._kernels.swept import sweep_edge
from rr1plan.compiling import Job, compile_ahead, compile_together, register

SOURCE = """
from rr1plan._kernels.jit import F64, OUT1, jit

@jit(F64(F64), entry=True)
def twice(x):
    return 2.0 * x

@jit(F64(F64))
def part(x):
    return twice(x) + 1.0

@jit(F64(OUT1), entry=True)
def whole(values):
    return sum([part(value) for value in values])
"""


@pytest.fixture(autouse=True)
def apart(monkeypatch, tmp_path) -> Iterator[None]:
    """No other functions are known, two processors are there, and a helper is always worth it."""
    monkeypatch.setattr(compiling, "_jobs", {})
    monkeypatch.setattr(compiling, "_told", [])
    monkeypatch.setattr(jit, "_made", [])
    monkeypatch.setattr(compiling, "_processors", lambda: 2)
    monkeypatch.setattr(compiling, "_WORTH_A_HELPER", 0)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    folders.code_folder.cache_clear()
    yield
    folders.code_folder.cache_clear()


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """A module of kernels that other processes find."""
    (tmp_path / "rr1plan_tiny.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("rr1plan_tiny")
    sys.modules.pop("rr1plan_tiny")


@pytest.fixture
def helpers(monkeypatch) -> list[subprocess.Popen[str]]:
    """All helpers that are started."""
    started, real = [], compiling._start_helper
    monkeypatch.setattr(compiling, "_start_helper", lambda: started.append(real()) or started[-1])
    return started


def until(done: Callable[[], object]) -> None:
    """Wait for something."""
    end = time.monotonic() + 60.0
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


def first() -> None:
    """Stands for a function that is compiled here."""
    return second() and second() and second()


def second() -> None:
    """Stands for another one."""


def job(function: Callable[[], object], build: Callable[[], object]) -> Job:
    """Of a function that is kept as soon as it was built here."""
    built = []
    return Job(function, lambda: bool(built), lambda: built.append(build()))


def test_a_helper_compiles_what_is_then_loaded_here(kernels, helpers):
    seen = []
    here = job(first, lambda: until(kernels.twice.is_kept))
    assert kernels.twice.is_kept() is False
    compile_together([kernels.twice.job, here], seen.append)
    assert seen[-1] == 1.0
    assert seen == sorted(seen)
    assert kernels.twice(3.0) == 6.0
    assert kernels.twice.build().stats.cache_hits
    assert [helper.poll() is not None for helper in helpers] == [True]


def test_what_is_missing_is_compiled_when_one_of_it_is_called(kernels, helpers):
    assert kernels.whole(np.array([1.0, 2.0])) == 8.0
    assert kernels.twice.is_kept()
    assert len(helpers) == 1
    assert len(compiling._told) == 1
    assert kernels.twice(1.0) == 2.0
    assert len(helpers) == 1


def test_what_few_need_is_compiled_when_it_is_called(kernels):
    rare = Job(first, lambda: False, lambda: pytest.fail("nobody called it"), ahead=False)
    register(rare)
    assert kernels.whole(np.ones(1)) == 3.0


def test_a_function_needs_those_that_its_parts_call(kernels):
    assert kernels.whole.job.needs == [kernels.twice.job]
    assert kernels.whole.job.size > kernels.twice.job.size


def test_what_is_called_is_compiled_before_its_callers(kernels):
    order = []
    twice = Job(kernels.twice.job.function, lambda: False, lambda: order.append("twice"))
    whole = Job(kernels.whole.job.function, lambda: False, lambda: order.append("whole"))
    register(twice)
    compile_together([whole])
    assert order == ["twice", "whole"]


def test_what_kernels_call_is_known_before_they_are_compiled(monkeypatch):
    monkeypatch.undo()
    for kernel in (sweep_edge, grow):
        library = kernel.build().overloads[kernel._signature.args].library
        known = {compiling._jobs[need.name].function.__qualname__ for need in kernel.job.needs}
        assert known >= {identity.split()[0].rpartition(".")[2] for identity in library.needs}
        assert library.needs


def test_what_a_helper_cannot_compile_is_compiled_here(helpers):
    built = []
    here = job(first, lambda: until(lambda: helpers and helpers[0].poll() is not None))
    # Others cannot import this module.
    unknown = job(second, lambda: built.append("second"))
    compile_together([here, unknown])
    assert built == ["second"]


def test_what_a_helper_keeps_elsewhere_is_compiled_here(monkeypatch):
    built, asked = [], []
    monkeypatch.setattr(compiling, "_ask", lambda helper, line: asked.append(line) or True)
    here = job(first, lambda: until(lambda: len(asked) == 2))
    compile_together([here, job(second, lambda: built.append("second"))])
    assert built == ["second"]


def test_a_helper_that_hangs_is_ended_and_its_function_compiled_here(monkeypatch, helpers):
    built, asked, real = [], [], compiling._ask
    monkeypatch.setattr(compiling, "_HELPER", "import time; print('ready', flush=True); time.sleep(600)")
    monkeypatch.setattr(compiling, "_ask", lambda helper, line: asked.append(line) or real(helper, line))
    monkeypatch.setattr(compiling, "_PATIENCE", 0.1)
    monkeypatch.setattr(compiling, "_GLANCE", 0.1)
    here = job(first, lambda: until(lambda: len(asked) == 2))
    compile_together([here, job(second, lambda: built.append("second"))])
    assert built == ["second"]
    assert helpers[0].poll() is not None


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_no_helper_outlives_an_error(helpers, error):
    def fail() -> None:
        until(lambda: helpers)
        raise error

    with pytest.raises(error):
        compile_together([job(first, fail), job(second, lambda: None)])
    assert [helper.poll() is not None for helper in helpers] == [True]


def test_a_helper_ends_when_the_process_that_asked_is_gone():
    helper = compiling._start_helper()
    with helper:
        assert compiling._ask(helper, '["/nowhere"]') is False or helper.stdin.close() is None
        assert helper.wait(60) is not None


def test_where_no_process_starts_all_is_compiled_here(monkeypatch):
    built = []
    monkeypatch.setattr(sys, "executable", f"{sys.executable}-that-is-not-there")
    compile_together([job(first, lambda: built.append(1)), job(second, lambda: built.append(2))])
    assert built == [1, 2]


@pytest.mark.parametrize("executable", [None, "", "/opt/blender/blender", "C:\\app\\planner.exe"])
def test_no_program_is_started_that_is_no_python(kernels, helpers, monkeypatch, executable):
    monkeypatch.setattr(sys, "executable", executable)
    assert kernels.whole(np.ones(1)) == 3.0
    assert not helpers


def test_a_frozen_program_and_a_process_of_many_start_none(kernels, helpers, monkeypatch):
    with monkeypatch.context() as changed:
        changed.setattr(sys, "frozen", True, raising=False)
        assert kernels.twice(1.0) == 2.0
    monkeypatch.setattr("multiprocessing.parent_process", lambda: object())
    assert kernels.whole(np.ones(1)) == 3.0
    assert not helpers


def test_without_a_folder_to_keep_code_in_no_helper_is_started(kernels, helpers, monkeypatch):
    monkeypatch.setattr(folders, "_can_write", lambda folder: False)
    assert kernels.whole(np.ones(1)) == 3.0
    assert not helpers


def test_little_work_is_not_worth_a_helper(kernels, helpers, monkeypatch):
    monkeypatch.setattr(compiling, "_WORTH_A_HELPER", 10_000)
    compile_ahead(kernels.twice.job)
    assert kernels.twice.is_kept() is False
    assert kernels.whole(np.ones(1)) == 3.0
    assert not helpers
