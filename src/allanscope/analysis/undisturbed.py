"""Which part of a run is quiet, and what the noise is there.

One lorry at four in the morning is in the coefficients of the whole night. Beside them stand those
of the longest stretch in which nothing was found to begin, to end or to last. Lines, drifts and
processes that are there all along are in it too: it is fitted beside what the search has found.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from allanscope.analysis.findings import event_times
from allanscope.history import Record
from allanscope.parts import Part
from allanscope.samples import unit_of
from allanscope.watch import Event

if TYPE_CHECKING:
    from allanscope.explain import Explanation
    from allanscope.noise import Coefficient, NoiseFit

__all__ = ["Undisturbed", "longest_stretch", "undisturbed"]

FEWEST_ROWS = 256
NEARLY_ALL = 0.98
"""Share of the run from which on there is nothing to tell apart."""


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """The longest stretch without a change, and the noise there.

    Attributes
    ----------
    begin_s, end_s : float
        In s since the first sample.
    axes : mapping
        Axis to its coefficients Q, N, B, K, R, of the samples of the stretch alone.
    """

    begin_s: float
    end_s: float
    axes: Mapping[str, Mapping[str, Coefficient]]


def longest_stretch(
    events: Iterable[Event], length_s: float, also: Iterable[tuple[float, float]] = ()
) -> tuple[float, float]:
    """Return begin and end of the longest stretch in which nothing begins, ends or lasts.

    A level that has shifted, and a rate that is another one, disturb at that moment alone; so does
    noise that has become less. `also` has further times that are disturbed.

    Examples
    --------
    >>> from allanscope.watch import Occurrence
    >>> lorry = Occurrence(100.0, 99.0, 101.0, 103.0, 160.0, 2.0, 1, 2)
    >>> longest_stretch([Event("variance_change", ("gx",), "times", (lorry,), 1, 30.0)], 1000.0)
    (160.0, 1000.0)
    >>> shift = Occurrence(700.0, 699.0, 701.0, 703.0, None, 0.1, 1, 2)
    >>> longest_stretch([Event("step", ("gx",), "dps", (shift,), 1, 30.0)], 1000.0)
    (0.0, 699.0)
    """
    disturbed = list(also)
    for event in events:
        if event.kind == "lost_samples":  # no term spans a gap: it adds no noise
            continue
        for once in event.occurrences:
            end_s = length_s if once.end_s is None else once.end_s
            fades = event.kind == "variance_change" and once.size < 1.0
            if fades or event.kind in ("step", "rate_change"):
                disturbed.append((once.lower_s, once.upper_s))
                disturbed.append((end_s, end_s))
            else:
                disturbed.append((once.lower_s, end_s))
    quiet, free_s = (0.0, 0.0), 0.0
    for begin_s, end_s in [*sorted(disturbed), (length_s, length_s)]:
        if begin_s - free_s > quiet[1] - quiet[0]:
            quiet = free_s, begin_s
        free_s = max(free_s, end_s)
    return quiet


def undisturbed(
    events: Iterable[Event],
    record: Record,
    part: Part | None = None,
    loop: Explanation | None = None,
) -> Undisturbed | None:
    """Return the longest undisturbed stretch of a run and its coefficients.

    Parameters
    ----------
    events : iterable of Event
        What was found in the run.
    record : Record
        Rows of the whole run.
    part : Part, optional
        Whose filters are offered to the fit.
    loop : Explanation, optional
        What the search has found. What has a time disturbs as well; beside the rest is fitted.

    Returns
    -------
    Undisturbed or None
        None where nothing was found, or where the stretch is too short.
    """
    if not len(record.start_s):
        return None
    whole_s = float(record.start_s[-1]) + 1.0 / record.rate_hz
    searched = loop.axes if loop is not None else {}
    times = [event_times(effect) for one in searched.values() for effect in one.effects]
    begin_s, end_s = longest_stretch(events, whole_s, [(t[0], t[-1]) for t in times if t])
    inside = record.between(begin_s, end_s)
    if end_s - begin_s > NEARLY_ALL * whole_s or len(inside.values) < FEWEST_ROWS:
        return None
    from allanscope.analysis.coefficients import published_coefficients
    from allanscope.explain import fit_beside
    from allanscope.noise import fit_noise

    fits = {}
    if loop is not None:
        with suppress(ValueError):  # in pieces too short
            fits = {axis: one.fit for axis, one in fit_beside(loop.held, inside).items()}
    for axis in record.axes:
        if axis not in fits:
            with suppress(ValueError):  # constant, or in pieces too short
                fits[axis] = fit_noise(inside, axis, part=part)
    # Noise below half a step is what the distance of the level from the end of its code makes it.
    coarse = {a for a, o in searched.items() if any(e.kind == "quantization" for e in o.effects)}
    told = [axis for axis in fits if axis not in coarse]
    found = {
        axis: _limited(inside, axis, fits[axis], published_coefficients(axis, fits, searched))
        for axis in told
    }
    return Undisturbed(begin_s, end_s, found) if found else None


def _limited(
    record: Record, axis: str, fit: NoiseFit, coefficients: Mapping[str, Coefficient]
) -> Mapping[str, Coefficient]:
    """Return the coefficients of a stretch; B and K as far as its own curve allows them."""
    from allanscope.allan import deviation
    from allanscope.analysis.curve_limits import SLOW, limited_by_curve

    if not any(coefficients[letter].detected for letter in SLOW):
        return coefficients
    values = record.values[:, record.axes.index(axis)]
    apart = np.insert(values, record.segments[1:, 0], np.nan)  # no term spans a gap
    rows = deviation(apart, record.rate_hz, exact=False)
    curve = replace(rows, m=rows.m * record.stride)
    return limited_by_curve(unit_of(axis), coefficients, fit.model, curve)[0]
