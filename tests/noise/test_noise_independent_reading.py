"""The judge of `python -m benchmarks measured`: N read without allanscope, where it is known."""

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

MODULE = Path(__file__).parents[2] / "benchmarks" / "independent_reading.py"
RATE = 104.0
WHITE = 0.004


@pytest.fixture(scope="module")
def judge():
    spec = spec_from_file_location("independent_reading", MODULE)
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def white(rng, seconds):
    return WHITE * np.sqrt(RATE) * rng.standard_normal(int(seconds * RATE))


def test_it_owes_the_loop_nothing():
    code = (
        f"import sys; sys.path.insert(0, {str(MODULE.parent)!r}); import independent_reading; "
        "print([name for name in sys.modules if name.startswith('allanscope')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("seconds", [60, 600, 6000])
def test_white_noise_is_read_within_its_error(judge, rng, seconds):
    off = [judge.reading_of(white(rng, seconds), RATE) for _ in range(10)]
    z = [(one.N - WHITE) / one.N_error for one in off]
    assert abs(np.mean(z)) < 1.5
    assert np.max(np.abs(z)) < 4.5
    assert off[0].N_error < 0.15 * WHITE / np.sqrt(seconds / 60)


def test_neither_flicker_nor_lines_nor_a_low_pass_moves_it(judge, rng):
    x = white(rng, 1200)
    t = np.arange(len(x)) / RATE
    slow = 2e-4 * np.cumsum(rng.standard_normal(len(x)))
    lines = 0.02 * np.sin(2 * np.pi * 3.3 * t) + 0.05 * np.sin(2 * np.pi * 11.1 * t)
    x = lfilter(*butter(2, 2 * 30 / RATE), x) + slow + lines
    found = judge.reading_of(x, RATE)
    assert abs(found.N / WHITE - 1) < 0.03
    assert found.band[1] < 15.0


def test_what_is_nowhere_flat_has_no_reading(judge, rng):
    x = np.cumsum(white(rng, 600))
    assert np.isnan(judge.reading_of(x, RATE).N)


def test_the_deviations_are_those_of_the_definition(judge, rng):
    x = white(rng, 600)
    tau, oadev = judge.oadev_of(x, 100.0)
    phase = np.concatenate([[0.0], np.cumsum(x)])
    m = round(tau[20] * 100.0)
    second = phase[2 * m :] - 2 * phase[m:-m] + phase[: -2 * m]
    assert oadev[20] == pytest.approx(np.sqrt(np.mean(second**2) / 2) / m, rel=1e-9)


def test_times_tell_bursts_from_gaps(judge, tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    def rate_of(times):
        path = tmp_path / "times.parquet"
        pq.write_table(pa.table({"t[ms]": times, "gx[dps]": np.zeros(len(times))}), path)
        found = judge.samples_of(path)
        return found.rate_hz, found.missing

    every_10_ms = 10.0 * np.arange(10_000)
    kept = np.delete(every_10_ms, np.arange(5, 9_995, 10))
    assert rate_of(kept) == pytest.approx((100.0, 0.1), rel=1e-2)
    bursts = every_10_ms // 50 * 50 + np.tile(2.0 * np.arange(5), 2_000)
    rate, missing = rate_of(bursts)
    assert rate == pytest.approx(100.0, rel=1e-3)
    assert missing == 0.0
