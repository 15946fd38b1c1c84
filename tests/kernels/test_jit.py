from __future__ import annotations

import importlib.util
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from rr1plan import code_units, compiling
from rr1plan._kernels import code_folder as folders
from rr1plan._kernels import jit as jit_module
from rr1plan._kernels.blended import time_polyline
from rr1plan._kernels.jit import all_kept, build_all

KERNELS = Path(jit_module.__file__).parent


@pytest.fixture(autouse=True)
def no_folder_is_remembered(monkeypatch, tmp_path):
    monkeypatch.setenv("RR1PLAN_CACHE", str(tmp_path / "user"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(compiling, "_told", [])
    monkeypatch.setattr(compiling, "_jobs", {})
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

@jit(F64(OUT1, I64), entry=True)
def add(values, count):
    total = 0.0
    for i in range(count):
        total += twice(values[i])
    return total
"""
# Its callers are in another file, which calls `add` by its address, and `half_of` as a part does.
CALLERS = """
import numpy as np
from tiny import add
from rr1plan._kernels.jit import F64, OUT1, jit

@jit(F64(OUT1), entry=True)
def both(values):
    return add(values, len(values)) + half_of(values)

@jit(F64(OUT1))
def half_of(values):
    if len(values) == 0:
        raise ValueError("nothing to add")
    return 0.5 * add(values.copy(), len(values))
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


def test_a_kernel_is_built_on_its_first_call_with_the_parts_it_calls(load):
    twice, add = load()
    assert twice.__name__ == "twice"
    assert twice.__doc__ == "Two times x."
    assert add(np.array([1.0, 2.0, 4.0]), 2) == 6.0
    assert twice._built is None
    assert add.build() is add.build()
    assert twice(3.0) == 6.0


def test_a_kernel_takes_no_other_types_than_its_signature_says(load):
    with pytest.raises(TypeError):
        load()[0]("text")


def test_code_that_is_kept_is_loaded_in_silence_and_its_callees_are_not(load, caplog):
    _, add = load()
    assert add.is_kept() is False
    assert add(np.ones(3), 3) == 6.0
    assert add.build().stats.cache_misses
    caplog.clear()
    compiling._told.clear()
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


def test_a_function_of_numba_itself_may_call_parts_and_entries(load):
    twice, add = load()

    @numba.njit
    def outside(values):
        return add(values, len(values)) + twice(values[0])

    assert outside(np.array([1.0, 2.0])) == 8.0


# ---- entries that call entries -------------------------------------------------------------


@pytest.fixture
def load_callers(load, tmp_path, monkeypatch):
    """Gives `add`, and `both` of another file, which calls it, as a new process would get them."""
    file = tmp_path / "source" / "callers.py"
    file.write_text(CALLERS)
    # As files of kernels name those they import.
    monkeypatch.setattr(folders, "_IMPORTS", re.compile(rb"^from (tiny) ", re.MULTILINE))
    monkeypatch.setattr(folders, "__file__", str(file.with_name("code_folder.py")))

    def load_callers():
        folders.stamp_of.cache_clear()
        _, add = load()
        spec = importlib.util.spec_from_file_location("callers", file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return add, module.both

    yield load_callers
    folders.stamp_of.cache_clear()


def test_an_entry_calls_another_by_its_address_and_both_are_kept(load_callers):
    add, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 9.0
    assert add._built is not None
    assert both.build().overloads[both._signature.args].library.needs == (add._identity,)
    add, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 9.0
    assert both.build().stats.cache_hits
    assert add.build().stats.cache_hits


def test_what_an_entry_raises_is_raised_by_its_caller(load_callers):
    for _ in range(2):
        _, both = load_callers()
        with pytest.raises(ValueError, match="nothing to add"):
            both(np.empty(0))


def test_an_entry_that_was_lost_is_compiled_anew_for_a_caller_that_is_kept(load_callers):
    add, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 9.0
    shutil.rmtree(add._folder())
    folders.code_folder.cache_clear()
    add, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 9.0
    assert both.build().stats.cache_hits
    assert add.build().stats.cache_misses


def test_a_caller_is_compiled_anew_when_the_text_of_what_it_calls_changes(load_callers, tmp_path):
    _, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 9.0
    file = tmp_path / "source" / "tiny.py"
    file.write_text(file.read_text().replace("2.0 * x", "3.0 * x"))
    add, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 13.5
    assert both.build().stats.cache_misses
    assert add.build().stats.cache_misses


def test_a_caller_that_needs_code_that_nobody_knows_is_compiled_anew(load_callers, monkeypatch):
    _, both = load_callers()
    assert both(np.array([1.0, 2.0])) == 9.0
    _, both = load_callers()
    monkeypatch.setattr(code_units, "_builders", {})
    assert both(np.array([1.0, 2.0])) == 9.0
    assert both.build().stats.cache_misses


def test_kept_callers_run_in_a_new_process_from_a_folder_that_cannot_be_written():
    code = (
        "import rr1plan._kernels.code_folder as folders;"
        "real = folders._can_write;"
        "folders._can_write = lambda f: not f.is_relative_to(folders.Path(folders.__file__).parent) and real(f);"
        "import numpy as np;"
        "from rr1plan.compiling import _told;"
        "from rr1plan._kernels.blended import time_polyline as f;"
        "d, _, bent, stop = f(np.eye(3, 2), np.zeros(3), np.ones(2), np.ones(2), 20.0, 1e-9);"
        "print(len(d) > 0, f.build().stats.cache_hits != {}, _told)"
    )
    time_polyline(np.eye(3, 2), np.zeros(3), np.ones(2), np.ones(2), 20.0, 1e-9)
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["True", "True", "[]"]


def test_a_kernel_answers_by_its_address_as_it_does_as_a_part(load, tmp_path):
    values = np.random.default_rng(0).normal(size=40)
    _, apart = load()
    file = tmp_path / "source" / "tiny.py"
    file.write_text(file.read_text().replace(", entry=True", ""))
    _, linked = load()

    @numba.njit
    def outside(values):
        return apart(values, len(values)), linked(values, len(values))

    by_address, as_part = outside(values)
    assert by_address == as_part


def test_all_that_the_package_calls_from_python_is_an_entry():
    package = Path(jit_module.__file__).parents[1]
    outside = "".join(f.read_text() for f in package.rglob("*.py") if "_kernels" not in f.parts)
    code = (
        "import rr1plan._kernels.jit as j; j._all_entries();"
        "print(*(f'{k.__module__} {k.__name__}' for k in j._made if not k.entry))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    parts = list(zip(said[::2], said[1::2], strict=True))
    assert len(parts) > 50
    for module, name in parts:
        stem = module.rpartition(".")[2]
        assert not re.search(rf"from {module} import .*\b{name}\b", outside)
        assert not re.search(rf"= (kernel|{stem})\.{name}\b", outside)


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
    twice, add = load()
    monkeypatch.setattr(jit_module, "iter_modules", lambda path: [])
    build_all(seen.append)
    assert seen == [0.0, 1.0]
    assert add._built is not None
    assert twice._built is None


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
