"""Text: tables of numbers and lines with labels, from whatever prints them.

::

    bytes ─▶ lines ─┬▶ columns (header) ─▶ table (rows) ─┬▶ interpretation ─▶ row_events
                    └▶ labelled (which kind of line) ────┘  axes, units,      losses, Blocks
                                                            scale

Sentences as of NMEA are rows of known columns (`labelled`). Values arrive as they are written: in
dps and g as float64, or in counts when the text says so (``[lsb]``) or has nothing but whole
numbers. Where no row comes of it, `refusal` says why. Columns and units are those of arrays and
tables in files as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from allanscope.samples import AXES, Block, StreamInfo, unit_of
from allanscope.wire.base import (
    OneWayEncoder,
    WireFormat,
    WireSettings,
    device_times,
    temperatures_at,
)
from allanscope.wire.lines import is_text
from allanscope.wire.text.columns import Column, column_of, columns_of, sensor_of_name
from allanscope.wire.text.decoder import TextDecoder
from allanscope.wire.text.refusal import why_no_rows
from allanscope.wire.text.units import (
    DIVISORS,
    LARGEST,
    SMALLEST,
    Quantity,
    accel_comes_first,
    assumed_as,
    gyro_unit,
    quantity_named,
    shows_gravity,
    unit_by_gravity,
)

__all__ = [
    "DIVISORS",
    "LARGEST",
    "SMALLEST",
    "Column",
    "Quantity",
    "TextDecoder",
    "TextEncoder",
    "TextFormat",
    "accel_comes_first",
    "assumed_as",
    "column_of",
    "columns_of",
    "gyro_unit",
    "quantity_named",
    "sensor_of_name",
    "shows_gravity",
    "unit_by_gravity",
    "why_no_rows",
]


_DIGITS = 9


class TextEncoder(OneWayEncoder):
    """Blocks to comma-separated lines: time in us, axes in dps and g, temperature in degC."""

    def __init__(self) -> None:
        super().__init__(StreamInfo(AXES, (8.75e-3,) * 3 + (0.061e-3,) * 3, 104.0))

    def describe(self, info: StreamInfo) -> bytes:
        """Return the header."""
        super().describe(info)
        names = [f"{axis}[{unit_of(axis)}]" for axis in info.axes]
        return ",".join(["t[us]", *names, "temp[degC]"]).encode("ascii") + b"\r\n"

    def encode(self, block: Block) -> bytes:
        """Return one line a row; the temperature is empty where there is none."""
        rows = np.arange(len(block))
        stamps = np.rint(1e6 * device_times(block, rows, self._info.nominal_hz)).tolist()
        values = np.round(block.counts * np.asarray(self._info.scale), _DIGITS).tolist()
        degrees = temperatures_at(block, rows).tolist()
        lines = [
            f"{stamp:.0f},{','.join(map(repr, row))},{'' if math.isnan(t) else f'{t:.3f}'}\r\n"
            for stamp, row, t in zip(stamps, values, degrees, strict=True)
        ]
        return "".join(lines).encode("ascii")


@dataclass(frozen=True, slots=True)
class TextFormat(WireFormat):
    """Tables with or without a header, and lines with labels."""

    name: str = "text"
    summary: str = "lines of numbers: CSV, TSV, MEMS-Studio logs, consoles with labels"

    def decoder(self, settings: WireSettings) -> TextDecoder:
        """Return a fresh decoder."""
        return TextDecoder(settings)

    def encoder(self) -> TextEncoder:
        """Return a fresh encoder."""
        return TextEncoder()

    def score(self, sample: bytes) -> float:
        """Return 0.9 where names say what the numbers are, 0.6 for bare rows of numbers, else 0.

        Less than the formats that are text as well but have a grammar.
        """
        if not is_text(sample):
            return 0.0
        decoder = TextDecoder(WireSettings())
        decoder.feed(sample, 0.0)
        decoder.finish()
        rows, others = decoder.stats.samples, decoder.stats.resyncs + decoder.stats.unknown
        if decoder.named:
            return 0.9 if rows >= 2 and rows > decoder.stats.resyncs else 0.0
        return 0.6 if rows >= 5 and rows > 4 * others else 0.0
