"""The public names: all load, none is missing, and importing the package loads nothing heavy."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rr1plan


@pytest.mark.parametrize("name", sorted(set(rr1plan.__all__)))
def test_every_public_name_loads(name: str) -> None:
    assert getattr(rr1plan, name) is not None
    assert name in dir(rr1plan)


def test_typed_imports_are_the_lazy_names() -> None:
    tree = ast.parse(Path(rr1plan.__file__).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If))
    typed = {alias.asname for node in ast.walk(block) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert typed | {"__version__"} == set(rr1plan.__all__)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'plam_motion'"):
        _ = rr1plan.plam_motion


def test_import_loads_nothing_heavy() -> None:
    heavy = "pinocchio coal ompl mujoco meshcat toppra ruckig numba scipy matplotlib trimesh coacd tornado rich"
    code = f"import sys, rr1plan; print([m for m in '{heavy}'.split() if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
