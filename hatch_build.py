"""Compile the kernels in C: run by hatchling for wheels and editable installs, or by hand in a source checkout.

    python hatch_build.py

The compiler is `ziglang`, a wheel that needs nothing else on the machine, or that of the environment variable CC. One
library is made for each level of the processor, and `rr1plan/kernels/planner_kernels.py` chooses at run time.
The kernels are also compiled to WebAssembly modules, `core.wasm` and `referee.wasm`, which only pages need. That is
always done by ziglang, because few other compilers have the target. With CC set and no ziglang that works, a warning
says that the modules are not built.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # by hand, without hatchling
    BuildHookInterface = object

ROOT = Path(__file__).parent
# The C files that include all others of a library; it is put into the folder `built` beside them.
UNITS = (ROOT / "rr1plan/kernels/kernels.c", ROOT / "rr1plan/validation/kernels/referee.c")
# Each floating-point operation is rounded by itself and sums stay in their order: all variants give the same bytes.
FLAGS = ("-std=gnu99", "-O3", "-ffp-contract=off", "-fno-math-errno")
LINKING = ("-shared", "-fPIC", "-fvisibility=hidden", "-s", "-lm")
WASM = (
    *("-target", "wasm32-freestanding", "-msimd128", "-nostdlib", "-fvisibility=hidden", "-s"),
    *("-Wl,--no-entry", "-Wl,--export-dynamic", "-Wl,--export=__heap_base"),
    *("-Wl,-z,stack-size=1048576",),
)
# The module of each unit, for pages.
MODULES = {UNITS[0]: ROOT / "rr1plan/kernels/built/core.wasm", UNITS[1]: UNITS[1].with_name("built") / "referee.wasm"}
VARIANTS = {"x86_64": ("x86_64_v2", "x86_64_v3", "x86_64_v4"), "aarch64": ("aarch64",)}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
# What wheels call processors where that is not what compilers do.
_TAGS = {
    ("darwin", "x86_64"): "x86_64",
    ("darwin", "aarch64"): "arm64",
    ("win32", "x86_64"): "amd64",
    ("win32", "aarch64"): "arm64",
}
# Of the systems: what the compiler calls them, the suffix of a library, the platform of a wheel.
_SYSTEMS = {
    "linux": ("linux-gnu.2.17", ".so", "manylinux_2_17_{}"),
    "darwin": ("macos.11.0", ".dylib", "macosx_11_0_{}"),
    "win32": ("windows-gnu", ".dll", "win_{}"),
}


def _binding_sources() -> ModuleType:
    """`rr1plan.binding.c_sources`, without the package, whose requirements are not there while it is built."""
    spec = importlib.util.spec_from_file_location("_sources", ROOT / "rr1plan/binding/c_sources.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["_sources"] = module
    spec.loader.exec_module(module)
    return module


_SOURCES = _binding_sources()


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
    # The kernels need nothing of zig's run-time library, which takes seconds to compile for each variant; only
    # Windows checks the stack with it.
    library = [] if sys.platform == "win32" else ["-rtlib=none"]
    return ["-target", f"{machine()}-{system}", *([f"-mcpu={variant}"] if level else []), *wide, *library]


def compile_kernels(unit: Path, out: Path, *flags: str, compiler: list[str] | None = None) -> None:
    """Compile the kernels of one unit into one file.

    Args:
        unit: The C file that includes all others.
        out: The library.
        flags: For the compiler, besides `FLAGS`.
        compiler: The compiler's command (default: CC, else ziglang).

    Raises:
        RuntimeError: it failed; with what the compiler wrote.
    """
    sources = _SOURCES.KernelSources(unit)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / out.name
        (Path(folder) / "layout.inc").write_text(sources.layout_source(), encoding="utf-8")
        command = [*(compiler or own_compiler() or zig()), *FLAGS, *flags, "-I", folder, "-o", str(made)]
        done = subprocess.run([*command, str(unit)], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"the kernels cannot be compiled: {shlex.join(command)}\n{done.stdout}{done.stderr}")
        # Whoever has the old library loaded keeps it.
        swap = out.with_name(f".{out.name}.{os.getpid()}")
        swap.write_bytes(made.read_bytes())
        swap.replace(out)


def build_all(warn: Callable[[str], object]) -> list[Path]:
    """Compile the variants for this machine's kind of processor, and the modules for pages.

    Args:
        warn: Is given the reason where the modules cannot be made.

    Raises:
        RuntimeError: an unknown system or processor, or a compiler that failed.
    """
    if machine() not in VARIANTS or sys.platform not in _SYSTEMS:
        raise RuntimeError(f"no kernels for {sys.platform} on {machine()}")
    files = []
    # Compilers are processes of their own: as many run side by side as there are processors.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        modules = [pool.submit(compile_kernels, *pair, *WASM, compiler=zig()) for pair in MODULES.items()]
        running = []
        for unit in UNITS:
            for variant in VARIANTS[machine()]:
                files.append(unit.with_name("built") / f"{unit.stem}-{variant}{_SYSTEMS[sys.platform][1]}")
                running.append(pool.submit(compile_kernels, unit, files[-1], *LINKING, *target_flags(variant)))
    for library in running:
        library.result()
    try:
        for module in modules:
            module.result()
        files += MODULES.values()
    except RuntimeError as error:
        if not own_compiler():
            raise
        warn(f"core.wasm and referee.wasm are not built: CC is set, and ziglang does not work: {error}")
    return files


def wheel_tag() -> str:
    """The tag of a wheel with these libraries: any Python, this platform."""
    processor = machine() if sys.platform == "linux" else _TAGS[sys.platform, machine()]
    form = "linux_{}" if own_compiler() and sys.platform == "linux" else _SYSTEMS[sys.platform][2]
    return f"py3-none-{form.format(processor)}"


class KernelsHook(BuildHookInterface):
    """What hatchling runs before it packs a wheel or installs in place."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels, and name the platform they are for."""
        if self.target_name != "wheel":
            return
        root = Path(self.root)
        for file in build_all(self.app.display_warning):
            build_data["artifacts"].append("/" + file.relative_to(root).as_posix())
        build_data["pure_python"] = False
        build_data["tag"] = wheel_tag()


if __name__ == "__main__":
    built = build_all(lambda text: sys.stderr.write(f"warning: {text}\n"))
    sys.stdout.writelines(f"{file}\n" for file in built)
