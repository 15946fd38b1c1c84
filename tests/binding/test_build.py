"""The build if modules for pages cannot be compiled, and reproducible bytes on every machine."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from rr1plan.kernels.planner_kernels import LIBRARY
from rr1plan.kernels.wasm_core import core_module
from rr1plan.validation.referee_kernels import LIBRARY as REFEREE
from rr1plan.validation.wasm_referee import referee_module

ROOT = Path(__file__).parents[2]


@pytest.fixture
def build() -> ModuleType:
    """The build of this source tree."""
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def broken_ziglang(build: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Compilers that do nothing, and a ziglang that fails; names of what was compiled."""
    compiled: list[str] = []

    def compile_kernels(unit: Path, out: Path, *flags: str, compiler: Any = None) -> None:
        if compiler == build.zig():
            raise RuntimeError("No module named ziglang")
        compiled.append(out.name)

    monkeypatch.setattr(build, "compile_kernels", compile_kernels)
    return compiled


def test_with_cc_a_module_that_cannot_be_made_is_left_out_with_a_warning(
    build: ModuleType, broken_ziglang: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "some-compiler")
    warnings: list[str] = []
    files = build.build_all(warnings.append)
    assert sorted(file.name for file in files) == sorted(broken_ziglang)
    assert all(file.suffix != ".wasm" for file in files)
    (warning,) = warnings
    assert warning.startswith(
        "core.wasm and referee.wasm are not built: CC is set, and ziglang does not work: No module"
    )


def test_without_cc_that_is_an_error(
    build: ModuleType, broken_ziglang: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(RuntimeError, match="No module named ziglang"):
        build.build_all(pytest.fail)


@pytest.mark.parametrize(("unit", "module"), [(0, core_module), (1, referee_module)])
def test_a_module_that_is_built_again_has_the_same_bytes(
    build: ModuleType, tmp_path: Path, unit: int, module: Callable[[], bytes]
) -> None:
    pytest.importorskip("ziglang", reason="ziglang is not installed")
    again = tmp_path / "other" / "again.wasm"
    build.compile_kernels(build.UNITS[unit], again, *build.WASM, compiler=build.zig())
    assert again.read_bytes() == module()


@pytest.mark.parametrize(
    ("system", "processor", "target", "suffix", "tag"),
    [
        ("linux", "x86_64", "x86_64-linux-gnu.2.17", ".so", "py3-none-manylinux_2_17_x86_64"),
        ("linux", "aarch64", "aarch64-linux-gnu.2.17", ".so", "py3-none-manylinux_2_17_aarch64"),
        ("darwin", "x86_64", "x86_64-macos.11.0", ".dylib", "py3-none-macosx_11_0_x86_64"),
        ("darwin", "arm64", "aarch64-macos.11.0", ".dylib", "py3-none-macosx_11_0_arm64"),
        ("win32", "AMD64", "x86_64-windows-gnu", ".dll", "py3-none-win_amd64"),
        ("win32", "ARM64", "aarch64-windows-gnu", ".dll", "py3-none-win_arm64"),
    ],
)
def test_libraries_and_wheels_are_named_after_their_platform(
    build: ModuleType, monkeypatch: pytest.MonkeyPatch, system: str, processor: str, target: str, suffix: str, tag: str
) -> None:
    compiled: list[tuple[str, tuple[str, ...]]] = []
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(build.platform, "machine", lambda: processor)
    monkeypatch.setattr(build.sys, "platform", system)
    monkeypatch.setattr(build, "compile_kernels", lambda unit, out, *flags, **_: compiled.append((out.name, flags)))
    files = build.build_all(pytest.fail)
    native = [(name, flags) for name, flags in compiled if not name.endswith(".wasm")]
    assert len(native) + 2 == len(files)
    for name, flags in native:
        assert name.endswith(suffix)
        assert flags[flags.index("-target") + 1] == target
        # Where Python looks for it.
        stem, variant = name.removesuffix(suffix).split("-", 1)
        library = next(one for one in (LIBRARY, REFEREE) if one.sources.unit.stem == stem)
        assert library.variant_file(variant).name == name
    assert build.wheel_tag() == tag
