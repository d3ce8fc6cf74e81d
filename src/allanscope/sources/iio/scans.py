"""Scans of a buffer of IIO: rows of the elements that are switched on, aligned as the kernel does.

An element has the place that is the next multiple of its own size, and a scan the size that is
the next multiple of its largest element's: three 16-bit axes and a 64-bit time are 6 bytes, 2 of
padding, and 8. Scans have no number: their times tell which ones are missing, and which of two
devices, gyroscope and accelerometer of one part, were taken together.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import PARTS, full_scale_of
from allanscope.quantities import GRAVITY

__all__ = [
    "AXIS_NAMES",
    "TIME",
    "Numbering",
    "ScanElement",
    "ScanLayout",
    "pair",
    "period_of",
    "scale_of",
]

AXIS_NAMES = {
    "anglvel_x": "gx",
    "anglvel_y": "gy",
    "anglvel_z": "gz",
    "accel_x": "ax",
    "accel_y": "ay",
    "accel_z": "az",
}
"""Names of the kernel, and ours."""
TIME = "timestamp"

_TYPE = re.compile(r"(be|le):([suSU])(\d{1,3})/(\d{1,3})(?:X(\d{1,3}))?(?:>>(\d{1,3}))?\s*")
_NEAR = 1e-3
"""Drivers give a scale with six decimals or nine: this share is less than from one to the next."""

_SLOW = 256
"""Samples over which the period is averaged."""


@dataclass(frozen=True, slots=True)
class ScanElement:
    """One number of a scan.

    Attributes
    ----------
    name : str
        As the kernel calls it, without direction: ``anglvel_x``, ``timestamp``.
    index : int
        Its place among the elements.
    big : bool
        Whether the most significant byte comes first.
    signed : bool
    bits, storage, shift : int
        Bits that count, bits that it takes, and how far the former are shifted up in the latter.
    """

    name: str
    index: int
    big: bool = False
    signed: bool = True
    bits: int = 16
    storage: int = 16
    shift: int = 0

    @classmethod
    def of(cls, name: str, index: int, kind: str) -> ScanElement:
        """Return the element of a type as the kernel and libiio write it.

        Raises
        ------
        ValueError
            For a type that is none, or of several numbers.

        Examples
        --------
        >>> ScanElement.of("accel_x", 0, "le:s12/16>>4").shift
        4
        """
        match = _TYPE.fullmatch(kind)
        if match is None or int(match[5] or 1) != 1:
            raise ValueError(f"{name} has the type {kind.strip()[:40]!r}, which is not supported")
        bits, storage, shift = int(match[3]), int(match[4]), int(match[6] or 0)
        if storage not in (8, 16, 32, 64) or not 0 < bits <= storage - shift:
            raise ValueError(f"{name} has the type {kind.strip()[:40]!r}, which is not possible")
        return cls(name, index, match[1] == "be", match[2] in "sS", bits, storage, shift)


@dataclass(frozen=True, slots=True)
class ScanLayout:
    """Where each element is in a scan.

    Attributes
    ----------
    elements : tuple of ScanElement
        Those that are switched on, in the order of their index.
    """

    elements: tuple[ScanElement, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of a scan.

        Examples
        --------
        >>> axes = tuple(ScanElement(name, i) for i, name in enumerate(("accel_x", "accel_y")))
        >>> ScanLayout((*axes, ScanElement("timestamp", 3, bits=64, storage=64))).dtype.itemsize
        16
        """
        at, offsets, formats = 0, [], []
        for one in self.elements:
            size = one.storage // 8
            at = -(-at // size) * size
            offsets.append(at)
            formats.append(f"{'>' if one.big else '<'}{'i' if one.signed else 'u'}{size}")
            at += size
        widest = max(one.storage for one in self.elements) // 8
        return np.dtype(
            {
                "names": [one.name for one in self.elements],
                "formats": formats,
                "offsets": offsets,
                "itemsize": -(-at // widest) * widest,
            }
        )

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes in a scan, by our names."""
        return tuple(AXIS_NAMES[one.name] for one in self.elements if one.name in AXIS_NAMES)

    def times_ns(self, scans: NDArray[Any]) -> NDArray[np.int64]:
        """Return the time of each scan in ns, shape (n,)."""
        return scans[TIME].astype(np.int64)

    def counts(self, scans: NDArray[Any]) -> NDArray[np.int64]:
        """Return the axes of each scan, shape (n, k)."""
        return np.column_stack(
            [_counts(scans, one) for one in self.elements if one.name in AXIS_NAMES]
        )


def _counts(scans: NDArray[Any], one: ScanElement) -> NDArray[np.int64]:
    """Return the bits of an element that count, with their sign."""
    up = 64 - one.bits - one.shift
    raw = (scans[one.name].astype(np.int64) << up).view(np.uint64)
    shifted = raw.view(np.int64) if one.signed else raw
    return (shifted >> (64 - one.bits)).astype(np.int64)


def scale_of(axis: str, per_count: float, part: str = "") -> float:
    """Return dps or g per count from a driver's rad/s or m/s^2: that of the datasheet where it is.

    Examples
    --------
    >>> scale_of("gx", 0.000152716, "LSM6DSM"), scale_of("az", 0.000598)
    (0.00875, 6.1e-05)
    """
    scale = per_count / GRAVITY if axis.startswith("a") else float(np.rad2deg(per_count))
    of = PARTS.get(part, PARTS["LSM6DSM"])
    table = of.gyro_scales if axis.startswith("g") else of.accel_scales
    if part in PARTS:
        return next((one for one in table.values() if abs(scale / one - 1) < _NEAR), scale)
    full = full_scale_of(axis, scale)
    return scale if full is None else table.get(full, scale)


def pair(
    times: NDArray[np.int64], others: NDArray[np.int64], period_ns: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the places in both of the scans that were taken within half a period of each other.

    Parameters
    ----------
    times, others : ndarray of int64, shapes (n,) and (m,)
        Times in ns, ascending.
    period_ns : float

    Examples
    --------
    >>> pair(np.array([0, 10, 20]), np.array([1, 21, 31]), 10.0)
    (array([0, 2]), array([0, 1]))
    """
    half = np.int64(period_ns / 2)
    found = np.searchsorted(others, times - half)
    there = found < len(others)
    there[there] = others[found[there]] - times[there] < half
    mine = np.flatnonzero(there)
    return mine, found[mine]


def period_of(times: NDArray[np.int64], nominal_ns: float = 0.0) -> float:
    """Return the usual step of times in ns; the nominal one where they are too few to tell."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) >= 8 else nominal_ns


class Numbering:
    """Numbers samples by their times: where a step is of several periods, samples are missing.

    Parameters
    ----------
    nominal_ns : float
        Period that the driver claims. These parts are off by several per cent: what is measured
        replaces it, so that the number of samples in a long gap is right as well.
    """

    def __init__(self, nominal_ns: float) -> None:
        self._period_ns = nominal_ns
        self._measured = 0
        self._last_ns: int | None = None
        self._next = 0

    def runs(self, times: NDArray[np.int64]) -> list[tuple[int, slice]]:
        """Return the number of the first sample of each run without a gap, and where the run is.

        Raises
        ------
        ValueError
            If the times go back: losses are unknown.
        """
        if not len(times):
            return []
        steps = np.diff(times, prepend=times[0] if self._last_ns is None else self._last_ns)
        first = int(self._last_ns is None)
        if len(steps) > first and steps[first:].min() <= 0:
            raise ValueError("times that go back")
        if self._measured == 0:
            self._period_ns = period_of(times, self._period_ns)
        periods = np.ones(len(steps), np.int64)
        if self._period_ns > 0.0:
            periods = np.maximum(np.rint(steps / self._period_ns).astype(np.int64), 1)
        single = steps[first:][periods[first:] == 1]
        if len(single):
            self._measured = min(self._measured + len(single), _SLOW)
            share = min(len(single) / self._measured, 1.0)
            self._period_ns += share * (float(single.mean()) - self._period_ns)
        numbers = self._next - 1 + np.cumsum(periods)
        starts = np.flatnonzero(np.r_[True, periods[1:] > 1])
        ends = np.r_[starts[1:], len(times)]
        self._last_ns, self._next = int(times[-1]), int(numbers[-1]) + 1
        return [
            (int(numbers[start]), slice(int(start), int(end)))
            for start, end in zip(starts, ends, strict=True)
        ]
