r"""The step is coarse enough to matter.

Rounding adds white noise of q^2/12 only while the noise is at least half a step. Below, the error
depends on where the level lies between two codes,

.. math:: E[e] = \sum_k \frac{(-1)^k}{\pi k} \sin(2\pi k \mu) e^{-2 \pi^2 k^2 \sigma^2},

the curve can fall to zero or rise twenty-fivefold, and slow noise is distorted. Deterministic: the
step is read off the values, the noise beneath it from how often neighbouring codes occur.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.values import noise_on_lattice
from allanscope.explain.view import View

_ENOUGH = 0.5
"""Noise in steps above which rounding is white to a tenth of a per cent."""
_KNOWN_TO = 1e-3
"""Relative error of a step that is seen: the scale factor of the conversion is printed so well."""


@dataclass(frozen=True)
class Quantization(EffectKind):
    """A coarse step."""

    step: Estimate
    noise_in_steps: float

    kind = "quantization"
    meaning = "the LSB is coarser than twice the noise"
    phrase = "coarse quantization, step {step}"
    needs = frozenset({"samples"})
    stage = 0
    is_single = True
    is_not_gaussian = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "repeated_samples": "neighbours are equal because there are few values"
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return f"the noise (rms) is {self.noise_in_steps:.2g} times the step of {self.step.text}"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Compare the noise beneath the rounding with the step."""
        if view.step <= 0 or float(view.data.std()) > 20 * view.step:
            return []
        known, key = view.series.steps_of_noise, (view.axis, view.step)
        if key not in known:
            known[key] = noise_on_lattice(view.samples, view.step)
        sigma = known[key]
        lsb = view.series.lsb[view.series.column(view.axis)]
        span = float(np.ptp(view.samples))
        known_to = max(_KNOWN_TO, lsb / span if view.step > 1.5 * lsb and span > 0 else 0.0)
        step = Estimate(
            view.step, view.step * (1 - known_to), view.step * (1 + known_to), view.unit
        )
        gain = math.inf if sigma < _ENOUGH else 0.0  # read off, not inferred
        return [Candidate(cls(step, sigma), gain)]
