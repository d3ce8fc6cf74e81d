"""AllanBank: every deviation of a stream at any moment, in a fixed small memory.

Samples go to two places. The cascade keeps sums of squared differences for all that can be
streamed: STDEV OSTDEV ADEV OADEV MDEV TDEV HDEV OHDEV TOTDEV PDEV. The archive keeps the run in at
most 8192 rows for the rest: MTOT TTOT HTOT THEO1 TheoBR TheoH, which are evaluated when asked, and
for the longest tau of the others, where it has more terms (`long_taus`)::

    update ──┬─▶ cascade   sums per tau ───────┐
             └─▶ archive   rows of block sums ─┴─▶ deviation(kind)

Both work on samples less an anchor, the first sample of each axis, which no estimator can see.

A bank is plain arrays as well, which a checkpoint or another process needs to go on from there. One
of them, ``header``, is JSON in UTF-8: format, version, and type, shape and checksum of each of the
others. No pickle; nothing in a state is ever executed.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.archive import Archive
from allanscope.allan.cascade import Cascade
from allanscope.allan.confidence import BiasCorrection, HadamardFactor, assemble
from allanscope.allan.curves import Curves, samples_to_value
from allanscope.allan.deviation import Deviation
from allanscope.allan.dynamic import SLOTS, DynamicDeviation, WindowBorders
from allanscope.allan.estimators import Sums, estimator_named
from allanscope.allan.kernels import rows_of
from allanscope.allan.noise_type import NoiseTypes, alpha_named, one_noise
from allanscope.allan.phase import LARGEST, checked_samples, positive_rate
from allanscope.allan.shard import BLOCK, Shard
from allanscope.samples import Block

__all__ = ["AllanBank", "pack_state"]

_SLICE = 1 << 15
"""Samples converted to float64 at a time: so many that the calls between the loops do not count,
so few that a cache of two megabytes holds them."""
_ALIGNED = 1 << 11
"""Samples of a segment between the places where the loops can begin a stretch of whole numbers
(`compiled/stretch.c`): slices end there."""
_FORMAT = "allanscope bank"
_VERSION = 2


class AllanBank:
    """All Allan-family deviations of several axes, updated sample by sample.

    Time per sample and memory do not depend on the length of the run. How the samples are cut into
    blocks does not change a bit of the result.

    Parameters
    ----------
    rate : float
        Sample rate in Hz; the nominal one, as long as none was measured (see `deviation`).
    axes : int
        Number of columns of the samples.
    per_octave : int
        Averaging times in each octave.
    scale : array_like, shape (axes,), optional
        Physical unit per count; deviations are then in that unit instead of counts.
    anchor : array_like, shape (axes,), optional
        Subtracted from every sample; the first sample if not given. Banks that are to be joined
        share one.
    window : float, optional
        Keep what `dynamic` needs, for windows of so many seconds at the rate given; 0 has them grow
        with the run.

    Attributes
    ----------
    rate : float
        May be set anew at any time: it enters at `deviation` only.
    samples : int
        Samples taken in so far, on each axis.

    Raises
    ------
    ValueError
        For a rate that is not positive, no axis, or a scale or anchor of another shape.

    Notes
    -----
    Terms are exact (full overlap, as in allantools) for m < 64 and in runs of up to 8192 samples.
    In longer ones they start at every 2^L-th sample for 32 * 2^L <= m < 64 * 2^L, beyond a 128th of
    the run at every 4096th to 8192nd part of it. The modified totals and the Theo family are exact
    up to 4096 samples; see `allanscope.allan.curves` for what comes after.

    Samples of float64 are summed in doubles: their relative error is about 1e-16 times
    (distance from the anchor / deviation). Integer samples have none below 2^53, wherever the
    first one lies: the mean is taken off as the run goes on, and put back where it counts.

    Examples
    --------
    >>> bank = AllanBank(rate=10.0, axes=1, per_octave=1)
    >>> bank.update(np.array([1, 2, 4, 3], np.int16))
    >>> oadev = bank.deviation("oadev")
    >>> oadev.tau.tolist(), oadev.deviation.tolist(), oadev.terms.tolist()
    ([0.1, 0.2], [[1.0, nan]], [[3, 1]])

    One term is no estimate; after one more sample there are two. Four samples later:

    >>> bank.wait("oadev", tau=0.2)
    0.1
    >>> bank.update(np.array([3, 1, 1, 2], np.int16))
    >>> bank.deviation("oadev").deviation.round(3).tolist()
    [[0.886, 1.025, nan]]
    """

    def __init__(
        self,
        rate: float,
        axes: int = 6,
        per_octave: int = 4,
        scale: ArrayLike | None = None,
        *,
        anchor: ArrayLike | None = None,
        window: float | None = None,
    ) -> None:
        if not (_is_count(axes) and _is_count(per_octave)):
            raise ValueError(
                f"need whole axes >= 1 and per_octave >= 1, got {axes!r} and {per_octave!r}"
            )
        self.rate = positive_rate(rate)
        self.axes = axes
        self.per_octave = per_octave
        self.scale = np.ones(axes) if scale is None else np.array(scale, np.float64)
        if self.scale.shape != (axes,) or not np.isfinite(self.scale).all():
            raise ValueError(f"{axes} axes need as many finite scales, got {self.scale}")
        self._anchor = None if anchor is None else np.array(anchor, np.float64)
        if self._anchor is not None and not (
            self._anchor.shape == (axes,) and (np.abs(self._anchor) < LARGEST).all()
        ):
            raise ValueError(f"{axes} axes need as many finite anchors, got {anchor!r}")
        if window is not None and not (np.isfinite(window) and window >= 0.0):
            raise ValueError(
                f"a window has a length in s, or 0 to grow with the run; got {window!r}"
            )
        self._cascade = Cascade(axes, per_octave, 0 if window is None else SLOTS)
        self._borders = None if window is None else WindowBorders(axes, self.rate, window)
        self._archive = Archive(axes)
        self._curves: Curves | None = None

    @property
    def samples(self) -> int:
        """Samples taken in so far, on each axis."""
        return self._cascade.samples

    @property
    def nbytes(self) -> int:
        """Bytes held, all axes together."""
        windows = self._cascade.marked.nbytes + (self._borders.nbytes if self._borders else 0)
        return windows + sum(array.nbytes for array in self._arrays().values())

    @property
    def keeps_windows(self) -> bool:
        """Whether there is a `dynamic`."""
        return self._borders is not None

    def update(self, samples: Block | ArrayLike) -> None:
        """Take in the next samples, neighbours of the last ones.

        Parameters
        ----------
        samples : Block or array_like, shape (n, axes), or (n,) for one axis
            Integers up to 2^53 or floats of at most 64 bits.

        Raises
        ------
        ValueError
            For another shape or type, or a sample that is not finite, beyond 1e100, or an integer
            beyond 2^53. Nothing is taken in then.
        """
        values = samples.counts if isinstance(samples, Block) else samples
        data = checked_samples(values, self.axes, self.samples)
        if len(data) == 0:
            return
        if self._anchor is None:
            self._anchor = data[0].astype(np.float64)
        self._curves = None
        borders, start = self._borders, 0
        while start < len(data):
            size = _SLICE if borders is None else min(_SLICE, borders.most_samples)
            beyond = (self._cascade.taken + size) % _ALIGNED
            size -= beyond if beyond < size else 0
            piece = rows_of(data[start : start + size])
            if borders is not None:
                self._cascade.make_room(len(piece))
                borders.plan(self._cascade, len(piece))
            self._cascade.extend(piece, self._anchor)
            self._archive.extend(piece, self._anchor)
            if borders is not None:
                borders.collect_when_due(self._cascade)
            start += size

    def gap(self, lost: int = 0) -> None:
        """Begin a new segment: no term joins what came before to what comes after.

        Parameters
        ----------
        lost : int
            Samples that are missing, for the times of `dynamic`.
        """
        self._curves = None
        self._cascade.close()
        self._archive.gap()
        if self._borders is not None:
            self._borders.close(self._cascade)
            self._borders.lose(lost)

    def deviation(
        self,
        kind: str,
        level: float = 0.95,
        rate: float | None = None,
        *,
        bias_corrected: BiasCorrection = True,
        hadamard_factor: HadamardFactor = "sp1065",
        noise: str | None = None,
    ) -> Deviation:
        """Return a deviation curve of everything so far.

        Parameters
        ----------
        kind : str
            One of stdev ostdev adev oadev mdev tdev hdev ohdev totdev mtotdev ttotdev htotdev
            theo1 theobr theoh pdev.
        level : float
            Two-sided confidence of the limits.
        rate : float, optional
            Measured sample rate in Hz instead of the bank's.
        bias_corrected, hadamard_factor
            As in `allanscope.allan.confidence.assemble`.
        noise : str, optional
            Power law to take at every tau, ``WPM`` to ``RRFM``, instead of finding it out.

        Returns
        -------
        Deviation
            Arrays of shape (axes, k), at the taus that have at least one term.

        Raises
        ------
        ValueError
            For an unknown kind, a rate that is not positive, or a level outside (0, 1).
        """
        rate = positive_rate(self.rate if rate is None else rate)
        if noise is not None:
            alpha_named(noise)
        if not 0.0 < level < 1.0:
            raise ValueError(f"level must lie between 0 and 1, got {level!r}")
        curves = self._settled_curves()
        sums = curves.sums(kind)
        if sums.m.size == 0:
            return _empty(kind, sums, level)
        in_units = replace(sums, variance=sums.variance * self.scale[:, np.newaxis] ** 2)
        return assemble(
            kind,
            in_units,
            rate,
            level,
            curves.noise_types(kind, sums) if noise is None else one_noise(noise),
            bias_corrected=bias_corrected,
            hadamard_factor=hadamard_factor,
        )

    def dynamic(self, rate: float | None = None) -> DynamicDeviation:
        """Return the Allan deviation (``oadev``) of each window of the run so far.

        Parameters
        ----------
        rate : float, optional
            Measured sample rate in Hz instead of the bank's.

        Returns
        -------
        DynamicDeviation
            Each value has the terms of a cascade that took the samples of the window alone: beyond
            m = 64 fewer than `deviation` has. No windows while the run is shorter than one.

        Raises
        ------
        ValueError
            For a bank without windows: one made without `window`, or that has taken in sums of
            another.

        Examples
        --------
        Noise that grows threefold in the middle of the run:

        >>> rng = np.random.default_rng(1)
        >>> bank = AllanBank(rate=100.0, axes=1, window=60.0)
        >>> bank.update(rng.normal(0.0, np.repeat([1.0, 3.0], 60_000)))
        >>> curves = bank.dynamic()
        >>> at = curves.tau.searchsorted(0.1)
        >>> curves.deviation[0, [0, -1], at].round(1).tolist()
        [0.3, 0.9]
        """
        rate = positive_rate(self.rate if rate is None else rate)
        if self._borders is None:
            raise ValueError("this bank keeps no windows; give it one: AllanBank(..., window=60.0)")
        settled, borders = self._cascade.settled(), self._borders.copy()
        borders.collect(settled)
        return borders.deviation(settled, self.scale, rate)

    def noise_types(self, tau: ArrayLike) -> NoiseTypes:
        """Return the noise at averaging times in samples; white FM with too little data to tell."""
        known = self._settled_curves().noise_at(tau)
        return known or NoiseTypes(np.zeros((self.axes, np.size(tau)), np.int64))

    def wait(self, kind: str, tau: float, rate: float | None = None) -> float:
        """Return how much longer to run, without a gap, until there is a value at a tau.

        Parameters
        ----------
        kind : str
            As in `deviation`.
        tau : float
            Averaging time in s; the one of the bank that is nearest to it is meant.
        rate : float, optional
            Measured sample rate in Hz instead of the bank's.

        Returns
        -------
        float
            In s; 0 exactly when `deviation` has a value there on every axis. Infinite where no
            run of any length has one: at a tau shorter than those that the bank keeps for so long
            a run, or for a record of one level that has no ratio.

        Raises
        ------
        ValueError
            For an unknown kind, or a rate or tau that is not positive.
        """
        rate = positive_rate(self.rate if rate is None else rate)
        estimator_named(kind)
        if not (np.ndim(tau) == 0 and np.isfinite(tau) and tau > 0):
            raise ValueError(f"tau must be positive and finite, got {tau!r} s")
        return (
            samples_to_value(kind, tau * rate, self._settled_curves(), self._cascade, self._archive)
            / rate
        )

    def merge(self, other: AllanBank) -> None:
        """Add another bank's run behind a gap: as if its samples had come here.

        Raises
        ------
        ValueError
            When axes, averaging times, scales or rates differ.
        """
        same = (self.axes, self.per_octave, self.scale.tolist(), self.rate)
        theirs = (other.axes, other.per_octave, other.scale.tolist(), other.rate)
        if same != theirs:
            raise ValueError(
                "banks differ in axes, per_octave, scale or rate and cannot be merged: "
                f"{same} and {theirs}"
            )
        if other._anchor is None:
            return
        if self._anchor is None:
            self._anchor = other._anchor.copy()
        self.gap()
        self._borders = None  # their sums belong to one run
        self._cascade.merge(other._cascade.settled(), other._anchor - self._anchor)
        self._archive.merge(other._archive)

    def join(self, shard: Shard) -> None:
        """Go on with a shard of the open segment that was summed up elsewhere.

        Counts are those of one pass, sums are those of one pass to rounding; so are the modified
        totals and the Theo family where the whole run is long enough for rows of the archive no
        shorter than a block, 8192 x 512 samples. A shorter run would lose the finer rows.

        Raises
        ------
        ValueError
            When the shard is of another run, or does not begin where the open segment ends.
        """
        if (self.axes, self.per_octave) != (
            shard.cascade.axes,
            shard.cascade.per_octave,
        ) or (self._anchor is not None and np.any(self._anchor != shard.anchor)):
            raise ValueError("the shard has other axes, another anchor or other averaging times")
        self._anchor = shard.anchor.copy()
        self._curves = self._borders = None
        block_sums = shard.block_sums
        self._cascade.join(shard.cascade, block_sums, shard.start)
        self._archive.join(block_sums, BLOCK)

    def __add__(self, other: AllanBank) -> AllanBank:
        merged = AllanBank.from_state(self.state())
        merged.merge(other)
        return merged

    def state(self) -> dict[str, NDArray[Any]]:
        """Return everything held, as plain arrays: for `numpy.savez`, or another process."""
        return pack_state(self._arrays())

    @classmethod
    def from_state(cls, state: Mapping[str, ArrayLike]) -> AllanBank:
        """Return the bank that `state` came from; it goes on to the same results, to the last bit.

        Raises
        ------
        ValueError
            For a state that is damaged, of another version, or no state of a bank.
        """
        blank = cls(1.0, axes=1)
        arrays = _unpacked(state, like=blank._arrays())
        scale, anchor = arrays["scale"], arrays["anchor"]
        if anchor.size not in (0, scale.size):
            raise ValueError("state of a bank is damaged: scale and anchor are inconsistent")
        bank = cls(float(arrays["rate"]), scale.size, int(arrays["per_octave"]), scale)
        bank._anchor = anchor if anchor.size else None
        bank._cascade.restore(arrays)
        bank._archive.restore(arrays)
        return bank

    def _settled_curves(self) -> Curves:
        if self._curves is None:
            self._curves = Curves(self._cascade.settled(), self._archive)
        return self._curves

    def _arrays(self) -> dict[str, NDArray[Any]]:
        return {
            "rate": np.array(self.rate),
            "per_octave": np.array(self.per_octave),
            "scale": self.scale,
            "anchor": np.empty(0) if self._anchor is None else self._anchor,
            **self._cascade.arrays(),
            **self._archive.arrays(),
        }


def _is_count(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        return False
    return int(value) >= 1


def _empty(kind: str, sums: Sums, level: float) -> Deviation:
    """Return the curve of a run that is too short for any tau."""
    nothing = sums.variance
    return Deviation(
        kind=kind,
        tau=np.empty(0),
        m=sums.m,
        deviation=nothing,
        lower=nothing,
        upper=nothing,
        edf=nothing,
        terms=sums.terms,
        noise=nothing.astype(np.str_),
        level=level,
        trusted=np.empty(0, np.bool_),
    )


def pack_state(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays and a header that describes them."""
    held = {name: np.array(array, order="C") for name, array in arrays.items()}
    header = {
        "format": _FORMAT,
        "version": _VERSION,
        "arrays": {name: _description(array) for name, array in held.items()},
    }
    return {"header": np.frombuffer(json.dumps(header).encode(), np.uint8).copy(), **held}


def _unpacked(
    state: Mapping[str, ArrayLike], like: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays of a state.

    Parameters
    ----------
    state : mapping
        What `pack_state` returned.
    like : mapping
        Arrays of a new bank: their names, types and numbers of dimensions are required.

    Raises
    ------
    ValueError
        Where the header is not one of ours or an array is missing or not what the header says.
    """
    try:
        header = json.loads(np.asarray(state["header"], np.uint8).tobytes())
        found = header["format"], header["version"]
        described = dict(header["arrays"])
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"not the state of a bank: its header cannot be read: {error!r}") from None
    if found != (_FORMAT, _VERSION):
        raise ValueError(f"state is {found[0]!r} version {found[1]!r}; need {_FORMAT!r} {_VERSION}")
    arrays = {}
    for name, model in like.items():
        array = np.array(state.get(name, ()), order="C")
        sound = _description(array) == described.get(name)
        if not sound or array.dtype != model.dtype or array.ndim != model.ndim:
            raise ValueError(f"state of a bank is damaged: {name!r} has the wrong type or shape")
        arrays[name] = array
    return arrays


def _description(array: NDArray[Any]) -> dict[str, Any]:
    return {
        "type": array.dtype.str,
        "shape": list(array.shape),
        "crc32": zlib.crc32(array.tobytes()),
    }
