"""What the closed loop is given to look at: the memory of a run, its spectrum and its rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from allanscope.analysis.state import StreamState
from allanscope.history import Record
from allanscope.noise.quantised import find_step
from allanscope.spectrum.density import Density

__all__ = ["FEWEST_ROWS", "Look", "look_of"]

FEWEST_ROWS = 64
"""Rows below which nothing is fitted."""


@dataclass(frozen=True, slots=True)
class Look:
    """A run so far, as the closed loop sees it.

    Attributes
    ----------
    record : Record
        Rows of all axes.
    densities : mapping of str to Density
        What there is above the rows of a long run.
    nominal_hz : float or None
        Sample rate that the device claims.
    rate_fit : (float, float) or None
        Measured rate and its standard error in Hz.
    """

    record: Record
    densities: Mapping[str, Density]
    nominal_hz: float | None
    rate_fit: tuple[float, float] | None

    @property
    def length_s(self) -> float:
        """Time that the rows cover, in s."""
        return len(self.record.values) / self.record.rate_hz


def look_of(state: StreamState) -> Look:
    """Return what the sums of one configuration have to show."""
    state.settle()
    fit = state.clock.rate()
    rate_hz = fit.hz or 1.0
    claimed_hz = state.info.nominal_hz if state.info.rate_claimed else 0.0
    measured = None
    if fit.is_measured and state.info.nominal_hz:
        measured = (fit.hz, fit.hz * fit.uncertainty_ppm * 1e-6)
    return Look(_record(state, rate_hz), _densities(state, rate_hz), claimed_hz or None, measured)


def _record(state: StreamState, rate_hz: float) -> Record:
    """Return the memory of the run; the step of numbers that are no counts is found from them."""
    record = state.history.record(rate_hz, state.info.axes, state.info.scale)
    if state.counted:
        return record
    steps = tuple(find_step(column * record.stride) for column in record.values.T)
    return replace(record, lsb=steps)


def _densities(state: StreamState, rate_hz: float) -> dict[str, Density]:
    """Return the measured density of every axis."""
    found = state.spectrum.densities(rate_hz, list(state.info.scale))
    return dict(zip(state.info.axes, found, strict=True))
