"""The pictures of a lot: each unit a dot, so that nothing hides in a mean."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from allanscope.fleet.drift import started_days
from allanscope.fleet.lot import Lot
from allanscope.quantities import COEFFICIENTS, symbols
from allanscope.report.picture import DATASHEET, MEASURED, MODEL, Picture, ink

__all__ = ["distribution_picture", "history_picture"]

MOST_DOTS = 1000
"""For each axis; the quantiles of a larger lot look the same."""

_HALF_WIDTH = 0.3
_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


def distribution_picture(lot: Lot, sensor_unit: str) -> Picture:
    """Return N, B and K of all axes of one sensor; a bar is the median, a line the datasheet."""
    axes = [axis for axis in lot.axes if lot.of_axis(axis)["sensor_unit"][0] == sensor_unit]

    def draw(figure: Figure) -> None:
        for name, ax in zip("NBK", figure.subplots(1, 3), strict=True):
            reading = COEFFICIENTS[sensor_unit, name][0]
            for at, axis in enumerate(axes):
                here = lot.of_axis(axis).detected(name)
                values = here[f"{name}_value"] * reading.factor
                if len(values):
                    dots = _quantiles(values)
                    shift = _HALF_WIDTH * (2.0 * _scattered(len(dots)) - 1.0)
                    ax.plot(at + shift, dots, "o", ms=2.5, alpha=0.6, c=MEASURED)
                    ax.plot([at - 0.4, at + 0.4], [np.median(values)] * 2, c=MODEL, lw=1.6)
                limit = lot.of_axis(axis)["datasheet_limit"]
                if name == "N" and np.isfinite(limit).any():
                    two_sided = np.nanmedian(limit) / np.sqrt(2.0) * reading.factor
                    ax.plot([at - 0.45, at + 0.45], [two_sided] * 2, "-.", c=DATASHEET, lw=1.4)
            if ax.has_data():
                ax.set_yscale("log")
            else:
                ax.set_yticks([])
                ax.text(0.5, 0.5, "not seen", ha="center", transform=ax.transAxes)
            ax.set_xticks(range(len(axes)), axes)
            ax.set_xlim(-0.6, len(axes) - 0.4)
            ax.set_title(f"{name} ({symbols(reading.unit)})", fontsize=9, color=ink())
            ax.grid(which="both", axis="y", alpha=0.2)

    return Picture(draw, height=3.0)


def history_picture(lot: Lot, sensor_unit: str) -> Picture | None:
    """Return N of every run over its date, less the median of its axis; None for a single day."""
    days = started_days(lot)
    here = lot.where((lot["sensor_unit"] == sensor_unit) & np.isfinite(days)).detected("N")
    when = started_days(here)
    if len(here) == 0 or np.ptp(when) < 1.0:
        return None

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        for axis in here.axes:
            some = here["axis"] == axis
            ratio = here["N_value"][some] / np.median(here["N_value"][some])
            shown = np.linspace(0, len(ratio) - 1, min(len(ratio), MOST_DOTS)).astype(np.int64)
            days_on = (when[some] - when.min())[shown]
            ax.plot(days_on, 100.0 * (ratio[shown] - 1.0), "o", ms=3, label=axis)
        ax.axhline(0.0, c=ink(), lw=0.8)
        ax.set_xlabel("days since the first run")
        ax.set_ylabel("N against the median (%)")
        ax.legend(ncols=3)

    return Picture(draw, height=2.6)


def _quantiles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values, ascending; of very many those that tell their distribution."""
    ascending = np.sort(values)
    return ascending[np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).astype(np.int64)]


def _scattered(count: int) -> NDArray[np.float64]:
    """Return places between 0 and 1 that are spread evenly, neighbours far from each other."""
    return np.asarray(np.arange(1, count + 1) * _GOLDEN % 1.0)
