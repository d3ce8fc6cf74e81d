"""Allan: how much the average of a signal over tau scatters, for every tau at once.

Two ways lead to the same curve. An array goes through every term there is; a stream keeps running
sums whose size does not depend on the length of the run::

    array ──▶ phase ──▶ estimators ──────────────┐                      noise_type
                        one file each            ├─▶ Sums ──▶ confidence ──▶ Deviation
    samples ─▶ AllanBank ─┬─ cascade (kernels) ──┤                edf
                          └─ archive ──▶ curves ─┘

An estimator is a variance of means over tau = m samples that some wandering of the signal cannot
spoil: `adev` is blind to an offset, `hdev` to a drift, `mdev` tells phase noise apart, the totals
and the Theo family squeeze more degrees of freedom from the end of the run. `noise_type` finds the
power law at each tau; `edf` turns it and the overlap of the terms into degrees of freedom, and
`confidence` those into chi-square limits. Where a run is too short for a value there is none.

Phase is the running sum of the rates with tau0 = 1 throughout; seconds enter at the end.

Adding an estimator means adding one file to `estimators`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.allan.deviation import Deviation, data_frame
from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.allan.archive import ROWS
    from allanscope.allan.bank import AllanBank
    from allanscope.allan.cascade import lags_of_level
    from allanscope.allan.choices import KINDS, CurveChoices
    from allanscope.allan.clock_statistics import (
        SlopeFit,
        avlr,
        gcodev,
        mtie,
        three_cornered_hat,
        tierms,
    )
    from allanscope.allan.confidence import chi_square_limits, degrees_of_freedom
    from allanscope.allan.dynamic import DynamicDeviation
    from allanscope.allan.edf import difference_edf, difference_overlap
    from allanscope.allan.estimators import variance_name
    from allanscope.allan.frequency import (
        density_of_deviation,
        deviation_of_density,
        factors_at,
        phase_to_rate_density,
        rate_to_phase_density,
        transfer,
    )
    from allanscope.allan.noise_type import LETTERS, alpha_named
    from allanscope.allan.oneshot import deviation, factors_of, identify_noise

__all__ = [
    "KINDS",
    "LETTERS",
    "ROWS",
    "AllanBank",
    "CurveChoices",
    "Deviation",
    "DynamicDeviation",
    "SlopeFit",
    "alpha_named",
    "avlr",
    "chi_square_limits",
    "data_frame",
    "degrees_of_freedom",
    "density_of_deviation",
    "deviation",
    "deviation_of_density",
    "difference_edf",
    "difference_overlap",
    "factors_at",
    "factors_of",
    "gcodev",
    "identify_noise",
    "lags_of_level",
    "mtie",
    "phase_to_rate_density",
    "rate_to_phase_density",
    "three_cornered_hat",
    "tierms",
    "transfer",
    "variance_name",
]

# The function `deviation` shares its name with the module of the class, which the import above has
# just entered here; removed, the name is looked up below.
globals().pop("deviation", None)

__getattr__, __dir__ = lazily(
    __name__,
    {
        "ROWS": "archive",
        "lags_of_level": "cascade",
        "AllanBank": "bank",
        "LETTERS": "noise_type",
        "alpha_named": "noise_type",
        "CurveChoices": "choices",
        "KINDS": "choices",
        "DynamicDeviation": "dynamic",
        "SlopeFit": "clock_statistics",
        "avlr": "clock_statistics",
        "chi_square_limits": "confidence",
        "degrees_of_freedom": "confidence",
        "density_of_deviation": "frequency",
        "deviation": "oneshot",
        "deviation_of_density": "frequency",
        "difference_edf": "edf",
        "difference_overlap": "edf",
        "gcodev": "clock_statistics",
        "factors_at": "frequency",
        "factors_of": "oneshot",
        "identify_noise": "oneshot",
        "mtie": "clock_statistics",
        "phase_to_rate_density": "frequency",
        "rate_to_phase_density": "frequency",
        "three_cornered_hat": "clock_statistics",
        "tierms": "clock_statistics",
        "transfer": "frequency",
        "variance_name": "estimators",
    },
)
