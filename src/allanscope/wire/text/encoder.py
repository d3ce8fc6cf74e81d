"""A device that prints comma-separated text with a header, simulated."""

from __future__ import annotations

import math

import numpy as np

from allanscope.samples import AXES, Block, StreamInfo, unit_of
from allanscope.wire.device_side import OneWayEncoder, temperatures, times

__all__ = ["TextEncoder"]

_DIGITS = 9


class TextEncoder(OneWayEncoder):
    """Blocks to lines of time in us, axes in dps and g, temperature in degC."""

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
        stamps = np.rint(times(block, rows, self._info.nominal_hz) * 1e6).astype(np.int64).tolist()
        values = np.round(block.counts * np.asarray(self._info.scale), _DIGITS).tolist()
        degrees = ["" if math.isnan(t) else f"{t:.3f}" for t in temperatures(block, rows).tolist()]
        lines = [
            f"{stamp},{','.join(map(repr, row))},{warmth}\r\n"
            for stamp, row, warmth in zip(stamps, values, degrees, strict=True)
        ]
        return "".join(lines).encode("ascii")
