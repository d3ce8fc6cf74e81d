r"""Coefficients that the measured Allan curve refutes: limits instead of extrapolated numbers.

B and K are levels of the lowest frequencies. Where a drift, or a tone that moves, is left out of
the fit together with those, they are fitted to whatever rises at the frequencies that remain, and
their values are what that would be at averaging times that nothing was fitted to. The curve knows
better, since no component adds more to an Allan variance than all of them together:

.. math:: \sigma_K(\tau) \le \sigma(\tau) \quad\text{at every}\ \tau

A coefficient whose whole interval is above what the curve allows is none. It becomes the limit that
the upper ends of the intervals of the curve set, and a remark says so. The curve is that of the
record as measured: what was subtracted from it made it higher, so the limit holds all the more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from allanscope.allan import Deviation
from allanscope.noise import Coefficient, NoiseModel
from allanscope.noise.filters import Remainder
from allanscope.quantities import COEFFICIENTS, duration, number, symbols

__all__ = ["SLOW", "limited_by_curve"]

SLOW = ("B", "K")
"""Coefficients of what adds most at the longest averaging times."""


def limited_by_curve(
    unit: str, coefficients: Mapping[str, Coefficient], model: NoiseModel, curve: Deviation
) -> tuple[dict[str, Coefficient], tuple[str, ...]]:
    """Return the coefficients, limits where the curve refutes a value, and a remark on each.

    Parameters
    ----------
    unit : str
        Of the axis.
    coefficients : mapping of str to Coefficient
        Those of the fit.
    model : NoiseModel
        The fitted one: its components and filters tell what a coefficient adds to the curve.
    curve : Deviation
        Overlapping Allan deviation of the axis as measured.
    """
    out, remarks = dict(coefficients), []
    usable = curve.trusted & np.isfinite(curve.upper) & (curve.upper > 0)
    slow = [letter for letter in SLOW if letter in out and out[letter].detected]
    if not (slow and usable.any()):
        return out, ()
    named = model.without(Remainder.symbol)  # which takes away again what B and K have too much
    parts = named.components_at(curve.kind, curve.m[usable])
    added = {c.symbol: part for c, part in zip(named, parts, strict=True)}
    for letter in slow:
        if not np.any(added.get(letter, 0.0)):
            continue
        known = out[letter]
        excess = np.sqrt(added[letter]) / curve.upper[usable]
        worst = int(np.argmax(excess))
        allowed = model.value(letter) / float(excess[worst])
        if known.lower <= allowed:
            continue
        out[letter] = replace(
            known, value=min(known.value, allowed), lower=0.0, upper=allowed, detected=False
        )
        usual = COEFFICIENTS[unit, letter][0]
        remarks.append(
            symbols(
                f"{letter} is {usual.limit(allowed)} {usual.unit}: the "
                f"{number(known.value * usual.factor)} fitted at higher frequencies would make the "
                f"deviation at {duration(curve.tau[usable][worst])} "
                f"{number(known.value / allowed, 2)} times its upper limit"
            )
        )
    return out, tuple(remarks)
