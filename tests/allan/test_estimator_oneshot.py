"""The one-call interface: which taus it offers, and what it refuses in which words."""

import numpy as np
import pytest

import allanscope.allan
from allanscope.allan import deviation
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
    assert curve.trusted.all()
    assert np.isfinite(curve.deviation).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("taus", ["octave", 3])
def test_every_offered_tau_has_a_value_within_its_limits(kind, taus):
    curve = deviation(DATA, 10.0, kind, taus)
    assert np.all(np.diff(curve.tau) > 0)
    assert np.all((curve.lower < curve.deviation) & (curve.deviation < curve.upper))
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
        ({"data": [1.0, 2.0, np.nan, 4.0]}, r"sample 2 is nan \(one of 1 not finite\)"),
        ({"data": [np.inf, 2.0, np.nan, 4.0]}, r"sample 0 is inf \(one of 2 not finite\)"),
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
        ({"taus": "decade"}, "unknown taus 'decade'; choose octave, all"),
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
    ],
)
def test_what_cannot_be_known_is_refused_by_name(arguments, message):
    arguments = {"data": DATA, "rate": 10.0} | arguments
    with pytest.raises(ValueError, match=message):
        deviation(**arguments)


def test_odd_windows_of_the_theo_family_are_refused():
    with pytest.raises(ValueError, match=r"theo1 has no window of 5 samples .* are even"):
        deviation(DATA, 4.0, "theo1", taus=[1.25])
