r"""The end of a range, the converter's or an amplifier's before it: what lies beyond is cut off.

:math:`y = \min(x, L)` makes the distribution lopsided and collects the share
:math:`P(x > L)` of all samples at the one value L, where the smooth distribution of noise has few.
White noise stays white, so the curve and the spectrum show nothing: N is merely too small, by

.. math:: \mathrm{Var}\,y < \mathrm{Var}\,x,

and nothing that is computed of the axis is that of the sensor. Deterministic: read off the values.
Both ends may be cut: each is named. The last code beside a missing one is no limit
(`crowded_codes`), and samples that collect within the range are a `dead_zone` or `unexplained`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.view import View


@dataclass(frozen=True)
class Saturation(EffectKind):
    """A limit that the samples run into."""

    level: Estimate
    side: Estimate
    fraction: Estimate

    kind = "saturation"
    meaning = "samples beyond a limit are cut off at it"
    phrase = "saturation at {level}, {fraction} of the samples"
    as_cause = "saturation"
    acts_slow = False
    needs = frozenset({"samples"})
    stage = 0
    is_not_gaussian = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "repeated_samples": "repeats at every value alike, not at the limit alone",
        "dead_zone": "a dead zone collects samples within the range, not at its end",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        end = "upper" if self.side.value > 0 else "lower"
        return (
            f"{100 * self.fraction.value:.3g} % of the samples lie at the {end} end, "
            f"{self.level.text}: the axis saturates, and its noise "
            "values are not valid"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look at both ends of the values that occur."""
        known = [c.effect.side.value for c in view.accepted if isinstance(c.effect, cls)]
        n = view.grid.n
        for crowded in view.crowded_codes:
            if crowded.side == 0 or crowded.side in known:
                continue
            half = view.step / 2
            error = math.sqrt(crowded.share * (1 - crowded.share) / n)
            level = Estimate(crowded.value, crowded.value - half, crowded.value + half, view.unit)
            side, share = Estimate.exact(float(crowded.side)), Estimate.of(crowded.share, error)
            yield Candidate(cls(level, side, share), math.inf)  # read off, not inferred
