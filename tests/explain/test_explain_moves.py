"""Every move and gate of the search on small records made by hand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from allanscope.explain import Budget, search
from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate, ResidualError
from allanscope.explain.effects import KINDS, gauss_markov, narrowband
from allanscope.explain.effects.band_limit import BandLimit
from allanscope.explain.effects.gauss_markov import GaussMarkov
from allanscope.explain.effects.narrowband import Narrowband
from allanscope.explain.effects.outliers import Outliers
from allanscope.explain.effects.shock import Shock
from allanscope.explain.effects.sinusoid import Sinusoid
from allanscope.explain.effects.unexplained import Unexplained, tone_without_name
from allanscope.explain.gates import (
    growth,
    growth_remarks,
    is_measured,
    judge,
    penalties,
    penalty_passed,
    refused,
)
from allanscope.explain.moves import SearchPath
from allanscope.explain.moves import add as moves_of_adding
from allanscope.explain.moves import drop as moves_of_dropping
from allanscope.explain.moves import settle as settling
from allanscope.explain.moves.add import add, add_bundle, proposals, with_rivals
from allanscope.explain.moves.add_bands import add_bands
from allanscope.explain.moves.drop import drop, drop_taken_over, refuse
from allanscope.explain.moves.fold import fold_sidebands, fold_steps
from allanscope.explain.moves.give_back import give_back
from allanscope.explain.moves.refit import refit
from allanscope.explain.regression import ordinates_of
from allanscope.explain.residual import error_of
from allanscope.explain.search import close_loop
from allanscope.explain.series import Series
from allanscope.explain.view import View
from allanscope.noise.components import GaussMarkov as CorrelatedNoise
from allanscope.noise.components import LineProfile, White
from allanscope.noise.filters import Filter, HighPass, MovingAverage, OnePole

Array = NDArray[np.float64]

RATE, N = 50.0, 6000
TIME = np.arange(N) / RATE


def view_of(samples: Array) -> View:
    """Return the hypothesis that one axis is the textbook's noise."""
    rows = samples[:, np.newaxis]
    series = Series(("gx",), rows, RATE, 1, (1e-9,), None, np.zeros(len(rows), np.bool_))
    return View(series, series.grid, "gx", rows[:, 0], 0.0)


def noise(seed: int) -> Array:
    return np.asarray(np.random.default_rng(seed).standard_normal(N))


def line(frequency: float, amplitude: float) -> Array:
    return np.asarray(amplitude * np.sin(2 * np.pi * frequency * TIME + 0.3))


def lines_of(candidates: Iterable[Candidate]) -> list[Sinusoid]:
    return [c.effect for c in candidates if isinstance(c.effect, Sinusoid)]


def best_of(view: View, kind: str) -> Candidate:
    return max(KINDS[kind].candidates(view), key=lambda c: c.gain)


def test_add_takes_the_best_candidate_and_keeps_the_path() -> None:
    view, path = view_of(noise(1) + line(7.0, 0.4)), SearchPath()
    added = add(view, proposals(view, [KINDS["sinusoid"]], path), path)
    assert added is not None
    assert [c.kind for c in added.accepted] == ["sinusoid"]
    assert added.spectrum.loglik > view.spectrum.loglik
    assert [(step.move, step.outcome) for step in path.steps] == [("add", "accepted")]
    assert path.acceptances == 1


def test_add_refuses_what_gains_less_than_its_penalty() -> None:
    view, path = view_of(noise(2)), SearchPath()
    small = replace(best_of(view_of(noise(2) + line(7.0, 0.4)), "sinusoid"), gain=3.0)
    assert not penalty_passed(view, small, 0.0)
    assert add(view, [small], path) is None
    assert path.steps[0].outcome.startswith("penalty")


def test_every_effect_before_makes_the_next_dearer() -> None:
    view = view_of(noise(3) + line(7.0, 0.4))
    candidate = best_of(view, "sinusoid")
    just = replace(candidate, gain=candidate.penalty + 0.5)
    assert penalty_passed(view, just, 0.0)
    assert not penalty_passed(view.accept(candidate), just, 0.0)  # ln 2 more
    assert not penalty_passed(view, just, 0.6931)


def test_the_gate_of_adequacy_refuses_a_line_that_is_there_half_of_the_time() -> None:
    half = np.where(np.arange(N) < N // 2, 1.0, 0.0)
    view = view_of(noise(4) + half * line(7.0, 0.8))
    found, why = judge(view, best_of(view, "sinusoid"))
    assert found is None or found.kind == "unexplained", why


def test_the_gate_of_held_out_data_refuses_a_process_of_one_half_only() -> None:
    slow = np.convolve(noise(5), np.ones(200) / 14.0, "same")
    view = view_of(noise(6) + np.where(np.arange(N) < N // 4, 1.5 * slow, 0.0))
    candidate = best_of(view, "gauss_markov")
    found, why = judge(view, candidate)
    assert found is None or found.kind == "unexplained", why


def test_refit_moves_an_estimate_when_another_effect_has_been_taken_out() -> None:
    view = view_of(noise(7) + line(0.2, 1.0) + 2.0 * np.exp(-TIME / 20.0))
    path = SearchPath()
    first = view.accept(best_of(view, "sinusoid"))
    both = first.accept(best_of(first, "warm_up"))
    again = refit(both, path)
    size = next(c.effect.amplitude.value for c in again.accepted if isinstance(c.effect, Sinusoid))
    assert size == pytest.approx(1.0, abs=0.06)  # three standard errors
    assert path.evaluations == 2
    assert again.spectrum.loglik >= both.spectrum.loglik - 1e-6


def line_and_slow_noise() -> View:
    """Return a view in which a line and Gauss-Markov noise were found, in that order."""
    slow = lfilter([0.3], [1.0, -0.95], noise(9))
    view = view_of(noise(7) + line(7.0, 1.0) + slow)
    first = view.accept(best_of(view, "sinusoid"))
    return first.accept(best_of(first, "gauss_markov"))


def test_refit_keeps_a_process_that_would_be_less_likely(monkeypatch: pytest.MonkeyPatch) -> None:
    both = line_and_slow_noise()
    former = both.accepted[-1]
    worse = replace(former, parts=(CorrelatedNoise(1.0, 1e-3),))
    monkeypatch.setattr(GaussMarkov, "refine", lambda self, view: worse)
    assert refit(both, SearchPath()).accepted[-1].parts == former.parts


def test_refit_keeps_what_would_lose_its_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be dropped for that, and found again as it was, until the search is stopped."""
    both = line_and_slow_noise()
    former = both.accepted[-1]
    assert is_measured(former)

    def endless(self: GaussMarkov, view: View) -> Candidate:
        del view
        return replace(former, effect=replace(self, correlation_time=Estimate(1e9, unit="s")))

    monkeypatch.setattr(GaussMarkov, "refine", endless)
    again = refit(both, SearchPath()).accepted[-1]
    assert again.effect == former.effect


def test_drop_removes_what_no_longer_pays_and_it_is_not_taken_again() -> None:
    view, path = view_of(noise(8) + line(7.0, 0.6) + line(11.0, 0.4)), SearchPath()
    poor = replace(best_of(view, "sinusoid"), gain=1.0)
    grown = view.accept(poor)
    grown = grown.accept(best_of(grown, "sinusoid"))
    left = drop(grown, path)
    assert [round(line.frequency.value) for line in lines_of(left.accepted)] == [11]
    assert path.was_dropped(poor, view.grid)
    assert path.steps[-1].move == "drop"
    again = proposals(left, [KINDS["sinusoid"]], path)
    assert all(round(line.frequency.value) != 7 for line in lines_of(again))


def behind_low_pass(x: Array) -> Array:
    keep = np.exp(-2 * np.pi * 8.0 / RATE)
    return np.asarray(lfilter([1 - keep], [1, -keep], x))


def with_process_and_low_pass(
    samples: Array, low_s: float, high_s: float
) -> tuple[View, Candidate]:
    """Return a view with correlated noise and the low-pass that is found beside it."""
    view = view_of(samples)
    process = gauss_markov._candidate(view, low_s, high_s)
    first = view.accept(process)
    return first.accept(best_of(first, "band_limit")), process


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_process_that_a_low_pass_takes_over_is_dropped(seed: int) -> None:
    """Two poles: correlated noise is half of the bend, and the low-pass is found for the rest."""
    samples = behind_low_pass(behind_low_pass(noise(seed)))
    both, process = with_process_and_low_pass(samples, 0.02, 0.1)
    without = both.without(process)
    assert both.spectrum.loglik - without.spectrum.loglik > 100  # where that is left in its place
    left = drop_taken_over(both, SearchPath())
    assert [c.kind for c in left.accepted] == ["band_limit"]
    assert left.spectrum.loglik > both.spectrum.loglik - process.penalty


def test_what_others_are_far_from_taking_over_is_not_asked_again(monkeypatch) -> None:
    band = lfilter([1.0], [1.0, -1.6, 0.9], noise(5))
    slow = lfilter([1.0], [1.0, -0.99], noise(6))
    view = view_of(noise(4) + 0.3 * band / np.std(band) + 0.5 * slow / np.std(slow))
    for kind in ("narrowband", "gauss_markov"):
        view = view.accept(best_of(view, kind))
    monkeypatch.setattr(moves_of_dropping, "_LEAST", 1.0)
    path = SearchPath()
    assert drop_taken_over(view, path) is view
    assert path.evaluations == 3  # of four: what the band takes of the slow noise is asked again
    monkeypatch.setattr(moves_of_dropping, "_FAR", np.inf)
    path = SearchPath()
    assert drop_taken_over(view, path) is view
    assert path.evaluations == 4


def test_what_is_known_of_data_stays_where_they_do() -> None:
    view = view_of(noise(3) + line(7.0, 0.4))
    squares, tone = view.squares, best_of(view, "sinusoid")
    other_model = view.with_parts(OnePole(9.0)).without_range(3.0, 4.0)
    assert other_model.squares is squares
    assert other_model.of_data[Sinusoid] is view.of_data[Sinusoid]
    without_it = view.accept(tone)
    assert without_it.squares is not squares
    assert not without_it.of_data
    assert without_it.without(tone).squares is not without_it.squares
    spectrum = without_it.spectrum
    named = without_it.relisted(replace(c, rivals={"narrowband": 9.0}) for c in without_it.accepted)
    assert named.spectrum is spectrum


@pytest.mark.parametrize(
    ("corner", "stays"), [(40.0, True), (90.0, True), (130.0, False), (3000.0, False)]
)
def test_a_corner_stays_where_it_was_measured(corner, stays) -> None:
    """Among bands a high-pass was moved to 3 kHz, in a record of 500 Hz, to be a slope for them."""
    before, after = HighPass(40.0), HighPass(corner)
    assert settling._is_same(before, after, settling._FAR, 1 / 500) is stays
    assert settling._is_same(CorrelatedNoise(1.0, 0.1), CorrelatedNoise(1.0, 9.0), 0.1, 1 / 500)


def test_what_is_settled_stays_so_after_what_changes_no_model() -> None:
    view = view_of(noise(3)).accept(best_of(view_of(noise(3) + line(7.0, 0.4)), "sinusoid"))
    early, late = KINDS["step"], KINDS["variance_change"]
    for kind in (early, late):
        kind.proposed(view)
    louder = late(*[Estimate.exact(1.0)] * 4, blocks=9, rms=(1.0, 2.0), unit="dps")
    told = view.accept(Candidate(louder, 9.0))
    assert list(told.proposed) == [early]
    assert told.is_fitted_as(view, early.stage)
    assert not told.is_fitted_as(view, late.stage)
    other = view.relisted(replace(c, gain=1.0) for c in view.accepted)
    for changed in (told.with_parts(OnePole(9.0)), told.without_range(3.0, 4.0), other):
        assert not changed.is_fitted_as(view, early.stage)
    assert not view.without(view.accepted[0]).is_fitted_as(view, early.stage)


def test_what_others_take_over_is_asked_once_where_only_the_noise_level_is_told(
    monkeypatch,
) -> None:
    asked = []

    def ask(view: View, path: SearchPath) -> View:
        asked.append(view)
        return drop_taken_over(view, path)

    monkeypatch.setattr(search, "drop_taken_over", ask)
    data = noise(4)
    data[: len(data) // 4] *= 1.5
    found = close_loop(view_of(data))
    assert [c.kind for c in found.accepted] == ["variance_change"]
    assert len(asked) == 1


def test_a_process_and_a_low_pass_that_are_both_there_stay() -> None:
    slow = lfilter([0.2], [1, -np.exp(-1 / RATE)], noise(11))
    both, _ = with_process_and_low_pass(behind_low_pass(noise(1)) + slow, 0.3, 3.0)
    assert drop_taken_over(both, SearchPath()) is both


def following() -> tuple[Array, Array]:
    """Return noise a fifth of which is as loud as another axis, and that axis."""
    size = int(RATE) // 2
    envelope = np.repeat(np.exp(np.random.default_rng(3).normal(0, 0.8, N // size)), size)
    axis = noise(12) * np.sqrt(0.8 + 0.2 * envelope**2 / np.mean(envelope**2))
    return axis, 3 * envelope * noise(13)


def view_beside(axis: Array, source: Array) -> View:
    rows = np.column_stack([axis, source])
    series = Series(("gx", "gy"), rows, RATE, 1, (1e-9, 1e-9), None, np.zeros(N, np.bool_))
    return View(series, series.grid, "gx", rows[:, 0], 0.0)


@pytest.mark.parametrize("bad", [0.0, 12.0])
def test_outliers_that_a_coupling_explains_are_given_back(bad: float) -> None:
    axis, source = following()
    axis[1000] += bad
    view = view_beside(axis, source)
    signal = np.where(np.abs(axis) >= np.sort(np.abs(axis))[-4], axis, 0.0)
    view = view.accept(Candidate(Outliers(Estimate(4.0), 6.0), 50.0, signal=signal))
    view = view.accept(best_of(view, "amplitude_coupling"))
    path = SearchPath()
    left = give_back(view, path)
    assert [c.kind for c in left.accepted] == ["amplitude_coupling"]
    again = proposals(left, [KINDS["outliers"]], path)
    assert [c.parameters["count"].value for c in (one.effect for one in again)] == [1] * bool(bad)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_a_burst_is_given_back_to_noise_that_is_as_loud_as_it(times: float) -> None:
    axis, source = following()
    axis[1000:1100] *= times
    view = view_beside(axis, source)
    vars(view.series)["shocks"] = ()  # none is found again
    burst = Shock(*(Estimate(one) for one in (1000 / RATE, 100 / RATE, 9.0)))
    signal = np.where((np.arange(N) >= 1000) & (np.arange(N) < 1100), axis, 0.0)
    view = view.accept(Candidate(burst, 50.0, signal=signal))
    view = view.accept(best_of(view, "amplitude_coupling"))
    left = [c.kind for c in give_back(view, SearchPath()).accepted]
    assert left == ["shock"] * (times > 1) + ["amplitude_coupling"]


@pytest.mark.parametrize("seed", range(4, 8))
def test_a_jump_beside_a_telegraph_signal_is_no_hop(seed: int) -> None:
    at_s = np.sort(np.random.default_rng(seed).uniform(0, N / RATE, 60))
    hops = np.where(np.searchsorted(at_s, TIME) % 2, 1.0, -1.0)
    for size in (0.0, 4.0):
        jump = size * (at_s[30] < TIME)
        view = view_of(0.3 * noise(seed) + hops + jump)
        known = view.accept(best_of(view_of(0.3 * noise(seed) + hops), "random_telegraph"))
        step = best_of(view_of(0.3 * noise(seed) + (size or 2.0) * (at_s[30] < TIME)), "step")
        assert bool(refused(known, step)) is (size == 0.0)


def test_an_effect_that_makes_the_error_grow_is_refused_and_the_search_says_why() -> None:
    """A step where there is none bends the curve; the line beside it does not."""
    view = view_of(noise(8) + line(7.0, 0.6))
    good = best_of(view, "sinusoid")
    wrong = best_of(view_of(noise(8) + 4.0 * (TIME > 60)), "step")
    white = replace(view, base=(White(1.0),))  # no random walk that a step could hide in

    def error(one: View) -> ResidualError:
        return error_of(one, one.spectrum.model, None)

    before, grown = error(white), white.accept(good).accept(wrong)
    left = refuse(grown, before, error(grown), error)
    assert [c.kind for c in left.accepted] == ["sinusoid"]
    assert (left.path[-1].move, left.path[-1].kind) == ("drop", "step")
    assert left.path[-1].outcome.startswith("error: ")
    assert refuse(left, before, error(left), error) is left


@pytest.mark.parametrize("size", [0.0, 2.0])
def test_what_made_up_for_a_jump_that_is_refused_is_fitted_again(size: float) -> None:
    """Of two jumps that make up for each other one alone would leave a level that is not there."""
    view = view_of(noise(8) + size * (TIME > 60))
    white = replace(view, base=(White(1.0),))
    grown = white.accept(best_of(view_of(noise(8) + 5.0 * (TIME > 60)), "step"))
    wrong = best_of(view_of(noise(8) - (5.0 - size) * (TIME > 70)), "step")
    grown = grown.accept(wrong)

    def error(one: View) -> ResidualError:
        bad = any(c.effect.is_same(wrong.effect, one.grid) for c in one.accepted)
        return ResidualError(9.0 if bad else 1.0, 0.0, 9.0, 9.0, 2.0)

    left = refuse(grown, error(white), error(grown), error)
    assert [c.kind for c in left.accepted] == ["step"] * (size > 0)
    assert np.mean(left.data[TIME > 70]) == pytest.approx(np.mean(left.data[TIME < 60]), abs=0.1)


def test_what_gains_beyond_doubt_is_refused_only_where_no_error_is_larger_without_it() -> None:
    """What a second description of a line gains is that of the line, and says nothing of it."""
    view = view_of(noise(8) + line(7.0, 3.0))
    good = replace(best_of(view, "sinusoid"), gain=1e5)
    wrong = best_of(view_of(noise(8) + 4.0 * (TIME > 60)), "step")
    white = replace(view, base=(White(1.0),))

    def error(one: View) -> ResidualError:
        return error_of(one, one.spectrum.model, None)

    before, grown = error(white), white.accept(good).accept(replace(wrong, gain=1e5))
    assert growth(before, error(grown))[1]
    left = refuse(grown, before, error(grown), error)
    assert [c.kind for c in left.accepted] == ["sinusoid"]
    # Without the line the error is larger, whatever has grown beside it.
    little = replace(before, chi2_per_dof=0.1 * error(left).chi2_per_dof, worst_band_z=1.0)
    worse = replace(error(left), chi2_per_dof=30.0)
    assert refuse(left, little, worse, lambda one: worse if one is left else before) is left


@pytest.mark.parametrize(("rms", "kept"), [(25.9, True), (60.0, False)])
def test_what_gains_beyond_doubt_outweighs_an_rms_that_may_be_chance(
    rms: float, kept: bool
) -> None:
    """Of three long averaging times it was twice what sampling leaves: a jump of 200 mdps went."""
    view = view_of(noise(8) + 8.0 * (TIME > 60))
    grown = view.accept(replace(best_of(view, "step"), gain=1756.0))
    before = ResidualError(0.5, 0.9, 15.0, 15.4, 1.9)
    after = ResidualError(1.9, 0.1, rms, 12.5, -2.5)
    left = refuse(grown, before, after, lambda one: after if one.accepted else before)
    assert [c.kind for c in left.accepted] == ["step"] * kept


@pytest.mark.parametrize(("gain", "told"), [(40.0, []), (80.0, ["unexplained"])])
def test_a_relaxation_that_is_plain_is_told_where_its_form_is_refused(
    gain: float, told: list[str]
) -> None:
    """That the level relaxes anyone sees; the model of it made chi-square grow from 3 to 9."""
    view = view_of(noise(8) + 3.0 * np.exp(-TIME / 15.0))
    warm = replace(best_of(view, "warm_up").finished(), gain=gain)
    before, grown = ResidualError(3.0, 0.0, 14.0, 13.0, 3.0), ResidualError(9.0, 0.0, 9.0, 9.0, 3.0)
    taken_out = view.accept(warm)
    left = refuse(taken_out, before, grown, lambda one: grown if one.has("warm_up") else before)
    assert [c.kind for c in left.accepted] == told
    assert np.allclose(left.data, view.data, atol=1e-12)  # what is told is not taken out


def test_nothing_is_kept_of_a_model_whose_error_is_absurd() -> None:
    view = view_of(noise(8) + line(3.0, 0.6) + line(7.0, 0.6))
    before = ResidualError(144.0, 0.0, 9.0, 9.0, 2.0)
    absurd = replace(before, chi2_per_dof=7e4)
    for _ in range(2):
        view = view.accept(replace(best_of(view, "sinusoid"), gain=1e6))
    left = refuse(view, before, absurd, lambda one: absurd if one.accepted else before)
    assert left.accepted == ()
    assert [step.kind for step in left.path] == ["sinusoid", "sinusoid"]
    # One that is to blame goes alone, whatever it gains.
    [first, _] = view.accepted
    alone = refuse(view, before, absurd, lambda one: absurd if first in one.accepted else before)
    assert [c.kind for c in alone.accepted] == ["sinusoid"]
    assert first not in alone.accepted


def test_where_no_one_is_to_blame_nothing_is_refused() -> None:
    """What is left of many lines is judged by the smaller sampling error of the better model."""
    view = view_of(noise(8) + sum(line(f, 0.6) for f in (3.0, 5.0, 7.0, 11.0, 13.0)))
    for _ in range(4):
        view = view.accept(best_of(view, "sinusoid"))
    before, grown = ResidualError(2.0, 0.5, 9.0, 9.0, 2.0), ResidualError(90.0, 0.0, 9.0, 9.0, 2.0)
    assert refuse(view, before, grown, lambda _: grown) is view


def test_an_error_may_grow_by_what_sampling_leaves() -> None:
    before = ResidualError(0.8, 0.7, 6.1, 11.0, -2.0)
    assert growth(before, ResidualError(1.3, 0.2, 9.7, 11.0, 3.0)) == (0.0, "")
    assert "chi-square" in growth(before, ResidualError(9.0, 1e-9, 9.7, 11.0, 3.0))[1]
    assert "worst band" in growth(before, ResidualError(1.3, 0.2, 9.7, 11.0, -9.0))[1]
    assert "rms" in growth(before, ResidualError(1.3, 0.2, 24.7, 11.0, 3.0))[1]


def test_an_rms_that_grows_beyond_sampling_is_said_with_what_sampling_leaves() -> None:
    before = ResidualError(2.3, 0.01, 9.48, 12.0, 3.0)
    assert growth_remarks(before, ResidualError(1.7, 0.1, 10.7, 10.8, 3.0)) == ()
    assert growth_remarks(before, ResidualError(1.7, 0.1, 15.4, 10.8, 3.0)) == (
        "rms over averaging times grows from 9.48 to 15.4 %; sampling error alone leaves 10.8 %",
    )
    both = growth_remarks(before, ResidualError(90.0, 0.0, 35.4, 10.8, 3.0))
    assert [line.partition(" grows")[0] for line in both] == [
        "chi-square per degree of freedom",
        "rms over averaging times",
    ]


def test_what_some_blocks_gain_and_others_lose_is_a_piece_of_something_else(monkeypatch) -> None:
    view = view_of(noise(3) + 2.0 * (TIME > 60))
    step = best_of(view, "step")
    assert judge(view, step)[0] is not None
    held = HeldOut(20.0, 300.0, "interleaved blocks of 1 s")
    monkeypatch.setattr(type(step.effect), "hold_out", lambda *_: held)
    assert judge(view, step)[0] is None


def test_sidebands_are_folded_into_one_tone() -> None:
    modulated = (1 + 0.6 * np.cos(2 * np.pi * 0.5 * TIME)) * line(9.0, 1.0)
    view, path = view_of(noise(9) + modulated), SearchPath()
    for _ in range(3):
        view = view.accept(best_of(view, "sinusoid"))
    folded = fold_sidebands(view, path)
    assert [c.kind for c in folded.accepted] == ["unexplained"]
    tone = folded.accepted[0].effect
    assert isinstance(tone, Unexplained)
    assert tone.frequency_low.value < 8.5
    assert tone.frequency_high.value > 9.5
    assert path.steps[-1].move == "fold sidebands"


def test_three_unrelated_lines_are_not_folded() -> None:
    view = view_of(noise(10) + line(5.0, 0.5) + line(9.0, 0.5) + line(14.7, 0.5))
    for _ in range(3):
        view = view.accept(best_of(view, "sinusoid"))
    assert fold_sidebands(view, SearchPath()) is view


def test_a_rival_that_gained_as_much_and_now_gains_nothing_is_named() -> None:
    view = view_of(noise(11) + line(7.0, 0.4))
    accepted = best_of(view, "sinusoid")
    band = Narrowband(Estimate(7.0), Estimate(0.1), Estimate(0.3))
    rival = replace(accepted, effect=band, gain=accepted.gain - 1.0)
    after = with_rivals(view.accept(accepted), [accepted, rival], [])
    assert after.accepted[-1].equivalent == ("narrowband",)
    stays = with_rivals(view.accept(accepted), [accepted, rival], [rival])
    assert stays.accepted[-1].equivalent == ()


def test_a_search_ends_where_its_bounds_are_and_says_so() -> None:
    view = view_of(noise(12) + line(7.0, 0.5) + line(11.0, 0.5) + line(17.0, 0.5))
    stopped = close_loop(view, Budget(acceptances=1))
    named = [c.kind for c in stopped.accepted if c.kind != "unexplained"]
    assert named == ["sinusoid"]
    assert "stopped" in stopped.stopped
    whole = close_loop(view)
    assert [c.kind for c in whole.accepted].count("sinusoid") == 3
    assert whole.stopped == ""
    assert {step.move for step in whole.path} >= {"add"}


def test_what_is_owed_is_the_penalty_of_all_that_was_added() -> None:
    view = view_of(noise(13) + line(7.0, 0.4))
    candidate = best_of(view, "sinusoid")
    assert penalties(view.accept(candidate), 0) == pytest.approx(candidate.penalty)
    assert penalties(view.accept(candidate), 1) == pytest.approx(np.log(2))


@pytest.mark.parametrize(("back", "kinds"), [(-0.8, ["excursion"]), (-0.4, ["step", "step"])])
def test_two_opposite_steps_are_one_excursion_where_they_are_of_one_size(
    back: float, kinds: list[str]
) -> None:
    view, path = view_of(noise(14) + 0.8 * (TIME >= 40) + back * (TIME >= 70)), SearchPath()
    for _ in range(2):
        view = view.accept(best_of(view, "step"))
    folded = fold_steps(view, path)
    assert [c.kind for c in folded.accepted] == kinds
    if kinds == ["excursion"]:
        box = folded.accepted[0].effect.parameters
        assert box["time"].value == pytest.approx(40, abs=0.5)
        assert box["duration"].value == pytest.approx(30, abs=0.5)


def test_each_stage_has_a_budget_of_its_own_and_is_named_where_it_ends() -> None:
    path = SearchPath()
    path.enter(3)
    path.evaluations += 3
    assert path.is_spent
    path.enter(3)
    assert not path.is_spent
    assert path.remark == ""
    path.stop("outliers")
    assert "stopped (outliers)" in path.remark
    lines = [line(f, 0.5) for f in (5.0, 7.0, 11.0, 13.0, 17.0)]
    stopped = close_loop(view_of(noise(12) + np.sum(lines, axis=0)), Budget(evaluations=40))
    assert "level and spectrum" in stopped.stopped


@pytest.mark.parametrize(
    ("error", "size"), [(0.2, "its rms is 0.100 mdps"), (2.0, "its rms is below 0.297 mdps")]
)
def test_power_that_may_be_none_has_a_limit_for_its_size(error: float, size: str) -> None:
    view = view_of(noise(1))
    searched = Candidate(Sinusoid(Estimate.of(4.5, 0.1, "Hz"), Estimate.of(1.0, 0.1, "dps")), 20.0)
    left = tone_without_name(view, LineProfile(1e-4, 4.0, 5.0, (1.0,)), error, searched)
    assert left.words.endswith(size)


def test_what_rows_are_too_slow_to_show_is_no_gauss_markov_noise() -> None:
    slow, fast = (
        lfilter([1 - phi], [1, -phi], noise(seed)) for seed, phi in ((2, np.exp(-0.1)), (3, 0.13))
    )
    assert list(KINDS["gauss_markov"].candidates(view_of(0.2 * noise(4) + slow)))
    assert not list(KINDS["gauss_markov"].candidates(view_of(fast)))


def test_no_low_pass_lowers_the_density_far_below_its_cutoff() -> None:
    share = np.fft.rfftfreq(N) / 0.3
    bent = np.fft.irfft(np.fft.rfft(noise(5)) / np.sqrt(1 + share**0.7), N)
    found = best_of(view_of(bent), "band_limit").effect
    assert isinstance(found, BandLimit)
    assert found.order is not None
    assert found.order >= 1.0


@pytest.mark.parametrize("filters", [(), (OnePole(8.0),), (MovingAverage.over(16, 1 / RATE),)])
def test_slow_signals_are_weighed_as_the_spectrum_of_the_fit_weighs_them(
    filters: tuple[Filter, ...],
) -> None:
    """At a zero of a filter there is leakage, and no signal is measured by what is not there."""
    view = view_of(noise(9)).with_parts(*filters)
    for m in (100, view.grid.low):
        np.testing.assert_allclose(
            view.fitter.first(view.spectrum.powers, m), view.spectrum.first(m), rtol=1e-12
        )


def test_a_search_for_a_band_is_left_where_it_has_become_a_line(monkeypatch) -> None:
    looked = []

    def counted(window: narrowband._Window, point: Array) -> float:
        looked[-1] += 1
        return loss(window, point)

    loss = narrowband._Window.loss
    monkeypatch.setattr(narrowband._Window, "loss", counted)
    view = view_of(noise(4))
    (first, width), *_ = narrowband._runs(view)
    for collapsed in (narrowband._COLLAPSED, 0.0):
        looked.append(0)
        monkeypatch.setattr(narrowband, "_COLLAPSED", collapsed)
        found = narrowband._fit_shape(view, first, width, narrowband._resonance)
        assert isinstance(found, narrowband._FaintLine)
    assert looked[0] < 0.3 * looked[1]


def test_a_faint_band_is_fitted_once_as_well_as_from_every_run_and_by_both_shapes(
    monkeypatch,
) -> None:
    """Where it is narrow the two have one spectrum, and every run around it leads to it."""
    followed = narrowband._fit_shape
    shapes: list[narrowband.Shape] = []

    def counted(*of):
        shapes.append(of[-1])
        return followed(*of)

    monkeypatch.setattr(narrowband, "_fit_shape", counted)
    pole = np.exp((-np.pi * 0.08 + 2j * np.pi * 12.0) / RATE)
    for seed in range(8):
        rng = np.random.default_rng([312, seed])
        driven = rng.standard_normal(N) + 1j * rng.standard_normal(N)
        tone = np.sqrt(1 - abs(pole) ** 2) * lfilter([1.0], [1.0, -pole], driven).real
        view = view_of(noise(seed) + 0.2 * tone)
        shapes.clear()
        (once,) = Narrowband.propose(view)
        assert shapes == [narrowband._resonance]
        with monkeypatch.context() as m:
            m.setattr(narrowband, "_ONE_SHAPE", 0.0)
            m.setattr(narrowband, "_is_around", lambda *_: False)
            (every,) = Narrowband.propose(view)
        assert len(shapes) == 5
        assert once.gain == pytest.approx(every.gain, abs=0.2)
        apart = abs(once.effect.frequency.value - every.effect.frequency.value)
        assert apart < 0.2 * every.effect.frequency.error


def test_what_is_left_at_a_first_fit_would_not_have_passed(monkeypatch) -> None:
    """Bands around the penalty: those that pass are the same when every one is followed."""

    def told(view: View) -> Candidate | None:
        found = list(Narrowband.propose(view))
        return found[0] if found and found[0].excess > 0 else None

    followed = narrowband._fit_shape
    passed = 0
    for seed in range(24):
        rng = np.random.default_rng([311, seed])
        f0, width = rng.uniform(2.0, 20.0), rng.uniform(0.05, 2.0)
        near = np.abs(np.fft.rfftfreq(N, 1 / RATE) - f0) < width / 2
        band = np.fft.irfft(near * np.fft.rfft(rng.normal(size=N)), N)
        view = view_of(noise(seed) + rng.uniform(0.0, 1.2) * band)
        quick = told(view)
        with monkeypatch.context() as m:
            m.setattr(narrowband, "_HOPELESS", -np.inf)
            m.setattr(
                narrowband,
                "_fit_shape",
                lambda *of: (
                    None if isinstance(one := followed(*of), narrowband._FaintLine) else one
                ),
            )
            assert told(view) == quick
        passed += quick is not None
    assert 4 < passed < 20


def test_what_a_scan_says_of_a_step_is_its_score_and_information() -> None:
    """The information of every box is that of its ordinates under the fitted noise."""
    view = view_of(noise(12))
    variance = view.spectrum.ordinates
    boxes = [(range(1000, 1500, 150), 200), (range(17, 18), 4983), (range(2500, 2501), 3490)]
    found = [
        (a, a + n, g) for at, n in boxes for a, g in zip(at, view.scan.boxes(at, n), strict=True)
    ]
    for a, b, gain in found:
        box = ordinates_of(((a / RATE - 1e-9 <= TIME) & (b / RATE - 1e-9 > TIME)).astype(float))
        score, information = np.sum(box * view.ordinates / variance), np.sum(box**2 / variance)
        assert gain == pytest.approx(score**2 / information / 2, rel=1e-3)


def test_only_candidates_that_are_picked_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    from allanscope.explain import effects

    calls = []
    measure = effects.marginal_covariance
    monkeypatch.setattr(
        effects, "marginal_covariance", lambda *given: calls.append(given) or measure(*given)
    )
    path, view = SearchPath(), view_of(noise(11))
    slow = [KINDS[kind] for kind in ("ramp", "step", "excursion")]
    found = proposals(view, slow, path)
    assert len(found) == len(slow)
    assert proposals(view, slow, path) == found  # a view is asked once
    assert not calls
    add(view, found, path)
    assert len(calls) == 1  # the best, which is noted
    finished = found[0].finished()
    assert finished.gain == found[0].gain
    assert finished.signal is not None
    again = KINDS["ramp"].candidates(view)[0].effect.refine(view)
    assert again is not None
    assert again.effect == finished.effect


def test_nothing_is_asked_beside_a_first_member_that_misses_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In noise: a step that misses 6.7 nats of its penalty, which no bundle begins with."""
    view, path = view_of(noise(7)), SearchPath()
    kinds = [kind for kind in KINDS.values() if kind.is_slow and kind.available(view)]
    found = proposals(view, kinds, path)
    assert max(c.excess for c in found if c.gain > 5.0) == pytest.approx(-6.7, abs=0.1)
    asked = path.evaluations
    assert add_bundle(view, kinds, found, path) is None
    assert path.evaluations == asked
    monkeypatch.setattr(moves_of_adding, "_ALONE", 7.0)
    assert add_bundle(view, kinds, found, path) is None
    assert path.evaluations > asked


LONG = 10 * N
SWING = np.cumsum(0.4 * np.sin(np.arange(LONG) / 26) + 0.3 * np.sin(np.arange(LONG) / 61))


@pytest.mark.parametrize(
    ("tone", "looks"),
    [
        pytest.param(
            np.repeat([1, 0, 1, 0, 1, 0], LONG // 6)
            * lfilter([0.3], [1, -0.6, 0.95], np.random.default_rng(2).standard_normal(LONG)),
            0,
            id="comes and goes",
        ),
        pytest.param(
            2 * np.sin((20 * np.pi * np.arange(LONG) + 2 * np.pi * SWING) / RATE), 2, id="swings"
        ),
    ],
)
def test_others_are_looked_for_once_beside_a_band_that_does_not_hold(tone, looks):
    """Each look is a second on a million rows, and eight of them did not make it another tone."""
    view, path = view_of(np.random.default_rng(1).standard_normal(LONG) + tone), SearchPath()
    candidates = proposals(view, [Narrowband, BandLimit], path)
    first = path.evaluations
    assert add_bands(view, candidates, path) is None
    assert path.evaluations <= first + looks
    second = path.evaluations
    assert add_bands(view, candidates, path) is None
    assert path.evaluations == second
