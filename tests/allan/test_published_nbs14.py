"""The values that NIST SP 1065 section 12.4 and W. Riley publish for the NBS14 data, to 1e-4."""

import numpy as np
import pytest

from allanscope.allan import deviation

TEN = {
    "adev": [91.22945, 115.8082],
    "oadev": [91.22945, 85.95287],
    "mdev": [91.22945, 74.78849],
    "tdev": [52.67135, 86.35831],
    "hdev": [70.80608, 116.7980],
    "ohdev": [70.80607, 85.61487],
    "totdev": [91.22945, 93.90379],
    "mtotdev": [75.50203, 75.83606],
    "ttotdev": [43.59112, 87.56794],
    "htotdev": [70.80607, 91.16396],
    "stdev": [100.9770, 102.6039],
}
TEN_RAW = {"mtotdev": [64.509, 64.794], "ttotdev": [37.244, 74.818]}

THOUSAND = {
    "adev": [2.922319e-1, 9.965736e-2, 3.897804e-2],
    "oadev": [2.922319e-1, 9.159953e-2, 3.241343e-2],
    "mdev": [2.922319e-1, 6.172376e-2, 2.170921e-2],
    "tdev": [1.687202e-1, 3.563623e-1, 1.253382],
    "hdev": [2.943883e-1, 1.052754e-1, 3.910860e-2],
    "ohdev": [2.943883e-1, 9.581083e-2, 3.237638e-2],
    "totdev": [2.922319e-1, 9.134743e-2, 3.406530e-2],
    "mtotdev": [2.418528e-1, 6.499161e-2, 2.287774e-2],
    "ttotdev": [1.396338e-1, 3.752293e-1, 1.320847],
    "htotdev": [2.943883e-1, 9.614787e-2, 3.058103e-2],
    "stdev": [2.884664e-1, 9.296352e-2, 3.206656e-2],
}
THOUSAND_RAW = {
    "mtotdev": [2.0664e-1, 5.5529e-2, 1.9547e-2],
    "ttotdev": [1.1930e-1, 3.2060e-1, 1.1285],
}
PDEV = [
    0.292231878106752,
    0.2144523356425264,
    0.15618112158618463,
    0.11709745745448434,
    0.06902958518983934,
    0.04974970773039839,
    0.03894741733071374,
    0.03086239274137211,
    0.012447414341332683,
]


def as_phase(rates, rate):
    return np.append(0.0, np.cumsum(rates)) / rate


def test_the_generator_starts_as_published(nbs14_1000):
    assert (nbs14_1000[1:4] * 2147483647).round().tolist() == [395529916, 1209410747, 633705974]


@pytest.mark.parametrize("kind", TEN)
def test_ten_points_as_published(kind, nbs14_10):
    curve = deviation(nbs14_10, rate=1.0, kind=kind, taus=[1, 2])
    assert curve.deviation == pytest.approx(TEN[kind], rel=1e-4)


@pytest.mark.parametrize("kind", TEN_RAW)
def test_ten_points_raw_totals_as_in_stable32(kind, nbs14_10):
    curve = deviation(nbs14_10, rate=1.0, kind=kind, taus=[1, 2], bias_corrected=False)
    assert curve.deviation == pytest.approx(TEN_RAW[kind], rel=1e-4)


@pytest.mark.parametrize("kind", THOUSAND)
def test_thousand_points_as_published(kind, nbs14_1000):
    curve = deviation(nbs14_1000, rate=1.0, kind=kind, taus=[1, 10, 100])
    assert curve.deviation == pytest.approx(THOUSAND[kind], rel=1e-4)


@pytest.mark.parametrize("kind", THOUSAND)
def test_phase_gives_what_rates_give_at_another_sample_rate(kind, nbs14_1000):
    phase = as_phase(nbs14_1000, rate=50.0)
    curve = deviation(phase, 50.0, kind, taus=[0.02, 0.2, 2.0], data_kind="phase")
    factor = 1 / 50.0 if kind in ("tdev", "ttotdev") else 1.0
    assert curve.deviation == pytest.approx(factor * np.array(THOUSAND[kind]), rel=1e-4)


@pytest.mark.parametrize("kind", THOUSAND_RAW)
def test_thousand_points_raw_totals_as_in_stable32(kind, nbs14_1000):
    curve = deviation(nbs14_1000, 1.0, kind, taus=[1, 10, 100], bias_corrected=False)
    assert curve.deviation == pytest.approx(THOUSAND_RAW[kind], rel=1e-4)


def test_hadamard_total_is_corrected_for_white_fm_but_not_at_one_sample(nbs14_10):
    corrected = deviation(nbs14_10, 1.0, "htotdev", taus=[1, 2]).deviation
    raw = deviation(nbs14_10, 1.0, "htotdev", taus=[1, 2], bias_corrected=False).deviation
    assert raw / corrected == pytest.approx([1.0, np.sqrt(0.995)], rel=1e-9)


def test_theo1_as_in_stable32(nbs14_1000):
    curve = deviation(nbs14_1000, rate=1.0, kind="theo1", taus=[10, 100, 1000])
    assert curve.m.tolist() == [10, 100, 1000]
    assert curve.tau.tolist() == [7.5, 75.0, 750.0]
    assert curve.deviation == pytest.approx([1.0757e-1, 3.1789e-2, 5.0524e-3], rel=1e-4)


def test_pdev_as_in_sigmatheta(nbs14_1000):
    curve = deviation(nbs14_1000, rate=1.0, kind="pdev")
    assert curve.m.tolist() == [2**k for k in range(9)]
    assert curve.deviation == pytest.approx(PDEV, rel=1e-12)


@pytest.mark.parametrize("kind", [*THOUSAND, "theo1", "theobr", "theoh", "pdev", "ostdev"])
def test_every_published_noise_is_white_fm(kind, nbs14_1000):
    assert set(deviation(nbs14_1000, rate=1.0, kind=kind).noise) == {"WFM"}
