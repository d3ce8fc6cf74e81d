r"""Noise whose amplitude follows another axis: loud while that axis moves, quiet while it rests.

A rectified vibration, a loose cable, a supply that a load modulates: the other axis does not leak
in (`cross_coupling` finds nothing), it decides how much noise there is,

.. math:: \mathrm{Var}\, y(t) = v_0 + c^2 (x(t) - \bar x)^2 .

The spectrum sees the mean of it. The data are whitened and cut into blocks; their mean squares are
chi-square around :math:`1 + s (q_b / \bar q - 1)` with q the mean square of the other axis in the
block, about its mean there (motion) or over the record (level). The share s of the power that
follows is found by maximum likelihood, and judged on stretches of time that were not used. The
source varies clearly more than what follows it, as this has a part that does not: that tells the
direction, and two axes that are shaken together from one that follows. The rows are divided by the
level, so that what comes later is looked for in even noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate, Parameter
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.explain.view import View
from allanscope.optimise import minimise_between
from allanscope.quantities import TWO_SIDED_95

Array = NDArray[np.float64]

_BLOCK_S, _FEWEST_ROWS, _FEWEST = 0.5, 16, 64
"""Length of a block, rows in one, and blocks in a record, at the least."""
_CAP = 20.0
"""Squares over their mean are cut here, or so much higher as the source is louder, so that one
sample cannot make a block loud."""
_STRETCHES = 24
"""Stretches of the record, every second of which is held out."""
_MOVES = 4.0
"""Relative variance of the blocks of a source, over that of white noise."""
_SOURCE = 2.0
"""Times that the variance of a source exceeds that of what follows it: two axes that one machine
shakes at the same times are alike."""
_CLEARLY = 5.0
"""Nats by which intervals of another level must explain less, both less their penalties."""
_ELSEWHERE = 1.5
"""Nats that the share gains away from the stretch that gains most, at the least: of records in
which one event shakes both axes, five of 700 have them."""
_MOST = 0.999
"""Largest share of its power that may follow: at 1 the likelihood is singular."""
_STEP, _LEAST = 0.01, 0.01
"""Of the share, over which the curvature of the likelihood is taken at the most, and the least."""


@dataclass(frozen=True)
class AmplitudeCoupling(EffectKind):
    """Noise that is as loud as another axis moves.

    Attributes
    ----------
    source : Parameter
        The other axis.
    slope : Estimate
        Standard deviation of a sample of the noise per unit of the other axis.
    share : Estimate
        Of the power of the noise that follows.
    of_the_level : bool
        Whether it follows the level of the other axis, and not its motion alone.
    """

    source: Parameter
    slope: Estimate
    share: Estimate
    of_the_level: bool

    kind = "amplitude_coupling"
    meaning = "the amplitude of the noise follows another axis"
    phrase = "noise amplitude follows {source}, {share} of its power"
    as_cause = "noise whose amplitude follows {source}"
    acts_slow = False
    sized_by = "share"
    needs = frozenset({"axes", "samples"})
    stage = 3
    is_single = True
    is_not_gaussian = True
    excluded_by = frozenset({"quantization", "random_telegraph", "variance_change"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "variance_change": "begins and ends abruptly, whatever the other axes do",
        "cross_coupling": "adds the other axis itself",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        what = "level" if self.of_the_level else "motion"
        return (
            f"{100 * self.share.value:.3g} % of the noise power follows the {what} of "
            f"{self.source.value}, {self.slope.text}"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Compare the power of the noise with the motion and the level of every other axis."""
        squares, size, kept = _squares(view)
        if len(squares) < _FEWEST:
            return []
        own = _spread(_motion(view.samples, size)[kept], size)
        found = []
        sources = list(_sources(view, size))
        for source, level, motion in sources:
            q = motion[kept]
            if _spread(q, size) > max(_SOURCE * own, _MOVES * 2 / size):
                power = _power(squares, q)
                share = _fit(power, q)
                freedom = _freedom(power, size, q, share)
                gain = float(_gains(power, freedom, q, share).sum())
                found.append((gain, share, source, level, motion, power, freedom))
        if not found:
            return []
        gain, share, source, level, motion, power, freedom = max(found, key=lambda one: one[0])
        if gain < _CLEARLY:
            return []
        q = motion[kept]
        looked_at = float(np.log(len(sources)))
        error = _error(power, freedom, q, share)
        white = float(np.median(view.spectrum.ordinates))
        slope, lower, upper = (
            float(np.sqrt(max(share + away * error, 0.0) * white / q.mean()))
            for away in (0.0, -TWO_SIDED_95, TWO_SIDED_95)
        )
        effect = cls(
            Parameter(source),
            Estimate(slope, lower, upper, f"{view.unit}/{view.unit_of(source)}"),
            Estimate.of(share, error),
            level,
        )
        relative = np.where(kept, motion / q.mean(), 1.0)
        best = Candidate(effect, gain, looked_at, signal=effect.signal(view, relative, size))
        abrupt = max((c.excess for c in VarianceChange.propose(view)), default=0.0)
        return [] if abrupt > 0 and best.excess < abrupt + _CLEARLY else [best]

    def signal(self, view: View, relative: Array, size: int) -> Array:
        """Return what the rows exceed those of even noise by, shape (n,).

        `relative` is the mean squares of the blocks of the source, over their mean.
        """
        s = np.sqrt(1 + self.share.value * (relative - 1))
        centre = (np.arange(len(s)) + 0.5) * size
        scale = np.interp(np.arange(view.grid.n), centre, s)
        data = view.data - view.data.mean()
        return np.asarray(data * (1 - 1 / scale))

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Fit the share again: it is one of the whole record."""
        return next(iter(self.propose(view)), replace(candidate, signal=None))

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where a part of the noise surely does not follow, and not one event decides.

        Of one event that shakes both axes nothing can be told: without the stretch that gains most,
        and those beside it, the noise must follow by the same share as well.
        """
        power, q, freedom = self._followed(view)
        share, most, stretch = self.share.value, self.share.upper, _stretches(len(power))
        gained = np.bincount(stretch, _gains(power, freedom, q, share))
        away = np.abs(stretch - int(np.argmax(gained))) > 1
        elsewhere = _gains(power[away], freedom, q[away], share, q.mean()).sum()
        follows = elsewhere > _ELSEWHERE and most is not None and most < 1
        return candidate if follows else None

    def _followed(self, view: View) -> tuple[Array, Array, float]:
        """Return the power of the blocks, that of what it follows, and the freedom of a block."""
        squares, size, kept = _squares(view)
        share, found = self.share.value, []
        for source, level, motion in _sources(view, size):
            if (source, level) == (self.source.value, self.of_the_level):
                q = motion[kept]
                power = _power(squares, q)
                found.append((power, q, _freedom(power, size, q, share)))
        return max(found, key=lambda one: float(_gains(one[0], one[2], one[1], share).sum()))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Fit every second stretch of the record, and judge by those between.

        Where few stretches hold most of the gain their scatter would be the gain itself: the error
        is what noise moves a gain by.
        """
        power, q, freedom = self._followed(view)
        gained, stretch = np.zeros(len(power)), _stretches(len(power))
        for fold in (0, 1):
            train = stretch % 2 == fold
            share = _fit(power[train], q[train], q.mean())
            gained[~train] = _gains(power, freedom, q, share, q.mean(), train)[~train]
        return HeldOut(
            nats=float(gained.sum()),
            error=float(np.sqrt(2 * max(candidate.gain, 0.0))),
            design=f"every second of {_STRETCHES} stretches by those between",
            replicated=True,
        )


def _block_rows(view: View) -> int:
    return max(_FEWEST_ROWS, int(_BLOCK_S * view.grid.rate_hz))


def _stretches(blocks: int) -> NDArray[np.int64]:
    """Return the stretch in which each block is."""
    return np.arange(blocks) * _STRETCHES // blocks


def _squares(view: View) -> tuple[Array, int, NDArray[np.bool_]]:
    """Return the squares of the whitened data in blocks, rows in one, and which blocks they are.

    Where a burst was taken out of the rows they tell nothing: they are no longer as loud as the
    other axis moves.
    """
    size = _block_rows(view)
    blocks = view.grid.n // size
    if blocks < _FEWEST:
        return np.empty((0, size)), size, np.zeros(blocks, bool)
    white = view.innovations[: blocks * size].reshape(blocks, size)
    bursts = [
        c.signal for c in view.accepted if c.effect.motion == "burst" and c.signal is not None
    ]
    taken = np.any(bursts, axis=0) if bursts else np.zeros(view.grid.n, bool)
    kept = ~np.any(taken[: blocks * size].reshape(blocks, size), axis=1)
    return white[kept] ** 2, size, kept


def _power(squares: Array, q: Array) -> Array:
    """Return the mean squares of blocks: where the source is loud, loud samples may follow it."""
    most = _CAP * np.maximum(q / q.mean(), 1.0)
    return np.asarray(np.minimum(squares, most[:, np.newaxis]).mean(axis=1))


def _motion(x: Array, size: int) -> Array:
    """Return the mean squares of blocks about their means."""
    return np.asarray(x[: len(x) // size * size].reshape(-1, size).var(axis=1))


def _sources(view: View, size: int) -> Iterator[tuple[str, bool, Array]]:
    """Yield the other axes with the mean squares of their blocks, of the motion and the level."""
    for axis in view.series.axes:
        for x in (one.rows for one in view.sources(axis) if axis != view.axis):
            motion = _motion(x, size)
            yield axis, False, motion
            means = x[: len(motion) * size].reshape(-1, size).mean(axis=1)
            yield axis, True, motion + (means - x.mean()) ** 2


def _spread(q: Array, size: int) -> float:
    """Return the relative variance of mean squares of blocks beyond that of white noise."""
    mean = float(q.mean())
    return float(q.var()) / mean**2 - 2 / size if mean > 0 else 0.0


def _following(q: Array, share: float, mean: float) -> Array:
    """Return by which factor the power of blocks is other than its mean as it follows a source."""
    return np.asarray(1 + share * (q / mean - 1))


def _freedom(power: Array, size: int, q: Array, share: float) -> float:
    """Return the degrees of freedom of a block: its rows, or less by tails.

    Neighbours tell them, once what follows the source is divided out: it scatters as well.
    """
    even = power / _following(q, share, float(q.mean()))
    scatter = float(np.mean(np.diff(even / even.mean()) ** 2)) / 2
    return float(np.clip(2 / scatter, 1.0, size))


def _error(power: Array, freedom: float, q: Array, share: float) -> float:
    """Return the standard error of the likeliest share.

    The likelihood takes all blocks to scatter alike. But what follows Gaussian motion has tails:
    the mean square of n rows, of which the part p follows, has the relative variance
    (2 + 6 p^2) / n, and loud blocks tell the share.
    """
    step = min(_STEP, share / 2, (1 - share) / 2)  # beyond 0 and 1 there is no likelihood
    low, best, high = (
        float(_gains(power, freedom, q, share + away).sum()) for away in (-step, 0.0, step)
    )
    information = max((2 * best - low - high) / step**2, _LEAST)
    factor = _following(q, share, float(q.mean()))
    scatter = 1 + 3 * (share * q / (q.mean() * factor)) ** 2
    telling = (q / q.mean() - 1) / factor
    telling = (telling - telling.mean()) ** 2
    wider = np.average(scatter, weights=telling) / scatter.mean()
    return float(np.sqrt(wider / information))


def _gains(
    power: Array,
    freedom: float,
    q: Array,
    share: float,
    mean: float | None = None,
    known: NDArray[np.bool_] | slice = slice(None),
) -> Array:
    """Return what every block gains by a share; the level is that of the known ones, or of all."""
    factor = _following(q, share, float(q.mean()) if mean is None else mean)
    scaled = power / factor
    level, other = power[known].mean(), scaled[known].mean()
    change = np.log(factor * other / level)
    return np.asarray(freedom / 2 * (power / level - scaled / other - change))


def _fit(power: Array, q: Array, mean: float | None = None) -> float:
    """Return the likeliest share, whatever the freedom of the blocks."""

    def loss(share: float) -> float:
        return -float(_gains(power, 1.0, q, share, mean).sum())

    return minimise_between(loss, 0.0, _MOST, within=1e-4)[0]
