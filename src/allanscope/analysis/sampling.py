"""What the pace of the rows says: a reader that is faster or slower than the sensor.

Stock firmware reads the sensor in a loop of its own, 50 times a second. A sensor that makes fewer
samples is read twice now and then, and rows repeat; one that makes more is read too seldom, and
samples are skipped. Repeated rows are seen in the values, by the effect ``repeated_samples``;
skipped ones leave no trace but a rate that no oscillator could be off by.
"""

from __future__ import annotations

from collections.abc import Mapping

from allanscope.analysis.result import AxisAnalysis, Rate
from allanscope.quantities import number

__all__ = ["sampling_remarks"]

OSCILLATOR = 0.1
"""No sensor of these is off by more: their data sheets say 6.5 or 7 per cent."""


def sampling_remarks(axes: Mapping[str, AxisAnalysis], rate: Rate) -> tuple[str, ...]:
    """Return what to say about rows that repeat and samples that were skipped."""
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
            f"the sensor and sees one sample in {number(1.0 / share, 3)}; noise above half its "
            "pace is folded into what it sees."
        )
    elif share > 1.0 + OSCILLATOR and not repeated:
        out.append(
            f"{rows} although the sensor is set to {number(rate.nominal_hz, 4)} Hz, and no row "
            "repeats: the setting is not what was said."
        )
    return tuple(out)


def _repeated(axes: Mapping[str, AxisAnalysis]) -> float:
    """Return the share of repeated rows that the loop found on any axis; 0 when on none."""
    found = [
        float(effect.parameters["fraction"].value)
        for axis in axes.values()
        if axis.explanation is not None
        for effect in axis.explanation.effects
        if effect.kind == "repeated_samples" and "fraction" in effect.parameters
    ]
    return max(found, default=0.0)
