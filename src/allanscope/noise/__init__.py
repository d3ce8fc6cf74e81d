"""Noise: what a record is made of, as numbers with intervals.

::

    History rows ──▶ DCT ordinates ─┐
                                    ├─▶ likelihood ──▶ NoiseFit: Q N B K R, band limit, model
    SpectrumBank ──▶ density bands ─┘
    AllanBank ──▶ Deviation ──▶ GLS with the full covariance of the curve: a second opinion

`components/` holds what noise can be and `filters/` what stands between it and the samples, one a
file, exact in discrete time (`part`, `transfer`); a `NoiseModel` (`model`) is components behind
filters. `grid` and `evidence` make the data independent, `likelihood` and `amplitudes` find the
most likely numbers, `drift` and `selection` decide what else the data demand where no search has
run, `estimates` turns the maximum into `coefficients` with intervals, and `fit` puts it together.
`crlb` says how well any of it can be known; `curve` judges a model by the Allan curve, and
`whiteness` by the spectrum.
"""

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.noise.bound import Bound, bound_model
    from allanscope.noise.coefficients import (
        BestAveraging,
        Coefficient,
        CoefficientPart,
        DatasheetVerdict,
        Uncertainty,
        find_best_averaging,
    )
    from allanscope.noise.crlb import relative_bounds, wait_until
    from allanscope.noise.curve import CurveResidual, deviation_covariance, gls_chi2
    from allanscope.noise.fit import NoiseFit, fit_array, fit_noise
    from allanscope.noise.model import NoiseModel
    from allanscope.noise.power_laws import (
        POWER_LAWS,
        fit_power_laws,
        model_of,
        power_laws_of,
    )
    from allanscope.noise.quantised import find_step, resolution_advice

__all__ = [
    "POWER_LAWS",
    "BestAveraging",
    "Bound",
    "Coefficient",
    "CoefficientPart",
    "CurveResidual",
    "DatasheetVerdict",
    "NoiseFit",
    "NoiseModel",
    "Uncertainty",
    "bound_model",
    "deviation_covariance",
    "find_best_averaging",
    "find_step",
    "fit_array",
    "fit_noise",
    "fit_power_laws",
    "gls_chi2",
    "model_of",
    "power_laws_of",
    "relative_bounds",
    "resolution_advice",
    "wait_until",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "POWER_LAWS": "power_laws",
        "BestAveraging": "coefficients",
        "Bound": "bound",
        "bound_model": "bound",
        "Coefficient": "coefficients",
        "CoefficientPart": "coefficients",
        "CurveResidual": "curve",
        "DatasheetVerdict": "coefficients",
        "NoiseFit": "fit",
        "NoiseModel": "model",
        "Uncertainty": "coefficients",
        "resolution_advice": "quantised",
        "deviation_covariance": "curve",
        "find_best_averaging": "coefficients",
        "find_step": "quantised",
        "fit_array": "fit",
        "fit_noise": "fit",
        "fit_power_laws": "power_laws",
        "gls_chi2": "curve",
        "model_of": "power_laws",
        "power_laws_of": "power_laws",
        "relative_bounds": "crlb",
        "wait_until": "crlb",
    },
)
