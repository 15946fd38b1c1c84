"""There are no import cycles, not even for types or inside functions; no file name occurs twice."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

import rr1plan

_ROOT = Path(__file__).resolve().parents[1]


def test_imports_have_no_cycle() -> None:
    graph = grimp.build_graph("rr1plan", cache_dir=None)
    modules = graph.modules - {"rr1plan"}  # which lists all public names
    imports = {name: graph.find_modules_directly_imported_by(name) & modules for name in modules}
    assert sum(map(len, imports.values())) > 1000
    TopologicalSorter(imports).prepare()


def test_a_file_name_alone_says_which_file_is_meant() -> None:
    package = Path(rr1plan.__file__).parent
    folders = [package, *(_ROOT / name for name in ("benchmarks", "docs", "examples", "tests"))]
    names = Counter(file.name for folder in folders for file in folder.rglob("*.py"))
    assert len(names) > 500
    shared = {"__init__.py", "conftest.py"}  # their names are given by Python and pytest
    assert {name for name, count in names.items() if count > 1} == shared


def test_ctrl_c_while_a_name_loads_its_libraries_is_a_keyboard_interrupt() -> None:
    script = """
import os, signal, sys
import rr1plan

class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == "mujoco._structs":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupts())
try:
    rr1plan.simulate
except KeyboardInterrupt:
    print("interrupted")
print("mujoco" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["interrupted", "True"]
