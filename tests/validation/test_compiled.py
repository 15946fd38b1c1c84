from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from rr1plan import compiling, kept_code
from rr1plan.validation import compiled

SOURCE = """
from rr1plan.validation.compiled import FLOATS1, OUT1, entry, part

@part
def half(x):
    if x < 0.0:
        raise ValueError("below zero")
    return 0.5 * x

@entry((FLOATS1, OUT1))
def halve(values, out):
    "Halve all."
    for i in range(len(values)):
        out[i] = half(values[i])
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Gives `halve` as a new process would get it."""
    monkeypatch.setattr(compiled, "_entries", [])
    monkeypatch.setattr(compiling, "_told", [])
    monkeypatch.setattr(compiling, "_jobs", {})
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "kept"))
    file = tmp_path / "tiny_entry.py"
    file.write_text(SOURCE)

    def load():
        compiling._told.clear()
        spec = importlib.util.spec_from_file_location("tiny_entry", file)
        module = importlib.util.module_from_spec(spec)
        sys.modules["tiny_entry"] = module
        spec.loader.exec_module(module)
        return module.halve

    yield load
    sys.modules.pop("tiny_entry", None)


def halved(halve):
    out = np.zeros(3)
    halve(np.array([1.0, 2.0, 4.0]), out)
    return out.tolist()


def test_importing_the_referee_loads_no_compiled_code_and_no_linear_algebra_of_scipy():
    code = (
        "import sys, rr1plan.validation, rr1plan.validation.compiled as c;"
        "print(len(c._entries), sum(e._built is not None for e in c._entries), 'scipy.linalg' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["3", "0", "False"]


def test_an_entry_is_compiled_on_its_first_call_and_says_so_once(load, caplog):
    halve = load()
    assert halve.__doc__ == "Halve all."
    assert not caplog.records
    assert halved(halve) == [0.5, 1.0, 2.0]
    assert halve.build().stats.cache_misses
    assert halved(halve) == [0.5, 1.0, 2.0]
    assert len(caplog.records) == 1


def test_an_entry_that_is_kept_is_loaded_in_silence(load, caplog):
    halved(load())
    caplog.clear()
    halve = load()
    assert halved(halve) == [0.5, 1.0, 2.0]
    assert halve.build().stats.cache_hits
    assert not caplog.records


def test_loaded_code_raises_what_compiled_code_raises(load):
    for _ in range(2):
        with pytest.raises(ValueError, match="below zero"):
            load()(np.array([-1.0]), np.zeros(1))


def test_an_entry_takes_no_other_types_than_its_signature_says(load):
    halved(load())
    with pytest.raises(TypeError):
        load()(np.zeros(2), np.zeros(2, np.float32))


def test_code_that_was_kept_in_another_form_is_made_anew(load, monkeypatch):
    halved(load())
    monkeypatch.setattr(kept_code, "_FORMAT", kept_code._FORMAT + 1)
    halve = load()
    assert halved(halve) == [0.5, 1.0, 2.0]
    assert halve.build().stats.cache_misses


def test_without_a_folder_an_entry_is_compiled_all_the_same(load, monkeypatch):
    def nowhere(*_):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(compiled, "keep", nowhere)
    assert halved(load()) == [0.5, 1.0, 2.0]


def test_other_failures_are_not_hidden(load, monkeypatch):
    def broken(*_):
        raise RuntimeError("out of registers")

    monkeypatch.setattr(compiled, "keep", broken)
    with pytest.raises(RuntimeError, match="registers"):
        halved(load())


def test_entries_are_built_ahead(load):
    halve = load()
    compiled.build_entries()
    assert halve._built is not None
