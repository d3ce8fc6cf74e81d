"""From the bins of all levels to bands of equal width on a logarithmic scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.spectrum.density import Density
from allanscope.spectrum.window import independent_averages

__all__ = ["Stretch", "assemble"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Adjacent bins of one level.

    Attributes
    ----------
    turns : ndarray, shape (b,)
        Centres in cycles per sample of the stream, ascending.
    width : float
        Distance of the bins in the same unit.
    power : ndarray, shape (b,) or (axes, b)
        One-sided density in unit^2 samples.
    segments : float
        Segments in the mean.
    """

    turns: Array
    width: float
    power: Array
    segments: float


def assemble(
    stretches: Sequence[Stretch], rate: float, scale: float, per_decade: int | None
) -> Density:
    """Join stretches to one density in unit^2 / Hz, in bands or bin by bin."""
    parts = [_banded(s, per_decade) if per_decade else _single(s) for s in reversed(stretches)]
    if not parts:
        return Density(*(np.empty(0) for _ in range(4)))
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    frequency, width, power, averages = columns
    return Density(
        frequency=frequency * rate,
        width=width * rate,
        density=power * scale**2 / rate,
        averages=averages,
    )


def _single(stretch: Stretch) -> tuple[Array, Array, Array, Array]:
    bins = len(stretch.turns)
    worth = independent_averages(stretch.segments, 1.0, alone=True)
    return (
        stretch.turns,
        np.full(bins, stretch.width),
        stretch.power,
        np.full(bins, float(worth)),
    )


def _banded(stretch: Stretch, per_decade: int) -> tuple[Array, Array, Array, Array]:
    """Mean of the bins whose centres fall into each band of a grid that is the same for all."""
    band = np.floor(np.log10(stretch.turns) * per_decade).astype(np.int64)
    first = np.flatnonzero(np.diff(band, prepend=band[0] - 1))
    bins = np.diff(np.append(first, len(band))).astype(np.float64)
    centre = np.add.reduceat(stretch.turns, first) / bins
    power = np.add.reduceat(stretch.power, first) / bins
    joint = independent_averages(stretch.segments, bins)
    alone = independent_averages(stretch.segments, bins, alone=True)
    # The lowest bands of a run have one or two bins and hardly any neighbours to share with.
    averages = np.where(bins < 3, alone, joint)
    return centre, bins * stretch.width, power, averages
