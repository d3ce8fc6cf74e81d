"""How far a model is from the data: the four numbers that are printed before and after.

*Same data*: both columns speak of the same record. Before, the record as measured stands against
the textbook terms. After, what was accepted as deterministic (lines, steps, warm-up, temperature,
outliers, coupling) is subtracted from it and the rest stands against the refitted terms with the
stationary effects, because a signal has no place in a variance model: that a line was subtracted
rather than modelled makes no difference to the taus it does not touch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.bank import AllanBank
from allanscope.allan.deviation import Deviation
from allanscope.explain.effect import ResidualError
from allanscope.explain.residual import band_scores
from allanscope.explain.view import View
from allanscope.noise.model import NoiseModel

__all__ = ["deviation_of", "error_of"]

Array = NDArray[np.float64]

_PER_OCTAVE = 2
_LEAST_EDF = 4.0
"""Where an estimate has fewer degrees of freedom it says nothing about the model."""


def deviation_of(data: Array, rate_hz: float) -> Deviation:
    """Overlapping Allan deviation on a half-octave grid."""
    bank = AllanBank(rate_hz, axes=1, per_octave=_PER_OCTAVE)
    bank.update(data[:, np.newaxis])
    return bank.deviation("oadev").axis(0)


def error_of(view: View, model: NoiseModel) -> ResidualError:
    """Compare the data of a view with a model.

    `rms_percent` and `expected_rms_percent` are over the taus whose estimate has at least four
    degrees of freedom: the last ones have one or two and would drown all others.
    """
    curve = deviation_of(view.data, view.grid.rate_hz)
    expected = model.deviation("oadev", curve.m)
    good = (curve.edf >= _LEAST_EDF) & np.isfinite(curve.deviation) & (expected > 0)
    ratio = curve.deviation[good] / expected[good] - 1
    bands = band_scores(view)
    chi2, p_value = _chi2(curve, model, view.grid.n)
    return ResidualError(
        chi2_per_dof=chi2,
        p_value=p_value,
        rms_percent=float(100 * np.sqrt(np.mean(ratio**2))) if good.any() else float("nan"),
        expected_rms_percent=float(100 * np.sqrt(np.mean(1 / (2 * curve.edf[good]))))
        if good.any()
        else float("nan"),
        worst_band_z=float(bands.z[np.argmax(np.abs(bands.z))]),
    )


def _chi2(curve: Deviation, model: NoiseModel, samples: int) -> tuple[float, float]:
    try:
        from allanscope.noise.gls import gls_chi2
    except ImportError:
        return float("nan"), float("nan")

    result = gls_chi2(curve, model, samples)
    return float(result.chi2_per_dof), float(result.p_value)
