"""Text: tables of numbers and lines with labels, from whatever prints them.

::

    bytes ─▶ lines ─┬▶ columns (header) ─▶ table (rows) ─┬▶ meaning (axes, units, scale) ─▶ rows
                    └▶ labelled ─▶ spoken (which kind) ──┘             losses, Blocks ◀────┘

Values arrive as they are written: in dps and g as float64, or in counts when the text says so
(``[lsb]``) or has nothing but whole numbers.
"""

from __future__ import annotations

from allanscope.wire.text.decoder import TextDecoder
from allanscope.wire.text.encoder import TextEncoder
from allanscope.wire.text.format import TextFormat

__all__ = ["TextDecoder", "TextEncoder", "TextFormat"]
