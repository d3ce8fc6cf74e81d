"""What axes have in common, and which of two couples into the other."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope import analyse
from allanscope.analysis.coherence import common_of, leak_of
from allanscope.analysis.findings import Finding, Member
from allanscope.explain import Effect, Parameter
from allanscope.history import Record

RATE = 104.0
AXES = ("gx", "gy", "gz", "ax", "ay", "az")


def record(values):
    n, k = values.shape
    return Record(
        RATE, 1, AXES[:k], values, (1e-9,) * k, np.full(n, np.nan), np.arange(n) / RATE,
        np.array([[0, n]]),
    )  # fmt: skip


def shaken(seed, size, low=3.0, high=9.0, n=60_000):
    """Return three axes of white noise, the first and third with a band in common."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(n, 3))
    spectrum = np.fft.rfft(rng.normal(size=n))
    hz = np.fft.rfftfreq(n, 1 / RATE)
    common = np.fft.irfft(np.where((hz > low) & (hz < high), spectrum, 0), n)
    values[:, 0] += size * common
    values[:, 2] -= 0.7 * size * common
    return values


def test_axes_with_a_band_in_common_have_one_cause_there():
    (found,) = common_of(record(shaken(1, 1.0)))
    assert found.axes == ("gx", "gz")
    # Two bands in an octave: those that lie in 3 to 9 Hz for the most part.
    assert 1.8 < found.low_hz <= 3.0
    assert 8.0 < found.high_hz < 14.0
    # In the band C = (a^2 b^2) / ((1 + a^2) (1 + b^2)) with a = 1 and b = 0.7.
    assert found.coherence == pytest.approx(0.49 / (2 * 1.49), rel=0.25)
    assert found.limit < 0.05


def test_the_number_of_threads_changes_nothing():
    one = record(shaken(1, 1.0))
    assert common_of(one, threads=2) == common_of(one)


def test_axes_with_nothing_in_common_are_not_coherent():
    def alone(seed):
        rng = np.random.default_rng(seed)
        white = rng.normal(size=(20_000, 6))
        return white + 0.03 * np.cumsum(rng.normal(size=(20_000, 6)), axis=0)

    assert sum(bool(common_of(record(alone(seed)))) for seed in range(60)) <= 1


def test_a_line_on_all_axes_is_no_coherence_of_noise():
    rng = np.random.default_rng(4)
    line = 0.3 * np.sin(2 * np.pi * 7.0 / RATE * np.arange(40_000))
    assert common_of(record(rng.normal(size=(40_000, 3)) + line[:, None])) == ()


def coupling(forth, back):
    """Return the finding of gx and gy that each list the other as the source."""

    def one(axis, source, slope):
        numbers = {"source": Parameter(source), "slope": Parameter(slope, unit="dps/dps")}
        return Member(axis, 0, Effect("cross_coupling", numbers))

    return Finding(
        "cross_coupling", ("gx", "gy"), (one("gy", "gx", forth), one("gx", "gy", back)), 9.0
    )


@pytest.mark.parametrize(
    ("of_x", "of_y", "source"),
    [(1.0, 0.0, "gx"), (0.0, 1.0, "gx"), (0.0, 0.0, None), (1.0, 1.0, None)],
    ids=["line of the source", "line of the other", "no line", "the line of a common vibration"],
)
def test_a_line_decides_which_axis_leaks(of_x, of_y, source):
    rng = np.random.default_rng(5)
    n, c = 40_000, 0.3
    x, own = rng.normal(size=(2, n))
    wave = 0.2 * np.sin(2 * np.pi * 7.0 / RATE * np.arange(n))
    x = x + of_x * wave
    y = own * np.sqrt(1 - c**2) + c * x + of_y * wave
    found = leak_of(coupling(c, c), {7.0: 0.0}, record(np.column_stack([x, y])), RATE)
    assert (found.source if found else None) == source
    # Seen from the other side.
    found = leak_of(coupling(c, c), {7.0: 0.0}, record(np.column_stack([y, x])), RATE)
    assert (found.target if found else None) == (None if source is None else "gx")


def test_the_result_lists_what_axes_have_in_common():
    values = shaken(2, 1.0, n=20_000) * 0.03
    result = analyse({f"{axis}[dps]": values[:, k] for k, axis in enumerate(AXES[:3])}, rate=RATE)
    (found,) = result.common
    assert found.axes == ("gx", "gz")
    assert result.to_dict()["common"][0]["axes"] == ["gx", "gz"]
