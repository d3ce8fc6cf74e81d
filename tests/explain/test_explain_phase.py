"""What leaks from axis to axis is in phase; what two axes hear of one source need not be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from allanscope.explain import explain
from support.measured import analysed

RATE, SIGMA = 52.0, 4e-3 * 52.0**0.5


def couplings(axes):
    return {
        (axis, effect.parameters["source"].value)
        for axis, found in axes.items()
        for effect in found.effects
        if effect.kind == "cross_coupling"
    }


def rumble(b):
    """Return broad noise of a machine from 5 to 20 Hz."""
    band = butter(2, [5.0, 20.0], "bandpass", fs=RATE, output="sos")
    return np.asarray(sosfilt(band, b.rng.normal(size=len(b.t))))


def turned(signal, degrees):
    """Return a signal of which every frequency is turned by the same phase."""
    spectrum = np.fft.rfft(signal) * np.exp(1j * np.deg2rad(degrees))
    return np.fft.irfft(spectrum, len(signal))


@pytest.mark.parametrize("degrees", [50.0, 70.0, -120.0])
def test_a_machine_that_two_axes_hear_at_another_phase_is_no_coupling(bench, degrees):
    b = bench(560, 120.0)
    machine = 0.7 * SIGMA * rumble(b)
    axes = explain(
        b.record(b.noise() + machine, b.noise() + turned(machine, degrees), lsb=SIGMA / 50)
    ).axes
    assert couplings(axes) == set()


@pytest.mark.parametrize("slope", [0.1, 0.5])
@pytest.mark.parametrize("seed", range(561, 563))
def test_a_leak_is_a_coupling_also_of_what_a_machine_does(bench, seed, slope):
    b = bench(seed, 240.0)
    source = b.noise() + 0.7 * SIGMA * rumble(b)
    axes = explain(b.record(b.noise() + slope * source, source, lsb=SIGMA / 50)).axes
    assert ("gx", "gy") in couplings(axes)


def test_a_leak_behind_another_low_pass_is_a_coupling_still(bench):
    b = bench(564, 240.0)
    source = b.noise()
    one_pole = np.exp(-2 * np.pi * 20.0 / RATE)
    behind = lfilter([1 - one_pole], [1, -one_pole], b.noise() + 0.5 * source)
    axes = explain(b.record(behind, source, lsb=SIGMA / 50)).axes
    assert couplings(axes)


@pytest.mark.parametrize(
    ("recording", "wrong", "right"),
    [
        ("ism330dhcx-fan-on", {("ax", "ay"), ("gx", "ax")}, None),
        ("px4-pixracer-desk", set(), {("gy", "gz"), ("gz", "gy")}),
    ],
)
def test_fans_are_no_coupling_and_a_driver_that_mixes_axes_is_one(recording, wrong, right):
    axes = analysed(recording).axes
    found = couplings({axis: one.explanation for axis, one in axes.items()})
    assert not wrong & found
    assert right is None or right & found
