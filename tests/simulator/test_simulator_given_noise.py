"""Noise that is given on the command line is what is simulated, with the slopes of theory."""

import json

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.allan import deviation
from allanscope.errors import UsageError
from allanscope.simulator import Simulator, Truth
from allanscope.simulator.noise import (
    Flicker,
    FlickerPhase,
    FlickerWalk,
    OctaveFlicker,
    RandomRun,
    RandomWalk,
    White,
    WhitePhase,
)

COLUMNS = ("oadev", "mdev", "tdev", "ohdev", "totdev", "ostdev")
SLOPES = {
    WhitePhase: (-1, -1.5, -0.5, -1, -1, -1),
    FlickerPhase: (-0.95, -1, 0, -0.95, -0.95, -0.95),
    White: (-0.5, -0.5, 0.5, -0.5, -0.5, -0.5),
    Flicker: (0, 0, 1, 0, 0, None),
    OctaveFlicker: (0, 0, 1, 0, 0, None),
    RandomWalk: (0.5, 0.5, 1.5, 0.5, 0.5, None),
    FlickerWalk: (1, 1, 2, 1, None, None),
    RandomRun: (1, 1, 2, 1.5, None, None),
}
"""Of deviations: DT0064's table, but for a random run, whose ADEV and MDEV saturate at the slope of
a ramp. None where the value depends on the length of the record."""


@pytest.mark.parametrize("noise", SLOPES)
def test_slopes_of_the_table_of_dt0064(noise):
    """Mean of 12 records between m = 8 and 128: of deviations, and twice that of variances."""
    factors = [8.0, 128.0]
    rng = np.random.default_rng(77)
    records = [noise(1.0, 1.0, rng).take(8192) for _ in range(12)]
    for kind, slope in zip(COLUMNS, SLOPES[noise], strict=True):
        if slope is None:
            continue
        curves = [deviation(x, 1.0, kind, factors) for x in records]
        variances = np.mean([curve.variance for curve in curves], axis=0)
        deviations = np.exp(np.mean([np.log(curve.deviation) for curve in curves], axis=0))
        for values, power in ((variances, 2), (deviations, 1)):
            found = np.log(values[1] / values[0]) / np.log(16.0)
            assert found == pytest.approx(power * slope, abs=0.08 * power), kind


def test_given_noise_takes_the_place_of_the_typical_one():
    sensor = Truth.typical().with_noise(["N=0.01,axis=gyro", "K=0.001", "n1=-0.1,n2=0.01,axis=ax"])
    assert (sensor.axes["gx"].N, sensor.axes["gx"].K, sensor.axes["gx"].B) == (0.01, 0.001, 0.0)
    assert sensor.axes["gy"].N == 0.01
    assert sensor.axes["gz"].offset == Truth.typical().axes["gz"].offset
    assert sensor.axes["ay"] == Truth.typical().axes["ay"]
    (markov,) = sensor.effects
    assert markov.axes == ("ax",)
    assert markov.parameters == pytest.approx({"sigma": 0.01 / 0.2**0.5, "correlation_time": 10.0})


def test_a_simulated_random_run_has_its_hadamard_deviation():
    """HVAR = 11/120 D^2 tau^3 for large m."""
    truth = Truth.typical(seed=3).with_noise(["D=0.1,axis=gx"])
    sensor = Simulator("LSM6DSM", 104.0, 3, truth=truth, duration_s=150.0, gyro_fs=2000.0)
    counts = np.asarray(sensor.read(104 * 100).counts)[:, 0] * sensor.info.scale[0]
    curve = deviation(counts, sensor.info.nominal_hz, "ohdev", [2.0, 4.0])
    expected = np.sqrt(11 / 120 * 0.1**2 * curve.tau**3)
    assert curve.deviation == pytest.approx(expected, rel=0.35)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("X=1", "unknown 'X'; write N B K Q P F D R B_dt0064 n1 n2 and axis"),
        ("N=1,axis=gw", "unknown axis 'gw'"),
        ("N=-1", "N"),
        ("n1=-0.1", "write e.g."),
        ("n1=0.1,n2=1", "needs n1 < 0 and n2 > 0"),
        ("axis=gx", "write e.g."),
    ],
)
def test_noise_that_makes_no_sense_is_refused(text, message):
    with pytest.raises(UsageError, match=message):
        Truth.typical().with_noise([text])


def test_a_given_markov_process_is_found_with_its_two_numbers(tmp_path):
    """dx/dt = n1 x + n2 w: correlation time -1/n1, sigma n2 / sqrt(-2 n1)."""
    path, out = str(tmp_path / "a.mcap"), tmp_path / "a.json"
    noise = ["--noise", "N=0.003,axis=gx", "--noise", "n1=-0.2,n2=0.01,axis=gx"]
    words = ["simulate", path, "--hours", "0.4", "--rate", "26", "--seed", "3", "--quiet", *noise]
    assert main(words) == 0
    assert main(["analyse", path, "--json", str(out), "--quiet"]) == 0
    axis = json.loads(out.read_text())["axes"]["gx"]
    (found,) = [one for one in axis["effects"] if one["kind"] == "gauss_markov"]
    for name, truth in (("sigma", 0.01 / np.sqrt(0.4)), ("correlation_time", 5.0)):
        known = found["parameters"][name]
        assert known["lower"] < truth < known["upper"]
        assert known["upper"] < 1.6 * known["lower"]
    assert axis["coefficients"]["N"]["value"] == pytest.approx(0.003, rel=0.03)
