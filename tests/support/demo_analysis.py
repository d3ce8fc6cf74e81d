"""A made-up but realistic result: six axes of an LSM6DSM at 6664 Hz, with two effects found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from allanscope.allan import Deviation, DynamicDeviation
from allanscope.analysis import Analysis, AxisAnalysis, Level, ModelCurve, Rate
from allanscope.explain import AxisExplanation, Effect, Parameter, ResidualError
from allanscope.noise import BestAveraging, Coefficient, DatasheetVerdict
from allanscope.samples import AXES, unit_of
from allanscope.spectrum import Density
from allanscope.wire import LinkStats

RATE_HZ = 6664.2
LINE_HZ, LINE_DPS = 49.98, 20e-3
SPREAD = {"gx": 1.0, "gy": 1.15, "gz": 0.92, "ax": 1.0, "ay": 0.9, "az": 1.35}
NOISE = {"dps": (2.9e-3, 1.2e-3, 4e-5), "g": (62e-6, 22e-6, 9e-7)}
DATASHEET = {"dps": 3.8e-3, "g": 90e-6}
ESTIMATORS = ("oadev", "adev", "mdev", "ohdev", "tdev", "totdev")
Curve = NDArray[np.float64]


def noise_of(axis: str) -> tuple[float, float, float]:
    """N, B and K of an axis, in dps or g."""
    N, B, K = (SPREAD[axis] * value for value in NOISE[unit_of(axis)])
    return N, B, K


def demo_analysis(duration_s: float = 7300.0, seed: int = 1, kinds=ESTIMATORS) -> Analysis:
    """Return the result of a run of this length."""
    rng = np.random.default_rng(seed)
    return Analysis(
        input={"name": "/dev/ttyACM0", "wire": "native", "serial": "0667FF485550755187"},
        part="LSM6DSM",
        duration_s=duration_s,
        samples=int(duration_s * RATE_HZ),
        lost_samples=1998 if duration_s > 900 else 0,
        segments=2 if duration_s > 900 else 1,
        rate=Rate(6660.0, RATE_HZ, 800.0 / duration_s),
        link=LinkStats(bytes=int(duration_s * 89e3), frames=int(duration_s * 247), crc_errors=3),
        axes={axis: _axis(axis, duration_s, rng, kinds) for axis in AXES},
        temperature={"first": 24.1, "last": 31.6, "lowest": 24.1, "highest": 31.7},
        marks=((600.0, "fan off"),) if duration_s > 600 else (),
        remarks=("the device dropped 1998 samples once",) if duration_s > 900 else (),
        version="0.1.0",
        dynamic=_dynamic(duration_s, rng) if duration_s > 60 else None,
    )


def _dynamic(duration_s: float, rng: np.random.Generator) -> DynamicDeviation:
    """Return 200 windows; in one of ten, a while long, the noise of two axes is twice as large."""
    window_s = duration_s / 32
    start = np.linspace(0.0, duration_s - window_s, 200)
    tau = 2.0 ** np.arange(-12, np.log2(window_s / 4), 0.5)
    few = np.sqrt(tau / window_s)
    shape = len(AXES), 200, len(tau)
    deviation = 1e-3 / np.sqrt(tau) * (1.0 + 0.3 * few * rng.standard_normal(shape))
    deviation[:2, 120:140] *= 2.0
    terms = np.full(shape[1:], 100, np.int64)
    return DynamicDeviation(tau, start, start + window_s, np.abs(deviation), terms, window_s)


def _axis(axis: str, duration_s: float, rng: np.random.Generator, kinds) -> AxisAnalysis:
    unit = unit_of(axis)
    tau = _taus(duration_s)
    model = _deviation_model(axis, tau)
    curves = {kind: _curve(kind, tau, model.total, duration_s, rng) for kind in kinds}
    density, density_model = _density(axis, duration_s, rng)
    N, B, K = noise_of(axis)
    rel = 12.0 / np.sqrt(duration_s * 10)
    coefficients = {
        "Q": Coefficient(0.0, 0.0, 3e-9, f"{unit}*s", False, None),
        "N": Coefficient(N, N * (1 - 0.2 * rel), N * (1 + 0.2 * rel), f"{unit}/sqrt(Hz)", True),
        "B": Coefficient(B, B * (1 - 3 * rel), B * (1 + 3.6 * rel), unit, rel < 0.3, 400.0),
        "K": Coefficient(K, 0.0, K * (1 + 50 * rel), f"{unit}/sqrt(s)", False, 5 * duration_s),
        "R": Coefficient(0.0, 0.0, 2e-7, f"{unit}/s", False, None),
    }
    fitted = curves["oadev"]
    best = int(np.argmin(np.where(fitted.trusted, fitted.deviation, np.inf)))
    limit = DATASHEET[unit]
    return AxisAnalysis(
        unit=unit,
        curves=curves,
        level=Level(0.31 if unit == "dps" else float(axis == "az"), 2e-3, unit),
        coefficients=coefficients,
        best_averaging=BestAveraging(
            fitted.tau[best],
            int(fitted.m[best]),
            fitted.deviation[best],
            fitted.lower[best],
            fitted.upper[best],
            0.5 * fitted.tau[best],
            2.0 * fitted.tau[best],
        ),
        datasheet={
            "density": DatasheetVerdict(
                limit,
                np.sqrt(2) * N,
                f"{unit}/sqrt(Hz)",
                "typical" if np.sqrt(2) * N < 1.2 * limit else "worse",
                "one-sided: sqrt(2) N against the datasheet's typical value",
            )
        },
        density=density,
        model=_detected(model, coefficients),
        model_before=_detected(_deviation_model(axis, tau, effects=False), coefficients),
        density_model=density_model,
        explanation=_explanation(axis, coefficients),
    )


def _chi2_ppf(p: Curve | float, dof: Curve) -> Curve:
    return 2.0 * special.gammaincinv(dof / 2.0, p)


def _taus(duration_s: float) -> Curve:
    octaves = np.arange(0, np.log2(duration_s * RATE_HZ / 2), 0.25)
    return np.unique(np.round(2**octaves)) / RATE_HZ


def _deviation_model(axis: str, tau: Curve, effects: bool = True) -> ModelCurve:
    N, B, K = noise_of(axis)
    parts = {
        "N": N / np.sqrt(tau),
        "B": np.full_like(tau, np.sqrt(2 * np.log(2) / np.pi) * B),
        "K": K * np.sqrt(tau / 3),
    }
    if effects and axis in ("gx", "gy"):
        phase = np.pi * LINE_HZ * tau
        parts["sinusoid"] = LINE_DPS * np.sin(phase) ** 2 / phase
    total = np.sqrt(sum(part**2 for part in parts.values()))
    return ModelCurve(tau, total, parts)


def _detected(model: ModelCurve, coefficients: dict[str, Coefficient]) -> ModelCurve:
    """Return the sum of what was detected, as the analysis has it drawn."""
    parts = {
        name: part
        for name, part in model.components.items()
        if name not in coefficients or coefficients[name].detected
    }
    return ModelCurve(model.x, np.sqrt(sum(part**2 for part in parts.values())), parts)


def _curve(
    kind: str, tau: Curve, total: Curve, duration_s: float, rng: np.random.Generator
) -> Deviation:
    edf = np.maximum(1.2 * duration_s / tau - 1.0, 1.0)
    shape = {"mdev": 0.75, "ohdev": 0.97, "tdev": 0.75 * tau / np.sqrt(3)}.get(kind, 1.0)
    # Neighbouring taus share most of their data: four an octave are correlated about as strongly
    # as a running mean over six.
    white = np.convolve(rng.standard_normal(len(tau) + 5), np.full(6, 6**-0.5), "valid")
    value = total * shape * np.sqrt(_chi2_ppf(special.ndtr(white), edf) / edf)
    return Deviation(
        kind=kind,
        tau=tau,
        m=np.round(tau * RATE_HZ).astype(np.int64),
        deviation=value,
        lower=value * np.sqrt(edf / _chi2_ppf(0.975, edf)),
        upper=value * np.sqrt(edf / _chi2_ppf(0.025, edf)),
        edf=edf,
        terms=np.maximum(duration_s * RATE_HZ - 2 * tau * RATE_HZ, 1).astype(np.int64),
        noise=np.where(tau < 3, "WFM", "FFM"),
        level=0.95,
        trusted=tau <= 0.1 * duration_s,
    )


def _density(axis: str, duration_s: float, rng: np.random.Generator) -> tuple[Density, ModelCurve]:
    edges = np.geomspace(4.0 / duration_s, 0.5 * RATE_HZ, 160)
    frequency, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    N, B, K = noise_of(axis)
    parts = {
        "N": np.full_like(frequency, 2 * N**2),
        "B": B**2 / np.pi / frequency,
        "K": 2 * (K / (2 * np.pi * frequency)) ** 2,
    }
    if axis in ("gx", "gy"):
        line = (edges[:-1] <= LINE_HZ) & (edges[1:] > LINE_HZ)
        parts["sinusoid"] = np.where(line, 0.5 * LINE_DPS**2 / width, 0.0)
    total = sum(parts.values())
    averages = np.maximum(width * duration_s, 1.0)
    value = total * rng.chisquare(2 * averages) / (2 * averages)
    return Density(frequency, width, value, averages), ModelCurve(frequency, total, parts)


def _explanation(axis: str, coefficients: dict[str, Coefficient]) -> AxisExplanation:
    effects: tuple[Effect, ...] = ()
    if axis in ("gx", "gy"):
        effects = (
            Effect(
                "sinusoid",
                {
                    "frequency": Parameter(LINE_HZ, LINE_HZ - 0.011, LINE_HZ + 0.011, "Hz"),
                    "amplitude": Parameter(LINE_DPS, 19.8e-3, 20.2e-3, "dps"),
                },
                axes=("gx", "gy"),
                evidence={
                    "words": "a line of 31 standard deviations on data that was not used to fit it",
                    "held_out_nats": 481.0,
                },
            ),
        )
    if axis == "gz":
        effects = (
            Effect(
                "warm_up",
                {
                    "time_constant": Parameter(724.0, 660.0, 801.0, "s"),
                    "amplitude": Parameter(-21e-3, -23e-3, -19e-3, "dps"),
                },
                equivalent=("temperature",),
                axes=("gz",),
                evidence={"words": "an exponential settling; the temperature settles alike"},
            ),
        )
    found = bool(effects)
    return AxisExplanation(
        effects=effects,
        before=ResidualError(
            7.4 if found else 1.02,
            1e-9 if found else 0.43,
            11.0 if found else 2.1,
            2.0,
            31.0 if found else 2.2,
        ),
        after=ResidualError(1.05, 0.37, 2.2, 2.0, 2.4),
        coefficients_before=coefficients,
        coefficients_after=coefficients,
        held_out_nats=481.0 if found else 0.0,
        held_out_nats_se=22.0 if found else 0.0,
        explained=axis != "az",
        remarks=()
        if axis != "az"
        else ("a rise near tau = 300 s is left that no effect explains",),
    )
