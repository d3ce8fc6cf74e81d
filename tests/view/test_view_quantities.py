"""Numbers in the units of the field."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from allanscope.quantities import (
    COEFFICIENTS,
    DEVIATION,
    Reading,
    compact,
    duration,
    interval,
    number,
    rate,
    symbols,
)


def test_the_datasheet_of_an_lsm6dsm_reads_as_its_makers_write_it():
    mdps, deg = COEFFICIENTS["dps", "N"]
    assert mdps.interval(3.8e-3, None, None) == "3.80"
    assert number(3.8e-3 * deg.factor) == "0.228"  # deg/sqrt(h), as in DT0064
    assert (mdps.unit, deg.unit) == ("mdps/sqrt(Hz)", "deg/sqrt(h)")


@pytest.mark.parametrize(
    ("unit", "letter", "index", "factor"),
    [
        ("dps", "N", 1, 60.0),  # dps/sqrt(Hz) = deg/sqrt(s); 3600 s in an hour
        ("dps", "B", 0, 3600.0),
        ("dps", "K", 0, 3600.0 * 60.0),
        ("dps", "R", 0, 3600.0**2),
        ("dps", "Q", 0, 3600.0),
        ("g", "N", 1, 9.80665),
        ("g", "K", 0, 1e6 * 60.0),
        ("g", "R", 0, 1e6 * 3600.0),
        ("g", "Q", 0, 9.80665e6),
        ("dps", "P", 0, 3600.0),
        ("dps", "F", 0, 3600.0**2),
        ("dps", "D", 0, 3600.0**2 * 60.0),
        ("g", "F", 0, 1e6 * 3600.0),
        ("g", "D", 0, 1e6 * 3600.0 * 60.0),
    ],
)
def test_conversions_follow_from_the_units(unit, letter, index, factor):
    assert COEFFICIENTS[unit, letter][index].factor == pytest.approx(factor, rel=1e-12)


def test_an_interval_shows_only_digits_that_the_data_support():
    assert interval(4.0217, 3.9812, 4.0622) == "4.02 [3.98, 4.06]"
    assert interval(1234.4, 1100.0, 1400.0) == "1230 [1100, 1400]"
    assert interval(1.5e-7, 1.1e-7, 1.9e-7) == "1.5e-7 [1.1e-7, 1.9e-7]"
    assert interval(5.0, math.nan, 7.0) == "5.00"
    assert interval(0.3, 0.0, 4.1) == "0.3 [0.0, 4.1]"
    assert interval(0.3, -30.0, 31.0) == "0 [-30, 31]"


@given(st.floats(1e-3, 1e3), st.floats(1.0, 1e4), st.floats(1.0, 1e4))
def test_no_limit_is_rounded_to_nothing(value, below, above):
    lower, upper = value / below, value * above
    shown = interval(value, lower, upper).partition("[")[2].rstrip("]").split(", ")
    assert [float(x) for x in shown] == pytest.approx([lower, upper], rel=0.21)


def test_a_compact_value_shows_both_errors_when_they_differ():
    assert compact(4.0217, 3.9812, 4.0622) == "4.02 +-0.04"
    assert compact(4.3, 3.7, 5.0) == "4.3 +0.7/-0.6"
    assert compact(4.3, None, None) == "4.30"


@given(st.floats(1e-9, 1e9), st.floats(0.0, 2.0))
def test_an_interval_never_loses_the_value(value, share):
    text = interval(value, value * (1 - min(share, 0.99)), value * (1 + share))
    shown = float(text.partition(" ")[0])
    assert abs(shown - value) <= 0.51 * max(share * value, 10 ** math.floor(math.log10(value) - 1))


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_any_float_can_be_shown(value):
    assert number(value)
    assert interval(value, value, value)
    assert duration(value)


@given(st.floats(10.0, 1e8))
def test_a_duration_is_right_to_its_second_unit(seconds):
    units = {"d": 86400, "h": 3600, "min": 60, "s": 1}
    words = duration(seconds).split()
    total = sum(int(n) * units[u] for n, u in zip(words[::2], words[1::2], strict=True))
    resolution = 3600 if seconds >= 864000 else 60 if seconds >= 36000 else 1
    if len(words) == 4:
        resolution = max(resolution, units[words[3]] if words[3] != "s" else 1)
    assert abs(total - seconds) <= max(resolution, 0.5 * units[words[-1]])


def test_a_rate_has_the_digits_of_its_uncertainty():
    assert rate(6664.2173, 12.0) == "6664.22 Hz +-12 ppm"
    assert rate(6664.2173, 300.0) == "6664.2 Hz +-300 ppm"
    assert rate(6660.0) == "6660 Hz"


def test_every_unit_has_a_printed_form_without_ascii_leftovers():
    units = [r.unit for pair in COEFFICIENTS.values() for r in pair]
    units += [r.unit for r in DEVIATION.values()]
    for unit in units:
        assert not set("*^()") & set(symbols(unit)), unit
        assert "sqrt" not in symbols(unit)
        assert "deg" not in symbols(unit)
    assert symbols("udeg") == "µ°"


def test_a_reading_scales_value_and_limits_alike():
    reading = Reading(1e3, "mdps")
    assert reading.interval(4.0217e-3, 3.9812e-3, 4.0622e-3) == "4.02 [3.98, 4.06]"
    assert reading.limit(0.521e-3) == "< 0.52"
    assert reading.compact(4.0217e-3, 3.9812e-3, 4.0622e-3) == "4.02 +-0.04"
