"""What to do next: one action for each thing that is open, with the evidence to be expected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from allanscope.analysis import verdict
from allanscope.analysis.experiments import _turned, another_rate, measurements, next_experiments
from allanscope.analysis.line_families import fold
from allanscope.explain import Effect, Parameter
from allanscope.noise import Coefficient
from support.demo_analysis import demo_analysis

RATES = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1660.0)


def with_effects(**effects):
    """Return a result with these effects of its axes, everything detected."""
    analysis = demo_analysis()
    axes = {}
    for name, axis in analysis.axes.items():
        explanation = replace(axis.explanation, effects=effects.get(name, ()))
        known = {k: replace(c, detected=True, wait_s=None) for k, c in axis.coefficients.items()}
        axes[name] = replace(axis, explanation=explanation, coefficients=known)
    return replace(analysis, axes=axes, traces={})


def once(kind, gain=50.0, rivals=None, **numbers):
    evidence = {"gain_nats": gain, "replicated": "not replicated" if rivals is None else True}
    if rivals:
        evidence["rivals"] = rivals
    parameters = {k: Parameter(v, v, v, "s") for k, v in numbers.items()}
    return Effect(kind, parameters, equivalent=tuple(rivals or ()), evidence=evidence)


def test_nothing_is_advised_where_nothing_is_open():
    assert next_experiments(with_effects()) == ()


def test_a_warm_up_is_settled_by_a_second_one_that_gains_as_much():
    analysis = with_effects(gx=[once("warm_up", 50.0, time_constant=40.0)])
    (told,) = next_experiments(analysis)
    assert "switch it on again" in told.action
    assert told.duration_s == min(200.0, analysis.duration_s)
    assert told.gain_nats == 50.0


def test_two_processes_are_settled_in_proportion_to_what_they_differ_by():
    rivals = {"random_telegraph": 46.0}
    analysis = with_effects(gx=[once("gauss_markov", 48.0, rivals)])
    (told,) = next_experiments(analysis)
    # 2 nats in this record: 10 in five times as much.
    assert told.duration_s == pytest.approx(5 * analysis.duration_s)
    assert told.gain_nats == pytest.approx(10.0)
    assert told.question.startswith("between correlated noise and random telegraph on gx")


def test_a_step_is_settled_beside_a_second_board():
    (told,) = next_experiments(with_effects(gy=[once("step", 30.0, time=40.0)]))
    assert "second board" in told.action
    assert told.gain_nats == 30.0


def test_what_was_replicated_and_has_no_rival_is_settled():
    found = replace(once("step"), evidence={"gain_nats": 30.0, "replicated": True})
    assert next_experiments(with_effects(gy=[found])) == ()


def test_a_coefficient_that_was_not_detected_takes_the_time_that_the_verdict_says():
    analysis = with_effects()
    axis = analysis.axes["gx"]
    open_one = Coefficient(1e-6, 0.0, 4e-6, "dps/sqrt(s)", detected=False, wait_s=1000.0)
    axis = replace(axis, coefficients={**axis.coefficients, "K": open_one})
    analysis = replace(analysis, axes={**analysis.axes, "gx": axis})
    (told,) = next_experiments(analysis)
    assert told.duration_s == pytest.approx(analysis.duration_s + 1000.0)
    assert told.action == "record about 17 min longer, 2.3 h in all"
    line = verdict(analysis).lines[2]
    assert f"{line.head}: {line.text}" == (
        "Keep recording: K to ±20 % in about 17 min (2.3 h in all)"
    )
    assert told.is_of_noise
    assert "K of 0.43 °/h/√h" in told.expectation


def test_one_recording_decides_a_coefficient_of_all_axes():
    analysis = with_effects()
    axes = dict(analysis.axes)
    for size, (name, axis) in enumerate(axes.items(), 1):
        unit = f"{axis.unit}/sqrt(s)"
        late = Coefficient(1e-6, 0.0, 4e-6 * size, unit, detected=False, wait_s=100.0 * size)
        axes[name] = replace(axis, coefficients={**axis.coefficients, "K": late})
    (told,) = next_experiments(replace(analysis, axes=axes))
    assert told.question == "K of all axes, not detected"
    assert told.duration_s == pytest.approx(analysis.duration_s + 100.0 * len(axes))
    assert "°/h/√h and " in told.expectation


def test_a_measurement_that_decides_more_comes_first():
    analysis = with_effects(
        gx=[once("gauss_markov", 9.9, {"random_telegraph": 1.0})],
        gy=[once("step", 30.0, time=40.0)],
        gz=[once("step", 30.0, time=120.0)],
    )
    first, *rest = measurements(next_experiments(analysis))
    assert "second board" in first.action
    assert rest
    question = "whether the step on gy and 1 other finding, seen once, are external"
    assert [one.question for one in first.decided] == [question]
    assert f"decide {question}: record" in verdict(analysis).lines[2].text


def test_the_direction_of_a_coupling_is_settled_by_a_turn_of_the_board():
    def leak(source):
        numbers = {"source": Parameter(source), "slope": Parameter(0.3, 0.2, 0.4, "dps/dps")}
        return Effect("cross_coupling", numbers, axes=("gx", "gy"), evidence={"gain_nats": 90.0})

    analysis = with_effects(gx=[leak("gy")], gy=[leak("gx")])
    (told,) = next_experiments(analysis)
    assert "turn the board about its" in told.action
    assert told.gain_nats > 1000.0


@pytest.mark.parametrize(
    ("source", "unit", "how", "follows"),
    [
        ("gy", "g/dps", "turn the board about its y axis", "ax follows gy with 570 µg/dps"),
        ("ay", "g/g", "tilt the board along its y axis", "ax follows ay with 0.057 %"),
    ],
)
def test_what_is_moved_is_the_source_of_a_coupling(source, unit, how, follows):
    numbers = {"source": Parameter(source), "slope": Parameter(5.7e-4, 5e-4, 6e-4, unit)}
    told = _turned(Effect("cross_coupling", numbers), "ax", with_effects())
    assert told.action.startswith(how)
    assert told.expectation.startswith(follows)


def test_the_shortest_comes_first_and_into_the_verdict():
    analysis = with_effects(
        gx=[once("gauss_markov", 48.0, {"random_telegraph": 46.0})],
        gz=[once("warm_up", 50.0, time_constant=10.0)],
    )
    first, last = next_experiments(analysis)
    assert first.duration_s < last.duration_s
    assert first.action in verdict(analysis).lines[2].text
    told = analysis.to_dict()["experiments"]
    assert [one["action"] for one in told] == [first.action, last.action]


@pytest.mark.parametrize("seed", range(6))
def test_at_the_advised_rate_the_candidates_lie_apart(seed):
    rng = np.random.default_rng(seed)
    seen = rng.uniform(5.0, 47.0)
    places = sorted(k * 104.0 + s * seen for k in range(7) for s in (1, -1) if k or s > 0)
    told = another_rate(seen, 104.0, places, RATES, 0.1)
    at = sorted([seen * told.rate_hz / 104.0, *(fold(one, told.rate_hz) for one in places)])
    assert told.rate_hz > 104.0
    assert sum(np.diff(at) > 4 / told.duration_s) >= len(places) - 1


def test_a_weak_line_takes_longer():
    weak = another_rate(46.0, 104.0, (46.0, 58.0), RATES, 0.001)
    assert weak.duration_s == pytest.approx(10_000.0)
    assert weak.gain_nats == pytest.approx(10.0)
    assert another_rate(46.0, 104.0, (46.0, 58.0), RATES, 0.0) is None
