"""What loggers and boards do to data that are otherwise textbook noise is named as that only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from allanscope.explain import explain
from allanscope.explain.effects.variance_change import _freedom, _intervals
from allanscope.explain.series import series_of
from allanscope.explain.view import View

RATE, SIGMA = 52.0, 4e-3 * 52.0**0.5


@pytest.fixture(scope="module")
def odd(bench):
    """Six axes with nothing else than what they are named after."""
    b = bench(301)
    n = len(b.t)
    spectrum = np.fft.rfft(b.noise())
    away = (np.fft.rfftfreq(n, 1 / RATE) - 13.0) / 1.0
    notched = np.fft.irfft(spectrum * np.sqrt(1 - 0.95 / (1 + away**2)), n)
    swing = 2.405 * np.sin(2 * np.pi * 0.04 * b.t)  # J0 is zero: there is no carrier
    relaxing = 1.5 * np.exp(-b.t / 12) + 3.0 * np.exp(-b.t / 150)
    return explain(
        b.record(
            b.noise() + 60 * SIGMA * (b.t >= 700.005),
            b.rng.uniform(-(3**0.5), 3**0.5, n) * SIGMA,
            b.noise() * (1 + 0.5 * b.t / b.t[-1]),
            notched,
            b.noise() + 6e-3 * np.sin(2 * np.pi * 7.0 * b.t + swing),
            b.noise() + relaxing,
            lsb=SIGMA / 5,
        )
    ).axes


@pytest.mark.parametrize(
    ("axis", "kind"),
    [
        ("gx", "step"),  # the samples beside it are no outliers
        ("gy", "unexplained"),  # light tails make neighbours no likelier to be equal
        ("gz", "scale_drift"),  # no stretch of it is louder than the rest
        ("ay", "drifting_line"),
        ("az", "warm_up"),  # two of them
    ],
)
def test_it_is_given_one_name(odd, axis, kind):
    assert {effect.kind for effect in odd[axis].effects} == {kind}


def test_a_hole_in_the_spectrum_leaves_the_rest_to_be_fitted(odd):
    holes = [effect for effect in odd["ax"].effects if effect.kind == "unexplained"]
    assert any("less power" in hole.evidence["words"] for hole in holes)
    assert odd["ax"].coefficients_after["N"].value == pytest.approx(4e-3, rel=0.1)


def test_a_step_between_two_samples_is_within_its_interval(odd):
    (step,) = odd["gx"].effects
    assert step.parameters["time"].lower <= 700.005 <= step.parameters["time"].upper


def test_more_than_half_a_record_is_as_good_as_the_rest_of_it():
    rng = np.random.default_rng(306)
    power = rng.chisquare(26, 2000) / 26 * np.where(np.arange(2000) < 900, 1.0, 1.2)
    (found,) = _intervals(power, 26.0)
    assert found[2] == pytest.approx(900, abs=20)
    assert found[3] == pytest.approx(1 / 1.2, rel=0.03)


def test_blocks_that_are_all_alike_have_no_change():
    """All at the cap, as where a model gives the data no power at all: the axis failed."""
    power = np.full(40, 20.0)
    assert _intervals(power, _freedom(power, 81)) == []


def test_light_tails_are_said_to_be_light(odd):
    (tails,) = odd["gy"].effects
    assert "lighter tails" in tails.evidence["words"]


def test_many_gaps_repeat_no_rows(bench):
    b = bench(302)
    record = b.record(b.noise(), b.noise(), lsb=SIGMA / 4)
    keep = np.arange(len(b.t)) % 5000 >= 30
    cut = np.flatnonzero(np.diff(keep.astype(int))) + 1
    bounds = np.cumsum([0, *(len(p) for p in np.split(np.arange(len(keep)), cut) if keep[p[0]])])
    holed = replace(
        record,
        values=record.values[keep],
        temperature_c=record.temperature_c[keep],
        start_s=record.start_s[keep],
        segments=np.column_stack([bounds[:-1], bounds[1:]]),
    )
    assert [axis.effects for axis in explain(holed).axes.values()] == [(), ()]
    assert View.of(series_of(holed), "gx").step == pytest.approx(SIGMA / 4)


@pytest.mark.parametrize("each", [2, 3])
def test_a_reader_faster_than_the_sensor_repeats_rows_and_does_nothing_else(bench, each):
    b = bench(303, 600.0)
    rows = np.arange(len(b.t))
    columns = np.column_stack([b.noise() for _ in range(4)])[rows // each * each]
    for axis in explain(b.record(*columns.T)).axes.values():
        (effect,) = axis.effects
        assert effect.kind == "repeated_samples"
        fraction = effect.parameters["fraction"]
        assert fraction.lower <= 1 - 1 / each <= fraction.upper
        N = axis.coefficients_after["N"]
        assert N.value == pytest.approx(4e-3, rel=0.02)  # of the rows that were measured


def test_what_was_equal_by_chance_does_not_add_to_the_share_of_repeats(bench):
    b = bench(304)
    rows = np.arange(len(b.t))
    rows[b.rng.random(len(rows)) < 0.05] = 0
    (effect,) = (
        explain(b.record(b.noise()[np.maximum.accumulate(rows)], lsb=SIGMA / 1.5))
        .axes["gx"]
        .effects
    )
    assert effect.parameters["fraction"].value == pytest.approx(0.05, rel=0.12)


def test_a_temperature_that_moves_within_a_minute_has_its_slope(bench):
    b = bench(307)
    slow = np.exp(-1 / (8 * RATE))  # two lags of 8 s behind a wandering room
    room = np.cumsum(b.rng.normal(0, 1, len(b.t)))
    for _ in range(2):
        room = lfilter([1 - slow], [1, -slow], room - room[0])
    room = room / room.std()
    read = np.round((25 + room + b.rng.normal(0, 0.02, len(b.t))) * 256) / 256
    (effect,) = explain(b.record(b.noise() + 0.3 * room, temperature=read)).axes["gx"].effects
    assert effect.kind == "temperature"
    assert effect.parameters["slope"].value == pytest.approx(0.3, rel=0.004)
