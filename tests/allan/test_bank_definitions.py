"""While nothing is thinned yet, the bank gives what each estimator's definition gives."""

import numpy as np
import pytest

from allanscope.allan import AllanBank
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.phase import to_phase

KINDS = sorted(REGISTRY)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 40, 127, 128, 129, 300])
@pytest.mark.parametrize("kind", KINDS)
def test_every_estimator_equals_its_definition_below_m_64(kind, n):
    rng = np.random.default_rng(n)
    counts = rng.integers(-500, 500, n).cumsum().astype(np.int32)
    bank = AllanBank(1.0, axes=1, per_octave=6)
    bank.update(counts)
    curve = bank.deviation(kind, bias_corrected=False)
    estimator = REGISTRY[kind]
    phase = to_phase(counts, rate=1.0)
    below = curve.m < 64
    for m, value, terms in zip(
        curve.m[below].tolist(), curve.deviation[0, below], curve.terms[0, below], strict=True
    ):
        variance, count = estimator.exact(phase, m)
        assert terms == count
        if count >= estimator.min_terms:
            assert value == pytest.approx(np.sqrt(variance), rel=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_no_tau_with_a_term_is_missing(kind):
    n, estimator = 200, REGISTRY[kind]
    data = np.random.default_rng(1).normal(size=n)
    bank = AllanBank(1.0, axes=1, per_octave=200)
    bank.update(data)
    phase = to_phase(data, rate=1.0)
    # The Theo family begins at 10 phases, as SP 1065 recommends, TheoH with OADEV.
    shortest = 10 if kind in ("theo1", "theobr") else 1
    possible = {
        m
        for m in range(shortest, 64)
        if estimator.admits(m, n) and estimator.exact(phase, m)[1] > 0
    }
    curve = bank.deviation(kind)
    assert set(curve.m[curve.m < 64].tolist()) == possible


def test_modified_totals_and_theo1_are_exact_at_all_m_up_to_4096_samples():
    data = np.random.default_rng(2).integers(-99, 99, 4096).astype(np.int16)
    bank = AllanBank(1.0, axes=1, per_octave=1)
    bank.update(data)
    phase = to_phase(data, rate=1.0)
    for kind in ("mtotdev", "htotdev", "theo1"):
        curve = bank.deviation(kind, bias_corrected=False)
        m = int(curve.m[-2])
        assert m >= 512
        assert curve.deviation[0, -2] == pytest.approx(
            np.sqrt(REGISTRY[kind].exact(phase, m)[0]), rel=1e-9
        )
