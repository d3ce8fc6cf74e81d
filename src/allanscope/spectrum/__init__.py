"""Spectrum: the power spectral density of a run, while it runs, in constant memory.

::

    samples ──▶ level 0 ──▶ mean |FFT|^2 ─────────────────────────┐  high frequencies
                   │ low-pass, every 4th                          │
                   ▼                                              ├─▶ bands ──▶ Density
                level 1 ──▶ mean |FFT|^2 ─────────────────────────┤
                   │                                              │
                   ▼ ...                                          ┘  low frequencies

Every level sees a quarter of the rate of the one above and resolves four times finer, so that the
resolution is about the same fraction of the frequency everywhere. A level is read only where the
low-pass in front of it is flat and closed to aliases.
"""

from typing import TYPE_CHECKING

from allanscope.lazy import lazily
from allanscope.spectrum.density import Density

if TYPE_CHECKING:
    from allanscope.spectrum.bank import SpectrumBank, SpectrumShard
    from allanscope.spectrum.ladder import SEGMENT

__all__ = ["SEGMENT", "Density", "SpectrumBank", "SpectrumShard"]

__getattr__, __dir__ = lazily(
    __name__, {"SEGMENT": "ladder", "SpectrumBank": "bank", "SpectrumShard": "bank"}
)
