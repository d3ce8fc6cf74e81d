"""The published N: all that is white at 1 Hz and below, with what other axes bring."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.signal import butter, iirpeak, lfilter, sosfilt

from allanscope import analyse
from allanscope.analysis.coefficients import add_coupled, total_white
from allanscope.analysis.disagreement import disagreement
from allanscope.analysis.result import ModelCurve, Reading
from allanscope.explain import Effect, Parameter
from allanscope.history import Record
from allanscope.noise import Coefficient, CoefficientPart, fit_noise
from allanscope.noise.components import GaussMarkov, MovingLine, Narrowband, WanderingLine
from allanscope.noise.fit import Known
from allanscope.pipeline.check import compare
from allanscope.simulator import Truth

RATE, SAMPLES = 100.0, 120_000


def white(rng, N, n=SAMPLES):
    return rng.normal(0, N * RATE**0.5, n)


def gauss_markov(rng, sigma, tc, n=SAMPLES):
    phi = np.exp(-1 / (tc * RATE))
    return lfilter([1], [1, -phi], rng.normal(0, sigma * np.sqrt(1 - phi**2), n))


@pytest.fixture(scope="module")
def short():
    """White noise of 0.8 mdps/sqrt(Hz) and a process of 0.054 s that has 6.2 below its corner."""
    rng = np.random.default_rng(3)
    sigma = 6.2e-3 / np.sqrt(2 * 0.054)
    return analyse({"gx": white(rng, 0.8e-3) + gauss_markov(rng, sigma, 0.054)}, RATE)


@pytest.fixture(scope="module")
def coupled():
    """Return an axis of 4 mdps/sqrt(Hz) that takes 30 % of one of 20."""
    rng = np.random.default_rng(4)
    own, source = white(rng, 4e-3), white(rng, 20e-3)
    return analyse({"gx": own + 0.3 * source, "gy": source}, RATE)


def test_a_short_process_is_part_of_n(short):
    axis = short.axes["gx"]
    assert [effect.kind for effect in axis.explanation.effects] == ["gauss_markov"]
    found, readings = axis.coefficients["N"], axis.readings
    assert found.lower < np.hypot(0.8e-3, 6.2e-3) < found.upper
    assert found.upper / found.lower < 1.06
    # The density to 1 Hz, and the deviation at 1 s: short of it by 4 % at a correlation time of
    # 0.054 s, less in what the interval leaves open.
    assert readings["N"].lower < found.upper
    assert found.lower < readings["N"].upper
    assert readings["N_1s"].upper > 0.96 * found.lower
    assert found.white_alone.value == pytest.approx(0.8e-3, rel=0.03)
    assert found.decoupled is None
    assert not any("by the fit" in remark for remark in axis.remarks)


def test_a_line_that_moves_far_is_part_of_n_and_has_no_other_form():
    """It is white at 1 Hz and below, like a broad band; asked for its forms, it failed the axis."""
    rng = np.random.default_rng(12)
    sigma, bandwidth = 10e-3, 20.0
    centres = (8.0, 14.0)
    turn = np.exp(-(np.pi * bandwidth + 2j * np.pi * np.repeat(centres, SAMPLES // 4)) / RATE)
    wave, now = np.empty(SAMPLES // 2), 0j
    for i, kick in enumerate(rng.normal(size=(SAMPLES // 2, 2)) @ [1, 1j]):
        now = turn[i] * now + np.sqrt(1 - abs(turn[i]) ** 2) * sigma * kick
        wave[i] = now.real
    line = MovingLine(1.0, 11.0, bandwidth, (-3.0, 3.0))
    found = total_white(
        fit_noise(one_axis(white(rng, 1e-3, len(wave)) + wave), "gx", known=Known((line,)))
    )
    level = line.with_power(sigma**2).density(np.zeros(1), 1 / RATE)[0] / 2
    assert found.lower < np.sqrt(1e-6 + level) < found.upper
    assert found.white_alone.value == pytest.approx(1e-3, rel=0.05)


def test_the_interval_of_the_sum_holds():
    """60 records, the correlation time fitted: a share of 95 % scatters by 2.8 %."""
    sigma, tc, n = 6.2e-3 / np.sqrt(2 * 0.054), 0.054, 6000
    held = []
    for seed in range(60):
        rng = np.random.default_rng([seed, 9])
        record = one_axis(white(rng, 2e-3, n) + gauss_markov(rng, sigma, tc, n))

        def fitted(log_tc, record=record):
            return fit_noise(record, "gx", known=Known((GaussMarkov(1.0, np.exp(log_tc)),)))

        best = minimize_scalar(
            lambda x: -fitted(x).fit.loglik,
            bounds=(np.log(0.03), np.log(0.078)),
            method="bounded",
            options={"xatol": 0.01},
        )
        found = total_white(fitted(best.x))
        held.append(found.lower <= np.hypot(2e-3, 6.2e-3) <= found.upper)
    assert 0.88 < np.mean(held) <= 1.0


def one_axis(values):
    n = len(values)
    return Record(
        rate_hz=RATE,
        stride=1,
        axes=("gx",),
        values=values[:, np.newaxis],
        lsb=(0.0,),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / RATE,
        segments=np.array([[0, n]], np.int64),
    )


def test_a_long_process_is_no_part_of_n():
    rng = np.random.default_rng(5)
    axis = analyse({"gx": white(rng, 4e-3) + gauss_markov(rng, 5e-3, 5.0)}, RATE).axes["gx"]
    assert [effect.kind for effect in axis.explanation.effects] == ["gauss_markov"]
    found = axis.coefficients["N"]
    assert found.lower < 4e-3 < found.upper
    assert found.white_alone is None
    assert axis.readings["N"].lower < 4e-3 < axis.readings["N"].upper


def test_what_a_broad_resonance_has_at_1_hz_is_part_of_n():
    """An oscillator of 12 Hz, shaken by noise, follows slow noise as a spring does."""
    rng = np.random.default_rng(21)
    radius, turn, drive = np.exp(-np.pi * 8 / RATE), 2 * np.pi * 11.3 / RATE, 5e-3
    poles = [1, -2 * radius * np.cos(turn), radius**2]
    shaken = lfilter([sum(poles)], poles, white(rng, drive))
    axis = analyse({"gx": white(rng, 4e-3) + shaken}, RATE).axes["gx"]
    assert [effect.kind for effect in axis.explanation.effects] == ["narrowband"]
    found = axis.coefficients["N"]
    assert found.lower < np.hypot(4e-3, drive) < found.upper
    assert found.upper / found.lower < 1.05
    assert found.white_alone.value == pytest.approx(4e-3, rel=0.1)
    assert axis.remarks == ()


def test_what_several_resonances_add_to_n_counts_where_each_alone_is_too_little_to_be_noted():
    """Four, each with 1.4 % of N squared at 0 Hz: 3 % of N."""
    rng = np.random.default_rng(22)
    values, places = white(rng, 4e-3), (18.0, 24.0, 30.0, 36.0)
    for frequency in places:
        radius, turn = np.exp(-np.pi * 2 / RATE), 2 * np.pi * frequency / RATE
        poles = [1, -2 * radius * np.cos(turn), radius**2]
        values += lfilter([0.12 * sum(poles)], poles, white(rng, 4e-3))
    known = Known(tuple(Narrowband(1.0, frequency, 2.0) for frequency in places))
    found = total_white(fit_noise(one_axis(values), "gx", known=known))
    assert found.value == pytest.approx(4e-3 * np.sqrt(1 + 4 * 0.12**2), rel=0.01)


def test_n_beside_a_resonance_whose_form_is_not_known_has_an_interval_that_holds():
    """40 records, the oscillator taken for a line that wanders: alone that holds a sixth."""
    radius, turn, n = np.exp(-np.pi * 3 / RATE), 2 * np.pi * 11.9 / RATE, 12_000
    poles = [1, -2 * radius * np.cos(turn), radius**2]
    held = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 31])
        shaken = lfilter([0.3 * sum(poles)], poles, white(rng, 4e-3, n + 500))[500:]
        record = one_axis(white(rng, 4e-3, n) + shaken)
        known = Known((WanderingLine(1.0, 12.0, 3.0),))
        found = total_white(fit_noise(record, "gx", known=known))
        held.append(found.lower < np.hypot(4e-3, 0.3 * 4e-3) < found.upper)
    assert 0.88 < np.mean(held) <= 1.0


@pytest.mark.parametrize("nothing", ["climb", "other_forms"])
def test_a_form_of_a_resonance_that_leaves_no_white_noise_does_not_tell_n(monkeypatch, nothing):
    rng = np.random.default_rng(31)
    values, radius = white(rng, 4e-3), np.exp(-np.pi * 3 / RATE)
    poles = [1, -2 * radius * np.cos(2 * np.pi * 12.0 / RATE), radius**2]
    record = one_axis(values + lfilter([0.3 * sum(poles)], poles, white(rng, 4e-3)))
    fit = fit_noise(record, "gx", known=Known((Narrowband(1.0, 12.0, 3.0),)))
    module = import_module("allanscope.analysis.coefficients")
    usual, way = total_white(fit), getattr(module, nothing)

    def dark(one):
        dim = [c.with_power(0.0) if c.symbol in "NB" or c.band else c for c in one.model]
        return replace(one, model=replace(one.model, components=tuple(dim)))

    def without(*given):
        found = way(*given)
        return dark(found) if nothing == "climb" else map(dark, found)

    monkeypatch.setattr(module, nothing, without)
    found = total_white(fit)
    assert found.value == pytest.approx(usual.value, rel=0.01)
    assert 0 < found.lower < found.value < found.upper


def test_two_resonances_on_a_table_leave_n_and_no_power_law():
    """60 ug/sqrt(Hz) behind a low-pass; peaks of 23 and 31 Hz, their flanks no slope of noise."""
    rng = np.random.default_rng(1007)
    finer, n = 1664.0, 300 * 1664

    def peak(frequency, quality, sigma):
        shaken = lfilter(*iirpeak(frequency, quality, fs=finer), rng.normal(size=n))
        return sigma * shaken / shaken.std()

    noise = rng.normal(0, 60e-6 * finer**0.5, n)
    noise = sosfilt(butter(2, 40, fs=finer, output="sos"), noise)
    sampled = (noise + peak(23.0, 6.0, 5e-4) + peak(31.0, 8.0, 2.8e-4))[::16]
    axis = analyse({"ax": np.round(sampled / 61e-6) * 61e-6}, 104.0).axes["ax"]
    kinds = [effect.kind for effect in axis.explanation.effects]
    assert kinds.count("narrowband") == 2
    assert "power_law" not in kinds
    assert axis.coefficients["N"].value == pytest.approx(60e-6, rel=0.04)


def test_n_has_what_another_axis_brings(coupled):
    found = coupled.axes["gx"].coefficients["N"]
    measured = np.hypot(4e-3, 0.3 * 20e-3)
    assert found.lower < measured < found.upper
    assert found.upper / found.lower < 1.03
    assert found.decoupled.lower < 4e-3 < found.decoupled.upper
    assert found.white_alone == found.decoupled
    read = coupled.axes["gx"].readings["N"]
    assert read.lower < found.upper
    assert found.lower < read.upper


def test_of_two_axes_that_may_each_be_the_source_one_is_cleaned(coupled):
    """White noise of equal colour does not tell the direction: both list it, one is cleaned."""
    found = {
        axis: next(e for e in one.explanation.effects if e.kind == "cross_coupling")
        for axis, one in coupled.axes.items()
    }
    assert all("the direction is not determined" in e.evidence["words"] for e in found.values())
    assert sorted(e.evidence["removed"] for e in found.values()) == [False, True]
    told = [e.evidence["direction_nats"] for e in found.values()]
    assert told[0] == pytest.approx(-told[1], abs=1e-6)
    kept = next(axis for axis, e in found.items() if not e.evidence["removed"])
    assert coupled.axes[kept].coefficients["N"].decoupled is None
    # A twin has the coupling once.
    twin = Truth.from_result(coupled.to_dict())
    assert [e.kind for e in twin.effects] == ["cross_coupling"]


def test_a_source_that_is_told_from_what_it_leaks_into_brings_its_own_n():
    """The source wanders, which tells the direction; what it brings is its white part alone."""
    rng = np.random.default_rng(6)
    own, source = white(rng, 4e-3), white(rng, 20e-3) + gauss_markov(rng, 0.1, 5.0)
    axes = analyse({"gx": own + 0.3 * source, "gy": source}, RATE).axes
    assert [effect.kind for effect in axes["gx"].explanation.effects] == ["cross_coupling"]
    assert "cross_coupling" not in [effect.kind for effect in axes["gy"].explanation.effects]
    found = axes["gx"].coefficients["N"]
    assert found.lower < np.hypot(4e-3, 6e-3) < found.upper
    assert found.decoupled.lower < 4e-3 < found.decoupled.upper
    assert axes["gy"].coefficients["N"].decoupled is None


def test_noise_whose_amplitude_follows_an_axis_is_in_n_once():
    rng = np.random.default_rng(8)
    t = np.arange(SAMPLES) / RATE
    source = white(rng, 20e-3) * np.exp(np.sin(2 * np.pi * t / 37))
    own = white(rng, 4e-3) + 0.15 * np.abs(source) * rng.normal(size=SAMPLES)
    axis = analyse({"gx": own, "gy": source}, RATE).axes["gx"]
    assert [effect.kind for effect in axis.explanation.effects] == ["amplitude_coupling"]
    found = axis.coefficients["N"]
    assert found.value == pytest.approx(own.std() / RATE**0.5, rel=0.02)
    assert found.decoupled is None
    assert axis.remarks == ()


def test_check_judges_n_as_measured(coupled):
    limits = {"gx": {"N": {"max": 6e-3}}}
    assert not compare(coupled, limits)[0].passed
    assert compare(coupled, {"gx": {"N": {"max": 7.5e-3}}})[0].passed
    # The fit without effects is no judge of N: a line, say, may have raised it.
    axis = coupled.axes["gx"]
    before = {"N": replace(axis.explanation.coefficients_before["N"], value=9e-3)}
    raised = replace(axis, explanation=replace(axis.explanation, coefficients_before=before))
    both = replace(coupled, axes={"gx": raised})
    assert compare(both, {"gx": {"N": {"max": 7.5e-3}}})[0].passed


def test_what_is_simulated_again_has_the_white_noise_once(coupled, short):
    again = Truth.from_result(short.to_dict())
    assert pytest.approx(0.8e-3, rel=0.03) == again.axes["gx"].N
    assert [effect.kind for effect in again.effects] == ["gauss_markov"]
    assert pytest.approx(4e-3, rel=0.03) == Truth.from_result(coupled.to_dict()).axes["gx"].N


def test_squares_add_up_and_so_do_their_errors():
    own = Coefficient(3.0, 2.9, 3.1, "", True)
    source = Coefficient(40.0, 39.0, 41.0, "", True)
    found = add_coupled(own, {"gy": (source, 0.1, 0.0)})
    assert found.value == pytest.approx(5.0)
    # Errors of squares: 6 * 0.1 and 0.01 * 80 * 1, over 2 * 5.
    assert found.upper - found.lower == pytest.approx(2 * np.hypot(0.6, 0.8) / 10, rel=0.01)
    wider = add_coupled(own, {"gy": (source, 0.1, 0.01)})
    assert wider.upper - wider.lower > 2 * (found.upper - found.lower)


def test_what_is_hardly_known_has_a_limit():
    # An axis that moved: the interval of the source spans ten decades.
    source = Coefficient(40.0, 1e-4, 1e6, "", True)
    unknown = Coefficient(3.0, 0.0, 3.1, "", False)
    found = add_coupled(unknown, {"gy": (source, 0.1, 0.0)})
    assert (found.detected, found.lower) == (False, 0.0)
    assert 0.1 * 1e6 < found.upper < 10 * 0.1 * 1e6
    # What the axis has of its own is there in any case.
    known = replace(unknown, lower=2.9, detected=True)
    found = add_coupled(known, {"gy": (source, 0.1, 0.0)})
    assert (found.detected, found.lower) == (True, 2.9)


# --- one line where a coefficient and its reading disagree ----------------------------------------


def coefficients(N=1e-3, B=1e-4, K=1e-6):
    sized = {"N": N, "B": B, "K": K}
    return {k: Coefficient(v, 0.98 * v, 1.02 * v, "", True) for k, v in sized.items()}


def reading(value, **where):
    return Reading(value, 0.99 * value, 1.01 * value, "", **where)


def effect(kind, **parameters):
    return Effect(kind, {name: Parameter(value) for name, value in parameters.items()})


DENSITY = {"band_hz": (0.1, 10.0)}


def test_agreement_within_3_percent_and_the_interval_of_the_density_is_not_told():
    for value in (1e-3, 1.015e-3, 1.035e-3, 0.97e-3):
        assert disagreement("dps", coefficients(), {"N": reading(value, **DENSITY)}) is None


def test_n_is_what_the_density_shows_however_wide_its_own_interval():
    wide = coefficients() | {"N": Coefficient(1e-3, 0.7e-3, 1.3e-3, "", True)}
    assert disagreement("dps", wide, {"N": reading(1.06e-3, **DENSITY)}) is not None
    assert disagreement("dps", wide, {"N": reading(1.03e-3, **DENSITY)}) is None


@pytest.mark.parametrize(
    ("found", "cause"),
    [
        ([], "cause: not identified"),
        (
            [effect("gauss_markov", sigma=1.0, correlation_time=0.4)],
            "Gauss-Markov noise with a correlation time of 0.400 s",
        ),
        ([effect("cross_coupling", source="ax", slope=0.1)], "cross-coupling from ax"),
        ([effect("step", time=1.0), effect("outliers", count=7)], "outliers"),
        ([effect("band_limit", cutoff=18.0)], "cause: not identified"),
    ],
)
def test_the_cause_is_what_was_found(found, cause):
    line = disagreement("dps", coefficients(), {"N": reading(6.2e-3, **DENSITY)}, found)
    assert line.startswith(
        "N is 6.20 mdps/√Hz from the density between 0.10 and 10 Hz but 1.00 from the fit; cause: "
    )
    assert cause in line


def test_the_cause_at_an_averaging_time_is_what_adds_most_to_the_curve_there():
    """A shock that is over soon adds little at 30 s, where the level follows the temperature."""
    tau = np.array([1.0, 10.0, 100.0])
    added = {"shock": np.array([3e-4, 5e-5, 1e-5]), "temperature": 1e-4 * tau}
    model = ModelCurve(tau, np.ones(3), added)
    found = [effect("shock", time=1.0), effect("temperature", slope=0.02)]
    high = {"K": reading(1e-3, tau_s=30.0)}
    line = disagreement("dps", coefficients(), high, found, model=model)
    assert line.endswith("temperature")
    assert disagreement("dps", coefficients(), high, found).endswith("shock")


def test_the_white_noise_behind_a_filter_is_no_cause():
    """A line of 0.56 Hz adds half of the deviation at 1 s, the filtered noise the other half."""
    model = ModelCurve(
        np.array([0.5, 2.0]),
        np.ones(2),
        {"band_limit": np.full(2, 4e-4), "drifting_line": np.full(2, 3e-4)},
    )
    found = [effect("band_limit", cutoff=36.0), effect("drifting_line", frequency=0.56)]
    high = {"N_1s": reading(5e-4, tau_s=1.0)}
    known = coefficients()
    assert "line around 0.560 Hz" in disagreement("dps", known, high, found, model=model)


def test_a_low_pass_explains_a_reading_below_the_coefficient():
    low = {"N": reading(0.5e-3, **DENSITY)}
    line = disagreement("dps", coefficients(), low, [effect("band_limit", cutoff=18.0)])
    assert line.endswith("a low-pass at 18.0 Hz")


@pytest.mark.parametrize(("alone", "is_cause"), [(0.99e-3, False), (0.8e-3, True)])
def test_a_coupling_that_brings_next_to_nothing_is_no_cause(alone, is_cause):
    known = coefficients()
    part = CoefficientPart(alone, 0.99 * alone, 1.01 * alone, True)
    known["N"] = replace(known["N"], decoupled=part)
    leak = [effect("cross_coupling", source="ay", slope=0.1)]
    line = disagreement("dps", known, {"N": reading(6.2e-3, **DENSITY)}, leak)
    assert line.endswith("cross-coupling from ay") == is_cause


@pytest.mark.parametrize("kind", ["band_limit", "sinusoid"])
def test_what_acts_far_from_where_n_was_read_is_no_cause(kind):
    name = "cutoff" if kind == "band_limit" else "frequency"
    low = {"N": reading(0.5e-3, **DENSITY)}
    far = disagreement("dps", coefficients(), low, [effect(kind, **{name: 38.0})])
    assert far.endswith("cause: not identified")
    near = disagreement("dps", coefficients(), low, [effect(kind, **{name: 18.0})])
    assert "18.0 Hz" in near


def test_what_the_coefficients_make_together_is_no_disagreement():
    """The deviation at 1 s has flicker noise in it, and the floor white noise and walk."""
    known = coefficients(N=1e-3, B=1e-3, K=1e-4)
    at_1s = np.sqrt(1e-6 + FLOOR**2 * 1e-6 + 1e-8 / 3)
    assert disagreement("dps", known, {"N_1s": reading(at_1s, tau_s=1.0)}) is None
    line = disagreement("dps", known, {"N_1s": reading(1.2 * at_1s, tau_s=1.0)})
    assert "from the deviation at 1 s" in line
    at_9s = np.sqrt(1e-6 / 9 + FLOOR**2 * 1e-6 + 3e-8) / FLOOR
    assert disagreement("dps", known, {"B": reading(at_9s, tau_s=9.0)}) is None
    assert disagreement("dps", known, {"B": reading(2 * at_9s, tau_s=9.0)}) is not None


def test_rounding_is_in_the_reading_and_the_cause():
    read = {"N": reading(np.hypot(1e-3, 2e-3), **DENSITY)}
    assert disagreement("dps", coefficients(), read, rounding=2e-3).endswith(
        "from the fit; cause: the step of the values"
    )
    assert disagreement("dps", coefficients(), read) is not None


FLOOR = np.sqrt(2 * np.log(2) / np.pi)
