"""The one-call interface: which taus it offers, and what it refuses in which words."""

import numpy as np
import pytest

import allanscope.allan
from allanscope.allan import AllanBank, deviation
from allanscope.allan.estimators import REGISTRY

DATA = np.random.default_rng(9).standard_normal(1000)
KINDS = sorted(REGISTRY)


def test_the_room_offers_three_names_and_no_other():
    assert allanscope.allan.AllanBank.__name__ == "AllanBank"
    assert callable(allanscope.allan.deviation)
    with pytest.raises(AttributeError, match="nonesuch"):
        _ = allanscope.allan.nonesuch


def test_octave_taus_are_powers_of_two_up_to_the_end():
    curve = deviation(DATA, 10.0)
    assert curve.m.tolist() == [2**k for k in range(9)]
    assert curve.tau == pytest.approx(curve.m / 10.0)
    assert curve.trusted.tolist() == [m <= 100 for m in curve.m]


def test_all_taus_are_all():
    curve = deviation(DATA[:100], 1.0, taus="all")
    assert curve.m.tolist() == list(range(1, 50))
    assert curve.terms.tolist() == [101 - 2 * m for m in range(1, 50)]


def test_a_number_is_how_many_in_each_octave():
    curve = deviation(DATA, 1.0, taus=4)
    octave = curve.m[(curve.m >= 64) & (curve.m < 128)]
    assert octave.tolist() == [64, 76, 91, 108]


def test_decade_and_many_taus():
    assert deviation(DATA, 1.0, taus="decade").m.tolist() == [1, 2, 4, 10, 20, 40, 100, 200, 400]
    many = deviation(DATA, 1.0, taus="many").m
    assert np.sum((many >= 128) & (many < 256)) == 24
    assert np.isin(2 ** np.arange(9), many).all()


def test_taus_in_seconds_are_whole_factors_in_ascending_order():
    curve = deviation(DATA, 104.3, taus=np.array([3, 1, 17, 3]) / 104.3)
    assert curve.m.tolist() == [1, 3, 17]


@pytest.mark.parametrize("kind", ["theo1", "theobr"])
def test_the_theo_family_takes_even_windows_at_three_quarters(kind):
    curve = deviation(DATA, 10.0, kind, taus=3)
    assert np.all(curve.m % 2 == 0)
    assert curve.m[(curve.m >= 64) & (curve.m < 128)].tolist() == [64, 82, 102]
    assert curve.tau == pytest.approx(0.075 * curve.m)
    assert deviation(DATA, 10.0, kind, taus=[2.0]).m.tolist() == [20]


def test_theoh_changes_from_allan_to_theo_at_a_tenth_of_the_run():
    curve = deviation(DATA, 1.0, "theoh", taus=[1, 7, 100, 136, 1000])
    assert curve.m.tolist() == [1, 7, 100, 136, 1000]
    assert curve.tau.tolist() == [1, 7, 100, 102, 750]
    assert curve.trusted.tolist() == [True, True, True, True, False]
    assert np.isfinite(curve.deviation).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("taus", ["octave", 3])
def test_every_offered_tau_has_a_value_within_its_limits(kind, taus):
    curve = deviation(DATA, 10.0, kind, taus)
    assert np.all(np.diff(curve.tau) > 0)
    assert np.all((curve.lower <= curve.deviation) & (curve.deviation <= curve.upper))
    assert np.all(curve.edf >= 1)
    assert set(curve.noise) == {"WFM"}
    assert curve.kind == kind


@pytest.mark.parametrize("kind", KINDS)
def test_time_scales_the_taus_and_only_the_time_deviations(kind):
    slow, fast = deviation(DATA, 1.0, kind), deviation(DATA, 200.0, kind)
    factor = 200.0 if kind in ("tdev", "ttotdev") else 1.0
    assert fast.tau * 200 == pytest.approx(slow.tau)
    assert fast.deviation * factor == pytest.approx(slow.deviation)
    assert fast.upper * factor == pytest.approx(slow.upper)


@pytest.mark.parametrize("kind", KINDS)
def test_the_factor_of_dt0064_is_three_for_the_hadamard_family_only(kind):
    ratio = (
        deviation(DATA, 1.0, kind, hadamard_factor="dt0064").deviation
        / deviation(DATA, 1.0, kind).deviation
    )
    assert ratio**2 == pytest.approx(3.0 if kind in ("hdev", "ohdev", "htotdev") else 1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_the_bank_gives_the_same_curve_where_it_keeps_every_term(kind):
    exact = deviation(DATA, 10.0, kind)
    streamed = deviation(DATA, 10.0, kind, exact=False)
    both = np.isin(streamed.tau.round(6), exact.tau[exact.m < 64].round(6))
    expected = np.isin(exact.tau.round(6), streamed.tau[both].round(6))
    assert both.sum() >= 2
    assert streamed.deviation[both] == pytest.approx(exact.deviation[expected], rel=1e-9)
    assert streamed.upper[both] == pytest.approx(exact.upper[expected], rel=1e-6)


def test_the_bank_keeps_its_own_taus():
    for per_octave in (4, np.int64(4)):
        assert deviation(DATA, 1.0, taus=per_octave, exact=False).m[-1] > 300
    for taus in ("all", [1.0]):
        with pytest.raises(ValueError, match="exact=False needs octave"):
            deviation(DATA, 1.0, taus=taus, exact=False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "allan"}, "unknown estimator 'allan'"),
        ({"rate": 0.0}, "rate must be positive and finite, got 0.0 Hz"),
        ({"rate": -5.0}, "rate must be positive"),
        ({"rate": np.nan}, "rate must be positive"),
        ({"data": [1.0, 2.0, np.nan, 4.0]}, r"oadev has no value at tau 0.1 s .* has 2 samples"),
        ({"data": [np.inf, 2.0, np.nan, 4.0]}, r"sample 0 is inf \(one of 1 not finite\)"),
        ({"data": [np.nan, np.nan, 4.0]}, "need at least 2 samples of rate, got 1"),
        ({"data": []}, "need at least 2 samples of rate, got 0"),
        ({"data": [1.0]}, "need at least 2 samples of rate, got 1"),
        ({"data": [1.0, 2.0], "data_kind": "phase"}, "need at least 3 samples of phase, got 2"),
        ({"data": [1.0, 2.0]}, "oadev needs at least 3 samples, got 2"),
        ({"data": [1, 2, 3], "kind": "mtotdev", "taus": [0.2]}, r"needs 2 samples \(0.2 s\) more"),
        ({"data": np.zeros(88), "kind": "theobr"}, "theobr needs at least 89 samples, got 88"),
        ({"data": np.zeros((10, 2))}, r"one dimension, got shape \(10, 2\)"),
        ({"data": ["a", "b", "c"]}, "integers or floats, got <U1"),
        ({"data": np.ma.masked_equal(np.arange(9), 4)}, "masked samples"),
        ({"data": np.zeros(9, complex)}, "integers or floats, got complex128"),
        ({"data": [True, False, True]}, "integers or floats, got bool"),
        ({"data_kind": "frequency"}, "unknown data_kind 'frequency'; choose rate or phase"),
        ({"taus": "log10"}, "unknown taus 'log10'; choose octave, decade, many, all"),
        ({"taus": []}, "taus is empty"),
        ({"taus": 0}, "taus as a number is how many in each octave, got 0"),
        ({"taus": 2.5}, "give averaging times in s as a sequence"),
        ({"taus": True}, "taus as a number"),
        ({"taus": [0.0]}, "tau must be positive and finite, got 0.0 s"),
        ({"taus": [np.nan]}, "tau must be positive and finite"),
        ({"taus": [1.04]}, "tau 1.04 s is 10.4 samples at 10 Hz; oadev needs a whole"),
        (
            {"taus": [0.1, 60.0]},
            r"oadev at tau 60 s needs 201 samples \(20.1 s\) more than the 1000",
        ),
        ({"level": 1.0}, "level must lie between 0 and 1, got 1.0"),
        ({"hadamard_factor": "1/2"}, "unknown Hadamard factor '1/2'; choose sp1065"),
        ({"noise": "pink"}, "unknown noise type 'pink'; choose one of WPM FPM WFM"),
        ({"bias_corrected": "some"}, "unknown bias_corrected 'some'; choose True, False or 'all'"),
    ],
)
def test_what_cannot_be_known_is_refused_by_name(arguments, message):
    arguments = {"data": DATA, "rate": 10.0} | arguments
    with pytest.raises(ValueError, match=message):
        deviation(**arguments)


def test_odd_windows_of_the_theo_family_are_refused():
    with pytest.raises(ValueError, match=r"theo1 has no window of 5 samples .* are even"):
        deviation(DATA, 4.0, "theo1", taus=[1.25])


GAPPY = np.concatenate([DATA[:300], [np.nan] * 5, DATA[300:420], [np.nan], DATA[420:900]])


@pytest.mark.parametrize("kind", KINDS)
def test_nan_is_a_gap_as_it_is_for_a_bank(kind):
    bank = AllanBank(10.0, axes=1, per_octave=1)
    bank.update(DATA[:300])
    for start, stop in ((300, 420), (420, 900)):
        bank.gap()
        bank.update(DATA[start:stop])
    streamed = bank.deviation(kind).axis(0)
    exact = deviation(GAPPY, 10.0, kind)
    shared = sorted({m for m in streamed.m.tolist() if m < 64} & set(exact.m.tolist()))
    assert len(shared) >= 2
    one, other = (np.isin(curve.m, shared) for curve in (streamed, exact))
    for name in ("deviation", "lower", "upper", "edf"):
        np.testing.assert_allclose(
            getattr(streamed, name)[one], getattr(exact, name)[other], rtol=1e-9, err_msg=name
        )
    assert streamed.terms[one].tolist() == exact.terms[other].tolist()
    assert streamed.noise[one].tolist() == exact.noise[other].tolist()


def test_no_term_spans_a_gap():
    stairs = np.concatenate([np.zeros(50), [np.nan], np.full(50, 1e6)])
    assert not deviation(stairs, 1.0).deviation.any()
    phase = np.append(0.0, np.cumsum(DATA))
    phase[500] = np.nan
    curve = deviation(phase, 1.0, data_kind="phase", taus=[1.0, 3.0])
    assert curve.terms.tolist() == [498 + 498, 494 + 494]


def test_a_tau_without_a_value_is_an_error_and_not_left_out():
    with pytest.raises(ValueError, match="oadev at tau 60 s needs"):
        deviation(DATA, 10.0, taus=[0.1, 60.0])
    with pytest.raises(ValueError, match=r"no value at tau 30 s between .* has 480 samples"):
        deviation(GAPPY, 10.0, taus=[0.1, 30.0])
    assert deviation(GAPPY, 10.0, taus="octave").m[-1] == 128


def test_the_noise_type_may_be_given():
    given = deviation(DATA, 1.0, "htotdev", taus=[16], noise="RWFM")
    found = deviation(DATA, 1.0, "htotdev", taus=[16])
    assert (given.noise.tolist(), found.noise.tolist()) == (["RWFM"], ["WFM"])
    # The bias correction goes by the type: 0.995 for white FM, 0.771 for random walk FM.
    assert (given.deviation / found.deviation) ** 2 == pytest.approx(0.995 / 0.771)
    bank = AllanBank(1.0, axes=1)
    bank.update(DATA)
    assert set(bank.deviation("oadev", noise="FFM").noise[0, :20].tolist()) == {"FFM"}


def bias_of_theo1(alpha, m):
    """THEO1 / AVAR at 0.75 m from the generalised covariance of the phase, an exact sum."""
    power = {
        2: lambda t: 1.0 * (t == 0),
        0: lambda t: -float(t),
        -1: lambda t: t**2 * np.log(t) if t else 0.0,
        -2: lambda t: float(t) ** 3,
    }

    def square(weights):
        return sum(a * b * power[alpha](abs(s - t)) for s, a in weights for t, b in weights)

    total = sum(
        square([(0, 1), (v, -1), (m - v, -1), (m, 1)]) / v for v in range(1, m // 2 + 1)
    ) / (0.75 * m**2)
    tau = 3 * m // 4
    return total / (square([(0, 1), (tau, -2), (2 * tau, 1)]) / (2 * tau**2))


@pytest.mark.parametrize(("alpha", "name"), [(2, "WPM"), (0, "WFM"), (-1, "FFM"), (-2, "RWFM")])
def test_the_bias_of_theo1_is_removed_by_noise_type(alpha, name):
    m = np.array([16, 64, 256])
    raw, corrected = (
        deviation(DATA, 1.0, "theo1", taus=m, noise=name, bias_corrected=how)
        for how in (True, "all")
    )
    exact = [bias_of_theo1(alpha, k) for k in m.tolist()]
    # The published fit against the exact sum: 4 % of the variance at most.
    np.testing.assert_allclose((raw.deviation / corrected.deviation) ** 2, exact, rtol=0.04)
    assert np.all((corrected.lower < corrected.deviation) & (corrected.deviation < corrected.upper))


def test_the_bias_of_totdev_is_removed_by_noise_type():
    for name, a in (("WFM", 0.0), ("FFM", 0.481), ("RWFM", 0.75)):  # NIST SP 1065 table 7
        raw, corrected = (
            deviation(DATA, 1.0, "totdev", taus=[400], noise=name, bias_corrected=how)
            for how in (True, "all")
        )
        assert (raw.deviation / corrected.deviation) ** 2 == pytest.approx(1 - 0.4 * a, rel=1e-3)


def records(power_law):
    """Return 150 records: five power laws, two mixed, and white noise with a drift or a step."""
    pure = {alpha: power_law(alpha, 3000, 18, seed=30 + alpha) for alpha in (2, 1, 0, -1, -2)}
    mixed = [pure[0] + 0.03 * pure[-2], pure[0] + 0.3 * pure[-1]]
    drift = np.arange(3000) - 1500.0
    return np.concatenate([*pure.values(), *mixed, (pure[0] + 0.002 * drift)[:12], pure[0] + drift])


def test_array_and_bank_give_one_curve(power_law):
    """The same noise types at every tau, and limits that only the thinning of terms moves."""
    every = records(power_law)[:150]
    banks = AllanBank(1.0, axes=len(every), per_octave=4)
    banks.update(every.T)
    for kind in ("oadev", "mdev", "ohdev", "totdev", "mtotdev", "htotdev"):
        streamed = banks.deviation(kind)
        taus = [m for m in streamed.m.tolist() if m in 2 ** np.arange(11)]
        columns = np.isin(streamed.m, taus)
        curves = [deviation(one, 1.0, kind, taus=taus) for one in every]
        found = np.array([curve.noise for curve in curves])
        assert (streamed.noise[:, columns] == found).all(), kind
        # From m = 64 on the terms of a bank start at every m / 32 at most, which white PM minds.
        dense = np.array(taus) < 64
        totals = kind not in ("oadev", "mdev", "ohdev", "totdev")
        for name in ("deviation", "lower", "upper"):
            exact = np.array([getattr(curve, name) for curve in curves])
            ratio = getattr(streamed, name)[:, columns] / exact
            np.testing.assert_allclose(ratio[:, dense | totals], 1.0, rtol=1e-6, err_msg=kind)
            trusted = np.array(taus) <= 300
            np.testing.assert_allclose(ratio[36:, trusted], 1.0, rtol=0.03, err_msg=kind)
