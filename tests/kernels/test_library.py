from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from decimal import Decimal, getcontext

import numpy as np
import pytest
from rr1plan._kernels import cover, motion, separation
from rr1plan.kernels.memory import CStruct, address_of, zeroed

from rr1plan.errors import InstallationError
from rr1plan.kernels import library, structs

VARIANTS = library.variants()


def test_a_variant_is_built_for_this_processor():
    assert VARIANTS, library.HOW_TO_BUILD
    assert library.load_library() is library.load_file(library.variant_file(VARIANTS[0]))


# ---- layouts ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_field_is_where_the_compiler_has_it(variant):
    expected = structs.layout_of(library.struct_classes())
    compiled = (ctypes.c_int64 * (len(expected) + 1)).in_dll(
        library.load_file(library.variant_file(variant)), "rr1_layout"
    )
    assert list(compiled) == [*expected, -1]


def test_the_headers_are_read_as_c_reads_them():
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
    (fields,) = structs.parse_structs(text).values()
    assert [(f.name, f.kind, f.pointer, f.count) for f in fields] == [
        ("one", "int64_t", False, 1),
        ("two", "double", False, 3),
        ("three", "Other", True, 1),
        ("x", "double", False, 1),
        ("y", "double", False, 1),
    ]
    assert structs.parse_enums(text) == {"NONE": -2, "ALONE": -1, "A": 0, "B": 1, "C": 5}


def test_kinds_are_numbered_as_the_tables_have_them():
    constants = structs.parse_enums(structs.header_text())
    same = {
        "OBSTACLE_ROUNDED_BOX": cover.ROUNDED_BOX,
        "OBSTACLE_CYLINDER": cover.CYLINDER,
        "OBSTACLE_HALF_SPACE": cover.HALF_SPACE,
        "CORE_CLOSED_FORM": cover.CLOSED_FORM,
        "CORE_LEFT_OUT": cover.LEFT_OUT,
        "CORE_POINTS": cover.POINTS,
        "CORE_CYLINDER": cover.ROUND,
        "BODY_POINT": separation.POINT,
        "BODY_SEGMENT": separation.SEGMENT,
        "BODY_BOX": separation.BOX,
        "BODY_CYLINDER": separation.CYLINDER,
        "BODY_CORNERS": separation.CORNERS,
        "BODY_HALF_SPACE": separation.HALF_SPACE,
        "BODY_CELLS": separation.CELLS,
        "EDGE_FREE": motion.FREE,
        "EDGE_CONTACT": motion.CONTACT,
        "EDGE_GRAZING": motion.GRAZING,
    }
    assert constants == same


def test_an_array_that_is_not_what_the_headers_say_is_refused():
    with pytest.raises(TypeError, match="rows of 16 bytes are no Joint, which takes 24"):
        CStruct("ArmGeometry", joints=np.zeros((4, 2), np.int64))
    with pytest.raises(TypeError, match="float32 is no array of double"):
        CStruct("PairTables", padding=np.zeros(3, np.float32))
    with pytest.raises(TypeError, match="not C-contiguous"):
        CStruct("PairTables", padding=np.zeros((3, 2))[:, 0])
    with pytest.raises(TypeError, match="a PairTables is no ArmGeometry"):
        CStruct("SceneTables", arm=CStruct("PairTables"))


def test_memory_for_vectors_is_aligned_and_zero():
    for count in (1, 7):
        frames = zeroed("FrameLanes", count)
        assert frames.shape == (count, 18 * 64)
        assert address_of(frames, "FrameLanes") % 64 == 0
        assert not frames.any()


# ---- what is wrong with an installation ------------------------------------------------------------


def test_missing_kernels_are_an_error_that_says_how_to_build_them(tmp_path, monkeypatch):
    monkeypatch.setattr(library, "FOLDER", tmp_path)
    for cached in (library.variants, library.load_library):
        monkeypatch.setattr(library, cached.__name__, cached.__wrapped__)
    with pytest.raises(InstallationError, match=r"no compiled kernels for .* build them with `pip install -e \.`"):
        library.load_library()


def test_a_library_of_other_headers_is_refused(monkeypatch):
    monkeypatch.setattr(structs, "layout_of", lambda classes: [8])
    with pytest.raises(InstallationError, match="built from other headers"):
        library.load_file.__wrapped__(library.variant_file(VARIANTS[0]))


def test_a_file_that_is_no_library_is_refused(tmp_path):
    (tmp_path / "kernels.so").write_bytes(b"no library")
    with pytest.raises(InstallationError, match="cannot be loaded"):
        library.load_file(tmp_path / "kernels.so")


@pytest.mark.skipif(sys.platform != "linux", reason="versions of symbols are a matter of Linux")
@pytest.mark.parametrize("variant", VARIANTS)
def test_a_library_needs_nothing_that_old_systems_lack(variant):
    """The wheel says manylinux_2_17; and no sine comes from the C library, which has another one in every release."""
    data = library.variant_file(variant).read_bytes()
    versions = [int(n) for n in re.findall(rb"GLIBC_2\.(\d+)", data)]
    assert max(versions, default=0) <= 17
    if nm := shutil.which("nm"):
        listed = subprocess.run([nm, "-D", "--undefined-only", library.variant_file(variant)], capture_output=True)
        names = {line.split()[-1].partition("@")[0] for line in listed.stdout.decode().splitlines()}
        assert names <= {"memcpy", "memset", "memmove"}


# ---- sines -----------------------------------------------------------------------------------------

getcontext().prec = 400
_PI = Decimal(
    "3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211706798214808651"
    "3282306647093844609550582231725359408128481117450284102701938521105559644622948954930381964428810975665933446128"
    "4756482337867831652712019091456485669234603486104543266482133936072602491412737245870066063155881748815209209628"
    "2925409171536436789259036001133053054882046652138414695194151160943305727036575959195309218611738193261179310511"
)


def exact_sine(angle, quarter):
    """The sine of an angle and so many quarter turns, in 400 digits."""
    x = Decimal(angle) + quarter * _PI / 2
    x -= 2 * _PI * (x / (2 * _PI)).to_integral_value()
    total, term, k = Decimal(0), x, 1
    while abs(term) > Decimal(10) ** -40:
        total += term
        term *= -x * x / ((k + 1) * (k + 2))
        k += 2
    return total


def sines(variant, name, angles):
    out = np.zeros((2, len(angles)))
    addresses = [address_of(row, "double") for row in (angles, *out)]
    getattr(library.load_file(library.variant_file(variant)), name)(addresses[0], len(angles), *addresses[1:])
    return out


@pytest.mark.parametrize("variant", VARIANTS)
def test_sines_are_exact_up_to_their_rounding(variant):
    rng = np.random.default_rng(0)
    large = rng.normal(size=60) * 10.0 ** rng.uniform(0.0, 60.0, 60)
    # The double that is nearest to a multiple of pi/2, by its size (Kahan and McDonald).
    angles = np.array([0.0, -0.0, 1e-300, np.pi / 4, -np.pi / 2, np.pi, 1e5, 6381956970095103.0 * 2.0**797, *large])
    exact = np.array([[float(exact_sine(float(a), k)) for a in angles] for k in range(2)])
    found = sines(variant, "rr1_sine_cosine", angles)
    assert np.abs(found - exact).max() < 3e-16
    assert np.isnan(sines(variant, "rr1_sine_cosine", np.array([np.inf, -np.inf, np.nan]))).all()


@pytest.mark.parametrize("variant", VARIANTS)
def test_sines_in_lanes_are_those_of_numpy_up_to_rounding(variant):
    angles = np.random.default_rng(1).uniform(-1e5, 1e5, 4000)
    angles[:2000] *= 1e-4
    found = sines(variant, "rr1_sine_cosine_lanes", angles)
    assert np.abs(found - [np.sin(angles), np.cos(angles)]).max() < 3e-16


def test_all_variants_give_the_same_sines():
    angles = np.random.default_rng(2).normal(size=800) * 10.0 ** np.arange(-10, 6).repeat(50)
    angles = np.clip(angles, -1e5, 1e5)
    for name in ("rr1_sine_cosine", "rr1_sine_cosine_lanes"):
        assert len({sines(variant, name, angles).tobytes() for variant in VARIANTS}) == 1
