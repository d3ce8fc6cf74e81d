"""Lines that are made of others: folded harmonics, sidebands, sums, images about the sample clock.

Frequencies in counts are exact, so that relations between them hold within the intervals of the
frequencies alone. With many lines and many relations some hold by chance; each is accepted only
where the number of chance agreements to be expected, among all that were compared, is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from math import gcd
from typing import NamedTuple

from allanscope.quantities import number

__all__ = ["FOLDS", "Line", "Relation", "fold", "relations_of"]

FOLDS = 12
"""Highest multiple of the sample rate about which a line is looked for."""
_FOLDED_HIGHEST = 9
"""Highest order of a harmonic that is seen folded."""
_CHANCE = 0.01
"""Expected number of relations by chance, among all of one sort that are compared."""
_PARTS = (2, 4, 8)
"""Parts of the sample rate about which converters that take turns make images."""
_RATIO_HIGHEST = 7
"""Highest orders of two harmonics of a fundamental that is not seen."""


class Line(NamedTuple):
    """A line: frequency and its interval in Hz, and the log-likelihood that it gained."""

    value: float
    lower: float
    upper: float
    gain: float


@dataclass(frozen=True, slots=True)
class Relation:
    """One line that is made of another, or of two.

    Attributes
    ----------
    bases : tuple of int
        Indices of the lines that it is made of, the fundamental first; of what `relations_of`
        returns the fundamental alone.
    product : int
        Its own index.
    order : int
        Of a folded harmonic; 0 of anything else.
    words : str
        E.g. ``f + 1.2 Hz``, where f is the fundamental, or ``fs/2 - f``, where fs is the sample
        rate; empty for a folded harmonic.
    chance : float
        Expected number of such agreements, had none a reason.
    is_even : bool
        Whether it is one of three lines at equal distances, and not a sum.
    """

    bases: tuple[int, ...]
    product: int
    order: int
    words: str
    chance: float
    is_even: bool = False


def fold(frequency_hz: float, rate_hz: float) -> float:
    """Return where a frequency is seen at a sample rate.

    Examples
    --------
    >>> fold(60.0, 104.0), fold(150.0, 104.0)
    (44.0, 46.0)
    """
    rest = frequency_hz % rate_hz
    return min(rest, rate_hz - rest)


def relations_of(lines: Sequence[Line], rate_hz: float) -> list[Relation]:
    """Return what lines are made of others, each once, the simplest and surest relation first.

    Parameters
    ----------
    lines : sequence of Line
        All of a record, harmonics of one another left out.
    rate_hz : float
        Sample rate.

    Examples
    --------
    >>> lines = [Line(f, f - 1e-4, f + 1e-4, gain) for f, gain in ((30, 90), (28.7, 9), (31.3, 8))]
    >>> [one.words for one in relations_of(lines, 104.0)]
    ['f - 1.3 Hz', 'f + 1.3 Hz']
    """
    made: dict[int, Relation] = {}
    based: set[int] = set()
    for sort in (_folded, _sidebands, _images, _parts_of_unseen):
        for one in sorted(sort(lines, rate_hz), key=lambda r: (r.order, r.chance)):
            first, *others = one.bases
            root = _root(first, made)
            is_free = one.product not in made and one.product not in based
            if is_free and one.product != root and not (one.order and first in made):
                made[one.product] = one
                based.add(first)
            elif not (one.product in made and _root(one.product, made) == root):
                continue
            # The second line of a sum belongs to it, as a fundamental of its own.
            for other in others:
                if other not in made and other != root:
                    words = _offset(lines, first, other) if one.is_even else _own(lines, other)
                    made[other] = replace(one, bases=(first,), product=other, words=words)
                    based.add(other)
    found = []
    for one in made.values():
        root = _root(one.bases[0], made)
        is_direct = one.order or root == one.bases[0]
        words = one.words if is_direct else _offset(lines, root, one.product)
        found.append(replace(one, bases=(root,), words=words))
    return found


def _root(at: int, made: dict[int, Relation]) -> int:
    while at in made:
        at = made[at].bases[0]
    return at


def _width(lines: Sequence[Line], *terms: tuple[int, float]) -> float:
    """Return how far a sum of frequencies may be off: twice its interval to each side."""
    return sum(abs(factor) * (lines[at].upper - lines[at].lower) for at, factor in terms)


def _folded(lines: Sequence[Line], rate_hz: float) -> list[Relation]:
    """Return harmonics beyond the Nyquist frequency."""
    tried = len(lines) * (len(lines) - 1) * (_FOLDED_HIGHEST - 1)
    found = []
    for base, other in permutations(range(len(lines)), 2):
        for order in range(2, _FOLDED_HIGHEST + 1):
            true = order * lines[base].value
            away = abs(fold(true, rate_hz) - lines[other].value)
            room = _width(lines, (base, order), (other, 1))
            chance = tried * 4 * room / rate_hz
            if true > rate_hz / 2 and away <= room and chance < _CHANCE:
                found.append(Relation((base,), other, order, "", chance))
    return found


def _sidebands(lines: Sequence[Line], rate_hz: float) -> list[Relation]:
    """Return equal distances to both sides, and sums of two lines; the weakest is made of them."""
    n = len(lines)
    tried = n * (n - 1) * (n - 2)  # n/2 mirrors and 1/6 sums of each kind, and twice a line.
    found = []
    for carrier in range(n):
        for one, other in combinations([k for k in range(n) if k != carrier], 2):
            mirrored = fold(2 * lines[carrier].value - lines[one].value, rate_hz)
            room = _width(lines, (carrier, 2), (one, 1), (other, 1))
            chance = tried * 4 * room / rate_hz
            if abs(mirrored - lines[other].value) > room or chance >= _CHANCE:
                continue
            if lines[carrier].gain >= max(lines[one].gain, lines[other].gain):
                found += [_made(lines, (carrier,), side, chance) for side in (one, other)]
            else:  # Of a comb, or twice a line less another.
                even = _weakest(lines, (carrier, one, other), chance)
                found.append(replace(even, is_even=True))
    for three in combinations(range(n), 3):
        a, b, c = sorted(three, key=lambda k: lines[k].value)
        room = _width(lines, (a, 1), (b, 1), (c, 1))
        chance = tried * 4 * room / rate_hz
        total = lines[a].value + lines[b].value
        if abs(fold(total, rate_hz) - lines[c].value) <= room and chance < _CHANCE:
            found.append(_weakest(lines, three, chance))
    return found


def _weakest(lines: Sequence[Line], three: tuple[int, ...], chance: float) -> Relation:
    """Return that the weakest of three lines is made of the others."""
    *bases, product = sorted(three, key=lambda k: -lines[k].gain)
    return _made(lines, tuple(bases), product, chance)


def _made(lines: Sequence[Line], bases: tuple[int, ...], product: int, chance: float) -> Relation:
    return Relation(bases, product, 0, _offset(lines, bases[0], product), chance)


def _offset(lines: Sequence[Line], base: int, product: int) -> str:
    apart = lines[product].value - lines[base].value
    return f"f {'+' if apart > 0 else '-'} {_plain(abs(apart))} Hz"


def _own(lines: Sequence[Line], at: int) -> str:
    return f"{_plain(lines[at].value)} Hz"


def _plain(value: float) -> str:
    text = number(value, 4)
    return text.rstrip("0").rstrip(".") if "." in text else text


def _images(lines: Sequence[Line], rate_hz: float) -> list[Relation]:
    """Return images about parts of the sample rate; the weaker is that of the stronger."""
    places = [(k, parts) for parts in _PARTS for k in range(1, parts // 2 + 1) if gcd(k, parts) < 2]
    tried = len(lines) * (len(lines) - 1) * len(places)
    found = []
    for base, other in permutations(range(len(lines)), 2):
        if lines[base].gain < lines[other].gain:
            continue
        room = _width(lines, (base, 1), (other, 1))
        chance = tried * 4 * room / rate_hz
        for k, parts in places:
            for sign in (-1, 1):
                seen = fold(k * rate_hz / parts + sign * lines[base].value, rate_hz)
                if abs(seen - lines[other].value) <= room and chance < _CHANCE:
                    words = f"{k if k > 1 else ''}fs/{parts} {'+' if sign > 0 else '-'} f"
                    found.append(Relation((base,), other, 0, words, chance))
    return found


def _parts_of_unseen(lines: Sequence[Line], rate_hz: float) -> list[Relation]:
    """Return harmonics of a fundamental that is not seen: 20 and 30 Hz are of 10 Hz."""
    ratios = [(p, q) for q in range(3, _RATIO_HIGHEST + 1) for p in range(2, q) if gcd(p, q) == 1]
    tried = len(lines) * (len(lines) - 1) / 2 * len(ratios)
    found = []
    for low, high in permutations(range(len(lines)), 2):
        for p, q in ratios:
            room = _width(lines, (low, q / p), (high, 1))
            chance = tried * 4 * room / rate_hz
            away = abs(lines[low].value * q / p - lines[high].value)
            if away <= room and chance < _CHANCE:
                is_low = lines[low].gain >= lines[high].gain
                base, product = (low, high) if is_low else (high, low)
                words = f"{q}/{p} f" if is_low else f"{p}/{q} f"
                found.append(Relation((base,), product, 0, words, chance))
    return found
