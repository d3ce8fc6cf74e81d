"""`together`: recordings of boards on one bench, or of one board at two rates.

What all boards share is separated from the noise of each, and the lines that two recordings have in
common are traced by their two sample rates.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from allanscope.analysis import (
    AlignedRecords,
    Analysis,
    IndividualNoise,
    RecordedLines,
    Separation,
    SharedLine,
    line_of,
    lines_in_both,
    separate_units,
)
from allanscope.errors import InputError, UsageError
from allanscope.pipeline.analyse_file import analyse_input
from allanscope.pipeline.outputs import short_names
from allanscope.pipeline.settings import DeviceSettings
from allanscope.quantities import DEVIATION, interval, limit, number, symbols
from allanscope.samples import unit_of

__all__ = ["Together", "analyse_together"]

_MOST = 12
_CRYSTAL_PPM = 40.0
"""Standard error of the crystal of a board, by which another board's may differ."""
_SHOWN = 5
"""Averaging times that are shown."""
_IDENTICAL = 1e-3
"""Share of the common deviation below which a board has no noise of its own."""


@dataclass(frozen=True, slots=True)
class Together:
    """What recordings have in common, and what each has alone.

    Attributes
    ----------
    names : tuple of str
        Of the recordings.
    clock : AlignedRecords or None
        How they lie in time; None where they have no axis in common for long enough.
    axes : mapping
        Axis to what all share of it and what each has alone; empty where nothing tells how they
        lie in time.
    lines : tuple of (str, str, SharedLine)
        Two recordings, and a line that both have.
    remarks : tuple of str
        What the reader must know.
    """

    names: tuple[str, ...]
    clock: AlignedRecords | None
    axes: Mapping[str, Separation]
    lines: tuple[tuple[str, str, SharedLine], ...]
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain numbers, null for what is not."""
        clock = self.clock
        return {
            "schema": "allanscope-together/1",
            "recordings": list(self.names),
            "lag_s": list(clock.lag_s) if clock else None,
            "drift_ppm": list(clock.drift_ppm) if clock else None,
            "remarks": list(self.remarks),
            "lines": [{"recordings": [a, b], **asdict(line)} for a, b, line in self.lines],
            "axes": {
                axis: {
                    "unit": unit_of(axis),
                    "tau": one.tau.tolist(),
                    "common": _plain(one.common),
                    "individual": one.is_individual,
                    "own": {
                        name: {
                            "deviation": _plain(own.deviation),
                            "lower": _plain(own.lower),
                            "upper": _plain(own.upper),
                            "measured": _plain(own.measured),
                            "gain": own.gain,
                        }
                        for name, own in zip(self.names, one.own, strict=True)
                    },
                }
                for axis, one in self.axes.items()
            },
        }

    def json(self) -> str:
        """Return `to_dict` as text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    def lines_of_text(self) -> list[str]:
        """Return what a terminal shows."""
        found = [f"{k}  {name}" for k, name in enumerate(self.names, 1)]
        for axis, one in self.axes.items():
            found += ["", *_table(axis, one)]
        if self.lines:
            found.append("")
        for a, b, line in self.lines:
            seen = " and ".join(f"{number(f, 5)} Hz" for f in line.seen_hz)
            pair = f"{self.names.index(a) + 1} and {self.names.index(b) + 1}"
            found.append(f"line at {seen} in {pair}: {line.words}")
        return [*found, *([""] if self.remarks else []), *self.remarks]


def analyse_together(paths: Sequence[Path], device: DeviceSettings, quiet: bool = True) -> Together:
    """Return what two to twelve recordings share, and what each has alone.

    Raises
    ------
    UsageError
        For one recording, or more than twelve.
    InputError
        When one cannot be read, or two are copies of one.
    """
    if not 2 <= len(paths) <= _MOST:
        raise UsageError(f"give 2 to {_MOST} recordings; got {len(paths)}")
    names = tuple(short_names(list(paths)))
    results = [analyse_input(path, device, quiet) for path in paths]
    seen = [_lines_of(one) for one in results]
    lines = tuple(
        (names[i], names[j], line)
        for i, j in combinations(range(len(names)), 2)
        for one, other in [(seen[i], seen[j])]
        if one is not None and other is not None
        for line in lines_in_both(one, other)
    )
    unmeasured = [name for name, one in zip(names, seen, strict=True) if one is None]
    remarks = [f"sample rate not measured, lines not compared: {', '.join(unmeasured)}"]
    try:
        clock, axes, why = separate_units(results, names)
    except ValueError as error:
        raise InputError(str(error)) from None
    remarks = [*(remarks if unmeasured else []), *_same_noise(names, axes), *why]
    return Together(names, clock, axes, lines, tuple(remarks))


def _lines_of(one: Analysis) -> RecordedLines | None:
    """Return the lines of a result; None where its rate was not measured."""
    ppm = one.rate.uncertainty_ppm
    if ppm is None:
        return None
    lines = [line_of(finding.members[0].effect) for finding in one.findings]
    by_device = _CRYSTAL_PPM if one.rate.source == "device" else 0.0
    found = [line[:3] for line in lines if line is not None]
    return RecordedLines(one.rate.best_hz, math.hypot(ppm, by_device), found)


def _table(axis: str, one: Separation) -> list[str]:
    """Return a few rows of one axis: what is shared, and what each has alone."""
    reading = DEVIATION[unit_of(axis)]
    last = len(one.tau) - 1
    rows = sorted({round(last * k / (_SHOWN - 1)) for k in range(_SHOWN)}) if last >= 0 else []
    own = one.own if one.is_individual else one.own[:1]
    heads = [f"own {k}" for k in range(1, len(own) + 1)] if one.is_individual else ["own, mean"]
    cells = [
        [
            f"{number(one.tau[row])} s",
            number(one.common[row] * reading.factor),
            *(_own_cell(curve, row, one.common[row], reading.factor) for curve in own),
        ]
        for row in rows
    ]
    columns = list(zip(["τ", "common", *heads], *cells, strict=True))
    widths = [max(map(len, column)) for column in columns]
    lines = [f"{axis}, Allan deviation in {symbols(reading.unit)} [95 %]"]
    for row in zip(*columns, strict=True):
        left = [f"{cell:>{width}}" for cell, width in zip(row[:2], widths[:2], strict=True)]
        right = [f"{cell:<{width}}" for cell, width in zip(row[2:], widths[2:], strict=True)]
        lines.append(f"  {'   '.join([*left, *right])}".rstrip())
    return lines


def _own_cell(curve: IndividualNoise, row: int, common: float, factor: float) -> str:
    value, low, high = (float(x[row]) * factor for x in (curve.deviation, curve.lower, curve.upper))
    if high < _IDENTICAL * common * factor:
        return "none"
    return interval(value, low, high) if math.isfinite(value) else limit(high)


def _same_noise(names: Sequence[str], axes: Mapping[str, Separation]) -> list[str]:
    """Return which recordings have no noise of their own: two boards always have some."""
    alike: dict[str, list[str]] = {}
    for k, name in enumerate(names):
        quiet = [
            axis
            for axis, one in axes.items()
            if len(one.tau) and (one.own[k].upper < _IDENTICAL * one.own[k].measured).all()
        ]
        if quiet:
            alike.setdefault(" ".join(quiet), []).append(name)
    return [
        f"no noise of its own on {on}: {', '.join(those)}; the samples are copies, or simulated "
        "with one seed"
        for on, those in alike.items()
    ]


def _plain(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float | None]:
    return [float(x) if math.isfinite(x) else None for x in values]
