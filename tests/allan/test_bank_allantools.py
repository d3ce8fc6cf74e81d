"""Where every term is taken, the bank agrees with allantools in every digit that matters."""

import allantools
import numpy as np
import pytest

from allanscope.allan import AllanBank

N = 2000


def signals():
    rng = np.random.default_rng(20)
    white = rng.normal(size=N)
    spectrum = np.fft.rfft(rng.normal(size=2 * N))
    flicker = np.fft.irfft(spectrum / np.sqrt(np.arange(spectrum.size) + 1.0))[:N]
    alternating = np.where(np.arange(N) % 2, 32767, -32768).astype(np.int16)
    return {
        "white": white,
        "flicker": flicker,
        "random walk": white.cumsum(),
        "counts on 1 g": (16384 + 12 * white).astype(np.int16),
        "full scale, alternating": alternating,
        "full scale, at random": rng.integers(-32768, 32768, N).astype(np.int16),
        "int32": rng.integers(-(2**31), 2**31, N).astype(np.int32),
        "ramp of counts": (np.arange(N) * 7 - 5000).astype(np.int32),
        "tiny floats": 1e-12 * white,
        "large floats": 1e6 * white,
        "small noise on a large offset": 1e3 + 1e-3 * white,
    }


def banked(data, per_octave=8):
    bank = AllanBank(rate=1.0, axes=1, per_octave=per_octave)
    bank.update(data)
    return bank


def assert_same(kind, data, most=63, rtol=1e-10, n=N):
    """Compare value and number of terms at all m that the bank has up to `most`."""
    curve = banked(data[:n]).deviation(kind)
    keep = curve.m <= most
    # An offset costs allantools digits, and no estimator can see it.
    rates = data[:n].astype(np.longdouble)
    rates = (rates - rates[0]).astype(np.float64)
    tau, expected, _, terms = getattr(allantools, kind)(
        rates, rate=1.0, data_type="freq", taus=curve.m[keep].astype(float)
    )
    by_m = {round(t): (d, k) for t, d, k in zip(tau, expected, terms, strict=True)}
    assert by_m
    for m, value, count in zip(
        curve.m[keep], curve.deviation[0, keep], curve.terms[0, keep], strict=True
    ):
        if int(m) in by_m:
            assert value == pytest.approx(by_m[int(m)][0], rel=rtol)
            assert count == by_m[int(m)][1]


@pytest.mark.parametrize("name", signals())
@pytest.mark.parametrize("kind", ["oadev", "ohdev", "mdev", "tdev", "totdev"])
def test_overlapping_kinds_equal_allantools_below_m_64(kind, name):
    assert_same(kind, signals()[name])


@pytest.mark.parametrize("name", signals())
@pytest.mark.parametrize("kind", ["adev", "hdev"])
def test_kinds_without_overlap_equal_allantools_at_every_m(kind, name):
    assert_same(kind, signals()[name], most=N)


@pytest.mark.parametrize("name", signals())
def test_pdev_equals_allantools_below_m_64(name):
    # Two summations deep, doubles leave 1e-9 of a float signal that runs far from its start.
    assert_same("pdev", signals()[name], rtol=1e-9, n=300)


@pytest.mark.parametrize("kind", ["oadev", "mdev", "totdev", "adev", "pdev"])
@pytest.mark.parametrize("n", [5, 7, 63, 64, 65, 255, 256, 257, 258])
def test_the_first_and_the_last_term_are_counted_at_any_length(kind, n):
    assert_same(kind, signals()["full scale, at random"], n=n, rtol=1e-9)


@pytest.mark.parametrize(
    "kind", ["adev", "oadev", "hdev", "ohdev", "mdev", "pdev", "totdev", "stdev", "ostdev"]
)
def test_a_constant_has_no_deviation(kind):
    for constant in (np.full(N, -32768, np.int16), np.full(N, 0.1)):
        assert not np.nan_to_num(banked(constant).deviation(kind).deviation).any()


def test_hadamard_does_not_see_a_ramp_of_counts():
    ramp = signals()["ramp of counts"]
    assert not np.nan_to_num(banked(ramp).deviation("ohdev").deviation).any()
    assert not np.nan_to_num(banked(ramp).deviation("hdev").deviation).any()


@pytest.mark.parametrize("kind", ["mtotdev", "htotdev"])
def test_modified_totals_equal_allantools_on_a_short_run(kind):
    data = signals()["counts on 1 g"][:60].astype(float)
    bank = banked(data, per_octave=2)
    curve = bank.deviation(kind, bias_corrected=False)
    tau, expected, _, _ = getattr(allantools, kind)(
        data - data[0], rate=1.0, data_type="freq", taus=curve.m.astype(float)
    )
    assert curve.m.tolist() == [round(t) for t in tau] == [1, 2, 3, 4, 6, 8, 11, 16]
    # allantools leaves a 1/sqrt(6) of its own at m = 1 of HTOTDEV; SP 1065 has OHDEV there.
    first = 1 if kind == "htotdev" else 0
    np.testing.assert_allclose(curve.deviation[0, first:], expected[first:], rtol=1e-10)


def test_theo1_equals_allantools_but_for_the_tau_it_stands_at():
    data = signals()["counts on 1 g"][:200].astype(float)
    curve = banked(data, per_octave=1).deviation("theo1")
    _, expected, _, _ = allantools.theo1(
        data - data[0], rate=1.0, data_type="freq", taus=curve.m[:-1].astype(float)
    )
    np.testing.assert_allclose(curve.deviation[0, : len(expected)], expected, rtol=1e-10)
    np.testing.assert_allclose(curve.tau, 0.75 * curve.m)
