"""Compile the kernels in C: run by hatchling for wheels and editable installs, or by hand in a source checkout.

    python hatch_build.py

The compiler is `ziglang`, a wheel that needs nothing else on the machine, or that of the environment variable CC. One
library is made for each level of the processor, and the right one is chosen at run time (`rr1plan/kernels/library.py`).
"""

from __future__ import annotations

import importlib.util
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # by hand, without hatchling
    BuildHookInterface = object  # type: ignore[assignment,misc]

SOURCES = Path(__file__).parent / "rr1plan" / "kernels"
BUILT = SOURCES / "built"
# Each floating-point operation is rounded by itself and sums stay in their order: all variants give the same bytes.
FLAGS = ("-std=gnu99", "-O3", "-ffp-contract=off", "-fno-math-errno")
LINKING = ("-shared", "-fPIC", "-fvisibility=hidden", "-s")
WASM = ("-target", "wasm32-freestanding", "-msimd128", "-nostdlib", "-Wl,--no-entry", "-Wl,--export-dynamic", "-s")
VARIANTS = {"x86_64": ("x86_64_v2", "x86_64_v3", "x86_64_v4"), "aarch64": ("aarch64",)}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
# Of the systems: what the compiler calls them, the suffix of a library, the platform of a wheel.
_SYSTEMS = {
    "linux": ("linux-gnu.2.17", ".so", "manylinux_2_17_{}"),
    "darwin": ("macos.11.0", ".dylib", "macosx_11_0_{}"),
    "win32": ("windows-gnu", ".dll", "win_{}"),
}


def machine() -> str:
    """The processor of this machine as compilers call it."""
    name = platform.machine().lower()
    return _MACHINES.get(name, name)


def own_compiler() -> list[str]:
    """The compiler of the environment variable CC, if there is one."""
    return shlex.split(os.environ.get("CC", ""))


def zig() -> list[str]:
    """The compiler that comes with the package ziglang."""
    return [sys.executable, "-m", "ziglang", "cc"]


def target_flags(variant: str) -> list[str]:
    """What makes the compiler at hand compile for a variant."""
    level = variant.partition("_v")[2]
    wide = ["-mprefer-vector-width=512"] if level == "4" else []
    if own_compiler():
        return [f"-march=x86-64-v{level}", *wide] if level else []
    system = _SYSTEMS[sys.platform][0]
    return ["-target", f"{machine()}-{system}", *([f"-mcpu={variant}"] if level else []), *wide]


def compile_kernels(out: Path, *flags: str, compiler: list[str] | None = None) -> None:
    """Compile all kernels into one file.

    Args:
        out: The library.
        flags: For the compiler, besides `FLAGS`.
        compiler: The compiler's command (default: CC, else ziglang).

    Raises:
        RuntimeError: it failed; with what the compiler wrote.
    """
    structs = _load_structs()
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / out.name
        layouts = structs.layout_source(structs.declared_structs())
        (Path(folder) / "layout.inc").write_text(layouts, encoding="utf-8")
        command = [*(compiler or own_compiler() or zig()), *FLAGS, *flags, "-I", folder, "-o", str(made)]
        done = subprocess.run([*command, str(SOURCES / "kernels.c")], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"the kernels cannot be compiled: {shlex.join(command)}\n{done.stdout}{done.stderr}")
        # Whoever has the old library loaded keeps it.
        swap = out.with_name(f".{out.name}.{os.getpid()}")
        swap.write_bytes(made.read_bytes())
        swap.replace(out)


def build_all() -> list[Path]:
    """Compile the variants for this machine's kind of processor.

    Raises:
        RuntimeError: an unknown system or processor, or a compiler that failed.
    """
    if machine() not in VARIANTS or sys.platform not in _SYSTEMS:
        raise RuntimeError(f"no kernels for {sys.platform} on {machine()}")
    files = []
    for variant in VARIANTS[machine()]:
        files.append(BUILT / f"kernels-{variant}{_SYSTEMS[sys.platform][1]}")
        compile_kernels(files[-1], *LINKING, *target_flags(variant))
    return files


def wheel_tag() -> str:
    """The tag of a wheel with these libraries: any Python, this platform."""
    processor = {"darwin": platform.machine(), "win32": "amd64"}.get(sys.platform, machine())
    form = "linux_{}" if own_compiler() and sys.platform == "linux" else _SYSTEMS[sys.platform][2]
    return f"py3-none-{form.format(processor)}"


class KernelsHook(BuildHookInterface):  # type: ignore[misc,valid-type]
    """What hatchling runs before it packs a wheel or installs in place."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels, and name the platform they are for."""
        if self.target_name != "wheel":
            return
        root = Path(self.root)
        for file in build_all():
            build_data["artifacts"].append("/" + file.relative_to(root).as_posix())
        build_data["pure_python"] = False
        build_data["tag"] = wheel_tag()


def _load_structs() -> ModuleType:
    """`rr1plan.kernels.structs`, without the package, whose requirements are not there while it is built."""
    spec = importlib.util.spec_from_file_location("_structs", SOURCES / "structs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["_structs"] = module
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    print(*build_all(), sep="\n")  # noqa: T201
