"""What must be said of an axis before any search: constant, saturated, too short, bridged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.series import Series, multiple_of
from allanscope.explain.view import View
from allanscope.parts import full_scale_of
from allanscope.quantities import duration

__all__ = ["SHORTEST_ROWS", "SHORTEST_S", "detection_limits", "hindrances", "observations"]

Array = NDArray[np.float64]

SHORTEST_ROWS = 2048
SHORTEST_S = 55.0
"""A run of a minute, less its first seconds and a clock that is off."""
_LONGEST_PERIOD = 256
"""Rows after which a pattern may begin anew: noise never does."""
_FULL_SCALE = 32767
_AT_THE_RAIL = 1e-4


def hindrances(series: Series, axis: str) -> tuple[str, ...]:
    """Return why an axis cannot be searched; empty when it can."""
    samples = series.values[:, series.column(axis)]
    n = len(samples)
    if n == 0 or np.all(samples == samples[0]):
        value = f" at {samples[0]:.6g}" if n else ""
        return (f"the channel is constant{value}: it carries no noise to analyse",)
    period = _period(samples)
    if period:
        return (
            f"the samples repeat every {period} rows to the last digit: a test pattern or a loop "
            "of the sender, no noise to analyse",
        )
    needed = max(SHORTEST_S, SHORTEST_ROWS / series.rate_hz)
    if n < SHORTEST_ROWS or series.duration_s < SHORTEST_S:
        missing = duration(np.ceil(needed - series.duration_s))
        return (
            f"too short to search for effects: {duration(series.duration_s)} of the "
            f"{duration(needed)} that it takes; run at least {missing} longer",
        )
    if (
        np.unique(samples[:: max(1, n // 4096)]).size < 2
        or float(np.mean(np.diff(samples) != 0)) < 1e-3
    ):
        return (
            "fewer than one sample in a thousand changes: the step hides the noise, "
            "choose a smaller full scale",
        )
    return ()


def _period(samples: Array) -> int:
    """Return after how many rows all samples come again exactly, 0 where they do not."""
    for period in range(2, min(_LONGEST_PERIOD, len(samples) // 4) + 1):
        if samples[period] == samples[0] and np.array_equal(samples[period:], samples[:-period]):
            return period
    return 0


def observations(series: Series, axis: str) -> tuple[str, ...]:
    """Return what the reader must know of an axis although it can be searched."""
    column = series.column(axis)
    samples, lsb = series.values[:, column], series.lsb[column]
    found = list(series.remarks)
    if full_scale_of(axis, lsb) is not None:  # else nobody knows where the range ends
        rail = float(np.mean(np.abs(samples) >= (_FULL_SCALE - 1) * lsb))
        if rail > _AT_THE_RAIL:
            found.append(
                f"{100 * rail:.2g} % of the samples are at the end of the range: the axis is "
                "saturated and its noise is not what the figures say"
            )
    for other in series.axes:
        factor = multiple_of(series, axis, other) if other != axis else None
        if factor is not None:
            found.append(
                f"{axis} is {factor:.6g} times {other}: the two hold one signal, which says "
                "nothing of how they are coupled"
            )
    share = float(series.bridged.mean())
    if share > 0:
        found.append(f"{100 * share:.2g} % of the samples are missing and were bridged")
    if series.stride > 1:
        found.append(
            f"rows are means of {series.stride} samples: single samples (outliers, repeats, "
            "the lattice) could not be judged, and above "
            f"{series.rate_hz / 2:.3g} Hz there is only the streaming spectrum"
        )
    return tuple(found)


def detection_limits(view: View) -> tuple[str, ...]:
    """Return what could have hidden: the sizes of a line and a step that would have been found."""
    spectrum = view.spectrum
    n = view.grid.n
    top = float(spectrum.at(np.array([view.grid.rate_hz / 8]))[0])
    line = np.sqrt(4 * top / n * (np.log(0.75 * n / 1e-3) + 2))
    k = np.arange(1, view.grid.low + 1)
    shape = np.sin(np.pi * k / 2) ** 2 / (2 * np.sin(np.pi * k / (2 * n))) ** 2 * 2 / n
    step = 6.3 / np.sqrt(np.sum(shape / spectrum.first(view.grid.low)))
    return (
        f"in {duration(view.series.duration_s)} a line above {line:.2g} {view.unit} (at "
        f"{view.grid.rate_hz / 8:.3g} Hz) or a step above {step:.2g} {view.unit} would have been "
        "found",
    )
