"""Noise: what a record is made of, as numbers with intervals.

::

    History rows ──▶ DCT ordinates ─┐
                                    ├─▶ Whittle likelihood ──▶ NoiseFit (Q N B K R, band limit)
    SpectrumBank ──▶ density bands ─┘            ▲                  │
                                          components/, model        ├─▶ datasheet, exports
    AllanBank ──▶ Deviation ──▶ GLS with full covariance ◀──────────┘
"""
