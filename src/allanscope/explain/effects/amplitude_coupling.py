r"""Noise whose amplitude follows another axis: loud while that axis moves, quiet while it rests.

A rectified vibration, a loose cable, a supply that a load modulates: the other axis does not leak
in (`cross_coupling` finds nothing), it decides how much noise there is,

.. math:: \mathrm{Var}\, y(t) = v_0 + c^2 (x(t) - \bar x)^2 .

The spectrum sees the mean of it. The data are whitened; their squares are chi-square around
:math:`1 + s (q / \bar q - 1)` with q the square of the other axis, about its mean over half a
second (motion) or over the record (level). They are compared sample by sample, which tells most
where the noise follows at once, and as means over half a second, where it is merely louder while
the other moves; the likelier is taken. The share s of the power that follows is found by maximum
likelihood, and judged on stretches of time that were not used. The source varies clearly more than
what follows it, as this has a part that does not: that tells the direction, and two axes that are
shaken together from one that follows. The rows are divided by the level, so that what comes later
is looked for in even noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate, Parameter
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.explain.regression import likely_interval
from allanscope.explain.view import View
from allanscope.lazy import once
from allanscope.median import medians
from allanscope.optimise import minimise_between

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
_BANDS, _PER_BAND = 64, 100
"""Most bands in which an axis may have any share of another at any phase, and rows for each."""
_ALONE = 25.0
"""Square of a sample of the source over the median of its block beyond which it is looked at in the
mean of the block alone: a knock shakes all axes in the same rows."""
_MOST = 0.999
"""Largest share of its power that may follow: at 1 the likelihood is singular."""
_STEP, _LEAST = 0.01, 0.01
"""Of the share, over which the curvature of the likelihood is taken at the most, and the least."""
_REACH, _TERMS = 5.0, 101
"""Standard errors within which shares are weighed by their likelihood, and how many."""


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
    at_once : bool
        Whether each sample follows, and not the loudness over half a second alone.
    """

    source: Parameter
    slope: Estimate
    share: Estimate
    of_the_level: bool
    at_once: bool

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
            f"{self.source.value}{' sample by sample' * self.at_once}, {self.slope.text}"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Compare the power of the noise with the motion and the level of every other axis."""
        likely = max(_powers(view), key=_gain, default=None)
        if likely is None:
            return []
        found = max(_powers(view, likely.source[0]), key=_gain)
        if found.gain < _CLEARLY:
            return []
        share = found.estimate
        source, of_the_level = found.source
        white = float(np.median(view.spectrum.ordinates)) * found.mean_power / found.mean_q
        assert share.lower is not None
        assert share.upper is not None
        slope, lower, upper = (
            float(np.sqrt(one * white)) for one in (share.value, share.lower, share.upper)
        )
        effect = cls(
            Parameter(source),
            Estimate(slope, lower, upper, f"{view.unit}/{view.unit_of(source)}"),
            share,
            of_the_level,
            found.at_once,
        )
        looked_at = float(np.log(4 * (len(view.series.axes) - 1)))
        best = Candidate(effect, found.gain, looked_at, signal=effect.signal(view, likely))
        abrupt = max((c.excess for c in VarianceChange.propose(view)), default=0.0)
        return [] if abrupt > 0 and best.excess < abrupt + _CLEARLY else [best]

    def signal(self, view: View, blocks: _Powers) -> Array:
        """Return what the rows exceed those of even noise by, shape (n,).

        They are evened by the level of blocks: what is slow is no louder in a loud sample.
        """
        s = np.ones(len(blocks.kept))
        s[blocks.kept] = np.sqrt(blocks.following(self.share.value))
        centre = (np.arange(len(s)) + 0.5) * blocks.rows
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
        found = self._followed(view)
        share, most, stretch = self.share.value, self.share.upper, _stretches(len(found.power))
        gained = np.bincount(stretch, found.gains(share))
        away = np.abs(stretch - int(np.argmax(gained))) > 1
        elsewhere = found.gains(share, away)[away].sum()
        follows = elsewhere > _ELSEWHERE and most is not None and most < 1
        return candidate if follows else None

    def _followed(self, view: View) -> _Powers:
        """Return the powers of what follows, and of what it follows, as they were found."""
        source, share = (str(self.source.value), self.of_the_level), self.share.value
        same = (
            one
            for one in _powers(view, source[0])
            if (one.source, one.at_once) == (source, self.at_once)
        )
        return max(same, key=lambda one: float(one.gains(share).sum()))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Fit every second stretch of the record, and judge by those between.

        Where few stretches hold most of the gain their scatter would be the gain itself: the error
        is what noise moves a gain by.
        """
        found = self._followed(view)
        gained, stretch = np.zeros(len(found.power)), _stretches(len(found.power))
        for fold in (0, 1):
            train = stretch % 2 == fold
            gained[~train] = found.gains(found.fit(train), train)[~train]
        return HeldOut(
            nats=float(gained.sum()),
            error=float(np.sqrt(2 * max(candidate.gain, 0.0))),
            design=f"every second of {_STRETCHES} stretches by those between",
            replicated=True,
        )


@dataclass(frozen=True)
class _Powers:
    """Mean squares of an axis, and of another that it may follow, of blocks or of samples.

    Attributes
    ----------
    source : (str, bool)
        The other axis, and whether its level counts or its motion.
    at_once : bool
        Whether the squares are those of samples.
    rows : int
        In a block.
    kept : ndarray, shape (blocks,)
        Those that tell.
    power, q : ndarray, shape (n,)
        Of the axis, whitened, and of the other, where they tell.
    mean_q : float
        Of the other, with samples that do not tell as large as they may be.
    """

    source: tuple[str, bool]
    at_once: bool
    rows: int
    kept: NDArray[np.bool_]
    power: Array
    q: Array
    mean_q: float

    @once
    def share(self) -> float:
        """The likeliest."""
        return self.fit()

    @once
    def gain(self) -> float:
        """What it gains, nats."""
        return float(self.gains(self.share).sum())

    @property
    def mean_power(self) -> float:
        """Power of the axis, whitened, where the other has its mean."""
        return float((self.power / self.following(self.share)).mean())

    @once
    def freedom(self) -> float:
        """Degrees of freedom of a mean square: its samples, or less by tails.

        Neighbours tell them, once what follows the source is divided out: it scatters as well.
        """
        even = self.power / self.following(self.share)
        scatter = float(np.mean(np.diff(even / even.mean()) ** 2)) / 2
        return float(min(2 / scatter, 1 if self.at_once else self.rows))

    @property
    def estimate(self) -> Estimate:
        """The likeliest share, with the interval that holds 95 % of them, as likely as they are.

        The likelihood takes all blocks to scatter alike. But what follows Gaussian motion has
        tails: the mean square of n rows, of which the part p follows, has the relative variance
        (2 + 6 p^2) / n, and loud blocks tell the share.
        """
        share, scale = self.share, self.freedom * len(self.power) / 2

        def loglik(share: float) -> float:
            return -scale * self.loss(share)

        step = min(_STEP, share / 2, (1 - share) / 2)  # beyond 0 and 1 there is no likelihood
        low, best, high = (loglik(share + away) for away in (-step, 0.0, step))
        information = max((2 * best - low - high) / step**2, _LEAST)
        wider = 1.0
        if not self.at_once:
            factor = self.following(share)
            scatter = 1 + 3 * (share * self.q / (self.mean_q * factor)) ** 2
            telling = self.beyond / factor
            telling = (telling - telling.mean()) ** 2
            wider = float(np.average(scatter, weights=telling) / scatter.mean())
        reach = _REACH * float(np.sqrt(wider / information))
        shares = np.linspace(max(share - reach, 0.0), min(share + reach, _MOST), _TERMS)
        lower, upper = likely_interval(shares, lambda one: loglik(one) / wider)
        return Estimate(share, min(lower, share), max(upper, share))

    def fit(self, known: NDArray[np.bool_] | slice = slice(None)) -> float:
        """Return the likeliest share of the known ones, whatever their freedom."""
        return minimise_between(lambda share: self.loss(share, known), 0.0, _MOST, within=1e-4)[0]

    def loss(self, share: float, known: NDArray[np.bool_] | slice = slice(None)) -> float:
        """Return twice the negative log-likelihood of the known ones, of each, but a constant."""
        factor = self.following(share)[known]
        return float(np.log(factor).mean() + np.log((self.power[known] / factor).mean()))

    @once
    def beyond(self) -> Array:
        """How far the other is from its mean."""
        return np.asarray(self.q / self.mean_q - 1)

    def following(self, share: float) -> Array:
        """Return by which factor the power is other than its mean as it follows the source."""
        return np.asarray(1 + share * self.beyond)

    def gains(self, share: float, known: NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Return what each gains by a share; the level is that of the known ones, or of all."""
        return self.freedom * self._gains(share, known)

    def _gains(self, share: float, known: NDArray[np.bool_] | slice) -> Array:
        factor = self.following(share)
        scaled = self.power / factor
        level, other = self.power[known].mean(), scaled[known].mean()
        change = np.log(factor * other / level)
        return np.asarray((self.power / level - scaled / other - change) / 2)


def _powers(view: View, axis: str | None = None) -> Iterator[_Powers]:
    """Yield the powers of blocks beside the motion and the level of every axis that varies more.

    Beside one axis alone, those of samples too, and without what the two have in common: that is
    as loud as the other, and would follow it without any noise that does.
    """
    size = max(_FEWEST_ROWS, int(_BLOCK_S * view.grid.rate_hz))
    kept = _untouched(view, size)
    if axis is None and np.count_nonzero(kept) < _FEWEST:
        return
    if axis is not None:
        others, least = [axis], -np.inf
    else:
        others = [other for other in view.series.axes if other != view.axis]
        own = _spread(_squares(view.samples, size, level=False)[kept])
        least = max(_SOURCE * own, _MOVES * 2 / size)
    for other in others:
        for x in (one.rows for one in view.sources(other)):
            white = view.innovations if axis is None else _apart(view.innovations, x)
            squares = _blocks(white, size)[kept] ** 2
            for level in (False, True):
                q = _squares(x, size, level)[kept]
                if _spread(q) <= least or not q.any():
                    continue
                for at_once in (False,) if axis is None else (False, True):
                    each = q if at_once else q.mean(axis=1, keepdims=True)
                    # Where the source is loud, loud samples may follow it.
                    power = np.minimum(squares, _CAP * np.maximum(each / each.mean(), 1.0))
                    most = _ALONE * medians(each)[:, np.newaxis]
                    tells = each <= most
                    power = power[tells] if at_once else power.mean(axis=1)
                    if each[tells].any():  # a coarse source may rest in most samples
                        mean = float(np.minimum(each, most).mean())
                        source = other, level
                        yield _Powers(source, at_once, size, kept, power, each[tells], mean)


def _gain(powers: _Powers) -> float:
    return powers.gain


def _untouched(view: View, size: int) -> NDArray[np.bool_]:
    """Return which blocks tell: where a burst was taken out they are no longer as loud."""
    bursts = [
        c.signal for c in view.accepted if c.effect.motion == "burst" and c.signal is not None
    ]
    taken = np.any(bursts, axis=0) if bursts else np.zeros(view.grid.n, bool)
    return np.asarray(~_blocks(taken, size).any(axis=1))


def _apart(white: Array, x: Array) -> Array:
    """Return whitened data without what they have in common with an axis, by bands.

    Where a few rows hold most of the power of the other, as many tell of it, and bands are fewer.
    What chance alone takes out of the loud rows is put back.
    """
    x = x - x.mean()
    loud = x**2 / np.sum(x**2)
    bands = int(np.clip(1 / (_PER_BAND * np.sum(loud**2)), 1, _BANDS))
    own, other = rfft(white), rfft(x)
    edges = np.linspace(0, len(own), bands + 1).astype(np.int64)
    cross = np.add.reduceat(own * other.conj(), edges[:-1])
    power = np.add.reduceat(np.abs(other) ** 2, edges[:-1])
    shared = np.repeat(cross / np.maximum(power, np.finfo(np.float64).tiny), np.diff(edges))
    return np.asarray(irfft(own - shared * other, len(white)) * (1 + bands * loud))


def _blocks(x: NDArray[Any], size: int) -> NDArray[Any]:
    return x[: len(x) // size * size].reshape(-1, size)


def _squares(x: Array, size: int, level: bool) -> Array:
    """Return the squares about the mean of the record, or of each block, shape (blocks, size)."""
    blocks = _blocks(x, size)
    return np.asarray((blocks - (x.mean() if level else blocks.mean(axis=1, keepdims=True))) ** 2)


def _spread(squares: Array) -> float:
    """Return the relative variance of mean squares of blocks beyond that of white noise."""
    q = squares.mean(axis=1)
    mean = float(q.mean())
    return float(q.var()) / mean**2 - 2 / squares.shape[1] if mean > 0 else 0.0


def _stretches(n: int) -> NDArray[np.int64]:
    """Return the stretch in which each is."""
    return np.arange(n) * _STRETCHES // n
