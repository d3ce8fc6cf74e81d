"""The result of every estimator: a deviation curve with its intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["POINT_COLUMNS", "Deviation", "data_frame"]

POINT_COLUMNS = ("tau", "m", "deviation", "lower", "upper", "edf", "terms", "noise", "trusted")
"""What a `Deviation` says of each averaging time."""

_MOST_ROWS = 60
"""Averaging times that a notebook shows."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """Deviation against averaging time, with everything needed to judge it.

    Arrays are ``(k,)`` for one axis or ``(axes, k)`` for several; `tau` is always ``(k,)``.

    Attributes
    ----------
    kind : str
        Estimator, e.g. ``"oadev"``.
    tau : ndarray, shape (k,)
        Averaging time in s, ascending: m / rate (0.75 m / rate for the Theo family).
    m : ndarray of int, shape (k,)
        Averaging factor in samples.
    deviation : ndarray
        The estimate in the unit of the data (times s for the time deviations).
    lower, upper : ndarray
        Chi-square limits of `deviation` at confidence `level`.
    edf : ndarray
        Equivalent degrees of freedom, those with which 95 % limits hold: `degrees_of_freedom` but
        for the totals and the Theo family near the end of the run.
    terms : ndarray of int
        Number of squared differences in the estimate.
    noise : ndarray of str
        Power law identified at this tau: ``WPM FPM WFM FFM RWFM FWFM RRFM``, or ``""``.
    level : float
        Two-sided confidence of `lower` and `upper`.
    trusted : ndarray of bool, shape (k,)
        False beyond the part of the run up to which DT0064 trusts this estimator, and where its
        limits do not hold: `Estimator.trusts`. Shape (axes, k) for several axes of estimators for
        which that depends on the noise.
    """

    kind: str
    tau: NDArray[np.float64]
    m: NDArray[np.int64]
    deviation: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    edf: NDArray[np.float64]
    terms: NDArray[np.int64]
    noise: NDArray[np.str_]
    level: float
    trusted: NDArray[np.bool_]

    @property
    def variance(self) -> NDArray[np.float64]:
        """Square of the deviation: AVAR of ADEV."""
        return self.deviation**2

    def simple_limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the limits of DT0064: deviation -+ deviation / sqrt(terms).

        One standard deviation if the terms were independent, which those of overlapping estimators
        are not: at long tau it is far too narrow. Kept for comparison with figures made that way.
        """
        error = self.deviation / np.sqrt(self.terms)
        return self.deviation - error, self.deviation + error

    def axis(self, column: int) -> Deviation:
        """Return the curve of one axis, without the taus at which it has no value."""
        if self.deviation.ndim == 1:
            return self
        keep = np.isfinite(self.deviation[column])
        return Deviation(
            kind=self.kind,
            tau=self.tau[keep],
            m=self.m[keep],
            deviation=self.deviation[column, keep],
            lower=self.lower[column, keep],
            upper=self.upper[column, keep],
            edf=self.edf[column, keep],
            terms=self.terms[column, keep],
            noise=self.noise[column, keep],
            level=self.level,
            trusted=np.broadcast_to(self.trusted, self.deviation.shape)[column, keep],
        )

    def trust_runs(self) -> list[tuple[bool, slice]]:
        """Return stretches of equal trust, each from the last point of the one before on."""
        edges = [0, *(np.flatnonzero(np.diff(self.trusted)) + 1).tolist(), len(self.trusted)]
        return [
            (bool(self.trusted[start]), slice(max(start - 1, 0), stop))
            for start, stop in pairwise(edges)
            if stop > start
        ]

    def plot(
        self,
        ax: Axes | None = None,
        *,
        factor: float = 1.0,
        unit: str = "",
        label: str | None = None,
        color: str | None = None,
    ) -> Axes:
        """Draw the curve on logarithmic scales, with its intervals.

        Beyond the part of the run up to which the estimator is trusted the curve goes on, hollow
        and dotted.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; by default a new figure of pyplot.
        factor : float
            Multiplies the deviation, e.g. 1000 for mdps.
        unit : str
            Unit after `factor`, for the label of the axis.
        label : str, optional
            Name in a legend; by default the estimator.
        color : str, optional
            Colour of a single curve.

        Returns
        -------
        matplotlib Axes
        """
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.subplots(layout="constrained")[1]
        curves = 1 if self.deviation.ndim == 1 else len(self.deviation)
        for number in range(curves):
            name = self.kind if label is None else label
            name = name if curves == 1 else f"{name} {number}"
            _draw(ax, self.axis(number), factor, name, color if curves == 1 else None)
        ax.set_xlabel("averaging time τ (s)")
        ax.set_ylabel(f"σ(τ) ({unit})" if unit else "σ(τ)")
        # Denormal numbers have no digits left that a logarithmic scale could show.
        if np.any(factor * self.deviation > np.finfo(float).tiny):
            ax.set_xscale("log")
            ax.set_yscale("log")
        return ax

    def to_dataframe(self) -> Any:
        """Return the curve as a table of pandas, or of polars where there is no pandas.

        One row for each averaging time, and for each axis (column ``axis``) where there are
        several.

        Raises
        ------
        ImportError
            When neither is installed.
        """
        return data_frame(self._columns())

    def __repr__(self) -> str:
        """Return what it is of, in one line."""
        count = self.tau.size
        ends = f", {self.tau[0]:.4g} to {self.tau[-1]:.4g} s" if count else ""
        return f"<Deviation {self.kind}: {count} averaging times{ends}>"

    def _repr_html_(self) -> str:
        columns = self._columns()
        rows = list(zip(*columns.values(), strict=True))
        names = ("tau, s" if name == "tau" else name for name in columns)
        head = "".join(f"<th>{name}</th>" for name in names)
        body = "".join(
            f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>"
            for row in rows[:_MOST_ROWS]
        )
        more = len(rows) - _MOST_ROWS
        tail = f"<p>and {more} more rows</p>" if more > 0 else ""
        return (
            f"<p>{escape(self.kind)}, {100 * self.level:g} % intervals</p>"
            f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{tail}"
        )

    def _columns(self) -> dict[str, NDArray[Any]]:
        if self.deviation.ndim == 1:
            return {name: getattr(self, name) for name in POINT_COLUMNS}
        parts = [self.axis(number) for number in range(len(self.deviation))]
        axis = np.repeat(np.arange(len(parts)), [len(one.tau) for one in parts])
        columns = {n: np.concatenate([getattr(one, n) for one in parts]) for n in POINT_COLUMNS}
        return {"axis": axis, **columns}


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return columns as a table of pandas, or of polars where there is no pandas.

    Raises
    ------
    ImportError
        When neither is installed.
    """
    for package in ("pandas", "polars"):
        try:
            return import_module(package).DataFrame(dict(columns))
        except ModuleNotFoundError as error:
            if error.name != package:
                raise
    raise ImportError("a table needs pandas or polars: python -m pip install pandas")


def _draw(ax: Axes, curve: Deviation, factor: float, label: str, color: str | None) -> None:
    trusted, sigma = curve.trusted, factor * curve.deviation
    (line,) = ax.plot(
        curve.tau[trusted], sigma[trusted], "o-", ms=2.5, lw=1.0, c=color, label=label
    )
    shade = line.get_color()
    low, high = factor * curve.lower, factor * curve.upper
    ax.fill_between(curve.tau, low, high, color=shade, alpha=0.2, lw=0)
    if not trusted.all():
        # At short tau and at long ones, each up to the nearest point that is trusted.
        for certain, run in curve.trust_runs():
            if not certain:
                part = slice(run.start, run.stop + 1)
                ax.plot(curve.tau[part], sigma[part], "o:", ms=2.5, lw=0.9, c=shade, mfc="none")


def _cell(value: object) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return escape(str(value))
