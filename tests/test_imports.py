"""There are no import cycles, not even for types or inside functions; no file name occurs twice."""

from __future__ import annotations

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
