"""The way of a sample from the sensor to the numbers of a result, with the parameters of the run.

From the sensor to the clock every sample takes one way. From the phase on it is the chain of the
design tip DT0064 (figure 1): M(m) averages m samples, D1(m) differences neighbours, and m:1 keeps
one of m. What a variance passes of the rate's density S(f) is written below half the sample rate,
with x = pi f tau: sigma^2 = integral of |H(f)|^2 S(f) df.
"""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.allan import ROWS, CurveChoices, lags_of_level
from allanscope.parts import Part
from allanscope.quantities import count
from allanscope.spectrum import SEGMENT

__all__ = ["ChainStep", "processing_chain"]

_DENSE = 64
"""Averaging factor below which a mean starts at every sample."""
_LONG = 128
"""Part of the run from which on rows of the archive are closer than the terms of a stream."""


@dataclass(frozen=True, slots=True)
class ChainStep:
    """One step on the way of a sample.

    Attributes
    ----------
    depth : int
        A step takes what the nearest step above it of one depth less gives.
    name : str
        What it is called.
    what : str
        What it does, with its parameters.
    numbers : str
        Which numbers of the result are taken there.
    passes : str
        ``|H(f)|^2`` of the variance that is taken there.
    """

    depth: int
    name: str
    what: str
    numbers: str
    passes: str = ""


def processing_chain(
    part: Part | None,
    rate_hz: float,
    scales: str,
    history: str,
    choices: CurveChoices | None = None,
) -> list[ChainStep]:
    """Return the steps in the order in which a sample takes them.

    Parameters
    ----------
    part : Part or None
        The sensor; None where it is not named.
    rate_hz : float
        Sample rate.
    scales : str
        What the output registers round to.
    history : str
        How much of the time series is kept.
    choices : CurveChoices, optional
        Of the curves; by default those of a bank.
    """
    choices = choices or CurveChoices()
    cutoffs = part.cutoffs_hz("gx", rate_hz) if part is not None else ()
    low_pass = f"low-pass at {' or '.join(f'{hz:.3g}' for hz in cutoffs)} Hz"
    starts = f"every start below m = {_DENSE}, {lags_of_level(1, 1)[0]} or more in τ above"
    archive = f"at most {count(ROWS)} rows, joined in pairs when full"
    starts += f"; from 1/{_LONG} of the run at rows of the archive"
    across = "; τ beyond the stretches between gaps"
    if choices.needs_samples:
        starts, archive, across = "every start", "every sample", ""
    third = "½ (DT0064)" if choices.hadamard == "dt0064" else "⅙ (DT0064: ½)"
    return [
        ChainStep(
            0,
            part.name if part is not None else "sensor",
            low_pass if cutoffs else "low-pass, fitted",
            "band_limit, N behind the filter",
        ),
        ChainStep(1, "output data rate", f"decimates to {rate_hz:g} samples/s", "folded lines"),
        ChainStep(
            2, "output registers", f"round to {scales}", "quantization, saturation, missing codes"
        ),
        ChainStep(3, "link", "frames checked and counted", "lost_samples, link, segments"),
        ChainStep(
            4,
            "clock",
            "line through arrival times by the host",
            "rate, tau = m / rate, clock_error",
        ),
        ChainStep(5, "phase", "cumulative sum between gaps", "level"),
        ChainStep(
            6,
            "M(m)",
            f"mean of m; {starts}",
            "OSTDVAR; m:1 STDVAR",
            "sin² x / x²",
        ),
        ChainStep(
            7,
            "D1(m)",
            "difference of neighbours, ½ of the mean square",
            "OAVAR, best_averaging, readings; m:1 AVAR",
            "2 sin⁴ x / x²",
        ),
        ChainStep(
            8,
            "M(m)",
            "averages once more, ½ of the mean square",
            "MAVAR; times τ²/3 TVAR",
            "2 sin⁶ x / x⁴",
        ),
        ChainStep(
            8,
            "D1(m)",
            f"differences once more, {third} of the mean square",
            "OHVAR; m:1 HVAR",
            "8 sin⁶ x / x²" if choices.hadamard == "dt0064" else "8/3 sin⁶ x / x²",
        ),
        ChainStep(8, "noise type", "MAVAR / AVAR, levels of power laws", "edf, lower, upper, bias"),
        ChainStep(7, "D1(m)", "the same, of the record reflected at both ends", "TOTVAR"),
        ChainStep(
            6, "slope(m)", "slope of a line through m; ½ of the mean square difference", "PVAR"
        ),
        ChainStep(
            6,
            "archive",
            archive,
            "MTOTVAR TTOTVAR HTOTVAR THEO1 THEOBR; THEOH, to a tenth of the run OAVAR",
        ),
        ChainStep(
            5,
            "spectrum",
            f"segments of {SEGMENT}, each level at a quarter of the rate",
            "density, N reading, lines",
        ),
        ChainStep(5, "history", history, "effects"),
        ChainStep(
            6,
            "bridge",
            "fills short gaps with noise like that around them",
            f"coefficients N B K Q R, residual{across}",
        ),
        ChainStep(5, "watch", "each block against those before", "events, undisturbed"),
    ]
