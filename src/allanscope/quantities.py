"""Numbers as people read them: the units of the field, intervals, durations.

Inside allanscope a rate is in dps, an acceleration in g and a time in s. Datasheets, papers and
Kalibr each speak another dialect, and this is the one place that translates::

    coefficient   gyro                        accelerometer
    N             mdps/sqrt(Hz)  deg/sqrt(h)  ug/sqrt(Hz)  m/s^2/sqrt(Hz)
    B             deg/h          mdps         ug           m/s^2
    K             deg/h/sqrt(h)  mdps/sqrt(s) ug/sqrt(h)   m/s^2/sqrt(s)
    Q             arcsec         udeg         um/s         ug*s
    R             deg/h/h        mdps/s       ug/h         m/s^2/s
    P, F, D       arcsec, deg/h/h, deg/h/h/sqrt(h)      um/s, ug/h, ug/h/sqrt(h)

The first of each is the one that tables show. Units are spelled in ASCII, as in the JSON;
`symbols` sets them the way print does. With sigma drawn in mdps (or ug), the white-noise line
crosses tau = 1 s at N in mdps/sqrt(Hz) (or ug/sqrt(Hz)), which is why charts use those.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = [
    "CHI_SQUARE_95",
    "COEFFICIENTS",
    "COEFFICIENT_NAMES",
    "DENSITY",
    "DEVIATION",
    "GRAVITY",
    "LETTERS",
    "LEVEL",
    "MAD_TO_SIGMA",
    "MAIN_LETTERS",
    "POWER_LAW_NAMES",
    "SENSOR_NAMES",
    "TWO_SIDED_95",
    "Reading",
    "between",
    "compact",
    "count",
    "counted",
    "duration",
    "interval",
    "limit",
    "measured",
    "moment",
    "number",
    "periods",
    "power_of_ten",
    "rate",
    "rough",
    "size",
    "student_widening",
    "symbols",
]

GRAVITY = 9.80665
"""m/s^2 in one g: the standard acceleration of gravity, exact by definition (ISO 80000-3)."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A unit to read a quantity in: multiply the internal value by `factor`.

    Examples
    --------
    >>> arw = COEFFICIENTS["dps", "N"][1]
    >>> f"{0.0038 * arw.factor:.3f} {arw.unit}"
    '0.228 deg/sqrt(h)'
    >>> arw.interval(0.0038, 0.0037, 0.0039), arw.limit(0.0039)
    ('0.228 [0.222, 0.234]', '< 0.23')
    """

    factor: float
    unit: str

    def interval(self, value: float, lower: float | None, upper: float | None) -> str:
        """Return a value given in the internal unit, with its interval, without the unit."""
        limits = (None if x is None else x * self.factor for x in (lower, upper))
        return interval(value * self.factor, *limits)

    def compact(self, value: float, lower: float, upper: float) -> str:
        """Return a value given in the internal unit, with its errors, without the unit."""
        return compact(value * self.factor, lower * self.factor, upper * self.factor)

    def limit(self, upper: float) -> str:
        """Return an upper limit given in the internal unit, without the unit."""
        return limit(upper * self.factor)


SENSOR_NAMES: Mapping[str, str] = {"dps": "gyroscope", "g": "accelerometer"}
"""By the unit of its axes."""

DEVIATION: Mapping[str, Reading] = {"dps": Reading(1e3, "mdps"), "g": Reading(1e6, "ug")}
"""For sigma and amplitudes, by the unit of the axis."""

LEVEL: Mapping[str, Reading] = {"dps": Reading(1e3, "mdps"), "g": Reading(1e3, "mg")}
"""For samples and levels, by the unit of the axis."""

DENSITY: Mapping[str, Reading] = {
    "dps": Reading(1e3, "mdps/sqrt(Hz)"),
    "g": Reading(1e6, "ug/sqrt(Hz)"),
}
"""For the square root of a power spectral density, by the unit of the axis."""

COEFFICIENTS: Mapping[tuple[str, str], tuple[Reading, Reading]] = {
    ("dps", "N"): (Reading(1e3, "mdps/sqrt(Hz)"), Reading(60.0, "deg/sqrt(h)")),
    ("dps", "B"): (Reading(3600.0, "deg/h"), Reading(1e3, "mdps")),
    ("dps", "K"): (Reading(216e3, "deg/h/sqrt(h)"), Reading(1e3, "mdps/sqrt(s)")),
    ("dps", "Q"): (Reading(3600.0, "arcsec"), Reading(1e6, "udeg")),
    ("dps", "R"): (Reading(12.96e6, "deg/h/h"), Reading(1e3, "mdps/s")),
    ("dps", "P"): (Reading(3600.0, "arcsec"), Reading(1e6, "udeg")),
    ("dps", "F"): (Reading(12.96e6, "deg/h/h"), Reading(1e3, "mdps/s")),
    ("dps", "D"): (Reading(777.6e6, "deg/h/h/sqrt(h)"), Reading(1e3, "mdps/s/sqrt(s)")),
    ("g", "N"): (Reading(1e6, "ug/sqrt(Hz)"), Reading(GRAVITY, "m/s^2/sqrt(Hz)")),
    ("g", "B"): (Reading(1e6, "ug"), Reading(GRAVITY, "m/s^2")),
    ("g", "K"): (Reading(60e6, "ug/sqrt(h)"), Reading(GRAVITY, "m/s^2/sqrt(s)")),
    ("g", "Q"): (Reading(GRAVITY * 1e6, "um/s"), Reading(1e6, "ug*s")),
    ("g", "R"): (Reading(3.6e9, "ug/h"), Reading(GRAVITY, "m/s^2/s")),
    ("g", "P"): (Reading(GRAVITY * 1e6, "um/s"), Reading(1e6, "ug*s")),
    ("g", "F"): (Reading(3.6e9, "ug/h"), Reading(GRAVITY, "m/s^2/s")),
    ("g", "D"): (Reading(216e9, "ug/h/sqrt(h)"), Reading(GRAVITY, "m/s^2/s/sqrt(s)")),
}
"""For each coefficient, by the unit of the axis and the letter: (usual, other).

Those of IEEE 952, then the other power laws: flicker PM, flicker walk and random run FM.
"""

POWER_LAW_NAMES: Mapping[str, str] = {
    **{"Q": "white phase noise", "P": "flicker phase noise", "N": "white noise", "B": "flicker"},
    **{"K": "random walk", "F": "flicker walk", "D": "random run"},
}
"""Every power law of the rate, from f^2 to f^-4."""

LETTERS = ("N", "B", "K", "Q", "R")
"""The coefficients in the order of tables."""

MAIN_LETTERS = LETTERS[:3]
"""Those that every axis is judged by; Q and R are told where they are found."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""

TWO_SIDED_95 = 1.959963984540054
"""Standard deviations to either side of the mean that hold 95 % of a normal distribution."""

CHI_SQUARE_95 = 3.841458820694124
"""Of chi-square with one degree of freedom: twice the log-likelihood ratio of one parameter."""

CHI_SQUARE_MEDIAN = 0.454936423119573
"""Median of chi-square with one degree of freedom, whose mean is 1."""

COEFFICIENT_NAMES: Mapping[str, str] = {
    "Q": "quantization",
    "N": "white noise (random walk)",
    "B": "bias instability",
    "K": "rate random walk",
    "R": "rate ramp",
}
"""What each letter stands for."""


def symbols(unit: str) -> str:
    """Return an ASCII unit, or a text with units, the way it is printed.

    Examples
    --------
    >>> symbols("deg/sqrt(h)"), symbols("ug/sqrt(Hz)"), symbols("m/s^2/sqrt(Hz)"), symbols("degC")
    ('°/√h', 'µg/√Hz', 'm/s²/√Hz', '°C')
    >>> symbols("a bug of 5 ug/sqrt(Hz) in 3 um")
    'a bug of 5 µg/√Hz in 3 µm'
    """
    for name in ("Hz", "h", "s", "2", "time"):
        unit = unit.replace(f"sqrt({name})", f"√{name}")
    for plain, set_in_print in _SYMBOLS:
        unit = unit.replace(plain, set_in_print)
    return _MICRO.sub("µ", unit)


_MICRO = re.compile(r"\bu(?=(?:g|m|°)(?![a-z]))")
_SYMBOLS = (
    ("degC", "°C"),
    (" deg ", "° "),
    ("deg", "°"),
    ("^2", "²"),
    ("^3", "³"),
    ("*", "·"),
    ("+-", "±"),
)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with `digits` significant digits, with an exponent only when it must.

    Examples
    --------
    >>> number(4.0217), number(0.00123), number(1.5e-7), number(48213.0), number(None)
    ('4.02', '0.00123', '1.5e-7', '48200', '-')
    """
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)
    decimals = digits - 1 - exponent
    if -4 < exponent < 6:  # rounding a number of numpy takes three times as long as printing it
        return f"{value:.{decimals}f}" if decimals >= 0 else _fixed(value, decimals)
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}e{exponent}"


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(power: int) -> str:
    """Return 0.1, 1, 10, 100 as such, and 10 with an exponent beyond.

    Examples
    --------
    >>> power_of_ten(-1), power_of_ten(-8)
    ('0.1', '10⁻⁸')
    """
    if -1 <= power <= 2:
        return f"{10.0**power:g}"
    return f"10{str(power).translate(_SUPERSCRIPT)}"


def interval(value: float, lower: float | None, upper: float | None) -> str:
    """Return a value with its interval, in as many digits as the interval deserves.

    Digits that the data do not support are not printed: half the interval's width keeps one
    significant digit, or two when it begins with 1, 2 or 3 (the rule of the Particle Data Group).
    Limits so far apart that this would round the lower one to nothing have digits of their own.

    Examples
    --------
    >>> interval(4.0217, 3.9812, 4.0622)
    '4.02 [3.98, 4.06]'
    >>> interval(812.4, 640.0, 1031.0)
    '810 [640, 1030]'
    >>> interval(0.93, 0.0213, 32.9)
    '0.93 [0.021, 33]'
    >>> interval(4.0217, None, None)
    '4.02'
    """
    if lower is None or upper is None or not math.isfinite(value + lower + upper):
        return number(value)
    if upper <= lower:
        return f"{number(value)} [{number(lower)}, {number(upper)}]"
    decimals = _decimals(0.5 * (upper - lower))
    exponent = _exponent(max(abs(value), abs(lower), abs(upper)))
    if lower * upper > 0.0 and _blurred(min(abs(lower), abs(upper)), decimals):
        centre, low, high = (number(x, 2) for x in (value, lower, upper))
    elif -4 < exponent < 6:
        centre, low, high = (_fixed(x, decimals) for x in (value, lower, upper))
    else:
        digits = max(2, min(exponent + decimals + 1, 6))
        centre, low, high = (number(x, digits) for x in (value, lower, upper))
    return f"{centre} [{low}, {high}]"


def compact(value: float, lower: float | None, upper: float | None) -> str:
    """Return a value with its errors, for where there is no room for an interval.

    Examples
    --------
    >>> compact(4.0217, 3.9812, 4.0622), compact(4.3, 3.7, 5.0), compact(0.93, 0.0213, 32.9)
    ('4.02 +-0.04', '4.3 +0.7/-0.6', '0.93 [0.021, 33]')
    """
    if lower is None or upper is None or not math.isfinite(value + lower + upper):
        return number(value)
    exponent = _exponent(max(abs(value), abs(upper)))
    if upper <= lower or not -4 < exponent < 6:
        return number(value)
    decimals = _decimals(0.5 * (upper - lower))
    if lower * upper > 0.0 and _blurred(min(abs(lower), abs(upper)), decimals):
        return interval(value, lower, upper)
    below, above = _fixed(value - lower, decimals), _fixed(upper - value, decimals)
    errors = f"+-{above}" if below == above else f"+{above}/-{below}"
    return f"{_fixed(value, decimals)} {errors}"


def measured(
    value: float, lower: float | None = None, upper: float | None = None, unit: str = ""
) -> str:
    """Return a value of any unit with its interval: rates in mdps, accelerations in ug.

    Large ones are in dps, mg or g; ratios of two equal units are in per cent.

    Examples
    --------
    >>> measured(49.981, 49.97, 49.992, "Hz")
    '49.981 [49.970, 49.992] Hz'
    >>> measured(4.1e-3, 3.9e-3, 4.3e-3, "dps")
    '4.10 [3.90, 4.30] mdps'
    >>> measured(2.0e-4, unit="g/degC"), measured(-0.0704, -0.081, -0.06, "dps/dps")
    ('200 ug/degC', '-7.0 [-8.1, -6.0] %')
    >>> measured(124.9, unit="dps"), measured(0.0341, 0.0338, 0.0344, "g")
    ('125 dps', '34.10 [33.80, 34.40] mg')
    """
    numerator, slash, rest = unit.partition("/")
    if numerator == rest:
        text, unit = Reading(100.0, "%").interval(value, lower, upper), "%" if unit else ""
    elif numerator in DEVIATION:
        usual = DEVIATION[numerator]
        larger = [usual, *_LARGER[numerator]]
        reading = next((one for one in larger if abs(value) * one.factor < _LONG), larger[-1])
        text = reading.interval(value, lower, upper)
        unit = f"{reading.unit}{slash}{rest}"
    else:
        text = interval(value, lower, upper)
    return f"{text} {unit}".rstrip()


_LARGER: Mapping[str, tuple[Reading, ...]] = {
    "dps": (Reading(1.0, "dps"),),
    "g": (Reading(1e3, "mg"), Reading(1.0, "g")),
}
_LONG = 1e4
"""Value from which a larger unit is easier to read."""


def limit(upper: float) -> str:
    """Return an upper limit.

    >>> limit(0.5217)
    '< 0.52'
    """
    return f"< {number(upper, 2)}"


def duration(seconds: float) -> str:
    """Return a duration in its two largest units.

    Examples
    --------
    >>> duration(7800), duration(45.2), duration(200), duration(97200), duration(0.25)
    ('2 h 10 min', '45 s', '3 min 20 s', '1 d 3 h', '0.25 s')
    """
    if not math.isfinite(seconds) or seconds < 0.0:
        return "-"
    if seconds < 9.95:
        return f"{number(seconds, 2)} s"
    left = round(seconds)
    if left >= 36000:
        left = 60 * round(left / 60)
    if left >= 864000:
        left = 3600 * round(left / 3600)
    parts: list[str] = []
    for unit, length in _UNITS:
        whole, left = divmod(left, length)
        if whole or parts:
            parts.append(f"{whole} {unit}" if whole else "")
        if len(parts) == 2:
            break
    return " ".join(part for part in parts if part)


def periods(low: float, high: float | None = None) -> str:
    """Return the period of a slow frequency in Hz, or those of a range, in brackets.

    >>> periods(0.0014), periods(0.00109, 0.00266), periods(0.05)
    (' (period 11 min 54 s)', ' (periods of 6 min 16 s to 15 min 17 s)', '')
    >>> periods(0.0, 0.00266)
    ' (periods of 6 min 16 s and more)'
    """
    if not 0.0 < (high or low) <= _SLOW_HZ:
        return ""
    if high is None:
        return f" (period {duration(1 / low)})"
    if low <= 0.0:
        return f" (periods of {duration(1 / high)} and more)"
    return f" (periods of {duration(1 / high)} to {duration(1 / low)})"


def student_widening(freedom: float) -> float:
    """Return how much wider a 95 % interval is whose error is known from few numbers.

    >>> round(student_widening(9), 3), round(student_widening(1e6), 3)
    (1.154, 1.0)
    """
    from scipy.special import stdtrit  # for those few that ask

    return float(stdtrit(freedom, 0.975)) / TWO_SIDED_95


def moment(seconds: float, length: float) -> str:
    """Return a time in a record, in as many decimals as a stretch of that length deserves.

    >>> moment(0.0006, 0.306), moment(187.005, 6.41), moment(4500.4, 600.0)
    ('0.00 s', '187.0 s', '4500 s')
    """
    decimals = math.ceil(1 - math.log10(length)) if length > 0 else 0
    return f"{seconds:.{min(max(decimals, 0), 6)}f} s"


def rough(seconds: float) -> str:
    """Return a duration that cannot be predicted better than in one unit.

    >>> rough(630.0), rough(5500.0), rough(12100.0)
    ('10 min', '92 min', '3.4 h')
    """
    unit, length = next((one for one in _UNITS if seconds >= 2 * one[1]), _UNITS[-1])
    value = seconds / length
    decimals = 1 if length > 60 and value < 10 else 0
    return f"{number(round(value, decimals), 2).removesuffix('.0')} {unit}"


_SLOW_HZ = 1 / 60
"""Frequency below which people speak of periods: an air conditioner has minutes, no millihertz."""
_UNITS = (("d", 86400), ("h", 3600), ("min", 60), ("s", 1))


def between(lower: float, upper: float) -> str:
    """Return where a time in s lies, in words; `upper` may be infinite.

    Examples
    --------
    >>> between(20.0, 93.0), between(47.0, math.inf), between(0.01, 0.01)
    ('between 20 s and 1 min 33 s', 'at 47 s or beyond', 'at 0.010 s')
    """
    if not math.isfinite(upper):
        return f"at {duration(lower)} or beyond"
    if duration(lower) == duration(upper):
        return f"at {duration(lower)}"
    return f"between {duration(lower)} and {duration(upper)}"


def rate(hz: float, uncertainty_ppm: float | None = None) -> str:
    """Return a sample rate with as many digits as its uncertainty deserves.

    Examples
    --------
    >>> rate(6664.2173, 12.0), rate(6660.0), rate(104.0, 1.0), rate(102.5, 2.7e-4)
    ('6664.22 Hz +-12 ppm', '6660 Hz', '104.00000 Hz +-1.0 ppm', '102.500000 Hz +-0.27 ppb')
    """
    if uncertainty_ppm is None:
        return f"{hz:.6g} Hz"
    if uncertainty_ppm <= 0.0:
        return f"{hz:.9g} Hz"
    decimals = max(0, min(_decimals(hz * uncertainty_ppm * 1e-6), 6))
    is_small = uncertainty_ppm < 0.01
    error = number(1e3 * uncertainty_ppm if is_small else uncertainty_ppm, 2)
    return f"{hz:.{decimals}f} Hz +-{error} {'ppb' if is_small else 'ppm'}"


def count(number_of: int) -> str:
    """Return a count in groups of three digits, as ISO 80000-1 sets them.

    >>> count(143856000)
    '143 856 000'
    """
    return f"{number_of:,}".replace(",", " ")


def counted(number_of: int, thing: str, things: str = "") -> str:
    """Return how many there are of a thing, in the singular or in the plural.

    >>> counted(1, "unit"), counted(1200, "recording"), counted(6, "axis", "axes")
    ('1 unit', '1 200 recordings', '6 axes')
    """
    return f"{count(number_of)} {thing if number_of == 1 else things or f'{thing}s'}"


def size(number_of_bytes: float) -> str:
    """Return an amount of data in decimal multiples.

    >>> size(950), size(12_345_678)
    ('950 B', '12.3 MB')
    """
    value = float(number_of_bytes)
    for unit in ("B", "kB", "MB", "GB"):
        if value < 999.5:
            return f"{value:.3g} {unit}"
        value /= 1e3
    return f"{value:.3g} TB"


def _decimals(uncertainty: float) -> int:
    """Decimals that a number with this uncertainty is printed with; negative: tens, hundreds."""
    first, _, power = f"{uncertainty:.2e}".partition("e")
    return (1 if float(first) < 3.55 else 0) - int(power)


def _blurred(smallest: float, decimals: int) -> bool:
    """Whether rounding to `decimals` moves the smaller limit by more than a fifth of itself."""
    return abs(round(smallest, decimals) - smallest) > 0.2 * smallest


def _exponent(value: float, digits: int = 2) -> int:
    """Power of ten of the first digit after rounding to `digits` significant ones."""
    return int(f"{abs(value):.{digits - 1}e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    """Round to `decimals` (negative: to tens, hundreds) and print without an exponent."""
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text
