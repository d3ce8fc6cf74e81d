"""What the pace of the rows says: a reader that is faster or slower than the sensor.

Stock firmware reads the sensor in a loop of its own, 50 times a second. A sensor that makes fewer
samples is read twice now and then, and rows repeat; one that makes more is read too seldom, and
samples are skipped. Repeated rows are seen in the values, by the effect ``repeated_samples``.

Skipped ones leave no trace in the values, only in the pace. Where it is far from what the sensor is
set to, no oscillator could be off by so much. Where it is near, 50 rows of a sensor set to 52 Hz,
the oscillator could; but then it would be off by just so much that rows come with the period of a
timer, whole multiples of 5 ms, as exactly as a crystal. By chance one in two hundred does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from allanscope.analysis.result import AxisAnalysis, Rate
from allanscope.quantities import number

__all__ = ["sampling_remarks"]

OSCILLATOR = 0.1
"""No sensor of these is off by more: their data sheets say 6.5 or 7 per cent."""

TIMER_MS = 5
"""Firmware that reads a sensor by a timer does so every 10, 20 or 40 ms."""

CRYSTALS = 3e-4
"""By how much the clock of a timer and the one that it is measured with may differ, and more."""


def sampling_remarks(
    axes: Mapping[str, AxisAnalysis], rate: Rate, offered_hz: Sequence[float] = ()
) -> tuple[str, ...]:
    """Return what to say about rows that repeat and samples that were skipped.

    Parameters
    ----------
    axes : mapping of str to AxisAnalysis
        What was found on each.
    rate : Rate
        Claimed and measured.
    offered_hz : sequence of float
        Rates that the sensor can be set to, ascending, where the nominal rate is only the pace of
        the rows of firmware that reads it by a timer.
    """
    out = []
    repeated = _repeated(axes)
    if repeated:
        made = rate.best_hz * (1.0 - repeated)
        out.append(
            f"{number(100 * repeated, 2)} % of the rows repeat the row before: "
            f"{number(rate.best_hz, 4)} rows come in a second, but the sensor made only about "
            f"{number(made, 4)} samples."
        )
    if rate.measured_hz is None or not rate.nominal_hz:
        return tuple(out)
    share = rate.measured_hz / rate.nominal_hz
    rows = f"{number(rate.measured_hz, 4)} rows come in a second"
    if share < 1.0 - OSCILLATOR:
        out.append(
            f"{rows} of a sensor set to {number(rate.nominal_hz, 4)} Hz: the reader is slower than "
            f"the sensor and reads one sample in {number(1.0 / share, 3)}; noise above half the "
            "reading rate is aliased."
        )
    elif share > 1.0 + OSCILLATOR and not repeated:
        out.append(
            f"{rows} although the sensor is set to {number(rate.nominal_hz, 4)} Hz, and no row "
            "repeats: the sensor is set to another rate."
        )
    elif _unrepeated(axes) and (words := _skipped(rate, offered_hz)):
        out.append(f"{rows}, {words}")
    return tuple(out)


def _skipped(rate: Rate, offered_hz: Sequence[float]) -> str:
    """Return what is skipped of a sensor that is little faster than its reader; empty if nothing.

    >>> at_50 = Rate(52.0, measured_hz=50.0004, uncertainty_ppm=20.0)
    >>> _skipped(at_50, ()).partition(": ")[2]
    'about 3.8 % of the samples of a sensor set to 52.00 Hz are never sent (skipped).'
    >>> _skipped(Rate(52.0, measured_hz=50.2, uncertainty_ppm=20.0), ())
    ''
    """
    assert rate.measured_hz is not None
    timers = 1e3 / rate.measured_hz / TIMER_MS
    known = (rate.uncertainty_ppm or 0.0) * 1e-6 < CRYSTALS / 3.0
    if not known or round(timers) < 1 or abs(timers / round(timers) - 1.0) > CRYSTALS:
        return ""
    above_hz = rate.measured_hz * (1.0 + CRYSTALS)
    claimed = rate.nominal_hz > above_hz
    faster = [rate.nominal_hz] if claimed else [hz for hz in offered_hz if hz > above_hz]
    if not faster or rate.measured_hz / faster[0] < 1.0 - OSCILLATOR:
        return ""
    share = number(100.0 * (1.0 - rate.measured_hz / faster[0]), 2)
    period_ms = TIMER_MS * round(timers)
    setting = f"a sensor set to {number(faster[0], 4)} Hz"
    if claimed:
        return (
            f"in step with a timer of {period_ms} ms and not with the sensor: about {share} % of "
            f"the samples of {setting} are never sent (skipped)."
        )
    return (
        f"in step with a timer of {period_ms} ms, a rate that the sensor does not have: about "
        f"{share} % of the samples of {setting} are never sent (skipped), more if it is faster."
    )


def _unrepeated(axes: Mapping[str, AxisAnalysis]) -> bool:
    """Whether repeated rows were looked for, and none found: only then may samples be skipped."""
    looked = [axis for axis in axes.values() if axis.explanation is not None]
    return bool(looked) and not _repeated(axes)


def _repeated(axes: Mapping[str, AxisAnalysis]) -> float:
    """Return the share of repeated rows that the loop found on any axis; 0 when on none."""
    found = [
        float(effect.parameters["fraction"].value)
        for axis in axes.values()
        if axis.explanation is not None
        for effect in axis.explanation.effects
        if effect.repeats_rows
    ]
    return max(found, default=0.0)
