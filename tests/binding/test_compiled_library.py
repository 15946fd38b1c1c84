"""The libraries of both sets of kernels: struct layouts, and error messages of an installation without them."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Never

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.binding.c_memory import address_of
from rr1plan.binding.c_sources import KernelSources, parse_enums, parse_prototypes, parse_structs
from rr1plan.binding.compiled_library import KernelLibrary
from rr1plan.errors import InstallationError
from rr1plan.kernels.planner_kernels import LIBRARY as PLANNERS
from rr1plan.validation import referee_kernels

LIBRARIES = {"planners": PLANNERS, "referee": referee_kernels.LIBRARY}
VARIANTS = [(name, variant) for name, library in LIBRARIES.items() for variant in library.variants]
BUILD = r"build them with `pip install -e \.` or, in a source checkout, `python hatch_build\.py`"


@pytest.fixture(params=LIBRARIES)
def copied(request: pytest.FixtureRequest, tmp_path: Path) -> KernelLibrary:
    """A copy of a library and its sources, to be changed."""
    unit = LIBRARIES[request.param].sources.unit
    shutil.copytree(unit.parent, tmp_path / "kernels")
    return KernelLibrary(KernelSources(tmp_path / "kernels" / unit.name))


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_variant_is_built_for_this_processor(name: str) -> None:
    library = LIBRARIES[name]
    assert library.variants
    assert library.fastest._name == str(library.variant_file(library.variants[0]))


def test_the_libraries_share_no_source_but_that_of_the_binding() -> None:
    planners, referee = (set(library.sources.files) for library in LIBRARIES.values())
    assert {file.name for file in planners & referee} <= {"cpu_level.c"}


@pytest.mark.parametrize(("name", "variant"), VARIANTS)
def test_every_field_is_where_the_compiler_has_it(name: str, variant: str) -> None:
    library = LIBRARIES[name]
    expected = library.sources.layout()
    loaded = library.load(library.variant_file(variant))
    compiled = (ctypes.c_int64 * (len(expected) + 1)).in_dll(loaded, "rr1_layout")
    assert list(compiled) == [*expected, -1]
    assert len(expected) > 10


def test_ctrl_c_while_arguments_are_converted_is_no_other_error() -> None:
    class Interrupted(np.ndarray):
        @property
        def flags(self) -> Never:
            raise KeyboardInterrupt

    given = np.zeros(3).view(Interrupted)
    for library in LIBRARIES.values():
        name, prototype = next((n, p) for n, p in library.sources.prototypes.items() if p.arguments[0].endswith("*"))
        arguments = (given if kind.endswith("*") else 0 for kind in prototype.arguments)
        with pytest.raises(KeyboardInterrupt):
            getattr(library.fastest, name)(*arguments)


@pytest.mark.parametrize("array", [np.zeros((2, 3)), np.zeros(0), np.arange(4.0)[1:], np.broadcast_to(1.0, ())])
def test_addresses_of_arrays_are_those_of_numpy(array: np.ndarray) -> None:
    sources = next(iter(LIBRARIES.values())).sources
    assert address_of(sources, array, "double") == array.ctypes.data
    array.flags.writeable = False
    assert address_of(sources, array, "double") == array.ctypes.data


def test_bytes_are_taken_as_the_array_they_hold() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    length = PLANNERS.fastest.rr1_polyline_length
    assert length(points.tobytes(), 5, 3) == length(points, 5, 3)
    assert length(points, 5, 3) == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum(), rel=1e-14)


def test_headers_are_read_as_c_reads_them() -> None:
    text = """
    // A comment; with a semicolon.
    typedef struct {
        int64_t one;  // first
        double two[3];
        const Other *three;
        double x, y;
    } Thing;
    enum { NONE = -2, ALONE };
    enum { A, B, C = B + 4 };
    """
    (fields,) = parse_structs(text).values()
    assert [(f.name, f.kind, f.pointer, f.count) for f in fields] == [
        ("one", "int64_t", False, 1),
        ("two", "double", False, 3),
        ("three", "Other", True, 1),
        ("x", "double", False, 1),
        ("y", "double", False, 1),
    ]
    assert parse_enums(text) == {"NONE": -2, "ALONE": -1, "A": 0, "B": 1, "C": 5}


def test_functions_are_read_as_c_reads_them() -> None:
    text = """
EXPORT double rr1_one(const Thing *thing, int64_t count, const double d[3],
                      double *out) {
    return 0.0;
}
static void rr1_two(void) {
}
EXPORT int64_t rr1_three(void) {
    return 3;
}
"""
    found = parse_prototypes(text)
    assert {name: (made.result, made.arguments) for name, made in found.items()} == {
        "rr1_one": ("double", ("Thing*", "int64_t", "double*", "double*")),
        "rr1_three": ("int64_t", ()),
    }


@pytest.mark.parametrize("name", LIBRARIES)
def test_all_exported_functions_are_declared_to_python(name: str) -> None:
    sources = LIBRARIES[name].sources
    text = "".join(file.read_text(encoding="utf-8") for file in sources.files)
    exported = set(re.findall(r"^EXPORT \w+ (rr1_\w+)\(", text, re.MULTILINE))
    assert exported == set(sources.prototypes)
    assert len(exported) > 3


@pytest.mark.skipif(sys.platform != "linux", reason="versions of symbols are a matter of Linux")
@pytest.mark.parametrize(("name", "variant"), VARIANTS)
def test_a_library_needs_nothing_that_old_systems_lack(name: str, variant: str) -> None:
    """The wheel says manylinux_2_17; and no planner's sine comes from the C library, which differs between releases."""
    file = LIBRARIES[name].variant_file(variant)
    data = file.read_bytes()
    versions = [int(n) for n in re.findall(rb"GLIBC_2\.(\d+)", data)]
    assert max(versions, default=0) <= 17
    if nm := shutil.which("nm"):
        listed = subprocess.run([nm, "-D", "--undefined-only", file], capture_output=True)
        names = {line.split()[-1].partition("@")[0] for line in listed.stdout.decode().splitlines()}
        # The referee has its own sines: it is independent of the planners in this, too.
        assert names <= {"memcpy", "memset", "memmove"} | (
            {"sin", "cos", "sincos", "atan2", "qsort"} if name == "referee" else set()
        )


# ---- what is wrong with an installation ------------------------------------------------------------


def test_missing_kernels_are_an_error_that_says_how_to_build_them(copied: KernelLibrary) -> None:
    shutil.rmtree(copied.folder)
    with pytest.raises(InstallationError, match=rf"no compiled kernels for .* in .*built; {BUILD}"):
        _ = copied.fastest


def test_a_motion_is_not_judged_without_the_kernels_of_the_referee(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = rp.load_scene("planar2r_path")
    rest = rp.Trajectory.rest(scene.joint_names(), scene.configuration())
    monkeypatch.setattr(referee_kernels, "LIBRARY", KernelLibrary(KernelSources(tmp_path / "referee.c")))
    with pytest.raises(InstallationError, match=rf"no compiled kernels for .*; {BUILD}"):
        rp.validate(rest, scene)


@pytest.mark.parametrize(
    ("suffix", "before", "after"),
    [
        (".h", "typedef struct {\n", "typedef struct {\n    int64_t added;\n"),
        (".c", "return", "return  "),
    ],
)
def test_a_library_of_other_sources_is_refused(copied: KernelLibrary, suffix: str, before: str, after: str) -> None:
    texts = {file: file.read_text(encoding="utf-8") for file in copied.sources.files if file.suffix == suffix}
    changed = next(file for file, text in texts.items() if before in text)
    changed.write_text(texts[changed].replace(before, after, 1), encoding="utf-8")
    with pytest.raises(InstallationError, match=f"were built from other sources; {BUILD}"):
        _ = copied.fastest
