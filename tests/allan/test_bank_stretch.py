"""Long stretches of counts stay whole numbers on the low rungs: the bits are those of doubles."""

import numpy as np
import pytest

from allanscope.allan import AllanBank

ROWS = 100_000
RNG = np.random.default_rng(11)


def _white(sigma, axes=2):
    return np.clip(np.rint(RNG.normal(0.0, sigma, (ROWS, axes))), -32768, 32767).astype(np.int16)


def _wandering():
    """Return counts whose mean is another one at each rung and in each batch."""
    walk = np.cumsum(RNG.normal(0.0, 3.0, (ROWS, 3)), axis=0)
    noise = RNG.normal([0.0, 900.0, -3000.0], 9.0, (ROWS, 3))
    return np.rint(noise + walk).astype(np.int16)


def _with_knocks():
    """Return quiet counts with a few at either end of the range, and a stretch that is loud."""
    counts = _white(8.0)
    counts[[20_000, 20_001, 61_007], 0] = [-32768, 32767, 32767]
    counts[70_000:74_000, 1] = RNG.integers(-32768, 32768, 4000)
    return counts


KINDS = {
    "quiet": _white(12.0),
    "loud": _white(150.0),
    "full scale": _white(20_000.0),
    "one loud axis": np.column_stack([_white(5.0), _white(700.0)[:, :1]]),
    "still": np.full((ROWS, 1), -7, np.int16),
    "wandering": _wandering(),
    "knocks": _with_knocks(),
    "eleven axes": _white(30.0, 11),
}


def _state(counts, pieces, per_octave=4, window=None):
    bank = AllanBank(100.0, counts.shape[1], per_octave, window=window)
    for begin, end in zip([0, *pieces], [*pieces, len(counts)], strict=True):
        bank.update(counts[begin:end])
    held = {name: array.tobytes() for name, array in bank.state().items()}
    if window is not None:
        curves = bank.dynamic()
        held |= {"dynamic": curves.deviation.tobytes(), "terms": curves.terms.tobytes()}
    return held


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pieces", [(), (4096, 50_001, 50_002, 81_920)])
def test_counts_have_the_bits_of_the_same_numbers_as_doubles(kind, pieces):
    counts = KINDS[kind]
    assert _state(counts, pieces) == _state(counts.astype(np.float64), ())


@pytest.mark.parametrize("window", [0.0, 7.0])
@pytest.mark.parametrize("kind", ["quiet", "wandering"])
def test_windows_are_noted_within_a_stretch(kind, window):
    counts = KINDS[kind]
    assert _state(counts, (), window=window) == _state(
        counts.astype(np.float64), (30_000,), window=window
    )


@pytest.mark.parametrize("per_octave", [1, 12])
def test_other_averaging_times_have_the_bits_of_doubles(per_octave):
    counts = KINDS["quiet"]
    assert _state(counts, (), per_octave) == _state(counts.astype(np.float64), (), per_octave)


@pytest.mark.parametrize("anchor", [[0.0, 1.0, -2.0], [0.0, 1.0, 0.5]])
def test_a_stretch_goes_on_after_a_gap_and_numbers_with_digits(anchor):
    counts = KINDS["wandering"]
    states = []
    for kind in (np.int16, np.float64):
        bank = AllanBank(100.0, 3, anchor=anchor)
        bank.update(counts[:30_000].astype(kind))
        bank.gap()
        bank.update(counts[30_000:40_000] + 0.25)
        bank.update(counts[40_000:].astype(kind))
        states.append({name: array.tobytes() for name, array in bank.state().items()})
    assert states[0] == states[1]
