r"""A random telegraph signal: the level switches between two values, +A and -A, at random.

Second moments are those of Gauss-Markov noise with sigma = A and 1/Tc = 2/dwell, exactly, so no
curve and no spectrum can name it. What can is the path: a two-state hidden Markov model on block
means, alternated with an estimate of the slow noise beneath (Wiener filter with the fitted B and
K), gives the most probable path. Its likelihood, noise refitted, plus the probability of the path
itself, is what the marginal likelihood of the Gauss-Markov process has to be compared with:

.. math:: \ln p(y \mid s) + \ln P(s) + [\ln p(y) - \ln p(y, s)]_{HMM} \quad \text{against} \quad
          \ln p_{GM}(y).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct, prev_fast_len

from allanscope.compiled import Pointer, kernel
from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, is_alike
from allanscope.explain.effects.gauss_markov import GaussMarkov
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import Regression, joint_fit, ordinates_of
from allanscope.explain.residual import removes
from allanscope.explain.series import block_means
from allanscope.explain.view import View
from allanscope.noise.components import Flicker, RandomWalk, Rounding, White
from allanscope.noise.components import GaussMarkov as CorrelatedNoise
from allanscope.noise.components import RandomTelegraph as Process
from allanscope.noise.grid import Grid

Array = NDArray[np.float64]

_BLOCKS = 16384
"""Blocks that a record is cut into at the least, where it has as many rows."""
_MOST_BLOCKS = 1 << 20
"""Most blocks of one path: a longer record shows its hops in a stretch."""
_LEAST_DOUBT = 0.003
"""Least relative error of the size, where blocks hold some rows: hops within them draw that of a
long record down by half a per cent."""
_TO_JUDGE, _TO_MEASURE = 12.0, 50.0
"""Blocks in a mean dwell. Few make the path probable; many miss no double switches, and tell when a
hop was: half a block of doubt at each makes the hops seem smaller, the more so in flicker noise."""
_SETTLED = 3e-3
"""Relative change of the switching rate at which its iteration ends."""
_MISSED = 1.4
"""Factor on the error of the dwell where noise hides switches."""
_ROUNDS = 40
"""Most turns of that iteration (expectation and maximisation)."""
_HARMONICS = 20.0
"""Band in units of one over the dwell that holds all but a per cent of the power of the hops."""
_LEAST = 1e-6
"""Share of the variance of the level that counts as white at the least: behind a steep filter there
is nothing at the top."""
_FEWEST_SWITCHES, _IN_A_HALF = 8, 2
"""Switches in the record and in each half of it: what hops now and then only is events."""
_COUNTED, _EVEN = 16, 0.5
"""Fewest dwells whose scatter is known, and their least deviation over their mean."""
_VISIBLE, _CLEAR, _SHARP = 4.0, 25.0, 60.0
"""Power of the mean over a dwell against white noise: below the first the path would follow the
noise, and fit it at every sample far better than it should; above the second it misses few hops;
above the third the size of the hops is that of the path."""
_ONE_CODE, _FEW_ROWS = 1.3, 10.0
"""Ratio up to which the hops are one step of the values, and rows in a dwell up to which noise that
is rounded stays on one value."""
_MOVED = 16.0
"""Variance of the level over that of white noise from which slow hops are looked for."""


@dataclass(frozen=True)
class RandomTelegraph(EffectKind):
    """Two levels."""

    amplitude: Estimate
    dwell: Estimate
    switches: int
    path_amplitude: float
    """Size of the hops on the path, from which it is found again."""

    kind = "random_telegraph"
    meaning = "the level switches between two values"
    phrase = "random telegraph signal, ±{amplitude}, mean dwell time {dwell}"
    as_cause = "a telegraph signal with a dwell time of {dwell} s"
    sized_by = "amplitude"
    is_single = True
    is_fitted = True
    is_not_gaussian = True
    excluded_by = frozenset({"gauss_markov", "quantization"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "gauss_markov": "same spectrum; two levels instead of a Gaussian",
        "step": "fewer than eight switches, or none in half of the record, are steps",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        apart = Estimate.exact(2 * self.amplitude.value, self.amplitude.unit).text
        return f"the level switches between two values {apart} apart"

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether other hops are the same hypothesis."""
        del grid
        return is_alike(self.dwell, other.dwell)

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Start from the Gauss-Markov process of the same spectrum."""
        found = next(iter(GaussMarkov.proposed(view)), None)
        twin = found if found is not None and found.excess >= 0 else None
        if twin is not None and isinstance(twin.effect, GaussMarkov):
            size, dwell_s = twin.effect.sigma.value, 2 * twin.effect.correlation_time.value
            candidates = [_candidate(view, size, dwell_s)]
        elif (moved := _moved(view)) > 0:  # a few slow hops are a random walk to any spectrum
            dwells = (view.series.duration_s / k for k in (15, 45))
            candidates = [_candidate(view, moved, dwell, _TO_JUDGE) for dwell in dwells]
        else:
            return
        best = max((c for c in candidates if c is not None), key=lambda c: c.gain, default=None)
        if best is None:
            return
        if twin is not None:
            best = _with_spectrum(view, best, twin)
        if found is not None:
            best = replace(best, rivals={GaussMarkov.kind: found.gain})
        yield best

    def refine(self, view: View) -> Candidate | None:
        """Find the path again."""
        again = _candidate(view, self.path_amplitude, self.dwell.value)
        twin = next(iter(GaussMarkov.proposed(view)), None)
        if again is None or twin is None or twin.excess < 0:
            return again
        return _with_spectrum(view, again, twin)

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Refuse hops between neighbouring values every few rows: they are the converter's codes.

        Noise behind a low-pass that hardly leaves two codes stays on each for some rows, and slow
        noise for more, where rounding errors follow each other. And what
        has not the spectrum of hops: a loud tone is on two sides too, longer or shorter as it
        moves.
        """
        codes = 2 * self.amplitude.value / view.step if view.step > 0 else 0.0
        rows = self.dwell.value * view.grid.rate_hz
        is_slow = rows >= _FEW_ROWS and not view.rounding
        is_code = 1 / _ONE_CODE < codes < _ONE_CODE and not is_slow
        return None if is_code or not removes(view, candidate) else candidate

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Refuse a change of the level that is hops: with a path beside it, it gains too little.

        To their spectrum, as to any, a few hops that happen to go one way are a jump.
        """
        if not other.effect.is_piecewise or other.signal is None:
            return ""
        bare, logliks = view.without(known), []
        for one in (bare, bare.accept(other)):
            found = _candidate(one, self.path_amplitude, self.dwell.value)
            if found is None:
                return ""
            logliks.append(one.spectrum.loglik + found.gain)
        return "hops of the telegraph signal" if logliks[1] - logliks[0] < other.penalty else ""

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut | None:
        """Judge the amplitude by interleaved blocks, on the path found in all of them."""
        size, dwell_s = self.path_amplitude, self.dwell.value
        path = _path(view, size, dwell_s, _judged(view, size, dwell_s))
        if path is None:
            return None
        column = _column(view, path)
        return interleaved(view, replace(joint_fit(view, column), gain=candidate.gain), column)


@dataclass(frozen=True)
class _Path:
    state: Array
    log_prior: float
    slack: float
    amplitude: float
    dwell_s: float
    switches: int
    doubt: float
    """Share of the size by which blocks that may be on either level move it."""
    rows: int
    """In each of those blocks."""


def _moved(view: View) -> float:
    """Deviation of means over a 200th of the record beyond the white noise in them, 0 if small."""
    means = block_means(view.data, 200)
    white = view.spectrum.model.value("N") ** 2 * 200 / view.series.duration_s
    variance = float(means.var())
    return float(np.sqrt(variance - white)) if variance > _MOVED * white else 0.0


def _column(view: View, path: _Path) -> Array:
    """Ordinates of the path: the first ones of slow hops, all of fast ones."""
    hop = view.grid.n // len(path.state)
    full = np.repeat(path.state, hop)
    full = np.concatenate([full, np.full(view.grid.n - len(full), full[-1])])
    top_hz = view.grid.low * view.grid.rate_hz / (2 * view.grid.n)
    m = view.grid.low if top_hz * path.dwell_s > _HARMONICS else view.grid.n - 1
    return np.asarray(ordinates_of(full)[np.newaxis, :m])


def _candidate(
    view: View, amplitude: float, dwell_s: float, per_dwell: float = 0.0
) -> Candidate | None:
    """Return hops like these, on so many blocks a dwell, or those that loud hops need."""
    if amplitude**2 * dwell_s < _VISIBLE * view.spectrum.model.value("N") ** 2:
        return None
    path = _path(view, amplitude, dwell_s, per_dwell or _judged(view, amplitude, dwell_s))
    if path is None or not _is_lasting(path) or _is_regular(path):
        return None
    fit = joint_fit(view, _column(view, path))
    size = float(fit.amplitude[0])
    if size <= 0:
        return None
    known = max(_TO_MEASURE, _known(view, size, path.dwell_s))
    gain = fit.gain + path.log_prior + path.slack
    if gain < 0:  # no hops: their size does not matter
        return _measured(view, path, path, fit, gain)
    part = _stretch(view, _MOST_BLOCKS * max(1, int(path.dwell_s * view.grid.rate_hz / known)))
    finer = _path(part, size, path.dwell_s, known)
    if finer is None or finer.switches < _FEWEST_SWITCHES:
        part, finer = view, path
    return _measured(view, path, finer, joint_fit(part, _column(part, finer)), gain)


def _known(view: View, size: float, dwell_s: float) -> float:
    """Return into how many blocks a dwell is cut if each tells when a hop was.

    The white noise in the mean of a block is half as large as the size.
    """
    return size**2 * dwell_s / max(4 * view.spectrum.model.value("N") ** 2, 1e-300)


def _judged(view: View, size: float, dwell_s: float) -> float:
    """Return blocks in a dwell of the path that is judged.

    Loud hops that are off by a part of a block leave more than the path explains.
    """
    return max(_TO_JUDGE, _known(view, size, dwell_s))


def _measured(view: View, path: _Path, finer: _Path, fit: Regression, gain: float) -> Candidate:
    """Return hops that were found on one path and measured on a finer one."""
    size, error = float(fit.amplitude[0]), float(np.sqrt(fit.covariance[0, 0]))
    dwell = finer.dwell_s
    doubt = max(finer.doubt, _LEAST_DOUBT) if finer.rows > 1 else finer.doubt
    effect = RandomTelegraph(
        Estimate.of(size, float(np.hypot(error, doubt * size)), view.unit),
        Estimate.of_log(dwell, 1.0 / np.sqrt(finer.switches), "s"),
        path.switches,
        size,
    )
    return Candidate(effect, gain, float(np.log(12)), parts=(Process(1.0, dwell),))


def _stretch(view: View, rows: int) -> View:
    """Return the beginning of a long record: short blocks of all of it would be too many.

    Coarse blocks blur fast hops and make them seem smaller; some thousand hops tell their size.
    """
    if rows >= view.grid.n:
        return view
    rows = int(prev_fast_len(rows))
    series = replace(
        view.series,
        axes=(view.axis,),
        values=view.data[:rows, np.newaxis],
        lsb=(view.series.lsb[view.series.column(view.axis)],),
        temperature_c=None,
        bridged=view.series.bridged[:rows],
    )
    return View(
        series,
        series.grid,
        view.axis,
        view.data[:rows],
        view.step,
        view.rounding,
        parts=view.parts,
        excluded=view.excluded,
        base=view.base,
    )


def _is_lasting(path: _Path) -> bool:
    """Return whether it hops often enough, and all along: a shock makes a few hops too."""
    hops = np.diff(path.state) != 0
    first, second = (int(np.count_nonzero(half)) for half in np.array_split(hops, 2))
    return path.switches >= _FEWEST_SWITCHES and min(first, second) >= _IN_A_HALF


def _is_regular(path: _Path) -> bool:
    """Return whether the dwells are too much alike: a slow tone makes a path too.

    Random dwells are exponentially distributed: their deviation is as large as their mean.
    """
    dwells = np.diff(np.flatnonzero(np.diff(path.state)))
    if len(dwells) < _COUNTED:
        return False
    return bool(np.std(dwells) < _EVEN * np.mean(dwells))


def _with_spectrum(view: View, candidate: Candidate, process: Candidate) -> Candidate:
    """Take from the Gauss-Markov process that the spectrum shows what the path does not tell.

    The size, where the path misses hops and takes noise for others, which blurs it by some per
    cent, with the error on the path: the power of a Gaussian process scatters, that of two levels
    does not; size and dwell, where noise breaks the path into too many pieces. Where both levels
    are seen but one is held longer than the other, the path is right: the spectrum, with
    1/Tc = 1/dwell_1 + 1/dwell_2, holds for the noise that enters the model only.
    """
    effect, twin = candidate.effect, process.finished().effect
    assert isinstance(effect, RandomTelegraph)
    assert isinstance(twin, GaussMarkov)
    tc = twin.correlation_time
    assert tc.lower is not None
    assert tc.upper is not None
    half = effect.dwell.value / 2
    white = max(view.spectrum.model.value("N") ** 2, 1e-300)
    seen = 2 * effect.amplitude.value**2 / white
    if tc.lower <= half <= tc.upper:
        if seen * half > _SHARP:
            return candidate
        size = twin.sigma.value
        error = effect.amplitude.error / effect.amplitude.value * size
        amplitude = Estimate.of(size, error, effect.amplitude.unit)
        dwell = Estimate.of_log(effect.dwell.value, _MISSED / np.sqrt(effect.switches), "s")
        return replace(candidate, effect=replace(effect, amplitude=amplitude, dwell=dwell))
    parts = (Process(1.0, 2 * tc.value),)
    if half > tc.upper and seen * tc.lower > _CLEAR:
        return replace(candidate, parts=parts)
    dwell = Estimate(2 * tc.value, 2 * tc.lower, 2 * tc.upper, "s")
    slower = replace(effect, amplitude=twin.sigma, dwell=dwell, path_amplitude=twin.sigma.value)
    return replace(candidate, effect=slower, parts=parts)


def _path(view: View, amplitude: float, dwell_s: float, per_dwell: float) -> _Path | None:
    """Alternate between the path and the slow noise beneath it."""
    grid = view.grid
    fine = int(min(grid.n // _BLOCKS, dwell_s * grid.rate_hz / per_dwell))
    hop = max(1, fine, grid.n // _MOST_BLOCKS)
    blocks = grid.n // hop
    block_s = hop / grid.rate_hz
    level = view.data[: blocks * hop].reshape(blocks, hop).mean(axis=1)
    level = level - level.mean()
    f = np.arange(1, blocks) * grid.rate_hz / (2 * grid.n)
    size, rate = amplitude, min(0.4, block_s / dwell_s)
    parts = _parts(view, dwell_s / 2, f)
    # That beside hops: at the top of the band, where they are short, they are still louder.
    white = max(float(parts[0].mean()) / hop, _LEAST * float(level.var()))
    whole = np.maximum(parts[0] + parts[1] + parts[2], np.finfo(np.float64).tiny)
    beneath_both = parts[1] / whole
    total = parts[0] + parts[1]
    wiener = np.divide(parts[1], total, out=np.zeros_like(total), where=total > 0)
    slow = _smooth(level, beneath_both)
    result = None
    for _ in range(_ROUNDS):
        rest = level - slow
        state, most, log_z, log_joint, switches = posterior(rest, size, rate, white)
        weight = float(np.sum(state**2))
        if weight <= 0:
            return None
        before, rate = rate, float(np.clip(switches / (blocks - 1), 1e-6, 0.4))
        hard = int(np.count_nonzero(np.diff(most)))
        log_prior = hard * np.log(rate) + (blocks - 1 - hard) * np.log1p(-rate)
        doubt, dwell = 1 - float(np.mean(np.abs(state))), _dwell(rate, block_s)
        result = _Path(most, log_prior, log_z - log_joint, size, dwell, hard, doubt, hop)
        slow = _smooth(level - size * state, wiener)
        new = float(np.sum((level - slow) * state) / np.sum(state**2))
        if new <= 0:
            return None
        size = new
        if abs(rate - before) < _SETTLED * before:
            break
    return result


def _dwell(chance: float, block_s: float) -> float:
    """Mean dwell of a signal that differs between two instants with this chance."""
    return -2 * block_s / float(np.log1p(-2 * chance))


def _smooth(values: Array, share: Array) -> Array:
    """Keep the given share of every ordinate."""
    ordinates = dct(values, norm="ortho")
    ordinates[1:] *= share
    return np.asarray(idct(ordinates, norm="ortho"))


def _parts(view: View, tc: float, f: Array) -> list[Array]:
    """White noise; flicker and random walk; the process: as fitted together."""
    fit = view.spectrum_with(CorrelatedNoise(1.0, tc))
    white = [c for c in fit.model if isinstance(c, White | Rounding)]
    slow = [c for c in fit.model if isinstance(c, Flicker | RandomWalk)]
    return fit.split((white, slow, fit.model.components[-1:]), f)


def posterior(
    data: Array, size: float, rate: float, variance: float
) -> tuple[Array, Array, float, float, float]:
    """Return what the data say about a signal that hops between +size and -size.

    Parameters
    ----------
    data : ndarray, shape (n,)
        Signal plus white noise of the given variance.
    rate : float
        Probability of a switch between two samples.

    Returns
    -------
    mean : ndarray, shape (n,)
        Posterior mean of the state (-1 to 1).
    path : ndarray, shape (n,)
        Most probable path of -1 and +1.
    log_evidence, log_joint : float
        Of the data, all paths summed; of the data with that path.
    switches : float
        Expected number of switches.
    """
    n = len(data)
    mean, path, found = np.empty(n), np.empty(n), np.empty(3)
    _posterior(
        np.ascontiguousarray(data, np.float64),
        *(n, float(size), float(rate), float(variance), mean, path, found),
        *(np.empty(5 * n), np.empty(2 * n, np.int8)),
    )
    log_z, log_joint, switches = found.tolist()
    return mean, path, log_z, log_joint, switches


_OUT = Pointer(np.float64, 1, written=True)
_posterior = kernel(
    "telegraph_posterior",
    *(Pointer(np.float64, 1), int, float, float, float),
    *(_OUT, _OUT, _OUT, _OUT, Pointer(np.int8, 1, written=True)),
)
