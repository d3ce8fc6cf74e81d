"""What is reported of a change: an event with its occurrences, in physical units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from allanscope.labels import kind_name
from allanscope.quantities import DEVIATION, Reading, duration, number, symbols

__all__ = ["KINDS", "Event", "Occurrence"]

KINDS: Mapping[str, str] = {
    "step": "level shift",
    "ramp": "level drift",
    "variance_change": kind_name("variance_change"),
    "sinusoid": "new line",
    "outliers": "burst of outliers",
    "repeated_samples": "repeated rows",
    "lost_samples": "lost samples",
    "rate_change": "sample rate change",
}
"""Kinds of events, in the words of the effects where they are the same."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """One time that it happened.

    Attributes
    ----------
    onset_s, lower_s, upper_s : float
        When it began, in s since the first sample, with a 95 % interval.
    found_s : float
        When it was known.
    end_s : float or None
        When it was over; None as long as it is there.
    size : float
        See `Event.size`.
    sample, found_sample : int
        Numbers of the sample at `onset_s`, and of the last one that was needed to know.
    """

    onset_s: float
    lower_s: float
    upper_s: float
    found_s: float
    end_s: float | None
    size: float
    sample: int
    found_sample: int


@dataclass(frozen=True, slots=True)
class Event:
    """A change that was found while it happened.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    axes : tuple of str
        Axes on which it was seen, the clearest first; empty for the stream as a whole.
    unit : str
        Of the size.
    occurrences : tuple of Occurrence
        Each time that it happened, the latest ones where there are many.
    count : int
        How often it happened.
    nats : float
        -log of the p-value, or log of the e-value, when it was first found.
    frequency_hz : float or None
        Of a line.
    frequency_interval_hz : (float, float) or None
        95 % interval of it: three bins at first, narrower while the line is there.
    sizes : mapping
        Size by axis.
    """

    kind: str
    axes: tuple[str, ...]
    unit: str
    occurrences: tuple[Occurrence, ...]
    count: int
    nats: float
    frequency_hz: float | None = None
    frequency_interval_hz: tuple[float, float] | None = None
    sizes: Mapping[str, float] = field(default_factory=dict)

    @property
    def size(self) -> float:
        """How large it was the last time.

        Of the level in dps or g, of the noise as a ratio of standard deviations, of a line its
        amplitude, of a rate in ppm, else how many.
        """
        return self.occurrences[-1].size

    @property
    def is_present(self) -> bool:
        """Whether it is still there."""
        return self.occurrences[-1].end_s is None

    @property
    def words(self) -> str:
        """One line: what, where, how large, since when.

        Examples
        --------
        >>> once = Occurrence(15_000.0, 14_999.0, 15_002.0, 15_004.0, None, 0.12, 1, 2)
        >>> Event("step", ("gx",), "dps", (once,), 1, 30.0).words
        'level shift on gx: 120 mdps, since 4 h 10 min'
        """
        last = self.occurrences[-1]
        where = f" on {', '.join(self.axes)}" if self.axes else ""
        what = KINDS[self.kind]
        if self.frequency_hz is not None and self.frequency_interval_hz is not None:
            ends = ", ".join(number(one) for one in self.frequency_interval_hz)
            what = f"new line at {number(self.frequency_hz)} [{ends}] Hz"
        reading = DEVIATION.get(self.unit, Reading(1.0, self.unit))
        size = number(last.size * reading.factor, 2).removesuffix(".0")  # of a count
        if self.kind == "lost_samples":
            size = f"at least {size}"  # of a long gap only the first few are counted
        size = f"{size} {symbols(reading.unit)}".rstrip()
        if last.end_s is None:
            when = f"since {duration(last.onset_s)}"
        else:
            when = f"from {duration(last.onset_s)} to {duration(last.end_s)}"
        often = f", {self.count} times, last" if self.count > 1 else ","
        return f"{what}{where}: {size}{often} {when}"
