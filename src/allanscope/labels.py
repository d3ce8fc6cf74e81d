"""The names of effects, errors and columns: one name for one thing on every screen and page.

Names of coefficients and units are in `quantities`, sentences in the rooms that say them.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = [
    "DATASHEET",
    "EXCESS",
    "HELD_OUT",
    "KIND_NAMES",
    "MINIMUM",
    "MODEL_ERRORS",
    "OTHER_UNITS",
    "WAIT",
    "kind_name",
]

KIND_NAMES: Mapping[str, str] = {
    "band_limit": "low-pass",
    "gauss_markov": "correlated noise",
    "high_pass": "high-pass",
    "narrowband": "narrow-band noise",
    "power_law": "power-law noise",
    "sinusoid": "line",
    "unexplained": "unexplained power",
    "variance_change": "noise level change",
    "warm_up": "warm-up",
}
"""Names of kinds of effects that differ from the word in a result, read without underscores."""

MODEL_ERRORS: Mapping[str, str] = {
    "chi2_per_dof": "χ² per degree of freedom",
    "p_value": "p-value of χ²",
    "rms_percent": "residual rms, %",
    "expected_rms_percent": "residual rms expected from sampling error, %",
    "worst_band_z": "worst spectral band, z",
}
"""Names of the fields of a `ResidualError`."""

HELD_OUT = "held-out log-likelihood gain"
EXCESS = "excess over sampling error"

MINIMUM = "minimum deviation"
DATASHEET = "datasheet"
OTHER_UNITS = "other units"
WAIT = "to ±20 % in about"
"""How much longer to record until a coefficient is known to that."""


def kind_name(kind: str) -> str:
    """Return the name of a kind of effect, or of something else that is written with underscores.

    >>> kind_name("sinusoid"), kind_name("random_telegraph")
    ('line', 'random telegraph')
    """
    return KIND_NAMES.get(kind, kind.replace("_", " "))
