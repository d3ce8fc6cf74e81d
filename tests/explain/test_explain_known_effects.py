"""The noise beside effects that are held, on a record that has grown since they were found."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.explain import explain, fit_beside
from allanscope.explain.known_effects import prolonged
from allanscope.history import Record
from allanscope.noise import fit_noise

RATE = 26.0
SHORT = 8192


def record(values: np.ndarray, stride: int = 1) -> Record:
    """Return samples of one axis as rows of so many each."""
    n = len(values) // stride * stride
    rows = values[:n].reshape(-1, stride).mean(axis=1)[:, np.newaxis]
    start = np.arange(len(rows)) * stride / RATE
    return Record(
        RATE / stride, stride, ("gx",), rows, (0.0,), np.full(len(rows), np.nan), start,
        np.array([[0, len(rows)]]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def samples() -> np.ndarray:
    """Return white noise with a tone, a step and a warm-up, all in the first quarter."""
    n = 4 * SHORT
    t = np.arange(n) / RATE
    noise = np.random.default_rng(7).normal(0.0, 0.04, n)
    tone = 0.02 * np.sin(2 * np.pi * 9.137 * t)
    return noise + tone + 0.03 * (t > 200.0) + 0.05 * np.exp(-t / 20.0)


@pytest.fixture(scope="module")
def found(samples):
    result = explain(record(samples[:SHORT]))
    assert {e.kind for e in result.axes["gx"].effects} == {"sinusoid", "step", "warm_up"}
    return result


def test_on_the_record_of_the_search_it_is_the_fit_of_the_search(samples, found):
    (beside,) = fit_beside(found.held, record(samples[:SHORT])).values()
    for letter, known in found.axes["gx"].coefficients_after.items():
        again = beside.fit.coefficients[letter]
        assert again.detected == known.detected
        assert again.upper == pytest.approx(known.upper, rel=0.02), letter
    assert set(beside.signals) == {"sinusoid", "step", "warm_up"}


@pytest.fixture(scope="module", params=[2, 4])
def searched_again(samples, request):
    """Return a longer record and what a search of it says."""
    longer = samples[: request.param * SHORT]
    return longer, explain(record(longer)).axes["gx"].coefficients_after


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_on_a_longer_record_it_is_what_a_new_search_would_say(found, searched_again, stride):
    """Rows of twice and four times the samples fold the tone down: it stays taken out."""
    longer, new = searched_again
    (beside,) = fit_beside(found.held, record(longer, stride)).values()
    fitted = beside.fit.coefficients
    # Longer rows have fewer ordinates: of 4096 the level is known to 1.1 %.
    tolerance = 0.01 if stride == 1 else 0.03
    assert fitted["N"].value == pytest.approx(new["N"].value, rel=tolerance)
    assert fitted["N"].lower < 0.04 / np.sqrt(RATE) < fitted["N"].upper
    assert not fitted["K"].detected
    assert fitted["K"].upper < 2 * new["K"].upper


def test_beside_nothing_but_a_clock_error_it_is_the_textbook():
    noise = np.random.default_rng(8).normal(0.0, 0.04, SHORT)
    result = explain(record(noise), nominal_hz=25.0, rate_fit=(RATE, 1e-3))
    assert [e.kind for e in result.axes["gx"].effects] == ["clock_error"]
    assert result.axes["gx"].own_effects == ()
    (beside,) = fit_beside(result.held, record(noise)).values()
    assert beside.signals == {}
    assert beside.fit.coefficients == fit_noise(record(noise), "gx").coefficients


def test_the_error_of_the_clock_follows_the_rate():
    noise = np.random.default_rng(8).normal(0.0, 0.04, SHORT)
    result = explain(record(noise), nominal_hz=25.0, rate_fit=(RATE, 1e-3))
    later = result.with_rate(25.0, (26.5, 1e-4))
    (effect,) = later.axes["gx"].effects
    assert effect.parameters["relative"].value == pytest.approx(0.06)


def test_a_signal_is_averaged_into_longer_rows_and_its_last_value_stays():
    assert prolonged(np.arange(6.0), 2, 0.0, 4).tolist() == [0.5, 2.5, 4.5, 5.0]
    assert prolonged(np.arange(6.0), 1, 4.0, 4).tolist() == [4.0, 5.0, 5.0, 5.0]
