"""Shards of a segment, summed up apart and joined, against one pass."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope.allan import AllanBank
from allanscope.allan.shard import ALIGNED, Shard
from allanscope.spectrum import SpectrumBank, SpectrumShard
from allanscope.spectrum.bank import ALIGNED as SPECTRUM_ALIGNED

N = 4_400_000  # more than 8192 rows of half a block
EXACT = ("adev", "oadev", "hdev", "ohdev", "totdev", "mtotdev", "theo1")
ROUNDED = {"stdev": 1e-14, "ostdev": 1e-14, "mdev": 1e-14, "pdev": 1e-10}


@pytest.fixture(scope="module")
def counts() -> NDArray[np.int16]:
    rng = np.random.default_rng(5)
    walk = np.cumsum(rng.standard_normal(N)) * 0.02
    return (rng.standard_normal(N) * 20 + walk + 900).astype(np.int16)[:, np.newaxis]


def joined(samples: NDArray[Any], cuts: list[int]) -> tuple[AllanBank, SpectrumBank]:
    bank, spectrum = AllanBank(100.0, 1), SpectrumBank(100.0, 1)
    anchor = samples[0].astype(np.float64)
    for start, stop in pairwise(cuts):
        halo = samples[start - ALIGNED : start] if start else None
        shard, other = Shard(1, 4, anchor, start, halo), SpectrumShard(1, anchor, halo)
        for taker in (shard, other):
            taker.extend(samples[start:stop])
        bank.join(shard)
        spectrum.join(other)
    bank.update(samples[cuts[-1] :])
    spectrum.update(samples[cuts[-1] :])
    return bank, spectrum


def test_joined_shards_are_one_pass(counts: NDArray[np.int16]) -> None:
    whole, whole_spectrum = AllanBank(100.0, 1), SpectrumBank(100.0, 1)
    whole.update(counts)
    whole_spectrum.update(counts)
    last = N - N % ALIGNED
    bank, spectrum = joined(counts, [0, 3 * ALIGNED, 4 * ALIGNED, 17 * ALIGNED, last])
    for kind in (*EXACT, *ROUNDED):
        one, other = whole.deviation(kind), bank.deviation(kind)
        np.testing.assert_array_equal(other.terms, one.terms)
        np.testing.assert_allclose(other.deviation, one.deviation, rtol=ROUNDED.get(kind, 0.0))
    for name, array in whole.state().items():
        if name in ("cascade", "heads", "counts", "archive", "starts", "part", "anchor"):
            np.testing.assert_array_equal(bank.state()[name], array, err_msg=name)
    for name, array in whole_spectrum.state().items():
        if name == "power":
            np.testing.assert_allclose(spectrum.state()[name], array, rtol=1e-14)
        else:
            np.testing.assert_array_equal(spectrum.state()[name], array, err_msg=name)


def test_shards_of_both_rooms_begin_at_the_same_samples() -> None:
    assert ALIGNED == SPECTRUM_ALIGNED


def test_a_shard_that_does_not_follow_is_refused() -> None:
    samples = np.zeros((2 * ALIGNED, 1), np.int16)
    anchor = np.zeros(1)
    shard = Shard(1, 4, anchor, ALIGNED, samples[:ALIGNED])
    shard.extend(samples[ALIGNED:])
    with pytest.raises(ValueError, match="0 samples are here"):
        AllanBank(1.0, 1).join(shard)
    first = Shard(1, 4, anchor)
    first.extend(samples[:ALIGNED])
    with pytest.raises(ValueError, match="another anchor"):
        AllanBank(1.0, 1, anchor=np.ones(1)).join(first)


@pytest.mark.parametrize(("start", "halo"), [(5, ALIGNED), (ALIGNED, 0), (0, ALIGNED)])
def test_a_shard_begins_at_a_batch_and_with_its_halo(start: int, halo: int) -> None:
    with pytest.raises(ValueError, match="multiples"):
        Shard(1, 4, np.zeros(1), start, np.zeros((halo, 1)) if halo else None)
    with pytest.raises(ValueError, match="multiples"):
        Shard(1, 4, np.zeros(1)).extend(np.zeros((5, 1)))
