from __future__ import annotations

from decimal import Decimal, getcontext

import numpy as np
import pytest

from rr1plan.kernels.planner_kernels import LIBRARY, CStruct, address_of, load_library, zeroed

VARIANTS = LIBRARY.variants


def test_an_array_that_is_not_what_the_headers_say_is_refused():
    with pytest.raises(TypeError, match="rows of 16 bytes are no Joint, which takes 24"):
        CStruct("ArmGeometry", joints=np.zeros((4, 2), np.int64))
    with pytest.raises(TypeError, match="float32 is not an array of double"):
        CStruct("PairTables", padding=np.zeros(3, np.float32))
    with pytest.raises(TypeError, match="not C-contiguous"):
        CStruct("PairTables", padding=np.zeros((3, 2))[:, 0])
    with pytest.raises(TypeError, match="a PairTables is no ArmGeometry"):
        CStruct("SceneTables", arm=CStruct("PairTables"))
    with pytest.raises(TypeError, match="float32 is not an array of double"):
        load_library().rr1_sine_cosine(np.zeros(3, np.float32), 3, np.zeros(3), np.zeros(3))


def test_memory_for_vectors_is_aligned_and_zero():
    for count in (1, 7):
        frames = zeroed("FrameLanes", count)
        assert frames.shape == (count, 18 * 64)
        assert address_of(frames, "FrameLanes") % 64 == 0
        assert not frames.any()


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
