"""The values that NIST SP 1065 section 12.4 and W. Riley publish for the NBS14 data, to 1e-4."""

import numpy as np
import pytest

from allanscope.allan import deviation
from allanscope.verify.certified import PDEV, TEN, TEN_RAW, THEO1, THOUSAND, THOUSAND_RAW


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
    assert curve.deviation == pytest.approx(THEO1, rel=1e-4)


def test_pdev_as_in_sigmatheta(nbs14_1000):
    curve = deviation(nbs14_1000, rate=1.0, kind="pdev")
    assert curve.m.tolist() == [2**k for k in range(9)]
    assert curve.deviation == pytest.approx(PDEV, rel=1e-12)


@pytest.mark.parametrize("kind", [*THOUSAND, "theo1", "theobr", "theoh", "pdev", "ostdev"])
def test_every_published_noise_is_white_fm(kind, nbs14_1000):
    assert set(deviation(nbs14_1000, rate=1.0, kind=kind).noise) == {"WFM"}
