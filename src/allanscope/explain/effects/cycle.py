r"""A cycle: the level repeats one waveform, in cycles of which each has a length of its own.

An air conditioner, a thermostat, the compressor of a refrigerator: the temperature of the bench
goes up and down, and the level with it. Where no thermometer has measured it, the curve has a hump
at half a period and falls beyond, which N, B and K take for a random walk. As the period wanders
the spectrum has no line but a broad band, and others at its multiples: a range without a name.
As a function of the phase it is one waveform (`explain.cycles`), whose harmonics are fitted
together with the noise.

It is held out cycle by cycle: the waveform is fitted to every second one and judged on the others.
It is no `narrowband`: that is noise, whose amplitude is another in each cycle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import ALPHA, Candidate, HeldOut
from allanscope.explain.cycles import (
    BELOW,
    Cycles,
    SlowPlaces,
    cycle_of,
    first_begins,
    level_of,
    phase_of,
    settled,
    slow_excess,
)
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.narrowband import Narrowband
from allanscope.explain.effects.unexplained import Unexplained
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import Regression, joint_fit, marginal_covariance
from allanscope.explain.residual import quartile_deviation
from allanscope.explain.series import in_time
from allanscope.explain.view import View
from allanscope.noise.components import Component, IrregularCycles
from allanscope.noise.selection import calibrated_penalty
from allanscope.quantities import duration, measured, student_widening

Array = NDArray[np.float64]

_PENALTY = calibrated_penalty("cycle")
"""Nats that noise hardly gains beyond the price of the instants."""
_HARMONIC = 3.0
"""Nats that each further harmonic must gain."""
_FEW, _MOST = 3, 12
"""Harmonics at first, with which the instants are sure to be found, and at the most."""
_TURNS = 3
"""Most turns of instants and number of harmonics."""
_LONGER = (1, 2, 3)
"""Times as long as a cycle: where such a frequency is left out of the fit, its own may be."""
_MULTIPLES = (1.0, 0.5)
"""Of the frequency with most power: the waveform may have most at twice its own."""
_UNEVEN = 0.3
"""Scatter of the amplitude over the cycles, relative to it, from which they are noise: of noise in
a band it is 0.57 (Rayleigh's), of measured temperatures 0.05 to 0.2. It is that of the quartiles: a
few cycles that are none leave them where they are."""
_MAIN = 0.7
"""Power of the first harmonic over that of the loudest, at the least."""
_REMNANT, _NEAR = 0.2, 0.15
"""Share of their gain that irregular cycles may leave, and how near to their frequencies, as a part
of these."""
_WIDTH = 0.6
"""Of the band of what differs from cycle to cycle, over the frequency: measured temperatures of
incubators and refrigerators leave a twentieth of their power so, most within half of it."""
_PIECE = 3.0
"""Times of what a cycle gains on average up to which a change of the level is what one of them
differs by from the waveform."""
_TOGETHER = 0.6
"""Mean vector of the phases at which the cycles of another axis begin, 1 where all are the same: by
chance it is one over the root of their number."""
_WAVEFORM = 256
"""Places of a waveform from which its highest and its lowest are taken."""


@dataclass(frozen=True)
class Cycle(EffectKind):
    """A waveform of the level, and when it is repeated.

    Attributes
    ----------
    period, sigma : Estimate
        Mean length of a cycle, and the rms of the level.
    peak_to_peak : float
        Highest over lowest level of the waveform.
    shortest_s, longest_s : float
        Lengths of cycles.
    begins : tuple of float
        When each cycle begins, and the last one ends, in s; those at both ends of the record begin
        before it and end after it.
    waveform : tuple of float
        Cosine and sine of each harmonic.
    price_of_instants : float
        In nats.
    unevenness : float
        Scatter of the amplitude over the cycles, relative to it, beyond that of the noise.
    """

    period: Estimate
    sigma: Estimate
    peak_to_peak: float
    shortest_s: float
    longest_s: float
    begins: tuple[float, ...]
    waveform: tuple[float, ...]
    price_of_instants: float
    unevenness: float = 0.0

    kind = "cycle"
    meaning = "the level repeats one waveform, in cycles whose length wanders"
    phrase = "cycle of the level every {period}, {sigma} rms"
    as_cause = "a cycle of the level"
    acts_fast = False
    sized_by = "sigma"
    shared_by = "period"
    is_single = True
    is_rival = False  # lines of one length and noise in a band look like it, until it is judged
    confused_with: ClassVar[Mapping[str, str]] = {
        "sinusoid": "has one period all along",
        "narrowband": "is noise, whose amplitude is another in each cycle",
        "temperature": "the measured temperature explains it",
        "unexplained": "no waveform is repeated",
    }

    @property
    def count(self) -> int:
        """Cycles, those in part among them."""
        return len(self.begins) - 1

    @property
    def wave_hz(self) -> tuple[float, ...]:
        """Mean frequency, and its multiples."""
        return tuple((np.arange(1, len(self.waveform) // 2 + 1) / self.period.value).tolist())

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        shortest, longest = duration(self.shortest_s), duration(self.longest_s)
        return (
            f"the level repeats one waveform {self.count} times, every "
            f"{duration(self.period.value)} on average ({shortest} to {longest}), "
            f"{measured(self.peak_to_peak, unit=self.sigma.unit)} peak to peak, "
            f"{self.sigma.text} rms"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Cut the record into cycles of about the frequency at which there is most power."""
        frequency = slow_excess(view)
        if frequency is None:
            return []
        starts = (first_begins(view, frequency * times) for times in _MULTIPLES)
        found = (cls._near(view, begins) for begins in starts if begins is not None)
        known = [one for one in found if one is not None]
        return [max(known, key=lambda one: one.excess)] if known else []

    def goes_along(self, other: Self) -> bool:
        """Return whether cycles of another axis begin at the same places in these."""
        phase = phase_of(np.array(self.begins), np.array(other.begins[1:-1]))
        return bool(abs(np.mean(np.exp(2j * np.pi * phase))) > _TOGETHER)

    def refine(self, view: View) -> Candidate | None:
        """Estimate instants and waveform again."""
        return self._near(view, self._rows(view))

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Cut the whole record again: when the next cycle begins cannot be known."""
        begins = first_begins(view, 1 / self.period.value)
        found = None if begins is None else self._near(view, begins)
        return replace(candidate, signal=None) if found is None else found.finished()

    @classmethod
    def _near(cls, view: View, begins: Array) -> Candidate | None:
        """Return cycles that begin about then, with as many harmonics as they need."""
        cycles = settled(view, begins, min(_FEW, _most(view, begins)))
        if cycles is None:
            return None
        begins = _divided(cycles.begins, 1 + int(np.argmax(_powers(cycles.fit.amplitude))))
        frequency = view.grid.rate_hz / float(np.diff(begins).mean())
        if any(low < frequency / n < high for low, high in view.excluded for n in _LONGER):
            return None
        part = _irregular(frequency)
        noise, harmonics = view.with_parts(part), 0
        for _ in range(_TURNS):
            before, harmonics = harmonics, _harmonics(noise, begins)
            if harmonics == before:
                break
            cycles = settled(noise, begins, harmonics)
            if cycles is None:
                return None
            begins = cycles.begins
        return cls._of(view, noise, cycles, part)

    @classmethod
    def _of(cls, view: View, noise: View, cycles: Cycles, part: Component) -> Candidate:
        """Return the candidate of settled cycles."""
        rate = view.grid.rate_hz
        lengths = np.diff(cycles.begins)[1:-1] / rate
        mean = float(lengths.mean())
        ends = float(np.hypot(cycles.errors[1], cycles.errors[-2])) / rate
        # Lengths scatter, by how much is known from these few (Student's distribution).
        scatter = student_widening(len(lengths) - 1) * lengths.std(ddof=1) / np.sqrt(len(lengths))
        error = np.hypot(scatter, ends / len(lengths))
        bare = cls(
            Estimate.of(mean, float(error), "s"),
            Estimate(1.0, unit=view.unit),
            0.0,
            float(lengths.min()),
            float(lengths.max()),
            tuple(view.time_at(cycles.begins).tolist()),
            tuple(cycles.fit.amplitude.tolist()),
            cycles.price,
        )
        further = _HARMONIC * (len(bare.waveform) // 2 - 1)
        searched = cycles.price + further + _PENALTY + float(np.log(ALPHA))
        gain = cycles.fit.gain + noise.spectrum.loglik - view.spectrum.loglik
        candidate = Candidate(bare, gain, searched, parts=(part,))

        def finish() -> tuple[EffectKind, Array | None]:
            covariance = marginal_covariance(noise, bare.columns(view), cycles.fit)
            done = bare.solved(view, candidate, cycles.fit.amplitude, covariance).finished()
            assert isinstance(done.effect, cls)
            sizes, by_noise = bare._sizes(noise, cycles.fit)
            uneven = float(np.sqrt(max(float(np.var(sizes)) - by_noise, 0.0)))
            return replace(done.effect, unevenness=uneven), done.signal

        return replace(candidate, finish=finish)

    def _rows(self, view: View) -> Array:
        """Return the rows at which cycles begin, not whole numbers."""
        return view.row_at(np.array(self.begins))

    def _cycle(self, view: View) -> NDArray[np.int64]:
        """Return the number of the cycle in which each of as many places is as `in_time` has."""
        places = SlowPlaces(view, view.grid.low + 1)
        return cycle_of(self._rows(view), places.at)

    def columns(self, view: View) -> Array:
        """Return the ordinates of the harmonics."""
        places = SlowPlaces.of(view, self.count)
        return places.harmonics(self._rows(view), len(self.waveform) // 2)

    def signal(self, view: View) -> Array:
        """Return the level."""
        phase = phase_of(self._rows(view), np.arange(view.grid.n, dtype=np.float64))
        return level_of(phase, np.array(self.waveform))

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the waveform that a regression found."""
        noise = float(np.trace(covariance)) / 2
        power = max(float(amplitude @ amplitude) / 2 - noise, 0.0)
        error = np.sqrt(amplitude @ covariance @ amplitude) / max(2 * power, 1e-300)
        level = level_of(np.arange(_WAVEFORM) / _WAVEFORM, amplitude)
        found = replace(
            self,
            sigma=Estimate.of_log(max(float(np.sqrt(power)), 1e-300), float(error), view.unit),
            peak_to_peak=float(np.ptp(level)),
            waveform=tuple(amplitude.tolist()),
        )
        return candidate.solved(found, partial(found.signal, view))

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where the cycles have one amplitude, and are not two or three in one.

        That of noise is another in each, and a band of noise is all that there is. What goes up and
        down once has most of its power at the frequency at which it does. Where all cycles may have
        one length they are lines.
        """
        powers = _powers(self.waveform)
        noise = view.with_parts(*candidate.parts)
        fit = joint_fit(noise, self.columns(view))
        sizes, by_noise = self._sizes(noise, fit)
        scatter = quartile_deviation(sizes)
        if powers[0] < _MAIN * powers.max() or scatter**2 - by_noise > _UNEVEN**2:
            return None
        steady = joint_fit(noise, self._steady().columns(view)).gain
        least = max(candidate.log_alternatives, self.price_of_instants + steady)
        return candidate if fit.gain > least else None

    def _steady(self) -> Self:
        """Return it with cycles of one length."""
        number = np.arange(len(self.begins))
        line = np.polyval(np.polyfit(number, self.begins, 1), number)
        return replace(self, begins=tuple(line.tolist()))

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Refuse what irregular cycles leave: pieces of a cycle, and power at their frequencies."""
        del view
        if other.effect.is_piecewise:
            is_piece = other.gain < _PIECE * known.gain / self.count
            return "a piece of a cycle" if is_piece else ""
        reach = _reach(other.effect)
        if reach is None or other.gain > _REMNANT * known.gain:
            return ""
        low, high = ((1 - _NEAR) * reach[0], (1 + _NEAR) * reach[1])
        return "left of the cycles" if any(low < f < high for f in self.wave_hz) else ""

    def _sizes(self, noise: View, fit: Regression) -> tuple[Array, float]:
        """Return the amplitude of every cycle over the usual one, and its variance by noise.

        `noise` has what is irregular as the last component: that does not count as noise.
        """
        columns, m = self.columns(noise), noise.grid.low
        spectrum, f = fit.spectrum, noise.grid.frequency[:m]
        level = np.array(self.waveform) @ columns
        highest = (len(self.waveform) // 2 + 1) / self.period.value
        inside = spectrum.kept[:m] & (f > BELOW / self.period.value) & (f < highest)
        data, signal = (in_time(x * inside) for x in (noise.ordinates[:m], level))
        cycle = self._cycle(noise)
        energy, right = (np.bincount(cycle, x * signal)[1:-1] for x in (signal, data))
        seen = energy > 0
        if not seen.any():  # all of its frequencies have been left out
            return np.array([0.0, 2.0]), 0.0
        sizes, usual = right[seen] / energy[seen], float(np.median(right[seen] / energy[seen]))
        quiet = spectrum.of(spectrum.model.components[:-1], f)
        power = float(np.average(quiet, weights=level**2) * np.median(1 / energy[seen]))
        return sizes / usual, power / usual**2

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the waveform by every second cycle; the instants have cost what they cost."""
        noise, columns = view.with_parts(*candidate.parts), self.columns(view)
        fit = joint_fit(noise, columns)
        held = interleaved(noise, fit, columns, recurs=True, block=self._cycle(view))
        nats = held.nats - self.price_of_instants
        return replace(held, nats=nats, design="every second cycle by the others")


def _irregular(frequency: float) -> Component:
    """Return what cycles leave of which each differs from the waveform, to be scaled."""
    return IrregularCycles(1.0, frequency, _WIDTH * frequency)


def _most(view: View, begins: Array) -> int:
    """Return the most harmonics that the slow ordinates hold."""
    return max(1, min(_MOST, view.grid.low // (2 * len(begins))))


def _harmonics(noise: View, begins: Array) -> int:
    """Return how many harmonics cycles need that begin then."""
    most = _most(noise, begins)
    columns = SlowPlaces.of(noise, len(begins) - 1).harmonics(begins, most)
    worth = [joint_fit(noise, columns[: 2 * h]).gain - _HARMONIC * h for h in range(1, most + 1)]
    return 1 + int(np.argmax(worth))


def _powers(waveform: Iterable[float]) -> Array:
    """Return the power of each harmonic, times two."""
    return np.asarray(np.sum(np.reshape(list(waveform), (-1, 2)) ** 2, axis=1))


def _divided(begins: Array, parts: int) -> Array:
    """Return so many cycles in the place of each: it had several in it."""
    cycle = np.arange(len(begins))
    return np.interp(np.arange(parts * (len(begins) - 1) + 1) / parts, cycle, begins)


def _reach(effect: EffectKind) -> tuple[float, float] | None:
    """Return between which frequencies in Hz a wave, a band or a range is; None for others."""
    if isinstance(effect, Unexplained):
        return effect.limits if effect.is_tone else None
    if isinstance(effect, Narrowband):
        centre, half = effect.frequency.value, effect.bandwidth.value / 2
        return centre - half, centre + half
    return (min(effect.wave_hz), max(effect.wave_hz)) if effect.wave_hz else None
