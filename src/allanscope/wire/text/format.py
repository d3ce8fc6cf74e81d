"""The registry entry of text."""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.wire.base import WireFormat, WireSettings
from allanscope.wire.text.decoder import TextDecoder
from allanscope.wire.text.encoder import TextEncoder

__all__ = ["TextFormat"]

_TEXT_BYTES = frozenset(b"\t\r\n\x1b") | frozenset(range(0x20, 0x7F))


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
        if not sample or sum(byte in _TEXT_BYTES for byte in sample) < 0.9 * len(sample):
            return 0.0
        decoder = TextDecoder(WireSettings())
        decoder.feed(sample, 0.0)
        decoder.finish()
        rows, others = decoder.stats.samples, decoder.stats.resyncs + decoder.stats.unknown
        if decoder.named:
            return 0.9 if rows >= 2 and rows > decoder.stats.resyncs else 0.0
        return 0.6 if rows >= 5 and rows > 4 * others else 0.0
