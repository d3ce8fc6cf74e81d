r"""When the cycles begin of a level that repeats one waveform, each with a length of its own.

A thermostat switches when it is warm or cold enough, not by the clock. So the level is a function
of a phase, a sum of harmonics c_h, and the phase goes on by one from the instant t_k at which a
cycle begins to the next,

.. math:: x(t) = \sum_{h=1}^{H} \mathrm{Re}\, c_h e^{2 \pi i h \varphi(t)}, \qquad
          \varphi(t) = k + \frac{t - t_k}{t_{k+1} - t_k}

Where the instants are known, the waveform is found by least squares (the time synchronous average
of rotating machines; Braun, Acustica 32, 1975). Where it is known, the record is cut into cycles by
dynamic programming: of all ways, each as likely a priori as the lengths scatter, that in which the
whitened rows are likeliest. The two are done in turn, from a cosine on (`first_begins`). Then the
instants are moved off the rows by the method of Gauss and Newton, the noise fitted again with each
step (`settled`).

So many instants fit noise too. Their price is that of Laplace: how much less likely the likeliest
are a priori than all that the data allow together,

.. math:: \tfrac12 \ln \frac{\det (\Lambda + F)}{\det \Lambda}
          + \tfrac12 \sum_k \frac{(\ln d_k - \overline{\ln d})^2}{s^2}

with the information F that the data hold on the instants, whatever the waveform is, and Lambda,
that of lengths d_k whose logarithms scatter by s, about their mean or that of the cycle before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from allanscope.explain.regression import Regression, joint_fit
from allanscope.explain.series import in_time
from allanscope.explain.view import View

__all__ = [
    "BELOW",
    "Cycles",
    "SlowPlaces",
    "cycle_of",
    "first_begins",
    "level_of",
    "phase_of",
    "settled",
    "slow_excess",
]

Array = NDArray[np.float64]

_FEWEST, _PLACES = 6, 20
"""Cycles in a record, and places for each ordinate below the frequency of the cycles: forty to a
cycle, where the record has so many slow ordinates."""
_FEWEST_PLACES = 12
"""The same where it has few."""
_SHORTEST_S = 20.0
"""Shortest period: what is faster is no matter of heat."""
_BAND, _NEXT = 0.15, 1.04
"""Half the width, over the frequency, of a band that is looked at, and the ratio of the next."""
_LOUDEST, _CLEAR = 50.0, 6.0
"""Power over the noise up to which an ordinate counts, and standard errors from which a band has
more power than noise."""
BELOW = 0.4
"""Part of the frequency of the cycles below which the level is something else."""
_SHORTEST, _LONGEST = 0.5, 1.9
"""Length of a cycle over the usual one."""
_STEADIEST, _FREEST, _FIRST = 0.05, 0.3, 0.2
"""Scatter of the logarithm of lengths, at the least, at the most, and at first."""
_TURNS = ((1, 3), (2, 2), (4, 2), (6, 2))
"""Harmonics, and turns of instants and waveform with so many."""
_STEPS, _LEAP, _SETTLED = 12, 0.25, 0.3
"""Most steps of Gauss and Newton, how far in cycles an instant moves in one, and the gain in nats
below which the last is done."""


@dataclass(frozen=True, eq=False)
class Cycles:
    """Instants, and what they cost.

    Attributes
    ----------
    begins : ndarray, shape (k + 1,)
        Row at which each of k cycles begins, the last one's end among them; not whole numbers. The
        first is before the record, or with it, and the last after it.
    errors : ndarray, shape (k + 1,)
        Standard errors of them in rows.
    price : float
        Of the instants, in nats.
    fit : Regression
        Of the harmonics beside the noise.
    """

    begins: Array
    errors: Array
    price: float
    fit: Regression


def slow_excess(view: View) -> float | None:
    """Return the frequency in Hz around which there is most slow power beyond the noise, or None.

    The lowest ordinates hold any drift; cycles have power at a frequency of their own.
    """
    m = view.grid.low
    powers = np.minimum(view.squares[:m] / view.spectrum.ordinates[:m], _LOUDEST)
    total = np.concatenate([[0.0], np.cumsum((powers - 1) * view.spectrum.kept[:m])])
    first = 2.0 * _FEWEST
    last = min(m / _FEWEST_PLACES, 2 * view.series.duration_s / _SHORTEST_S)
    if last <= first:
        return None
    centre = first * _NEXT ** np.arange(1 + int(np.log(last / first) / np.log(_NEXT)))
    low, high = ((centre * (1 + side * _BAND)).astype(np.int64) for side in (-1, 1))
    score = (total[high] - total[low]) / np.sqrt(2.0 * (high - low))
    best = int(np.argmax(score))
    unit = view.grid.rate_hz / (2 * view.grid.n)
    return float(centre[best]) * unit if score[best] > _CLEAR else None


def phase_of(begins: Array, at: Array) -> Array:
    """Return the phase of cycles, in cycles, at some rows.

    Before the first and after the last it goes on as it does in that.

    Examples
    --------
    >>> phase_of(np.array([0.0, 10.0, 30.0]), np.array([-5.0, 5.0, 20.0, 40.0])).tolist()
    [-0.5, 0.5, 1.5, 2.5]
    """
    cycle = cycle_of(begins, at)
    return np.asarray(cycle + (at - begins[cycle]) / np.diff(begins)[cycle])


def cycle_of(begins: Array, at: Array) -> NDArray[np.int64]:
    """Return the number of the cycle in which rows are, or to which they are nearest."""
    return np.clip(np.searchsorted(begins, at, side="right") - 1, 0, len(begins) - 2)


def level_of(phase: Array, waveform: Array) -> Array:
    """Return the level at phases in cycles, of cosine and sine of each harmonic."""
    turn = np.exp(2j * np.pi * phase)
    level = np.zeros_like(turn)
    for cosine, sine in waveform.reshape(-1, 2)[::-1]:
        level = (level + (cosine - 1j * sine)) * turn
    return np.asarray(level.real)


def _waves(phase: Array, count: int) -> Array:
    """Return cosine and sine of a phase in cycles and of its multiples, shape (2 count, n)."""
    turn = np.exp(2j * np.pi * phase)
    waves, power = np.empty((2 * count, len(phase))), np.ones_like(turn)
    for h in range(count):
        power = power * turn
        waves[2 * h], waves[2 * h + 1] = power.real, power.imag
    return waves


@dataclass(frozen=True, eq=False)
class SlowPlaces:
    """The slow ordinates of a record as so many places in time, evenly apart.

    Attributes
    ----------
    view : View
    count : int
        Places.
    """

    view: View
    count: int

    @classmethod
    def of(cls, view: View, cycles: float) -> Self:
        """Return those for so many cycles."""
        return cls(view, int(min(view.grid.low + 1, 2 * _PLACES * cycles)))

    @property
    def rows(self) -> float:
        """Rows from one place to the next."""
        return self.view.grid.n / self.count

    @property
    def at(self) -> Array:
        """The row in the middle of each, shape (count,)."""
        return np.asarray((np.arange(self.count) + 0.5) * self.rows - 0.5, np.float64)

    def ordinates(self, signals: Array) -> Array:
        """Return the ordinates of signals given at the places, shape (p, count - 1)."""
        found = dct(signals, norm="ortho", axis=-1)[..., 1:]
        return np.asarray(found * np.sqrt(self.rows))

    def harmonics(self, begins: Array, count: int) -> Array:
        """Return the ordinates of the harmonics of cycles, those beyond the places too, 0."""
        columns = np.zeros((2 * count, self.view.grid.low))
        waves = _waves(phase_of(begins, self.at), count)
        columns[:, : self.count - 1] = self.ordinates(waves)
        return columns

    def weights(self, fit: Regression | None = None) -> Array:
        """Return 1 over the deviation of each ordinate, and 0 where it is left out."""
        spectrum = self.view.spectrum if fit is None else fit.spectrum
        m = self.count - 1
        return np.asarray(spectrum.kept[:m] / np.sqrt(spectrum.ordinates[:m]))


def first_begins(view: View, frequency: float) -> Array | None:
    """Return about when cycles of about a frequency begin; None where there are too few of them.

    Returns
    -------
    ndarray, shape (k + 1,)
        In rows.
    """
    cycles = frequency * view.series.duration_s
    places = SlowPlaces.of(view, cycles)
    if not _FEWEST <= cycles <= places.count / _FEWEST_PLACES:
        return None
    weight = places.weights()
    weight[: int(2 * BELOW * cycles)] = 0.0
    white = view.ordinates[: places.count - 1] * weight
    rows, length = in_time(white), places.count / cycles
    near = slice(int(2 * (1 - 2 * _BAND) * cycles), int(2 * (1 + 2 * _BAND) * cycles))
    waveform, scatter = np.array([np.sqrt(2 * np.mean(white[near] ** 2)), 0.0]), _FIRST
    for harmonics, turns in _TURNS:
        for _ in range(turns):
            begins = _cut(rows, length, scatter, waveform)
            if len(begins) <= _FEWEST:
                return None
            logs = np.log(np.diff(begins)[1:-1])
            length = float(np.exp(logs.mean()))
            scatter = float(np.clip(logs.std(), _STEADIEST, _FREEST))
            phase = phase_of(begins, np.arange(places.count, dtype=np.float64) + 0.5)
            waves = _waves(phase, harmonics)
            waveform = np.linalg.lstsq(waves.T, rows, rcond=None)[0]
    return begins * places.rows - 0.5


def _cut(rows: Array, length: float, scatter: float, waveform: Array) -> Array:
    """Return the ends of the likeliest cycles, in places: the first before the record.

    Parameters
    ----------
    rows : ndarray, shape (n,)
        The level, of unit variance beside the cycles.
    length, scatter : float
        Usual length, and the standard deviation of its logarithm.
    waveform : ndarray, shape (2 h,)
        Cosines and sines of a cycle.
    """
    n, lengths = len(rows), np.arange(max(4, int(_SHORTEST * length)), int(_LONGEST * length) + 1)
    # The cycles at both ends of the record are there in part: beyond them nothing is measured.
    beyond = int(lengths[-1])
    padded, seen = (np.pad(values, beyond) for values in (rows, np.ones(n)))
    cost = np.full((len(padded), len(lengths)), np.inf)
    for i, size in enumerate(lengths.tolist()):
        shape = level_of((np.arange(size) + 0.5) / size, waveform)
        misfit = np.correlate(seen, shape**2, "valid") / 2 - np.correlate(padded, shape, "valid")
        unlikely = (np.log(size / length) / scatter) ** 2 / 2 + np.log(size)
        cost[: len(misfit), i] = misfit + unlikely
    least, last = np.zeros(len(padded) + 1), np.zeros(len(padded) + 1, np.int64)
    at = np.arange(len(lengths))
    for end in range(beyond + 1, len(padded) + 1):
        begin = end - lengths
        total = least[begin] + cost[begin, at]
        best = int(np.argmin(total))
        least[end], last[end] = total[best], lengths[best]
    ends = [beyond + n + int(np.argmin(least[beyond + n :]))]
    while ends[-1] > beyond:
        ends.append(ends[-1] - int(last[ends[-1]]))
    return np.array(ends[::-1], np.float64) - beyond


def settled(view: View, begins: Array, harmonics: int) -> Cycles | None:
    """Return the likeliest cycles, with noise and waveform; None where they run together.

    Parameters
    ----------
    begins : ndarray, shape (k + 1,)
        About when each begins, in rows.
    harmonics : int
        Of the waveform.
    """
    places = SlowPlaces.of(view, len(begins) - 1)

    def fitted(begins: Array) -> Regression:
        return joint_fit(view, places.harmonics(begins, harmonics))

    fit = fitted(begins)
    part = 1.0
    for _ in range(_STEPS):
        again = begins + part * _step(places, begins, fit).moved
        if np.any(np.diff(again) < _SHORTEST / 2 * np.diff(begins).mean()):
            return None
        new = fitted(again)
        gained = new.gain - fit.gain
        if gained > 0:
            whole = _covering(again, view.grid.n)
            fit = new if whole is again else fitted(whole)
            begins, part = whole, min(1.0, 2 * part)
        else:
            part /= 2
        if abs(gained) < _SETTLED:
            break
    if len(begins) <= _FEWEST:
        return None
    last = _step(places, begins, fit)
    return Cycles(begins, last.errors, last.price, fit)


def _covering(begins: Array, rows: int) -> Array:
    """Return cycles of which the first and the last are in the record in part, and none beyond.

    Where an end of them has come into the record, another as long as they are on average follows.
    """
    length = float(np.diff(begins).mean())
    first = max(0, int(np.searchsorted(begins, 0.0, side="right")) - 1)
    stop = int(np.searchsorted(begins, rows - 1.0)) + 1
    before = [begins[0] - length] if begins[0] > 0.0 else []
    after = [begins[-1] + length] if begins[-1] < rows - 1.0 else []
    if not before and not after and stop - first == len(begins):
        return begins
    return np.concatenate([before, begins[first:stop], after])


@dataclass(frozen=True, eq=False)
class _Step:
    """By how many rows instants are to be moved, how well they are known, and what they cost."""

    moved: Array
    errors: Array
    price: float


def _step(places: SlowPlaces, begins: Array, fit: Regression) -> _Step:
    """Return one step of Gauss and Newton."""
    weight, m = places.weights(fit), places.count - 1
    waves = _waves(phase_of(begins, places.at), len(fit.amplitude) // 2)
    lengths, waveform = np.diff(begins), places.ordinates(waves) * weight
    left = places.view.ordinates[:m] * weight - fit.amplitude @ waveform
    changes = places.ordinates(_changes(places.at, begins, waves, fit.amplitude)) * weight
    # Whatever the instants change that the waveform can change as well is not known of them.
    free = (
        changes
        - (changes @ waveform.T) @ np.linalg.pinv(waveform @ waveform.T, hermitian=True) @ waveform
    )
    unusual, apart = _unusual(lengths)
    known = apart.T @ apart
    known[0, 0] += 1 / float(lengths.mean()) ** 2  # the first begins somewhere in its cycle
    information = known + free @ free.T
    moved = np.linalg.solve(information, free @ left - apart.T @ unusual)
    reach = _LEAP * float(lengths.mean())
    occam = np.linalg.slogdet(information)[1] - np.linalg.slogdet(known)[1]
    return _Step(
        np.clip(moved, -reach, reach),
        np.sqrt(np.diag(np.linalg.inv(information))),
        float(occam + unusual @ unusual) / 2,
    )


def _unusual(lengths: Array) -> tuple[Array, Array]:
    """Return by how many deviations lengths are unusual, and what an instant changes of that.

    Compared with the mean of all, or with the one before, where these are more alike: by day an air
    conditioner runs for longer.

    Returns
    -------
    unusual : ndarray, shape (k,)
    apart : ndarray, shape (k, k + 1)
        Of an instant that is moved by a row.
    """
    logs, at = np.log(lengths), np.arange(len(lengths))
    apart = np.zeros((len(lengths), len(lengths) + 1))
    apart[at, at], apart[at, at + 1] = -1 / lengths, 1 / lengths
    # The first and the last are there in part: how long they are is hardly known.
    scatter = float(np.clip(logs[1:-1].std(), _STEADIEST, _FREEST))
    change = float(np.clip(np.diff(logs[1:-1]).std(), _STEADIEST, _FREEST))
    unusual = (logs - logs.mean()) / scatter
    if change < scatter:
        unusual[1:] = np.diff(logs) / change
        apart[0], apart[1:] = apart[0] / scatter, np.diff(apart, axis=0) / change
    else:
        apart /= scatter
    return unusual, apart


def _changes(at: Array, begins: Array, waves: Array, waveform: Array) -> Array:
    """Return what the level changes by as each instant is moved by a row, shape (k + 1, places)."""
    order = np.repeat(np.arange(1, len(waveform) // 2 + 1), 2)
    turned = np.empty_like(waves)
    turned[0::2], turned[1::2] = -waves[1::2], waves[0::2]
    slope = 2 * np.pi * (order * waveform) @ turned
    cycle = cycle_of(begins, at)
    length = np.diff(begins)[cycle]
    gone = (at - begins[cycle]) / length
    changes, place = np.zeros((len(begins), len(at))), np.arange(len(at))
    changes[cycle, place] = -slope * (1 - gone) / length
    changes[cycle + 1, place] = -slope * gone / length
    return changes
