r"""A dead zone: what lies near one value is replaced by it.

A threshold in a filter, a comparator with hysteresis, a driver that calls small rates zero. Within
a width w around a level L all samples are L, so L holds what the empty values on both sides of it
would have held,

.. math:: y = L \quad \text{for} \quad |x - L| < w / 2 ,

and the noise figures are those of what is left. Deterministic: read off the values. A crowded code
with values missing on one side only, or none, may be a replaced code and is `unexplained`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.crowded_codes import CrowdedCode
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.view import View

_EMPTY = 1.5
"""Steps to the next value that occurs from which a value between them is missing."""
_EXPECTED = 20
"""Samples just beyond as wide a range as the empty one: by chance it is not empty."""


@dataclass(frozen=True)
class DeadZone(EffectKind):
    """A range of values that is replaced by one."""

    level: Estimate
    width: Estimate
    fraction: Estimate

    kind = "dead_zone"
    meaning = "samples near one value are replaced by it"
    phrase = "dead zone of {width} around {level}, {fraction} of the samples"
    as_cause = "a dead zone"
    is_counted = True
    acts_slow = False
    needs = frozenset({"samples"})
    stage = 0
    is_not_gaussian = True
    located_by = "level"
    excluded_by = frozenset({"quantization"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "saturation": "collects samples at the end of the range, not within it",
        "quantization": "replaces samples at every step alike",
        "unexplained": "a replaced code leaves the values beside it as they are",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return (
            f"samples within a dead zone of {self.width.text} around "
            f"{self.level.text} are replaced by it "
            f"({100 * self.fraction.value:.3g} % of all), and the noise values are not valid"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look at every value within the range at which samples collect."""
        known = [c.effect.level.value for c in view.accepted if isinstance(c.effect, cls)]
        for crowded in view.crowded_codes:
            ends = (
                values_beside(view, crowded)
                if crowded.side == 0 and crowded.value not in known
                else None
            )
            if ends is None:
                continue
            half, room = view.step / 2, view.step  # the first that occurs stands for half a step
            error = math.sqrt(crowded.share * (1 - crowded.share) / view.grid.n)
            width = ends[1] - ends[0]
            yield Candidate(
                cls(
                    Estimate(crowded.value, crowded.value - half, crowded.value + half, view.unit),
                    Estimate(width, width - room, width + room, view.unit),
                    Estimate.of(crowded.share, error),
                ),
                math.inf,  # read off, not inferred
            )


def values_beside(view: View, crowded: CrowdedCode) -> tuple[float, float] | None:
    """Return the next values below and above that occur; None where they are not far enough."""
    samples = view.samples[~view.series.bridged]
    apart = samples - crowded.value
    least = view.step / 2
    ends = []
    for side in (-1, 1):
        beyond = side * apart[side * apart > least]
        gap = float(beyond.min(initial=np.inf))
        if not _EMPTY * view.step < gap < np.inf:
            return None
        if np.count_nonzero(beyond < 2 * gap) < _EXPECTED:
            return None
        ends.append(crowded.value + side * gap)
    return ends[0], ends[1]
