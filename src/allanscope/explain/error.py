"""How far a model is from the data: the four numbers that are printed before and after.

*Same data*: both columns speak of the same record. Before, the record as measured stands against
the textbook terms. After, what was accepted as deterministic (lines, steps, warm-up, temperature,
outliers, coupling) is subtracted from it and the rest stands against the refitted terms with the
stationary effects, because a signal has no place in a variance model: that a line was subtracted
rather than modelled makes no difference to the taus it does not touch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank, Deviation
from allanscope.explain.effect import ResidualError
from allanscope.explain.residual import band_scores
from allanscope.explain.view import View
from allanscope.noise import NoiseModel, gls_chi2
from allanscope.noise.components import Ramp

__all__ = ["deviation_of", "error_of"]

Array = NDArray[np.float64]

_PER_OCTAVE = 2


def deviation_of(data: Array, rate_hz: float) -> Deviation:
    """Overlapping Allan deviation on a half-octave grid."""
    bank = AllanBank(rate_hz, axes=1, per_octave=_PER_OCTAVE)
    bank.update(data[:, np.newaxis])
    return bank.deviation("oadev").axis(0)


def error_of(view: View, model: NoiseModel) -> ResidualError:
    """Compare the data of a view with a model, up to a third of the record."""
    curve = deviation_of(view.data, view.grid.rate_hz)
    stride = view.grid.stride  # the model is one of samples
    curve = replace(curve, m=stride * curve.m)
    fitted = sum(
        model.number(f) > 0 for f in model.numbers if not isinstance(model.parts[f.part], Ramp)
    )
    residual = gls_chi2(curve, model, n=stride * view.grid.n, fitted=fitted)
    bands = band_scores(view)
    return ResidualError(
        chi2_per_dof=residual.chi2 / residual.dof,
        p_value=residual.p_value,
        rms_percent=residual.rms_percent,
        expected_rms_percent=residual.expected_rms_percent,
        worst_band_z=float(bands.z[np.argmax(np.abs(bands.z))]),
    )
