"""Every estimator against its equation, written out term by term."""

import numpy as np
import pytest

from allanscope.allan.estimators import REGISTRY

N = 60


@pytest.fixture(scope="module")
def phase():
    steps = np.random.default_rng(3).integers(-9, 10, N)
    return np.append(0.0, np.cumsum(steps))


def means(x, m, stride):
    return [(x[i + m] - x[i]) / m for i in range(0, len(x) - m, stride)]


def stdvar(x, m, stride):
    w = means(x, m, stride)
    return sum((value - sum(w) / len(w)) ** 2 for value in w) / (len(w) - 1), len(w)


def allan(x, m, stride):
    terms = [x[i + 2 * m] - 2 * x[i + m] + x[i] for i in range(0, len(x) - 2 * m, stride)]
    return sum(t**2 for t in terms) / (2 * m**2 * len(terms)), len(terms)


def hadamard(x, m, stride):
    terms = [
        x[i + 3 * m] - 3 * x[i + 2 * m] + 3 * x[i + m] - x[i]
        for i in range(0, len(x) - 3 * m, stride)
    ]
    return sum(t**2 for t in terms) / (6 * m**2 * len(terms)), len(terms)


def modified(x, m):
    terms = [
        sum(x[i + j + 2 * m] - 2 * x[i + j + m] + x[i + j] for j in range(m))
        for i in range(len(x) - 3 * m + 1)
    ]
    return sum(t**2 for t in terms) / (2 * m**4 * len(terms)), len(terms)


def parabolic(x, m):
    if m == 1:
        return allan(x, 1, 1)
    terms = [
        sum(((m - 1) / 2 - k) * (x[i + k] - x[i + k + m]) for k in range(m))
        for i in range(len(x) - 2 * m)
    ]
    return 72 * sum(t**2 for t in terms) / (m**6 * len(terms)), len(terms)


def total(x, m):
    count = len(x)
    image = {i: x[i] for i in range(count)}
    for j in range(1, count - 1):
        image[-j] = 2 * x[0] - x[j]
        image[count - 1 + j] = 2 * x[-1] - x[count - 1 - j]
    terms = [image[i - m] - 2 * image[i] + image[i + m] for i in range(1, count - 1)]
    return sum(t**2 for t in terms) / (2 * m**2 * len(terms)), len(terms)


def mirrored_windows(values, m):
    """Mean square of second differences of m-means in detrended windows mirrored to 9m values."""
    squares = []
    for start in range(len(values) - 3 * m + 1):
        window = np.array(values[start : start + 3 * m])
        half = 3 * m // 2
        slope = (window[-half:].mean() - window[:half].mean()) / (3 * m - half)
        window = window - slope * np.arange(3 * m)
        extended = np.concatenate([window[::-1], window, window[::-1]])
        mean = [extended[j : j + m].mean() for j in range(9 * m - m + 1)]
        squares.append(
            np.mean([(mean[j] - 2 * mean[j + m] + mean[j + 2 * m]) ** 2 for j in range(6 * m)])
        )
    return np.mean(squares), len(squares)


def modified_total(x, m):
    mean, windows = mirrored_windows(x, m)
    return mean / (2 * m**2), windows


def hadamard_total(x, m):
    if m == 1:
        return hadamard(x, 1, 1)
    mean, windows = mirrored_windows(np.diff(x), m)
    return mean / 6, windows


def theo1(x, m):
    squares = [
        sum(
            ((x[i] - x[i - d + m // 2]) + (x[i + m] - x[i + d + m // 2])) ** 2 / (m / 2 - d)
            for d in range(m // 2)
        )
        for i in range(len(x) - m)
    ]
    return sum(squares) / (0.75 * m**2 * len(squares)), len(squares)


DEFINITIONS = {
    "stdev": lambda x, m: stdvar(x, m, m),
    "ostdev": lambda x, m: stdvar(x, m, 1),
    "adev": lambda x, m: allan(x, m, m),
    "oadev": lambda x, m: allan(x, m, 1),
    "hdev": lambda x, m: hadamard(x, m, m),
    "ohdev": lambda x, m: hadamard(x, m, 1),
    "mdev": modified,
    "tdev": lambda x, m: (modified(x, m)[0] * m**2 / 3, modified(x, m)[1]),
    "totdev": total,
    "mtotdev": modified_total,
    "ttotdev": lambda x, m: (modified_total(x, m)[0] * m**2 / 3, modified_total(x, m)[1]),
    "htotdev": hadamard_total,
    "theo1": theo1,
    "pdev": parabolic,
}


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 10, 16, 19])
@pytest.mark.parametrize("kind", DEFINITIONS)
def test_value_and_terms_follow_the_equation(kind, m, phase):
    if REGISTRY[kind].even and m % 2:
        pytest.skip("only even windows")
    variance, terms = REGISTRY[kind].exact(phase, m)
    expected, count = DEFINITIONS[kind](phase.tolist(), m)
    assert terms == count
    assert variance == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("m", [N, N - 1, N // 2 + 1])
def test_total_deviation_reaches_the_end_of_the_run(m, phase):
    assert REGISTRY["totdev"].exact(phase, m)[0] == pytest.approx(total(phase.tolist(), m)[0])


@pytest.fixture(scope="module")
def long_phase():
    return np.append(0.0, np.cumsum(np.random.default_rng(8).standard_normal(400)))


def test_theobr_scales_theo1_by_the_mean_ratio_of_allan_to_theo1(long_phase):
    x = long_phase.tolist()
    ratios = [allan(x, 9 + 3 * i, 1)[0] / theo1(x, 12 + 4 * i)[0] for i in range(401 // 30 - 3 + 1)]
    raw = theo1(x, 200)[0]
    variance, windows = REGISTRY["theobr"].exact(long_phase, 200)
    assert len(ratios) == 11
    assert variance == pytest.approx(raw * np.mean(ratios), rel=1e-12)
    assert windows == 201


def test_theobr_needs_ninety_phases(long_phase):
    assert np.isnan(REGISTRY["theobr"].exact(long_phase[:89], 40)[0])
    variance, _ = REGISTRY["theobr"].exact(long_phase[:90], 40)
    x = long_phase[:90].tolist()
    assert variance == pytest.approx(theo1(x, 40)[0] * allan(x, 9, 1)[0] / theo1(x, 12)[0])


def test_theoh_is_allan_up_to_a_tenth_of_the_run_and_theobr_above(long_phase):
    theoh = REGISTRY["theoh"]
    found = theoh.curve(long_phase, [1, 40, 54, 300])
    expected = [
        REGISTRY["oadev"].exact(long_phase, 1),
        REGISTRY["oadev"].exact(long_phase, 40),
        REGISTRY["theobr"].exact(long_phase, 54),
        REGISTRY["theobr"].exact(long_phase, 300),
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert theoh.tau([1, 40, 54, 300], 400).tolist() == [1.0, 40.0, 40.5, 225.0]
    assert [m for m in range(38, 58) if theoh.admits(m, 400)] == [38, 39, 40, 54, 56]


def test_a_long_record_thins_the_ratio_of_theobr_without_moving_it():
    from allanscope.allan.estimators import theobr

    x = np.append(0.0, np.cumsum(np.random.default_rng(2).standard_normal(12_000)))
    steps = range(x.size // 30 - 3 + 1)
    full = np.mean(
        [
            REGISTRY["oadev"].exact(x, 9 + 3 * i)[0] / REGISTRY["theo1"].exact(x, 12 + 4 * i)[0]
            for i in steps[::3]
        ]
    )
    assert theobr.theobr_ratio(x) == pytest.approx(full, rel=3e-3)
