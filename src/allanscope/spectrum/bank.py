"""The streaming spectrum: constant memory, from the length of the run to the Nyquist frequency.

A part of one segment can be averaged by itself, elsewhere: a shard, which a bank then takes in as
if it had seen it. The low levels of the ladder look back less than a halo of `ALIGNED` samples;
what leaves them upwards, 1 / 256 of the samples, is kept and pushed up the bank's own high levels
in order. Frames and filters begin where one pass has them, because shards begin at multiples of
`ALIGNED` samples: the hop of the highest low level.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.samples import Block
from allanscope.spectrum.density import Density, Stretch, assemble
from allanscope.spectrum.ladder import FACTOR, SEGMENT, Ladder, narrow_columns

__all__ = ["ALIGNED", "SpectrumBank", "SpectrumShard"]

_FORMAT = "allanscope spectrum 1"
_SLICE = 6 << 16
"""Numbers taken at a time: so many that the calls between the loops do not count, so few that a
cache of two megabytes holds them."""
_READ_TO = 0.3
"""Part of its rate up to which a decimated level is read: flat and free of aliases."""
_FIRST_BIN = 3
"""Lowest bin that the window keeps clear of the mean and of slow drifts."""

_SHARD_LEVELS = 4
ALIGNED = SEGMENT * FACTOR ** (_SHARD_LEVELS - 1)
"""Samples of the halo, and twice the hop of the highest level that a shard works on."""
_ROWS_AT_ONCE = 1 << 13


class SpectrumBank:
    """Streaming one-sided power spectral density of several axes.

    Level 0 averages windowed segments of 2048 samples; level l does the same at 1 / 4^l of the
    rate and is read where level l - 1 is too coarse. A level comes into being when the first
    sample reaches it, so that the state grows with the logarithm of the run (about 25 KiB an axis
    and level).

    Parameters
    ----------
    rate : float
        Samples per second; only scales the result and can be replaced when it is read.
    axes : int
        Number of columns.
    anchor : array_like, shape (axes,), optional
        Subtracted from every sample; the first sample if not given. Banks that are to be joined
        share one.

    Examples
    --------
    White noise of variance 1 at 100 Hz has a one-sided density of 2 / 100:

    >>> bank = SpectrumBank(rate=100.0, axes=1)
    >>> bank.update(np.random.default_rng(1).standard_normal((100_000, 1)))
    >>> density = bank.density(0)
    >>> round(float(np.average(density.density, weights=density.averages)), 3)
    0.02
    """

    def __init__(self, rate: float, axes: int = 6, *, anchor: ArrayLike | None = None) -> None:
        if not (np.isfinite(rate) and rate > 0):
            raise ValueError(f"the rate must be a positive number of Hz, got {rate!r}")
        if axes < 1:
            raise ValueError(f"need at least one axis, got {axes}")
        self.rate = float(rate)
        self.axes = axes
        self.samples = 0
        self._anchor = None if anchor is None else np.array(anchor, np.float64)
        if self._anchor is not None and not (
            self._anchor.shape == (axes,) and np.isfinite(self._anchor).all()
        ):
            raise ValueError(f"{axes} axes need as many finite anchors, got {anchor!r}")
        self._ladder = Ladder(axes)

    def update(self, samples: Block | ArrayLike) -> None:
        """Take the next samples.

        Parameters
        ----------
        samples : Block or array_like, shape (n, axes)
            Counts, or values in any unit. Contiguous with what came before.
        """
        values = np.asarray(samples.counts if isinstance(samples, Block) else samples)
        if values.ndim == 1 and self.axes == 1:
            values = values[:, np.newaxis]
        if values.ndim != 2 or values.shape[1] != self.axes:
            raise ValueError(f"need samples of shape (n, {self.axes}), got {values.shape}")
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise ValueError("the samples contain values that are not finite; mark a gap instead")
        size = max(_SLICE // self.axes, SEGMENT)
        for first in range(0, len(values), size):
            part = values[first : first + size]
            if self._anchor is None:
                self._anchor = part[0].astype(np.float64)
            self._ladder.push(narrow_columns(part, self._anchor))
        self.samples += len(values)

    def gap(self) -> None:
        """Mark a gap: no segment spans it."""
        self._ladder.clear()

    def merge(self, other: SpectrumBank) -> None:
        """Add what another bank has averaged, as if it had followed after a gap."""
        if (other.axes, other.rate) != (self.axes, self.rate):
            raise ValueError(
                f"cannot merge {other.axes} axes at {other.rate:g} Hz into {self.axes} at "
                f"{self.rate:g} Hz"
            )
        self._ladder.merge(other._ladder)
        self.samples += other.samples

    def join(self, shard: SpectrumShard) -> None:
        """Go on with a shard of the open segment that was summed up elsewhere; as in one pass."""
        if self._anchor is None:
            self._anchor = shard.anchor.copy()
        self._ladder.join(shard.ladder, shard.above)
        self.samples += shard.samples

    def __add__(self, other: SpectrumBank) -> SpectrumBank:
        merged = SpectrumBank.from_state(self.state())
        merged.merge(other)
        return merged

    def density(
        self,
        axis: int,
        rate: float | None = None,
        scale: float = 1.0,
        *,
        per_decade: int | None = 60,
    ) -> Density:
        """Return the density of one axis.

        Parameters
        ----------
        axis : int
            Column.
        rate : float, optional
            True sample rate in Hz; that of the constructor when not given.
        scale : float
            Unit per count.
        per_decade : int or None
            Bands in a decade; None gives every bin, for the search for lines. Neighbouring bins
            are then correlated (4/9, because of the window), and `averages` is that of each alone.

        Returns
        -------
        Density
            Empty as long as there are fewer than 64 samples.
        """
        stretches = [
            Stretch(s.turns, s.width, s.power[axis], s.segments) for s in self._stretches()
        ]
        return assemble(stretches, rate or self.rate, scale, per_decade)

    def densities(
        self, rate: float | None = None, scale: ArrayLike = 1.0, *, per_decade: int | None = 60
    ) -> tuple[Density, ...]:
        """Return the densities of all axes; `scale` may differ from axis to axis."""
        scales = np.broadcast_to(np.asarray(scale, np.float64), (self.axes,))
        return tuple(
            self.density(axis, rate, float(factor), per_decade=per_decade)
            for axis, factor in enumerate(scales)
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything held, as plain arrays: for `numpy.savez`, or another process."""
        return {
            "format": np.array(_FORMAT),
            "rate": np.array(self.rate),
            "samples": np.array(self.samples),
            "axes": np.array(self.axes),
            "anchor": np.empty(0) if self._anchor is None else self._anchor.copy(),
            **self._ladder.arrays(),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, ArrayLike]) -> SpectrumBank:
        """Return the bank that `state` came from; it goes on to the same results.

        Raises
        ------
        ValueError
            For a state that is damaged, of another version, or no state of a spectrum.
        """
        if str(state.get("format", "")) != _FORMAT:
            raise ValueError(f"not the state of a spectrum: need {_FORMAT!r}")
        try:
            bank = cls(float(np.asarray(state["rate"])), int(np.asarray(state["axes"])))
            bank.samples = int(np.asarray(state["samples"]))
            anchor = np.array(state["anchor"], np.float64)
            bank._ladder.restore(state)
        except (KeyError, TypeError) as error:
            raise ValueError(f"state of a spectrum is damaged: {error}") from None
        if anchor.shape not in ((0,), (bank.axes,)):
            raise ValueError("state of a spectrum is damaged: the anchor has another size")
        bank._anchor = anchor if anchor.size else None
        return bank

    def _stretches(self) -> list[Stretch]:
        """Return what to read where, from the highest frequencies down; power is (axes, bins)."""
        levels = self._ladder.levels
        used = [depth for depth, level in enumerate(levels) if level.count]
        found: list[Stretch] = []
        for depth in used:
            level = levels[depth]
            mean = level.power / level.count
            floor = _READ_TO / FACTOR if depth + 1 in used else 0.0
            found.append(self._stretch(depth, SEGMENT, mean, float(level.count), floor))
        deepest = used[-1] if used else -1
        for depth in range(deepest + 1, len(levels)):
            single = levels[depth].unfinished()
            if single is None:
                break
            length = levels[depth].pending.shape[1]
            below = found[-1].turns[0] - found[-1].width / 2 if found else np.inf
            part = self._stretch(depth, length, single, 1.0, 0.0)
            keep = part.turns + part.width / 2 <= below
            if keep.any():
                found.append(Stretch(part.turns[keep], part.width, part.power[:, keep], 1.0))
        return found

    def _stretch(
        self, depth: int, length: int, power: NDArray[np.float64], segments: float, floor: float
    ) -> Stretch:
        """Cut the readable part out of one level."""
        bins = np.arange(power.shape[1])
        local, half = bins / length, 0.5 / length
        top = _READ_TO if depth else 0.5
        keep = (bins >= _FIRST_BIN) & (local - half >= floor) & (local + half <= top)
        turns = local[keep] / FACTOR**depth
        width = 1 / length / FACTOR**depth
        one_sided = 2 * power[:, keep] * FACTOR**depth
        return Stretch(turns, width, one_sided, segments)


class SpectrumShard:
    """Periodograms of the samples that follow a halo.

    Parameters
    ----------
    axes : int
        Number of columns.
    anchor : ndarray, shape (axes,)
        The bank's: the first sample of the run.
    halo : ndarray, shape (ALIGNED, axes), optional
        The last samples before the shard; none for a shard that begins its segment.

    Attributes
    ----------
    ladder : Ladder
        The low levels.
    samples : int
        Taken in, without the halo.
    """

    def __init__(
        self,
        axes: int,
        anchor: NDArray[np.float64],
        halo: NDArray[np.generic] | None = None,
    ) -> None:
        self.anchor = anchor
        self.samples = 0
        self.ladder = Ladder(axes)
        self.ladder.grow(_SHARD_LEVELS)
        self._above: list[NDArray[np.float32]] = []
        if halo is not None:
            self._push(halo)
            for level in self.ladder.levels:
                level.power[:] = 0.0
                level.count = 0
        self._above = [np.empty((axes, 0), np.float32)]

    @property
    def above(self) -> NDArray[np.float32]:
        """What goes to the level above, shape (axes, n)."""
        return np.concatenate(self._above, axis=1)

    def extend(self, samples: NDArray[np.generic]) -> None:
        """Take in the next samples, shape (n, axes)."""
        self._push(samples)
        self.samples += len(samples)

    def _push(self, samples: NDArray[np.generic]) -> None:
        for first in range(0, len(samples), _ROWS_AT_ONCE):
            part = narrow_columns(samples[first : first + _ROWS_AT_ONCE], self.anchor)
            for level, decimator in zip(self.ladder.levels, self.ladder.decimators, strict=True):
                level.push(part)
                part = decimator.push(part)
            self._above.append(part)
