r"""A line: hum, a pump, a fan, an alias, a mechanical oscillation that never changes.

Spotted as the largest ordinate of the periodogram (zero-padded once) over the local level: with n
samples about 0.75 n frequencies are looked at, so a line needs a gain of ln(0.75 n / alpha) nats.
Below some tens of cycles per record the periodogram leaks and the level is not local: there cosine
and sine are fitted by GLS with the noise refitted. Amplitude and frequency follow by least squares,

.. math:: sd(A) = \sqrt{S_1/T}, \qquad sd(f) = \sqrt{3 S_1/T} / (\pi A T)

with the one-sided density S_1 beside the line. It enters the model as a signal that is subtracted.

Noise makes the fitted amplitude larger than the true one: amplitude, phase and frequency each take
one degree of freedom of it, so that the mean square of the fitted amplitude is A^2 + 3 sd^2 and its
mean A + sd^2 / A. Reported is what has this taken off, :math:`\sqrt{\hat A^2 - 2\,sd^2}`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import minimum_filter1d

from allanscope.explain.candidate import ALPHA, Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.unexplained import beside, tone_left_over
from allanscope.explain.heldout import interleaved_signal
from allanscope.explain.regression import joint_fit
from allanscope.explain.running_level import may_hold_a_line, running_level
from allanscope.explain.slow_waves import SlowWaves
from allanscope.explain.stationarity import constancy
from allanscope.explain.view import View
from allanscope.noise.components import Sinusoid as Line
from allanscope.noise.grid import Grid
from allanscope.optimise import minimise_between
from allanscope.quantities import CHI_SQUARE_MEDIAN, periods

Array = NDArray[np.float64]

_FEWEST_CYCLES = 3.0
"""Of fewer waves, nothing tells a line from a drift."""
_SLOW_CYCLES = 40.0
"""Below this many cycles per record the level around a line must come from the model."""
_AT_NYQUIST = 0.25
"""Distance from the Nyquist frequency, times the length of the record, below which a line is at it:
cosine and sine are then nearly the same samples of alternating sign, and no phase is known. At
this distance their correlation is 2 / pi."""
_PROPOSALS = 3
"""Highest peaks that are fitted in full."""
_MARGIN = 8
"""Ordinates beside an excluded range into which what was excluded leaks."""
_BLOCK = 1024
"""Rows over which a wave is computed by one exponential each."""
_BESIDE = 400
"""Ordinates on each side that tell the level around a line."""
_CONSTANT_P = 1e-5
"""Chance below which the parts of a line differ too much to be one line."""
_REMNANT = 0.2
"""Power that a line may leave of what it is, which it is taken for as a whole."""
_AGREE = 5.0
"""Standard errors within which sidebands count as equal, and as equally far from the carrier."""
_ASIDE = 0.25
"""Farthest sideband, as a share of the carrier: beyond, lines are harmonics or strangers."""


@dataclass(frozen=True)
class Sinusoid(EffectKind):
    """A line in the spectrum."""

    frequency: Estimate
    amplitude: Estimate
    constancy_p: float | None = None

    kind = "sinusoid"
    meaning = "a tone of constant amplitude and frequency"
    phrase = "line at {frequency}, {amplitude}"
    as_cause = "a line at {frequency} Hz"
    is_counted = True
    is_line = True
    sized_by = "amplitude"
    located_by = "frequency"
    shared_by = "frequency"
    is_fitted = True
    resembles_bend = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "narrowband": "a line is one bin wide however long the record is",
        "unexplained": "a chirp or a modulated tone changes between parts of the record",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        f = self.frequency.value
        return f"a line at {f:.6g} Hz{periods(f)}, amplitude {self.amplitude.text}"

    @property
    def curve(self) -> Line:
        """The tone."""
        return Line(abs(self.amplitude.value), self.frequency.value)

    @property
    def is_constant(self) -> bool:
        """Whether the parts of the record may hold one and the same line."""
        return self.constancy_p is not None and self.constancy_p >= _CONSTANT_P

    @property
    def wave_hz(self) -> tuple[float, ...]:
        """Its frequency, where it is constant."""
        return (self.frequency.value,) if self.is_constant else ()

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another line is the same hypothesis."""
        return abs(self.frequency.value - other.frequency.value) < grid.rate_hz / grid.n

    def waves(self, view: View) -> float:
        """Return how many waves the record holds."""
        return self.frequency.value * view.series.duration_s

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look at every frequency from three cycles per record to Nyquist."""
        yield from (_at(view, f) for f in _fast_lines(view))
        yield from (_at(view, f) for f in _slow_lines(view))

    def refine(self, view: View) -> Candidate:
        """Estimate frequency, amplitude and phase again."""
        return _at(view, self.frequency.value)

    def elsewhere(self, view: View, questions: int) -> Candidate:
        """Return what another axis has at the same frequency, which is known.

        Parameters
        ----------
        view : View
            The other axis.
        questions : int
            How many lines and axes are asked for together.
        """
        found = _at(view, self.frequency.value, is_known=True)
        assert isinstance(found.effect, Sinusoid)
        effect = replace(found.effect, frequency=self.frequency)
        return replace(found, effect=effect, log_alternatives=float(np.log(questions)))

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate it again: no phase is known well enough to be good for twice the time."""
        rate = view.grid.rate_hz
        f = self.frequency.value % rate
        f = min(f, rate - f)  # where longer rows show it
        if f * view.series.duration_s < _FEWEST_CYCLES:
            return replace(candidate, signal=None)
        return _at(view, f)

    def is_resolved(self, view: View) -> bool:
        """Return whether it is farther from every line there is than the record resolves.

        Two nearer lines of opposite phase are any slow bend at all: they cancel except at the ends.
        """
        known = (c.effect for c in view.accepted)
        near = 1 / view.series.duration_s
        return all(
            abs(one.frequency.value - self.frequency.value) >= near
            for one in known
            if isinstance(one, Sinusoid)
        )

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where it is one line all along; a tone that changes has no name."""
        f = self.frequency.value
        steady = not beside(view, f) and self.is_constant
        return candidate if steady else tone_left_over(view, candidate, f)

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge amplitude and phase by interleaved blocks."""
        return interleaved_signal(view, _pair(view, self.frequency.value), candidate.gain)

    def columns(self, view: View) -> Array | None:
        """Return the ordinates of cosine and sine of a slow line."""
        slow = self.waves(view) < _SLOW_CYCLES
        return _slow_pair(view.grid, self.frequency.value) if slow else None

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the amplitude and phase that a joint regression found."""
        error = float(np.sqrt(np.trace(covariance) / 2))
        size = _unbiased(float(np.hypot(*amplitude)), error)
        found = replace(self, amplitude=Estimate.of(size, error, self.amplitude.unit))
        signal = amplitude @ _pair(view, self.frequency.value)
        return replace(candidate, effect=found, signal=signal)


def constant_line(view: View, first: int, stop: int) -> Candidate | None:
    """Return the line that all power of some ordinates is; None where it is not one line.

    `view` is without what left them out of its fit. What is loud beside a line hides in a search
    that it is constant.
    """
    low, high = np.array([first + 1, stop + 1]) * view.grid.rate_hz / (2 * view.grid.n)
    found = _at(view, float(low + high) / 2)
    effect = found.effect
    assert isinstance(effect, Sinusoid)
    if not (low < effect.frequency.value < high and effect.is_constant and found.excess > 0):
        return None
    inside = slice(first, stop)
    rest = view.accept(found)
    noise = view.spectrum.ordinates[inside]
    power = float((view.squares[inside] - noise).sum())
    left, error = float((rest.squares[inside] - noise).sum()), float(np.sqrt(2 * noise @ noise))
    if left > _REMNANT * power + error:
        return None
    held = effect.hold_out(view, found)
    return replace(found, held_out=held) if held.nats > held.error else None


def sidebands(lines: Sequence[Sinusoid]) -> tuple[Sinusoid, ...]:
    """Return a carrier with two equal lines at equal distances beside it, if there is one.

    A tone whose amplitude or phase is modulated steadily is exactly three (or more) constant lines.
    Three names for one thing would be three wrong names. Where a swinging frequency leaves nothing
    at the carrier itself, two such pairs about one centre show it.
    """
    ordered = sorted(lines, key=lambda line: line.frequency.value)
    for family in combinations(ordered, 3):
        f, error = _places(family)
        uneven = abs(f[0] + f[2] - 2 * f[1])
        if f[2] - f[1] > _ASIDE * f[1] or uneven > 2 * _AGREE * error:
            continue
        if _is_of_a_wave(ordered, (f[2] - f[0]) / 2, error):
            continue
        if _are_equal(family[0], family[2]):
            return family
    for pairs in combinations(ordered, 4):
        f, error = _places(pairs)
        if f[3] - f[0] > _ASIDE * f[0] or abs(f[0] + f[3] - f[1] - f[2]) > _AGREE * error:
            continue
        if any(_is_of_a_wave(ordered, apart, error) for apart in (f[1] - f[0], f[2] - f[1])):
            continue
        if _are_equal(pairs[0], pairs[3]) and _are_equal(pairs[1], pairs[2]):
            return pairs
    return ()


def _places(lines: Sequence[Sinusoid]) -> tuple[list[float], float]:
    """Return the frequencies of lines, and the error of them all together."""
    errors = [line.frequency.error for line in lines]
    return [line.frequency.value for line in lines], float(np.linalg.norm(errors))


def _are_equal(first: Sinusoid, second: Sinusoid) -> bool:
    """Return whether two lines have the same size."""
    spread = float(np.hypot(first.amplitude.error, second.amplitude.error))
    return abs(first.amplitude.value - second.amplitude.value) < _AGREE * spread


def _is_of_a_wave(lines: Sequence[Sinusoid], apart: float, error: float) -> bool:
    """Return whether lines so far apart are harmonics, all or the odd ones, of a line there is."""
    found = [line.frequency.value for line in lines]
    return any(abs(f - wave) < _AGREE * error for f in found for wave in (apart, apart / 2))


def _at(view: View, frequency: float, *, is_known: bool = False) -> Candidate:
    """Fit a line near a frequency, or at one that is known."""
    n, rate = view.grid.n, view.grid.rate_hz
    duration = n / rate
    if not is_known:
        frequency = _peak(view.data, rate, frequency, 0.75 / duration)
    if frequency * duration < _SLOW_CYCLES:
        if not is_known:
            frequency = _slow_peak(view, frequency)
        fit = joint_fit(view, _slow_pair(view.grid, frequency))
        pair = _pair(view, frequency)
        gain, amplitudes = fit.gain, fit.amplitude
        error = float(np.sqrt(np.trace(fit.covariance) / 2))
    else:
        frequency = min(frequency, rate - frequency)
        if rate / 2 - frequency < _AT_NYQUIST / duration:
            frequency = rate / 2
        pair = _pair(view, frequency)
        normal = pair @ pair.T
        amplitudes = np.linalg.solve(normal, pair @ (view.data - view.data.mean()))
        level = max(
            _local_level(view, frequency), float(view.spectrum.at(np.array([frequency]))[0])
        )
        gain = float(amplitudes @ normal @ amplitudes / (2 * level))
        error = float(np.sqrt(level * np.trace(np.linalg.inv(normal)) / len(pair)))
    amplitude = _unbiased(float(np.linalg.norm(amplitudes)), error)
    sd_frequency = np.sqrt(3.0) * error / (np.pi * amplitude * duration)
    effect = Sinusoid(
        Estimate.of(frequency, sd_frequency, "Hz"),
        Estimate.of(amplitude, error, view.unit),
        constancy(view.data, rate, frequency),
    )
    return Candidate(effect, gain, float(np.log(0.75 * n)), signal=amplitudes @ pair)


def _unbiased(fitted: float, error: float) -> float:
    """Return an amplitude without what noise adds, phase and frequency being fitted to it too.

    Never more than half is taken off: of what is that faint no size is known.
    """
    return float(np.sqrt(max(fitted**2 - 2 * error**2, fitted**2 / 4)))


@dataclass(frozen=True)
class _Periodogram:
    """Frequencies and power of a zero-padded transform, and the running level beside lines.

    Empty where there can be no line, whatever the model is.
    """

    frequency: Array
    power: Array
    level: Array

    @classmethod
    def of(cls, view: View) -> Self:
        n, rate = view.grid.n, view.grid.rate_hz
        size = next_fast_len(2 * n, real=True)
        lowest = int(_SLOW_CYCLES * size / n) + 1
        power = (np.abs(rfft(view.data - view.data.mean(), size)) ** 2 / n)[lowest:]
        if not may_hold_a_line(power, _price(view)):
            return cls(*(np.empty(0),) * 3)
        frequency = np.arange(lowest, lowest + len(power)) * rate / size
        return cls(frequency, power, running_level(power))


def _price(view: View) -> float:
    return float(np.log(0.75 * view.grid.n / ALPHA))


def _fast_lines(view: View) -> list[float]:
    n, rate = view.grid.n, view.grid.rate_hz
    if Sinusoid not in view.of_data:
        view.of_data[Sinusoid] = _Periodogram.of(view)
    seen: _Periodogram = view.of_data[Sinusoid]
    if not len(seen.power):
        return []
    ordinate = np.clip((seen.frequency * 2 * n / rate).astype(int) - 1, 0, n - 2)
    inside = minimum_filter1d(view.spectrum.kept, 2 * _MARGIN + 1)[ordinate]
    # A resonance in the model is narrower than the blocks of the running level.
    level = np.maximum(seen.level, view.spectrum.ordinates[ordinate])
    ratio = np.where(inside, seen.power / level, 0.0)
    found = []
    for _ in range(_PROPOSALS):
        best = int(np.argmax(ratio))
        gain = float(ratio[best])
        if gain < _price(view):
            break
        found.append(float(seen.frequency[best]))
        ratio[max(0, best - 12) : best + 12] = 0.0
    return found


def _slow_lines(view: View) -> list[float]:
    """Frequencies of few cycles, scanned by GLS under the null's noise, then refitted."""
    n, m = view.grid.n, view.grid.low
    weight = view.spectrum.kept[:m] / view.spectrum.first(m)
    waves = _slow_waves(view.grid)
    scores = waves.gains(weight, view.ordinates[:m])
    order = np.argsort(scores)[::-1]
    price = np.log(0.75 * n / ALPHA)
    found = []
    for index in order[:2]:
        if scores[index] > 0.35 * price:
            fit = joint_fit(view, waves.pair(index))
            if fit.gain > 0.6 * price:
                found.append(float(waves.frequency[index]))
    return found[:1]


def _slow_peak(view: View, frequency: float) -> float:
    duration = view.grid.n / view.grid.rate_hz
    spread, lowest = 0.5 / duration, _FEWEST_CYCLES * 0.9 / duration
    frequency = max(frequency, lowest)  # a slower drift draws it down, a little with every fit

    def loss(f: float) -> float:
        return -joint_fit(view, _slow_pair(view.grid, f), rounds=4).gain

    low, high = max(frequency - spread, lowest), frequency + spread
    return minimise_between(loss, low, high, within=0.01 / duration)[0]


@lru_cache(maxsize=2)  # all axes of a record are scanned alike
def _slow_waves(grid: Grid) -> SlowWaves:
    """Return the waves that are scanned: a quarter of a cycle apart."""
    cycles = np.arange(_FEWEST_CYCLES, _SLOW_CYCLES, 0.25)
    return SlowWaves.of(grid, cycles * (grid.rate_hz / grid.n))


def _slow_pair(grid: Grid, frequency: float) -> Array:
    """Return the first ordinates of cosine and sine of a frequency in Hz, shape (2, m)."""
    return SlowWaves.of(grid, np.array([frequency])).pair(0)


def _pair(view: View, frequency: float) -> Array:
    """Return cosine and sine of a frequency, shape (2, n); at Nyquist the cosine alone, (1, n)."""
    if 2 * frequency == view.grid.rate_hz:
        alternating = np.where(np.arange(view.grid.n) % 2, -1.0, 1.0)
        return np.asarray(alternating - alternating.mean())[np.newaxis]
    wave = _wave(view.grid.n, 2 * np.pi * frequency / view.grid.rate_hz)
    pair = np.vstack([wave.real, wave.imag])
    return np.asarray(pair - pair.mean(axis=1, keepdims=True))


def _wave(n: int, angle: float) -> NDArray[np.complex128]:
    """Return exp(i angle k) for k < n, a tenth as costly as n exponentials."""
    inside = np.exp(1j * angle * np.arange(_BLOCK))
    starts = np.exp(1j * angle * _BLOCK * np.arange(-(-n // _BLOCK)))
    return np.asarray(np.outer(starts, inside).ravel()[:n])


def _peak(data: Array, rate: float, frequency: float, spread: float) -> float:
    """Maximise the periodogram near a frequency, on data reduced to a narrow band around it."""
    n = len(data)
    mixed = (data - data.mean()) * _wave(n, -2 * np.pi * frequency / rate)
    hop = max(1, n // 4096)
    whole = n // hop * hop
    slow = mixed[:whole].reshape(-1, hop).sum(axis=1)
    at = (np.arange(len(slow)) + 0.5) * hop / rate

    def loss(offset: float) -> float:
        return -float(abs(np.sum(slow * np.exp(-2j * np.pi * offset * at))))

    return frequency + minimise_between(loss, -spread, spread, within=1e-4 * spread)[0]


def _local_level(view: View, frequency: float) -> float:
    """Variance of an ordinate around a frequency, from the median, which a line does not move."""
    centre = int(frequency * 2 * view.grid.n / view.grid.rate_hz)
    half = min(_BESIDE, max(8, centre // 3))
    near = view.squares[max(0, centre - half) : centre + half]
    return float(np.median(near)) / CHI_SQUARE_MEDIAN
