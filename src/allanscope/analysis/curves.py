"""The curves of a run: of its bank or of every sample, and on across short gaps.

No term of a bank spans a gap, so one sample lost in a thousand ends a curve at some hundred
samples, however long the run. The noise is fitted to a series whose short gaps are filled with
noise like that around them (`allanscope.noise.gap_bridging`), and from that series the long
averaging times are computed too: there the filling is a small part of every mean, as rare as the
losses. At short ones, where terms between the gaps tell as much, those stay, as measured::

    curve of the bank ──────────────┐ as long as it has half of the degrees of freedom
    record ─▶ bridge_gaps ─▶ bank ──┴ from there on
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank
from allanscope.allan.choices import CurveChoices
from allanscope.allan.deviation import POINT_COLUMNS, Deviation
from allanscope.analysis.analyser import StreamState
from allanscope.errors import UsageError
from allanscope.history import Record
from allanscope.noise.gap_bridging import bridge_gaps, steps_of, worth_of
from allanscope.samples import StreamInfo

__all__ = ["across_gaps", "curves_of_bank", "curves_of_samples"]

LIVE_KINDS = ("oadev", "mdev", "ohdev", "totdev")
MOST_LIVE_ROWS = 1 << 18
"""Rows whose gaps a refresh bridges: a second or two."""

_WORTH = 0.5
"""Part of the degrees of freedom below which the terms between gaps are dropped."""
_FEWEST_ROWS = 32
"""Shortest averaging time in rows that are means themselves: as in `allanscope.allan.curves`."""

Curves = dict[str, dict[str, Deviation]]
"""Of each axis the curve of each estimator."""


def curves_of_bank(
    info: StreamInfo,
    bank: AllanBank,
    record: Record,
    rate_hz: float,
    level: float,
    choices: CurveChoices,
    is_live: bool = False,
) -> Curves:
    """Return the curves of a bank, continued across short gaps.

    Parameters
    ----------
    info : StreamInfo
        What its columns are.
    bank : AllanBank
        The sums of a run, in counts; its scale is set.
    record : Record
        The memory of the same run.
    rate_hz : float
        True sample rate.
    level : float
        Two-sided confidence of the limits.
    choices : CurveChoices
        Which curves.
    is_live : bool
        Whether only what a refresh can afford is asked for.
    """
    found: Curves = {name: {} for name in info.axes}
    bank.scale = np.asarray(info.scale)
    for kind in LIVE_KINDS if is_live else choices.kinds_of_banks:
        whole = choices.of_bank(bank, kind, level, rate_hz)
        for column, name in enumerate(info.axes):
            curve = whole.axis(column)
            if len(curve.tau):
                found[name][kind] = curve
    most = MOST_LIVE_ROWS if is_live else sys.maxsize
    return across_gaps(found, record, choices, level, most)


def curves_of_samples(
    state: StreamState, rate_hz: float, level: float, choices: CurveChoices
) -> Curves:
    """Return the curves at averaging times that no bank has, from every sample.

    Raises
    ------
    UsageError
        When an averaging time that was asked for has no value.
    """
    found: Curves = {}
    for column, (name, scale) in enumerate(zip(state.info.axes, state.info.scale, strict=True)):
        values = scale * state.samples_with_gaps(column)
        try:
            curves = {
                kind: choices.of_samples(values, kind, level, rate_hz)
                for kind in choices.kinds_of_arrays
            }
        except ValueError as error:
            raise UsageError(str(error)) from None
        found[name] = {kind: curve for kind, curve in curves.items() if curve is not None}
    return found


def across_gaps(
    curves: Mapping[str, Mapping[str, Deviation]],
    record: Record,
    choices: CurveChoices,
    level: float,
    most_rows: int = sys.maxsize,
) -> Curves:
    """Return the curves of a run, continued across its short gaps.

    Parameters
    ----------
    curves : mapping
        Of each axis the curve of each estimator, without a term across a gap.
    record : Record
        The memory of the same run.
    choices : CurveChoices
        As the curves were made.
    level : float
        Two-sided confidence of their limits.
    most_rows : int
        A longer record, as coarse as its gaps allow, takes too long to bridge; its curves stay.

    Examples
    --------
    A minute of white noise of which every eighth sample is lost:

    >>> rows = np.delete(np.arange(6000), np.arange(7, 6000, 8))
    >>> values = np.random.default_rng(1).standard_normal((len(rows), 1))
    >>> bounds = np.column_stack([np.arange(0, len(rows), 7), np.arange(7, len(rows) + 7, 7)])
    >>> nan = np.full(len(rows), np.nan)
    >>> record = Record(100.0, 1, ("gx",), values, (1.0,), nan, rows / 100.0, bounds)
    >>> bank, choices = AllanBank(100.0, 1), CurveChoices()
    >>> for first, last in bounds:
    ...     bank.gap()
    ...     bank.update(values[first:last])
    >>> short = choices.of_bank(bank, "oadev", 0.95, 100.0).axis(0)
    >>> long = across_gaps({"gx": {"oadev": short}}, record, choices, 0.95)["gx"]["oadev"]
    >>> float(short.tau[-1]), float(long.tau[long.trusted][-1])
    (0.03, 5.12)
    >>> at = int(long.m.searchsorted(64))  # the truth is 1 / 8
    >>> [float(part[at].round(3)) for part in (long.lower, long.deviation, long.upper)]
    [0.105, 0.119, 0.138]
    """
    bridged = _bridged(record, most_rows)
    if bridged is None:
        return {name: dict(of_axis) for name, of_axis in curves.items()}
    bank = AllanBank(bridged.rate_hz, len(record.axes), choices.times_in_each_octave)
    for first, last in bridged.segments:
        bank.gap()
        bank.update(bridged.values[first:last])
    worth, joined = worth_of(bridged), {}
    kinds = dict.fromkeys(kind for of_axis in curves.values() for kind in of_axis)
    whole = {kind: choices.of_bank(bank, kind, level, bridged.rate_hz) for kind in kinds}
    for column, name in enumerate(record.axes):
        joined[name] = {
            kind: _joined(curve, _in_samples(whole[kind].axis(column), bridged.stride, worth))
            for kind, curve in curves.get(name, {}).items()
        }
    return joined


def _bridged(record: Record, most_rows: int) -> Record | None:
    """Return a record without short gaps, in rows that serve the averaging times wanted."""
    if len(record.values) < 2:
        return None
    steps, short = steps_of(record)
    if not short.any():
        return None
    # The shortest averaging time must still fit between most of the gaps, or a hole would be left.
    lengths = np.diff(record.segments, axis=1)
    each = 1
    while np.maximum(lengths - 6 * _FEWEST_ROWS * each, 0).sum() > _WORTH * lengths.sum():
        each *= 2
    rows = record if each == 1 else _means_on_a_grid(record, np.where(short, steps, 0), each)
    return bridge_gaps(rows) if len(rows.values) <= most_rows else None


def _means_on_a_grid(record: Record, gaps: NDArray[np.int64], each: int) -> Record:
    """Return the means of `each` rows, of those that were not lost in a short gap.

    Parameters
    ----------
    record : Record
        Rows.
    gaps : ndarray of int64, shape (n - 1,)
        Steps to the next row where that is across a short gap, else 0.
    each : int
        Rows of a mean. No mean spans a long gap; what does not fill one before it is given up.
    """
    first = np.zeros(len(record.values), bool)
    first[record.segments[:, 0]] = True
    first[1:] &= gaps == 0
    row = np.concatenate([[0], np.cumsum(np.maximum(gaps, 1))])
    begin = np.flatnonzero(first)
    piece = np.cumsum(first) - 1
    mean = (row - row[begin][piece]) // each
    last = np.append(row[begin[1:] - 1], row[-1])[piece] - row[begin][piece]
    whole = np.flatnonzero((mean + 1) * each <= last + 1)
    key = (piece << 40) + mean
    at = np.flatnonzero(np.diff(key[whole], prepend=-1))
    count = np.diff(np.append(at, len(whole)))
    cut = np.flatnonzero(np.diff(key[whole][at], prepend=-9) != 1)
    start = record.start_s[begin][piece[whole][at]] + mean[whole][at] * each / record.rate_hz
    return replace(
        record,
        rate_hz=record.rate_hz / each,
        stride=record.stride * each,
        values=np.add.reduceat(record.values[whole], at) / count[:, np.newaxis],
        temperature_c=np.full(len(at), np.nan),
        start_s=start,
        segments=np.column_stack([cut, np.append(cut[1:], len(at))]),
    )


def _in_samples(curve: Deviation, stride: int, worth: float) -> Deviation:
    """Return a curve of rows as one of samples, known as well as the measured rows tell."""
    wider = 1.0 / math.sqrt(worth)
    none = np.ones_like(curve.deviation)  # of a constant axis, whose deviation is 0

    def limit(of: NDArray[np.float64]) -> NDArray[np.float64]:
        ratio = np.divide(of, curve.deviation, out=none.copy(), where=curve.deviation > 0)
        return np.asarray(curve.deviation * ratio**wider)

    known = replace(
        curve,
        m=curve.m * stride,
        edf=np.maximum(worth * curve.edf, 1.0),
        lower=limit(curve.lower),
        upper=limit(curve.upper),
    )
    return known if stride == 1 else _part(known, curve.m >= _FEWEST_ROWS)


def _joined(between: Deviation, across: Deviation) -> Deviation:
    """Return a curve from terms between the gaps, and from where they are few across them."""
    here = dict(zip(between.m.tolist(), between.edf.tolist(), strict=True))
    few = [
        here.get(m, 0.0) < _WORTH * edf
        for m, edf in zip(across.m.tolist(), across.edf.tolist(), strict=True)
    ]
    if not any(few):
        return between
    start = across.m[few.index(True)]
    parts = _part(between, between.m < start), _part(across, across.m >= start)
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in POINT_COLUMNS
    }
    return replace(between, **joined)


def _part(curve: Deviation, keep: NDArray[np.bool_]) -> Deviation:
    kept: dict[str, Any] = {name: getattr(curve, name)[keep] for name in POINT_COLUMNS}
    return replace(curve, **kept)
