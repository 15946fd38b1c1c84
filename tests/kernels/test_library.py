from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from decimal import Decimal, getcontext

import numpy as np
import pytest

from rr1plan.binding.library import HOW_TO_BUILD, KernelLibrary
from rr1plan.binding.sources import KernelSources, Prototype, parse_enums, parse_prototypes, parse_structs
from rr1plan.errors import InstallationError
from rr1plan.kernels.library import LIBRARY, CStruct, address_of, load_library, zeroed
from rr1plan.validation import native

LIBRARIES = {"planners": LIBRARY, "referee": native.LIBRARY}
VARIANTS = LIBRARY.variants
BUILT = [(name, variant) for name, library in LIBRARIES.items() for variant in library.variants]


def test_a_variant_of_each_library_is_built_for_this_processor():
    assert all(library.variants for library in LIBRARIES.values()), HOW_TO_BUILD
    assert load_library() is LIBRARY.fastest
    assert native.load_library() is native.LIBRARY.fastest


def test_the_libraries_share_no_source_but_that_of_the_binding():
    planners, referee = (set(library.sources.files) for library in LIBRARIES.values())
    assert {file.name for file in planners & referee} <= {"cpu_level.c"}


# ---- layouts ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "variant"), BUILT)
def test_every_field_is_where_the_compiler_has_it(name, variant):
    library = LIBRARIES[name]
    expected = library.sources.layout()
    loaded = library.load(library.variant_file(variant))
    compiled = (ctypes.c_int64 * (len(expected) + 1)).in_dll(loaded, "rr1_layout")
    assert list(compiled) == [*expected, -1]
    assert len(expected) > 10


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
    (fields,) = parse_structs(text).values()
    assert [(f.name, f.kind, f.pointer, f.count) for f in fields] == [
        ("one", "int64_t", False, 1),
        ("two", "double", False, 3),
        ("three", "Other", True, 1),
        ("x", "double", False, 1),
        ("y", "double", False, 1),
    ]
    assert parse_enums(text) == {"NONE": -2, "ALONE": -1, "A": 0, "B": 1, "C": 5}


def test_exported_functions_are_read_as_c_reads_them():
    text = """
    EXPORT double rr1_one(const Thing *thing, int64_t count,  // rows
                          const double q[3], double (*rows)[6]) {
    }
    static void rr1_hidden(void) {
    EXPORT void rr1_two(void) {
    """
    assert parse_prototypes(text.replace("\n    ", "\n")) == {
        "rr1_one": Prototype("double", ("Thing*", "int64_t", "double*", "double*")),
        "rr1_two": Prototype("void", ()),
    }


@pytest.mark.parametrize("name", LIBRARIES)
def test_all_exported_functions_are_declared_to_python(name):
    sources = LIBRARIES[name].sources
    text = "".join(file.read_text(encoding="utf-8") for file in sources.files)
    exported = set(re.findall(r"^EXPORT \w+ (rr1_\w+)\(", text, re.MULTILINE))
    assert exported == set(sources.prototypes)
    assert len(exported) > 3


def test_an_array_that_is_not_what_the_headers_say_is_refused():
    with pytest.raises(TypeError, match="rows of 16 bytes are no Joint, which takes 24"):
        CStruct("ArmGeometry", joints=np.zeros((4, 2), np.int64))
    with pytest.raises(TypeError, match="float32 is no array of double"):
        CStruct("PairTables", padding=np.zeros(3, np.float32))
    with pytest.raises(TypeError, match="not C-contiguous"):
        CStruct("PairTables", padding=np.zeros((3, 2))[:, 0])
    with pytest.raises(TypeError, match="a PairTables is no ArmGeometry"):
        CStruct("SceneTables", arm=CStruct("PairTables"))
    with pytest.raises(ctypes.ArgumentError, match="float32 is no array of double"):
        load_library().rr1_sine_cosine(np.zeros(3, np.float32), 3, np.zeros(3), np.zeros(3))


def test_memory_for_vectors_is_aligned_and_zero():
    for count in (1, 7):
        frames = zeroed("FrameLanes", count)
        assert frames.shape == (count, 18 * 64)
        assert address_of(frames, "FrameLanes") % 64 == 0
        assert not frames.any()


# ---- what is wrong with an installation ------------------------------------------------------------


def copied(library, folder):
    """A library of the same sources that is looked for in another folder."""
    other = KernelLibrary(library.sources)
    other.folder = folder
    return other


@pytest.mark.parametrize("name", LIBRARIES)
def test_missing_kernels_are_an_error_that_says_how_to_build_them(name, tmp_path):
    library = copied(LIBRARIES[name], tmp_path)
    assert library.variants == ()
    with pytest.raises(InstallationError, match=r"no compiled kernels for .* build them with `pip install -e \.`"):
        _ = library.fastest


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_library_of_other_headers_is_refused(name, monkeypatch):
    library = LIBRARIES[name]
    monkeypatch.setattr(library.sources, "layout", lambda: [8])
    with pytest.raises(InstallationError, match="built from other headers"):
        library.load(library.variant_file(library.variants[0]))


def test_a_library_without_a_function_that_the_sources_export_is_refused(tmp_path):
    unit = tmp_path / "kernels.c"
    unit.write_text("EXPORT void rr1_new(int64_t count) {\n}\n", encoding="utf-8")
    with pytest.raises(InstallationError, match="rr1_new"):
        KernelLibrary(KernelSources(unit)).load(LIBRARY.variant_file(VARIANTS[0]))


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_file_that_is_no_library_is_refused(name, tmp_path):
    (tmp_path / "kernels.so").write_bytes(b"no library")
    with pytest.raises(InstallationError, match="cannot be loaded"):
        LIBRARIES[name].load(tmp_path / "kernels.so")


@pytest.mark.skipif(sys.platform != "linux", reason="versions of symbols are a matter of Linux")
@pytest.mark.parametrize(("name", "variant"), BUILT)
def test_a_library_needs_nothing_that_old_systems_lack(name, variant):
    """The wheel says manylinux_2_17; and no planner's sine comes from the C library, which differs between releases."""
    file = LIBRARIES[name].variant_file(variant)
    data = file.read_bytes()
    versions = [int(n) for n in re.findall(rb"GLIBC_2\.(\d+)", data)]
    assert max(versions, default=0) <= 17
    if nm := shutil.which("nm"):
        listed = subprocess.run([nm, "-D", "--undefined-only", file], capture_output=True)
        names = {line.split()[-1].partition("@")[0] for line in listed.stdout.decode().splitlines()}
        # Sines of the referee are its own affair: it is independent of the planners in that too.
        assert names <= {"memcpy", "memset", "memmove"} | ({"sin", "cos", "sincos"} if name == "referee" else set())


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
    getattr(LIBRARY.load(LIBRARY.variant_file(variant)), name)(angles, len(angles), *out)
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
