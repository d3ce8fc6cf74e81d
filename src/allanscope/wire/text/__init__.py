"""Text: tables of numbers and lines with labels, from whatever prints them.

::

    bytes ─▶ lines ─┬▶ columns (header) ─▶ table (rows) ─┬▶ meaning (axes, units, scale) ─▶ rows
                    └▶ labelled (which kind of line) ────┘             losses, Blocks ◀────┘

Sentences as of NMEA are rows of known columns (`labelled`). Values arrive as they are written: in
dps and g as float64, or in counts when the text says so (``[lsb]``) or has nothing but whole
numbers. Where no row comes of it, `refusal` says why. Columns and units are those of arrays and
tables in files as well.
"""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.wire.base import WireFormat, WireSettings
from allanscope.wire.lines import is_text
from allanscope.wire.text.columns import Column, column_of
from allanscope.wire.text.decoder import TextDecoder
from allanscope.wire.text.encoder import TextEncoder
from allanscope.wire.text.refusal import why_no_rows
from allanscope.wire.text.units import (
    DIVISORS,
    LARGEST,
    SMALLEST,
    Quantity,
    accel_comes_first,
    quantity_named,
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
    "column_of",
    "quantity_named",
    "unit_by_gravity",
    "why_no_rows",
]


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
