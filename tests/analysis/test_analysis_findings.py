"""Findings: what is one disturbance is one, and what only looks alike is not."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

from allanscope import analyse
from allanscope.analysis import finding_phrase, findings_of, verdict
from allanscope.analysis.finding_phrases import finding_sentence
from allanscope.analysis.findings import Finding, Member
from allanscope.explain import Effect, Parameter
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import KINDS, VOCABULARY, EffectKind
from allanscope.report import render
from allanscope.view.tables import findings_table
from support.demo_analysis import demo_analysis


def effect(kind, gain=10.0, axes=(), **numbers):
    """Return an effect; a number is (value, half of its interval, unit) or a name."""
    parameters = {
        name: Parameter(one)
        if isinstance(one, str)
        else Parameter(one[0], one[0] - one[1], one[0] + one[1], one[2])
        for name, one in numbers.items()
    }
    evidence = {"gain_nats": gain}
    return Effect(kind, parameters, axes=axes, evidence=evidence)


def line(hz, half=1e-3, dps=0.02, gain=10.0):
    found = {"frequency": (hz, half, "Hz"), "amplitude": (dps, 0.001, "dps")}
    return effect("sinusoid", gain, **found)


def step(s, gain=10.0):
    return effect("step", gain, time=(s, 0.05, "s"), size=(0.01, 0.001, "dps"))


def excursion(s, duration_s):
    found = {"time": (s, 0.05, "s"), "duration": (duration_s, 0.1, "s"), "size": (1.0, 0.1, "dps")}
    return effect("excursion", **found)


def sizes(effects):
    return sorted((len(one.members) for one in findings_of(effects)), reverse=True)


def test_one_line_on_three_axes_is_one_finding():
    found = findings_of({"gx": [line(7.0)], "gy": [line(7.002)], "az": [line(6.999)]})
    assert [one.axes for one in found] == [("gx", "gy", "az")]
    assert finding_phrase(found[0]) == "line at 7 Hz, 20 mdps"


def test_a_slow_line_is_told_by_its_period():
    (found,) = findings_of({"gx": [line(0.0014, 1e-5)]})
    assert finding_phrase(found) == "line at 0.0014 Hz (period 11 min 54 s), 20 mdps"


@pytest.mark.parametrize(
    ("spans", "said"),
    [
        (((723.0, 758.0),), ", at 12 min 3 s for 35 s"),
        (((0.0, 200.0), (500.0, 650.0)), ", in 28 % of the record"),
    ],
)
def test_a_line_that_comes_and_goes_says_when(spans, said):
    found = {"frequency": (48.0, 0.1, "Hz"), "sigma": (0.012, 0.001, "dps")}
    whole = effect("drifting_line", **found)
    partly = replace(whole, evidence=whole.evidence | {"present": spans, "share_of_time": 0.28})
    phrases = [finding_phrase(findings_of({"gx": [one]})[0]) for one in (whole, partly)]
    assert phrases[1] == phrases[0] + said


def test_signals_of_other_dwell_times_are_two_however_wide_their_intervals():
    def hops(dwell_s, half_s):
        size = (8.0e-3, 1e-3, "dps")
        return effect("random_telegraph", amplitude=size, dwell=(dwell_s, half_s, "s"))

    assert sizes({"gy": [hops(77.0, 50.0)], "gz": [hops(8.7, 1.0)]}) == [1, 1]
    assert sizes({"gy": [hops(12.0, 4.0)], "gz": [hops(8.7, 1.0)]}) == [2]


def test_a_harmonic_beyond_nyquist_belongs_to_its_fundamental():
    # 3 x 41 Hz and 4 x 41 Hz at 104 Hz are seen at 19 and 44 Hz.
    places = [(41.0, 0.02), (19.0, 0.005), (44.0, 0.002), (13.37, 0.01)]
    lines = {"gx": [line(hz, 1e-4, dps) for hz, dps in places]}
    comb, alone = findings_of(lines, rate_hz=104.0)
    assert (comb.harmonics, comb.folded) == ((3, 4), (3, 4))
    assert finding_phrase(comb).endswith("with harmonics 3 and 4 (3 and 4 folded)")
    assert len(alone.members) == 1
    assert len(findings_of(lines)) == 4


@pytest.mark.parametrize(
    ("frequencies", "mixed"),
    [
        ((30.0, 28.7, 31.3), ("f - 1.3 Hz", "f + 1.3 Hz")),
        ((20.0, 21.5, 23.0, 24.5), ("f + 1.5 Hz", "f + 3 Hz", "f + 4.5 Hz")),
        ((30.0, 7.3, 37.3), ("f + 7.3 Hz", "7.3 Hz")),
        ((30.0, 2.6, 27.4, 32.6), ("f - 2.6 Hz", "f + 2.6 Hz", "2.6 Hz")),
        ((44.3, 50.2, 9.5), ("50.2 Hz", "f - 34.8 Hz")),
        ((20.3, 31.7), ("fs/2 - f",)),
        ((20.3, 5.7), ("fs/4 - f",)),
        ((20.2, 30.3), ("3/2 f",)),
        ((20.3, 33.1, 11.9), ()),
    ],
)
def test_lines_that_are_made_of_others_are_one_finding(frequencies, mixed):
    # The second and third add up to the fundamental, or are mixed; the first is the strongest.
    lines = {"gx": [line(f, 1e-5, gain=100.0 - k) for k, f in enumerate(frequencies)]}
    found = findings_of(lines, rate_hz=104.0)
    assert sum(len(one.members) for one in found) == len(frequencies)
    assert sorted(found[0].mixed) == sorted(mixed)
    assert len(found) == (1 if mixed else len(frequencies))


def test_lines_are_not_made_of_others_by_chance():
    rng = np.random.default_rng(6)
    joined = 0
    for _ in range(200):
        lines = {"gx": [line(f, 3e-4) for f in rng.uniform(5, 50, 5)]}
        joined += any(one.mixed or one.folded for one in findings_of(lines, rate_hz=104.0))
    # Three sorts of relations, each with a hundredth by chance in the whole record at the most.
    assert joined <= 8


def test_lines_are_no_folded_harmonics_by_chance():
    rng = np.random.default_rng(5)
    joined = 0
    for _ in range(200):
        lines = {"gx": [line(f, 1e-4) for f in rng.uniform(3.0, 51.0, 5)]}
        joined += any(one.folded for one in findings_of(lines, rate_hz=104.0))
    assert joined <= 5
    vague = {"gx": [line(41.0, half=0.05), line(19.0, half=0.05)]}
    assert not any(one.folded for one in findings_of(vague, rate_hz=104.0))


def test_lines_beyond_their_intervals_are_two():
    assert sizes({"gx": [line(7.0)], "gy": [line(7.01)]}) == [1, 1]
    assert sizes({"gx": [line(7.0, half=4e-3)], "gy": [line(7.01, half=4e-3)]}) == [2]


def test_harmonics_belong_to_their_fundamental():
    effects = {"gx": [line(21.0, gain=50), line(7.0)], "gy": [line(14.001, dps=0.005)]}
    (found,) = findings_of(effects)
    assert (found.kind, found.harmonics, found.gain_nats) == ("sinusoid", (2, 3), 70.0)
    assert found.members[0].effect is effects["gx"][1]
    assert [(one.axis, one.index) for one in found.members] == [("gx", 1), ("gy", 0), ("gx", 0)]
    assert finding_phrase(found) == "line at 7 Hz, 20 mdps, with harmonics 2 and 3"


@pytest.mark.parametrize("hz", [14.02, 10.5, 17.5, 3.3])
def test_what_is_no_multiple_stands_alone(hz):
    assert sizes({"gx": [line(7.0), line(hz)]}) == [1, 1]


def test_a_slow_line_is_no_fundamental_of_everything():
    """At 0.01 +- 0.001 Hz any line is a multiple by chance."""
    assert sizes({"gx": [line(0.01, half=1e-3), line(0.07), line(5.0)]}) == [1, 1, 1]


def test_a_wide_resonance_is_no_harmonic_of_a_narrow_line():
    """Swaying of 0.564 Hz over 4 mHz, and a resonance of the mounting at 20.29 Hz."""

    def band(hz, width_hz):
        numbers = {"frequency": (hz, 0.001, "Hz"), "bandwidth": (width_hz, 0.1 * width_hz, "Hz")}
        return effect("narrowband", **numbers, sigma=(0.01, 0.001, "dps"))

    assert sizes({"gx": [band(1.691, 0.005)], "gz": [band(20.29, 0.68)]}) == [1, 1]
    assert sizes({"gx": [band(1.691, 0.005)], "gz": [band(20.29, 0.06)]}) == [2]


def test_a_line_in_a_band_is_one_with_it():
    numbers = {"frequency": (7.3, 0.05, "Hz"), "bandwidth": (1.0, 0.1, "Hz")}
    band = effect("narrowband", **numbers, sigma=(0.01, 0.001, "dps"))
    assert sizes({"gx": [line(7.0), band]}) == [2]
    assert sizes({"gx": [line(9.0), band]}) == [1, 1]


def test_a_line_in_a_band_of_another_axis_is_another():
    """Broad vibration of 1.9 Hz around 16.8 Hz, and a line of 0.03 Hz at 15.8 Hz."""

    def band(hz, width_hz):
        numbers = {"frequency": (hz, 0.04, "Hz"), "bandwidth": (width_hz, 0.1 * width_hz, "Hz")}
        return effect("narrowband", **numbers, sigma=(0.01, 0.001, "dps"))

    assert sizes({"gx": [band(16.8, 1.9)], "ax": [band(15.8, 0.03)]}) == [1, 1]
    assert sizes({"gx": [band(16.8, 1.9)], "ax": [line(16.5)]}) == [1, 1]
    assert sizes({"gx": [band(16.8, 1.9)], "ax": [band(16.2, 1.2)]}) == [2]
    assert sizes({"gx": [band(13.39, 0.13)], "ax": [band(13.38, 0.006)]}) == [2]


def test_what_happens_at_one_time_is_one_event():
    burst = {"intervals": (1.0, 0.0, ""), "start": (299.6, 0.1, "s"), "stop": (301.0, 0.1, "s")}
    effects = {
        "gx": [step(300.0, gain=90.0), step(300.6)],
        "gy": [excursion(300.2, 25.0)],
        "gz": [effect("variance_change", **burst)],
        "ax": [step(325.3)],
    }
    (found,) = findings_of(effects)
    assert (found.kind, len(found.members)) == ("step", 5)
    assert finding_phrase(found) == (
        "steps, excursion and noise level change at 5 min to 5 min 25 s"
    )
    assert sizes({"gx": [step(300.0)], "gy": [step(302.0)]}) == [1, 1]
    shock = effect("shock", time=(300.0, 0.1, "s"), duration=(6.0, 0.1, "s"), peak=(9.0, 1.0, "g"))
    assert sizes({"ax": [shock], "ay": [step(303.0)], "gx": [step(308.0)]}) == [2, 1]


def band(low, high):
    numbers = {"frequency_low": (low, 0.0, "Hz"), "frequency_high": (high, 0.0, "Hz")}
    return effect("unexplained", **numbers, share=(0.2, 0.01, ""))


def test_two_that_have_no_name_are_not_one_for_that():
    assert sizes({"gx": [band(1.0, 2.0)], "gy": [band(1.0, 20.0)]}) == [1, 1]
    assert sizes({"gx": [band(1.0, 2.0), band(5.0, 6.0)]}) == [1, 1]
    assert sizes({"gx": [band(1.0, 2.0)], "gy": [band(1.0, 2.0)]}) == [2]


def test_a_narrow_band_is_where_it_is():
    assert sizes({"gx": [band(31.0, 33.1)], "gy": [band(32.9, 33.5)]}) == [2]
    assert sizes({"gx": [band(31.0, 33.1), band(32.9, 33.5)]}) == [1, 1]
    assert sizes({"gx": [band(31.0, 33.1)], "gy": [band(33.2, 33.5)]}) == [1, 1]
    assert sizes({"gx": [band(31.0, 33.1)], "gy": [line(32.3)]}) == [2]
    assert sizes({"gx": [band(30.0, 38.0)], "gy": [line(32.3)]}) == [1, 1]
    assert sizes({"gx": [band(31.0, 33.1)], "gy": [line(34.0)]}) == [1, 1]


def test_a_kind_without_a_place_is_one_where_all_of_it_agrees():
    def process(tc):
        numbers = {"sigma": (0.01, 0.001, "dps"), "correlation_time": (tc, 0.5, "s")}
        return effect("gauss_markov", **numbers)

    assert sizes({"gx": [process(5.0)], "gy": [process(5.3)]}) == [2]
    assert sizes({"gx": [process(5.0)], "gy": [process(50.0)]}) == [1, 1]
    assert sizes({"gx": [process(5.0), process(5.3)]}) == [1, 1]
    warm = [effect("temperature", slope=(one, 0.01, "dps/degC")) for one in (0.1, -0.5)]
    assert sizes({"gx": warm[:1], "gy": warm[1:]}) == [2]


def test_the_two_time_constants_of_a_warm_up_are_told_apart():
    def warming(tau_s, dps):
        found = {"time_constant": (tau_s, 0.1 * tau_s, "s"), "amplitude": (dps, 0.001, "dps")}
        return effect("warm_up", axes=("gx", "gy"), **found)

    effects = {
        "gx": [warming(100.0, 0.1), warming(1800.0, 0.05)],
        "gy": [warming(110.0, -0.2), warming(2000.0, -0.09)],
    }
    (found,) = findings_of(effects)
    assert len(found.members) == 4
    times = "1 min 40 s to 1 min 50 s and 30 min to 33 min 20 s"
    assert finding_phrase(found) == f"warm-up, -200 to 100 mdps, time constant {times}"
    (alone,) = findings_of({"gx": effects["gx"]})
    assert finding_phrase(alone).endswith("50 to 100 mdps, time constant 1 min 40 s and 30 min")


def test_couplings_are_one_by_their_source_or_by_each_other():
    def leak(source):
        return effect("cross_coupling", source=source, slope=(0.3, 0.01, "dps/g"))

    assert sizes({"gx": [leak("ax")], "gy": [leak("ax")], "gz": [leak("ay")]}) == [2, 1]
    assert sizes({"gx": [leak("gy")], "gy": [leak("gx")]}) == [2]


@pytest.mark.parametrize(
    ("sources", "said"),
    [
        ("ay", "cross-coupling from ay, 30 %"),
        ("ay az", "cross-coupling from ay and az, 30 %"),
        ("ay az gx", "mutual cross-coupling"),
    ],
)
def test_many_couplings_are_one_word(sources, said):
    slope = (0.3, 0.01, "g/g")
    couplings = [effect("cross_coupling", source=s, slope=slope) for s in sources.split()]
    members = tuple(Member("ax", i, one) for i, one in enumerate(couplings))
    assert finding_phrase(Finding("cross_coupling", ("ax",), members, 10.0)) == said


def test_what_is_of_the_stream_is_no_finding_of_an_axis():
    clock = effect("clock_error", relative=(1e-4, 1e-6, ""))
    assert findings_of({"gx": [clock], "gy": [clock]}) == ()


def test_the_verdict_names_the_three_largest_and_counts_the_rest():
    analysis = demo_analysis(7300.0)
    many = tuple(line(hz, gain=hz) for hz in (7.1, 11.3, 13.7, 17.9, 23.3))
    axis = analysis.axes["gx"]
    axes = {"gx": replace(axis, explanation=replace(axis.explanation, effects=many))}
    known = replace(analysis, axes=axes)
    told = verdict(known).lines[1]
    assert told.head == "Additional effects found"
    lines = [f"line at {hz} Hz, 20 mdps, on gx" for hz in (23.3, 17.9, 13.7)]
    assert told.text == "; ".join([*lines, "and 2 more, see the report"])
    page = render(replace(known, record=None))
    assert "Findings: 5, named effects first" in page
    assert "see the findings below" in page
    assert "1 axis" in page
    assert findings_table(known).count("**line**") >= 5


@pytest.fixture(scope="module")
def hum():
    """Return a hum of 7.013 Hz with two harmonics on three axes, and a knock at 300 s."""
    rng, t = np.random.default_rng(2), np.arange(60_000) / 100.0
    wave = sum(np.sin(2 * np.pi * 7.013 * k * t + k) / k for k in (1, 2, 3))
    sizes = {"gx": 0.02, "gy": 0.012, "gz": 0.006}
    samples = {k: 0.04 * rng.standard_normal(len(t)) + a * wave for k, a in sizes.items()}
    samples["gx"][30_000:] += 0.05
    samples["gz"][30_000:32_000] += 0.05
    return analyse(samples, 100.0)


def test_a_hum_with_harmonics_on_three_axes_is_one_finding(hum):
    assert sum(len(axis.explanation.effects) for axis in hum.axes.values()) >= 11
    first, second = hum.findings
    assert (first.kind, first.axes, first.harmonics) == ("sinusoid", ("gx", "gy", "gz"), (2, 3))
    assert len(first.members) == 9
    assert set(second.axes) == {"gx", "gz"}
    assert {one.effect.kind for one in second.members} == {"step", "excursion"}
    lines = verdict(hum).lines[1].text.split("; ")
    assert lines[0].startswith("line at 7.013 Hz, ")
    assert " mdps, with harmonics 2 and 3, on all axes (9" in lines[0]
    assert lines[0].endswith(" % of the excess)")
    assert lines[1].startswith("excursion and step at 5 min to 5 min 20 s on gx gz (")


def test_the_json_points_at_the_effects(hum):
    result = hum.to_dict()
    for finding in result["findings"]:
        lead = finding["effects"][0]
        assert result["axes"][lead["axis"]]["effects"][lead["index"]]["kind"] == finding["kind"]
    pointed = {(one["axis"], one["index"]) for f in result["findings"] for one in f["effects"]}
    assert len(pointed) == sum(len(axis["effects"]) for axis in result["axes"].values())


def unexplained(words, gain=10.0):
    """Return what was found without a name, in the words of the search."""
    found = band(15.0, 30.0)
    return replace(found, evidence={"gain_nats": gain, "words": words})


def test_what_has_a_name_comes_before_what_has_none():
    """However much more the nameless gained, and within one finding as well."""
    found = findings_of({"gx": [unexplained("lighter tails", 900.0), line(7.0)], "gy": [step(9.0)]})
    assert [one.kind for one in found] == ["sinusoid", "step", "unexplained"]
    narrow = replace(band(6.9, 7.1), evidence={"gain_nats": 500.0})
    (both,) = findings_of({"gx": [narrow, line(7.0)]})
    assert finding_phrase(both) == "line at 7 Hz, 20 mdps, with unexplained power"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("lighter tails than a Gaussian (excess kurtosis -0.12)", "lighter tails than a Gaussian"),
        (
            "5.4 % more power than the model between 15 and 30 Hz (z = 7.1); held-out "
            "log-likelihood gain 12.0 ± 4.0",
            "5.4 % more power than the model between 15 and 30 Hz",
        ),
        ("", "unexplained power between 15 and 30 Hz"),
    ],
)
def test_what_has_no_name_is_said_in_its_own_words(words, said):
    (found,) = findings_of({"gx": [unexplained(words)]})
    assert finding_phrase(found) == said
    assert finding_sentence(found, ("gx", "gy")) == f"{said} on gx"


def test_outliers_are_counted_in_whole_numbers():
    (found,) = findings_of({"ax": [effect("outliers", count=(3.0, 0.0, ""))]})
    assert finding_phrase(found) == "isolated outliers (3)"


def test_a_share_of_an_axis_of_the_same_sensor_is_a_percentage():
    leak = effect("cross_coupling", source="az", slope=(-0.108, 0.01, "g/g"))
    (found,) = findings_of({"ax": [leak]})
    assert finding_phrase(found) == "cross-coupling from az, -11 %"


def test_a_named_finding_is_a_short_sentence():
    tone = effect(
        "sinusoid",
        "frequency",
        frequency=(12.43, 0.004, "Hz"),
        amplitude=(0.35e-3, 1e-5, "g"),
    )
    drifting = effect(
        "drifting_line",
        "frequency",
        frequency=(5.027, 0.01, "Hz"),
        bandwidth=(0.02, 0.01, "Hz"),
        sigma=(0.029, 0.001, "dps"),
    )
    low_pass = effect("band_limit", cutoff=(36.2, 0.4, "Hz"))
    axes = ("gx", "gy", "az")
    told = {
        "az": ([tone], "line at 12.43 Hz, 0.35 mg, on az"),
        "gx": ([drifting], "drifting line around 5.03 Hz, 29 mdps rms, on gx"),
        "gy": ([low_pass], "low-pass at 36 Hz on gy"),
    }
    for axis, (effects, said) in told.items():
        (found,) = findings_of({axis: effects})
        assert finding_sentence(found, axes) == said
    (all_axes,) = findings_of({axis: [low_pass] for axis in axes})
    assert finding_sentence(all_axes, axes) == "low-pass at 36 Hz on all axes"


def test_events_at_one_time_are_one_sentence():
    effects = {axis: [step(45.2), step(54.8), excursion(45.0, 10.0)] for axis in ("gx", "az")}
    (found,) = findings_of(effects)
    said = finding_sentence(found, ("gx", "gy", "az"))
    assert said == "steps and excursions at 45 to 55 s on gx az"


def test_every_kind_of_effect_has_a_phrase_of_its_own_parameters():
    """One that is missing would be said by the word of the JSON."""
    for name in set(VOCABULARY) - {"unexplained"}:
        kind = KINDS[name]
        assert kind.phrase or kind.of_the_stream, name
        fields = set(re.findall(r"\{(\w+)\}", kind.phrase + kind.as_cause)) - {"event"}
        assert fields <= set(kind.__dataclass_fields__), name


def test_a_new_kind_brings_its_own_words_and_traits(monkeypatch):
    """Nothing else has to know it: verdict, causes and events ask the kind."""
    monkeypatch.setattr("allanscope.explain.effects.KINDS", dict(KINDS))

    @dataclass(frozen=True)
    class Earthquake(EffectKind):
        size: Estimate
        kind = "earthquake"
        meaning = "the bench shakes"
        phrase = "earthquake at {event}, {size}"
        motion = "burst"
        propose = classmethod(lambda cls, view: ())

    quake = effect("earthquake", time=(45.0, 0.1, "s"), size=(0.01, 0.001, "dps"))
    (found,) = findings_of({"gx": [quake]})
    assert finding_phrase(found) == "earthquake at 45 s, 10 mdps"
    (found,) = findings_of({"gx": [quake, step(45.2)]})
    assert finding_phrase(found) == "earthquake and step at 45 s"
