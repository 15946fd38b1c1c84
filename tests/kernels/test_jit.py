from __future__ import annotations

import importlib.util
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from rr1plan import kept_code
from rr1plan._kernels import code_folder as folders
from rr1plan._kernels import jit as jit_module
from rr1plan._kernels.jit import all_kept, build_all

KERNELS = Path(jit_module.__file__).parent


@pytest.fixture(autouse=True)
def no_folder_is_remembered(monkeypatch, tmp_path):
    monkeypatch.setenv("RR1PLAN_CACHE", str(tmp_path / "user"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(jit_module, "_told", [])
    monkeypatch.setattr(jit_module, "_made", [])
    folders.code_folder.cache_clear()
    yield
    folders.code_folder.cache_clear()


def forbid(monkeypatch, *places):
    """Let nothing be written in some folders (root may write where others may not)."""
    real = folders._can_write
    monkeypatch.setattr(folders, "_can_write", lambda f: not any(f.is_relative_to(p) for p in places) and real(f))


SOURCE = """
from rr1plan._kernels.jit import F64, I64, OUT1, jit

@jit(F64(F64))
def twice(x):
    "Two times x."
    return 2.0 * x

@jit(F64(OUT1, I64))
def add(values, count):
    total = 0.0
    for i in range(count):
        total += twice(values[i])
    return total
"""


@pytest.fixture
def load(tmp_path):
    """Gives `twice` and `add`, which calls it, as a new process would get them."""
    file = tmp_path / "source" / "tiny.py"
    file.parent.mkdir()
    file.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("tiny", file)
        module = importlib.util.module_from_spec(spec)
        sys.modules["tiny"] = module
        spec.loader.exec_module(module)
        return module.twice, module.add

    yield load
    sys.modules.pop("tiny", None)


def test_importing_the_planner_builds_no_kernel():
    code = (
        "import rr1plan.pipeline, rr1plan._kernels.jit as j;"
        "print(len(j._made), sum(k._built is not None for k in j._made))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    there, built = map(int, said.stdout.split())
    assert there > 20
    assert built == 0


def test_a_kernel_is_built_on_its_first_call_and_builds_those_it_calls(load):
    twice, add = load()
    assert twice.__name__ == "twice"
    assert twice.__doc__ == "Two times x."
    assert add(np.array([1.0, 2.0, 4.0]), 2) == 6.0
    assert twice._built is not None
    assert add.build() is add.build()


def test_a_kernel_takes_no_other_types_than_its_signature_says(load):
    with pytest.raises(TypeError):
        load()[0]("text")


def test_code_that_is_kept_is_loaded_in_silence_and_its_callees_are_not(load, caplog):
    _, add = load()
    assert add.is_kept() is False
    assert add(np.ones(3), 3) == 6.0
    assert add.build().stats.cache_misses
    caplog.clear()
    jit_module._told.clear()
    twice, add = load()
    assert add.is_kept() is True
    assert add(np.ones(3), 3) == 6.0
    assert add.build().stats.cache_hits
    assert twice._built is None
    assert not caplog.records


def test_a_kernel_that_was_loaded_is_compiled_into_another_one(load):
    assert load()[0](1.0) == 2.0
    twice, add = load()
    assert twice(3.0) == 6.0
    assert twice.build().stats.cache_hits
    assert add(np.ones(3), 3) == 6.0
    assert add.build().stats.cache_misses
    assert twice(3.0) == 6.0


def test_code_is_loaded_as_numba_does_it_where_the_short_way_fails(load, monkeypatch):
    def other(*_):
        raise AttributeError("no such name in this numba")

    assert load()[1](np.ones(3), 3) == 6.0
    monkeypatch.setattr(kept_code, "_callable", other)
    _, add = load()
    assert add(np.ones(3), 3) == 6.0
    assert add.build().stats.cache_hits


def test_whether_all_are_kept_is_known_without_building_them(load, monkeypatch):
    monkeypatch.setattr(jit_module, "iter_modules", lambda path: [])
    twice, add = load()
    assert twice(1.0) == 2.0
    assert not all_kept()
    assert add(np.ones(2), 2) == 4.0
    assert all_kept()
    monkeypatch.setattr(folders, "_can_write", lambda folder: False)
    folders.code_folder.cache_clear()
    shutil.rmtree(twice._file.parent / "__pycache__")
    assert all_kept()


def test_all_can_be_built_ahead(load, monkeypatch):
    seen = []
    kernels = load()
    monkeypatch.setattr(jit_module, "iter_modules", lambda path: [])
    build_all(seen.append)
    assert seen == [0.5, 1.0]
    assert all(kernel._built is not None for kernel in kernels)


# ---- where code is kept --------------------------------------------------------------------


def test_a_file_has_another_stamp_when_a_kernel_it_imports_changes(monkeypatch, tmp_path):
    for name in ("before", "same", "after"):
        shutil.copytree(KERNELS, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    with (tmp_path / "after" / "separation.py").open("a") as file:
        file.write("\n# changed\n")

    def stamp(folder, stem):
        monkeypatch.setattr(folders, "__file__", str(tmp_path / folder / "code_folder.py"))
        return folders.stamp_of(tmp_path / folder / f"{stem}.py")

    assert stamp("before", "edges") == stamp("same", "edges")
    for stem in ("separation", "motion", "swept", "edges", "rrt_connect"):
        assert stamp("before", stem) != stamp("after", stem)
    assert stamp("before", "generator") == stamp("after", "generator")


def test_a_file_that_cannot_be_read_has_no_stamp(tmp_path):
    assert folders.stamp_of(tmp_path / "nothing.py") == ""


def test_code_is_kept_beside_the_source_and_that_of_older_texts_is_removed(tmp_path):
    old = folders.code_folder(tmp_path / "a.py", f"a-{'0' * 16}")
    other = folders.code_folder(tmp_path / "a_b.py", f"a_b-{'0' * 16}")
    new = folders.code_folder(tmp_path / "a.py", f"a-{'1' * 16}")
    assert new == tmp_path / "__pycache__" / f"a-{'1' * 16}"
    assert new.is_dir()
    assert other.is_dir()
    assert not old.exists()


def test_numbas_own_setting_goes_first(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    assert folders.code_folder(tmp_path / "a.py", "a-0") == tmp_path / "mine" / "a-0"


def test_a_read_only_installation_keeps_code_in_the_users_folder(monkeypatch, tmp_path):
    forbid(monkeypatch, tmp_path / "site")
    folder = folders.code_folder(tmp_path / "site" / "a.py", "a-0")
    assert folder == tmp_path / "user" / "code" / "a-0"
    assert folder.is_dir()


def test_code_made_ahead_is_taken_over_by_a_user_who_may_not_write_there(monkeypatch, tmp_path):
    made = folders.code_folder(tmp_path / "site" / "a.py", "a-0")
    (made / "a.nbi").write_text("code")
    folders.code_folder.cache_clear()
    forbid(monkeypatch, tmp_path / "site")
    folder = folders.code_folder(tmp_path / "site" / "a.py", "a-0")
    assert (folder / "a.nbi").read_text() == "code"
    folders.code_folder.cache_clear()
    forbid(monkeypatch, tmp_path / "site", tmp_path / "user")
    folder = folders.code_folder(tmp_path / "site" / "a.py", "a-0")
    assert not folder.is_relative_to(tmp_path)
    assert (folder / "a.nbi").read_text() == "code"


def test_without_any_folder_kernels_run_and_it_is_said_that_they_are_not_kept(load, monkeypatch, caplog):
    monkeypatch.setattr(folders, "_can_write", lambda folder: False)
    twice, _ = load()
    assert folders.code_folder(twice._file, twice._stamp) is None
    assert twice(4.0) == 8.0
    assert "in every process" in caplog.text


def test_a_full_disk_costs_the_cache_only(load, monkeypatch, caplog):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
    assert load()[0](4.0) == 8.0
    assert "No space left" in caplog.text


def test_other_failures_to_compile_are_not_hidden(load, monkeypatch):
    def broken(*args, **options):
        raise RuntimeError("out of registers")

    monkeypatch.setattr(numba, "njit", broken)
    with pytest.raises(RuntimeError, match="registers"):
        load()[0](1.0)


# ---- what the user notices -----------------------------------------------------------------


def test_compiling_announces_itself_once_and_says_where_the_code_goes(load, caplog):
    twice, add = load()
    assert not caplog.records
    assert add(np.ones(2), 2) == 4.0
    assert twice(1.0) == 2.0
    assert len(caplog.records) == 1
    assert str(twice._file.parent) in caplog.text


def interrupt_while_compiling(kernel, monkeypatch):
    real = kernel._compile
    monkeypatch.setattr(kernel, "_compile", lambda *how: (signal.raise_signal(signal.SIGINT), real(*how))[1])


def test_ctrl_c_while_a_kernel_is_built_is_raised_once_it_is(load, monkeypatch):
    twice, _ = load()
    interrupt_while_compiling(twice, monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        twice(1.0)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert twice(1.0) == 2.0


def test_ctrl_c_does_not_wait_for_the_kernels_that_are_still_to_be_built(load, monkeypatch):
    twice, add = load()
    interrupt_while_compiling(add, monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        add(np.ones(2), 2)
    assert twice._built is None
    assert add._built is None
    monkeypatch.undo()
    assert add(np.ones(2), 2) == 4.0


def test_who_handles_ctrl_c_otherwise_keeps_doing_so(load, monkeypatch):
    seen = []
    before = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        twice, _ = load()
        interrupt_while_compiling(twice, monkeypatch)
        assert twice(1.0) == 2.0
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [signal.SIGINT]
