"""What the streaming spectrum shows above the rows of a long run.

A run that no longer fits in memory is kept as block means, and what lies above their Nyquist
frequency only as a density in log-spaced bands. A low-pass and a tone still show there: the bands
are fitted by white noise behind a filter, and runs of bands far above it are reported. Within one
band a line and a narrow resonance look alike, so each names the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Parameter
from allanscope.explain.effects.band_limit import bilinear, one_pole
from allanscope.explain.effects.base import ALPHA, estimate, log_interval
from allanscope.explain.view import View
from allanscope.spectrum.density import Density

__all__ = ["above_the_rows"]

Array = NDArray[np.float64]

_LEAST_BANDS = 8
_LINE_Z = 6.0
_NEXT_Z = 4.0
_NARROW = 3
"""Most neighbouring bands that a line spreads over."""


@dataclass(frozen=True)
class _Bands:
    f: Array
    width: Array
    power: Array
    averages: Array
    floor: float
    rate: float


def above_the_rows(view: View, density: Density) -> View:
    """Add what the density shows above the Nyquist frequency of the rows of a view.

    Averaging attenuates such a tone but does not remove it: the rows show it at its alias. Where
    both are seen they are one, the band tells which, and the rows tell its frequency and size.
    """
    rate = view.series.rate_hz * view.series.stride
    seen = (density.frequency > view.series.rate_hz / 2) & (density.density > 0)
    seen &= density.frequency < rate / 2
    if np.count_nonzero(seen) < _LEAST_BANDS:
        return view
    bands = _Bands(
        density.frequency[seen],
        density.width[seen],
        density.density[seen],
        density.averages[seen],
        2 * view.step**2 / 12 / rate,
        rate,
    )
    model, limit = _baseline(view, bands)
    z = (bands.power / model - 1) * np.sqrt(bands.averages)
    accepted = list(view.accepted) + ([] if limit is None else [limit])
    for low, high in _runs(z):
        tone = _tone(view, bands, bands.power - model, z, slice(low, high + 1))
        twins = [c for c in accepted if _unfolded(view, c, tone) is not None]
        if twins:
            accepted = [_unfolded(view, c, tone) or c for c in accepted]
        else:
            accepted.append(tone)
    return replace(view, accepted=tuple(accepted))


def _unfolded(view: View, seen: Candidate, tone: Candidate) -> Candidate | None:
    """Return a line of the rows at the frequency of which it is the alias, if the tone has it."""
    if seen.kind != "sinusoid" or tone.kind != "sinusoid":
        return None
    at, size = seen.parameters["frequency"], seen.parameters["amplitude"]
    band = tone.parameters["frequency"]
    assert isinstance(at.value, float)
    assert isinstance(size.value, float)
    row_hz, stride = view.series.rate_hz, view.series.stride
    for fold in range(1, stride // 2 + 1):
        for sign in (-1, 1):
            f = fold * row_hz + sign * at.value
            if not band.lower <= f <= band.upper:  # type: ignore[operator]
                continue
            x = np.pi * f / (row_hz * stride)
            passed = float(abs(np.sin(stride * x) / (stride * np.sin(x))))
            half = (at.upper - at.lower) / 2  # type: ignore[operator]
            spread = (size.upper - size.lower) / 2 / passed  # type: ignore[operator]
            value = size.value / passed
            return replace(
                seen,
                parameters={
                    "frequency": Parameter(f, f - half, f + half, "Hz"),
                    "amplitude": Parameter(value, value - spread, value + spread, size.unit),
                },
                words=f"a line at {f:.6g} Hz, seen in the rows at its alias {at.value:.4g} Hz",
            )
    return None


def _baseline(view: View, bands: _Bands) -> tuple[Array, Candidate | None]:
    """Fit white noise, flat or filtered, to the bands that no tone lifts."""
    f, power, averages = bands.f, bands.power, bands.averages
    floor, rate = bands.floor, bands.rate
    weight = np.minimum(averages, 1e5)
    quiet = np.ones(len(f), bool)
    level = float(np.median(power))
    flat, filtered, best = np.full_like(power, level), np.full_like(power, level), np.zeros(3)
    for _ in range(3):
        use = weight * quiet

        def loss(p: Array, use: Array = use) -> float:
            return float(
                np.sum(
                    use * (np.log(_shape(p, f, floor, rate)) + power / _shape(p, f, floor, rate))
                )
            )

        starts = [np.array([np.log(level), np.log(c * rate), 0.0]) for c in (0.1, 0.3, 1.0)]
        results = [
            minimize(loss, s, method="Nelder-Mead", options={"maxiter": 800}) for s in starts
        ]
        result = min(results, key=lambda r: float(r.fun))
        best = np.asarray(result.x)
        filtered = _shape(best, f, floor, rate)
        mean = float(np.sum(use * power) / np.sum(use))
        flat = np.full_like(power, mean)
        quiet = (power / filtered - 1) * np.sqrt(averages) < _NEXT_Z
    use = weight * quiet
    gain = _deviance(use, power, flat) - _deviance(use, power, filtered)
    price = float(np.log(30 / ALPHA))
    if gain < price or view.has("band_limit"):
        return (flat if gain < price else filtered), None
    cutoff = float(np.exp(best[1]))
    h = 0.01
    losses = [
        _deviance(use, power, _shape(best + np.array([0, d, 0]), f, floor, rate))
        for d in (-h, 0.0, h)
    ]
    error = 1 / np.sqrt(max((losses[0] - 2 * losses[1] + losses[2]) / h**2, 1e-2))
    return filtered, Candidate(
        kind="band_limit",
        parameters={"cutoff": log_interval(cutoff, float(error), "Hz")},
        gain=gain,
        price=price,
        words=f"the top of the band is cut above {cutoff:.3g} Hz",
        evidence={"seen_in": "streaming spectrum"},
    )


def _deviance(weight: Array, power: Array, model: Array) -> float:
    return float(np.sum(weight * (np.log(model) + power / model)))


def _shape(p: Array, f: Array, floor: float, rate: float) -> Array:
    """Level times one pole (p[2] < 1/2) or two, plus the rounding."""
    cutoff = float(np.exp(np.clip(p[1], -20, 20)))
    one = one_pole(f, rate, (cutoff,))
    two = bilinear(f, rate, (min(cutoff, 0.499 * rate), 2.0))
    mix = 1 / (1 + np.exp(-40 * (np.clip(p[2], -2, 2) - 0.5)))
    return np.asarray(np.exp(p[0]) * ((1 - mix) * one + mix * two) + floor)


def _runs(z: Array) -> list[tuple[int, int]]:
    """First and last band of every run that holds a band above the limit."""
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(z > _LINE_Z):
        if runs and k <= runs[-1][1]:
            continue
        low = high = int(k)
        while low > 0 and z[low - 1] > _NEXT_Z:
            low -= 1
        while high < len(z) - 1 and z[high + 1] > _NEXT_Z:
            high += 1
        runs.append((low, high))
    return runs


def _tone(view: View, bands: _Bands, excess: Array, z: Array, inside: slice) -> Candidate:
    f, width, averages = bands.f, bands.width, bands.averages
    power = float(np.sum(excess[inside] * width[inside]))
    error = float(np.sqrt(np.sum((np.abs(excess[inside]) * width[inside]) ** 2 / averages[inside])))
    centre = float(np.average(f[inside], weights=np.maximum(excess[inside], 0) * width[inside]))
    half = float(np.sum(width[inside])) / 2
    where = Parameter(centre, centre - half, centre + half, "Hz")
    gain = float(np.max(z[inside]) ** 2 / 2)
    price = float(np.log(len(z) / ALPHA))
    evidence = {"seen_in": "streaming spectrum"}
    if inside.stop - inside.start <= _NARROW:
        amplitude = np.sqrt(2 * power)
        return Candidate(
            kind="sinusoid",
            parameters={
                "frequency": where,
                "amplitude": estimate(amplitude, error / amplitude, view.unit),
            },
            gain=gain,
            price=price,
            rivals={"narrowband": gain},
            words=f"a line near {centre:.4g} Hz, as narrow as the streaming spectrum can tell",
            evidence=evidence,
        )
    sigma = np.sqrt(power)
    return Candidate(
        kind="narrowband",
        parameters={
            "frequency": where,
            "bandwidth": Parameter(half, half / 2, 2 * half, "Hz"),
            "sigma": estimate(sigma, error / (2 * sigma), view.unit),
        },
        gain=gain,
        price=price,
        words=f"noise in a band around {centre:.4g} Hz",
        evidence=evidence,
    )
