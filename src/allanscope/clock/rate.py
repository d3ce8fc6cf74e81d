"""The rate: a straight line through the earliest arrivals, robust against stalls and steps.

Numbers n and times t obey t = t0 + n T + e, with a t0 of its own for every segment and one period T
for all. The remaining delays e are small, never far below the line, sometimes far above it, and
neighbours may be alike, because polling and sampling beat against each other. `fit_line` gives the
rate by one clock with its error (`LineFit`); a `RateFit` is the best that is known by all clocks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from allanscope.median import median, medians
from allanscope.quantities import MAD_TO_SIGMA, TWO_SIDED_95, student_widening

__all__ = ["ClockError", "LineFit", "RateFit", "fit_line", "rate_of_line"]

Floats = NDArray[np.float64]

FEWEST_ROWS = 6
SHORTEST_STRETCH = 3
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 1e-7, 1e5
STEP_ROWS = 4
STEP_SIGMAS = 8.0
STEP_S = 0.05
OUTLIER_SIGMAS = 4.0
ORDINATES = 6
"""Ordinates of the residuals' spectrum that give the sigma of a slope, the lowest ones: few enough
for a spectrum that rises towards them."""
JOINED, FEWEST_JOINED = (2, 4, 8, 16), 24
"""Neighbours of which the lowest may be kept, and the fewest rows that are left."""
CRYSTALS = 1e-4
"""Relative difference from the host's clock that the step of a device or of a bus may have."""
MOST_PHASES = 64
"""Phases of one step that frames take in turn; with so many there is nothing left to creep."""

LEAST_WARMING_C = 0.5
"""Over less than this the noise of a thermometer would be taken for temperature."""

THERMOMETER = 0.01
"""Share of a temperature coefficient that the noise and the scale of the thermometer may make."""

TIGHTEST_S = 1e-7
"""No clock is read more finely than this; residuals below are rounding."""

DISAGREEMENT = 1e-3
"""Crystals are off by less than a tenth of this. A host that sees the device's crystal off by more
has read late: what had waited while it was held up came in a rush, and looks like a high rate."""


@dataclass(frozen=True, slots=True)
class LineFit:
    """A rate, and how well it is known.

    Attributes
    ----------
    hz : float
        Samples per second of the clock that gave the times.
    relative_sigma : float
        Standard deviation of `hz`, relative.
    residual_s : float
        Standard deviation of the arrivals about the line, in seconds.
    span_s : float
        Time covered.
    drift_per_h, drift_sigma_per_h : float
        Relative change of the rate in an hour, and its standard deviation; NaN when the run is too
        short to tell.
    steps : int
        Places at which the line was broken because the delay changed for good.
    per_degc, per_degc_sigma : float
        Relative change of the rate per degC, and its standard deviation; NaN when the temperature
        is unknown or hardly moved. It takes all of the drift for the temperature's: a run that only
        warms up cannot tell one from the other.
    """

    hz: float
    relative_sigma: float
    residual_s: float
    span_s: float
    drift_per_h: float
    drift_sigma_per_h: float
    steps: int
    per_degc: float = np.nan
    per_degc_sigma: float = np.nan


def fit_line(
    index: NDArray[np.int64],
    time_s: Floats,
    segment: NDArray[np.int64],
    resolution_s: float,
    temperature_c: Floats | None = None,
    cadence_s: float = 0.0,
    hidden_s: float = 0.0,
    guessed: bool = False,
) -> LineFit | None:
    """Fit one rate to several stretches of numbers and times.

    Parameters
    ----------
    index, time_s, segment : ndarray, shape (k,)
        Sample numbers, their times in seconds, and the stretch that each belongs to, ascending.
    resolution_s : float
        Step of the time stamps. A phase that creeps through one step cannot be told from a rate:
        the rate is never known better than what may creep (`_room_to_creep`) over the span,
        uniformly distributed.
    temperature_c : ndarray, shape (k,), optional
        Temperature at these samples; NaN where it is not known.
    cadence_s : float
        Another step, that of the reader.
    hidden_s : float
        What may creep whatever the length of a frame is.
    guessed : bool
        Whether the step is a guess. Times that lie on the line exactly do not give it away: it may
        be as coarse as their decimals are.

    Returns
    -------
    LineFit or None
        None while there are too few points, or while they show no progress.
    """
    found = _common_line(index, time_s, segment)
    if found is None:
        return None
    found = _lowest(found)
    x, stretch, kept, residual = found.x, found.stretch, found.kept, found.residual
    period_s, freedom = found.period_s, found.freedom
    xc, residual = _centred(x, stretch, kept)[kept], residual[kept]
    span_s = float(np.ptp(x[kept])) * period_s
    slope_sigma = _slope_sigma(xc, residual, stretch[kept])
    if guessed and np.abs(residual).max() < TIGHTEST_S:
        resolution_s = max(resolution_s, _decimal_step(time_s))
    frame = max(float(np.gcd.reduce(np.diff(index))), 1.0)
    phases = np.arange(1, max(int(median(np.diff(x)) / frame), 1) + 1)[:MOST_PHASES]
    creep_s = max(
        _room_to_creep(step, frame * period_s, span_s, phases) for step in (resolution_s, cadence_s)
    )
    floor = max(creep_s, hidden_s) / np.sqrt(12.0) / span_s
    drift, drift_sigma = _bend(xc**2, xc, residual, stretch[kept], freedom)
    drift_floor = 8.0 * floor / span_s  # a bend of one step, as the floor is a slope of one
    per_degc = per_degc_sigma = np.nan
    if temperature_c is not None:
        warmth = _warmth(x, temperature_c[found.telling], stretch)
        per_degc, per_degc_sigma = _bend(warmth[kept], xc, residual, stretch[kept], freedom)
        per_degc_sigma = float(np.hypot(per_degc_sigma, THERMOMETER * per_degc))
    return LineFit(
        hz=1.0 / period_s,
        relative_sigma=float(np.hypot(slope_sigma / period_s, floor)),
        residual_s=float(np.sqrt(residual @ residual / freedom)),
        span_s=span_s,
        drift_per_h=-3600.0 * 2.0 * drift / period_s**2,
        drift_sigma_per_h=3600.0 * float(np.hypot(2.0 * drift_sigma / period_s**2, drift_floor)),
        steps=found.steps,
        per_degc=-per_degc / period_s,
        per_degc_sigma=per_degc_sigma / period_s,
    )


def rate_of_line(
    index: NDArray[np.int64], time_s: Floats, segment: NDArray[np.int64]
) -> float | None:
    """Return the rate in Hz that `fit_line` finds, without how well it is known."""
    found = _common_line(index, time_s, segment)
    return None if found is None else 1.0 / found.period_s


@dataclass(frozen=True, slots=True)
class _CommonLine:
    """Points that tell about one rate, shape (k,), and the line through them.

    `telling` says which of all points they are, shape (n,).
    """

    x: Floats
    stretch: NDArray[np.int64]
    telling: NDArray[np.bool_]
    kept: NDArray[np.bool_]
    residual: Floats
    period_s: float
    freedom: int
    steps: int

    @property
    def scatter_of_slope(self) -> float:
        """Standard error of the slope if rows are independent, in seconds a sample."""
        xc, residual = _centred(self.x, self.stretch, self.kept)[self.kept], self.residual
        residual = residual[self.kept]
        return float(np.sqrt(residual @ residual / self.freedom / (xc @ xc)))


def _common_line(
    index: NDArray[np.int64], time_s: Floats, segment: NDArray[np.int64]
) -> _CommonLine | None:
    if len(index) < FEWEST_ROWS:
        return None
    x = (index - index[0]).astype(np.float64)
    y = time_s - time_s[0]
    period_s = _typical_period(x, y, segment)
    if not SHORTEST_PERIOD_S < period_s < LONGEST_PERIOD_S:
        return None
    stretch = _split_at_steps(y - period_s * x, segment)
    steps = int(stretch[-1] + 1 - len(np.unique(segment)))
    telling = np.bincount(stretch)[stretch] >= SHORTEST_STRETCH
    if telling.sum() < FEWEST_ROWS:
        return None
    x, y, stretch = x[telling], y[telling], stretch[telling]
    return _line_of(x, y, stretch, telling, steps)


def _line_of(
    x: Floats, y: Floats, stretch: NDArray[np.int64], telling: NDArray[np.bool_], steps: int
) -> _CommonLine | None:
    line = _line(x, y, stretch)
    if line is None:
        return None
    period_s, residual, kept = line
    freedom = int(kept.sum()) - len(np.unique(stretch[kept])) - 1
    if freedom < 3 or not SHORTEST_PERIOD_S < period_s < LONGEST_PERIOD_S:
        return None
    return _CommonLine(x, stretch, telling, kept, residual, period_s, freedom, steps)


def _lowest(found: _CommonLine) -> _CommonLine:
    """Keep the lowest of so many neighbours each that the line is known best.

    Where frames and polls beat, the least delay is not reached in every window: a line through all
    follows the beat, one through the lowest of several the least delay. Which is known better, the
    scatter about it tells, as that of independent rows.
    """
    x, stretch = found.x, found.stretch
    y = found.residual + found.period_s * _centred(x, stretch, found.kept)
    late = np.where(found.kept, found.residual, np.inf)
    starts = np.diff(stretch, prepend=-1) != 0
    within = np.arange(len(x)) - np.flatnonzero(starts)[np.cumsum(starts) - 1]
    best = found
    for many in JOINED:
        group = np.cumsum(within % many == 0)
        order = np.lexsort((late, group))
        rows = order[np.diff(group, prepend=0) != 0]
        telling = np.zeros_like(found.telling)
        telling[np.flatnonzero(found.telling)[rows]] = True
        line = _line_of(x[rows], y[rows], stretch[rows], telling, found.steps)
        if line is None or len(rows) < FEWEST_JOINED:
            break
        if line.scatter_of_slope < best.scatter_of_slope:
            best = line
    return best


def _line(
    x: Floats, y: Floats, stretch: NDArray[np.int64]
) -> tuple[float, Floats, NDArray[np.bool_]] | None:
    """Return slope, residuals and inliers of the common line; None where nothing moves."""
    kept = np.ones(len(x), bool)
    for _ in range(4):
        xc, yc = _centred(x, stretch, kept), _centred(y, stretch, kept)
        sxx = float(xc[kept] @ xc[kept])
        if sxx <= 0.0:
            return None
        slope = float(xc[kept] @ yc[kept]) / sxx
        residual = yc - slope * xc
        before, kept = kept, _inliers(residual)
        if np.array_equal(kept, before):
            break  # all further rounds would be this one
    return slope, residual, kept


def _typical_period(x: Floats, y: Floats, segment: NDArray[np.int64]) -> float:
    """Median of slopes over so short a part of the run that most of them span no stall or step."""
    _, inverse, count = np.unique(segment, return_inverse=True, return_counts=True)
    lag = max(1, min(len(x) // 8, int(median(count[inverse])) // 2))
    same = segment[lag:] == segment[:-lag]
    dx, dy = (x[lag:] - x[:-lag])[same], (y[lag:] - y[:-lag])[same]
    moved = dx > 0.0
    return median(dy[moved] / dx[moved]) if moved.any() else 0.0


def _split_at_steps(residual: Floats, segment: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the stretches between steps, numbered: at a step the medians of both sides differ.

    Only what changes within a few windows counts, so a rate that drifts is no step.
    """
    breaks = np.diff(segment, prepend=segment[0]) != 0
    if len(residual) >= 4 * STEP_ROWS:
        levels = medians(sliding_window_view(residual, STEP_ROWS))
        jump = levels[STEP_ROWS:] - levels[:-STEP_ROWS]
        whole = segment[2 * STEP_ROWS - 1 :] == segment[: 1 - 2 * STEP_ROWS]
        if whole.sum() >= 2 * STEP_ROWS:
            size = np.where(whole, np.abs(jump - median(jump[whole])), 0.0)
            limit = max(STEP_SIGMAS * MAD_TO_SIGMA * median(size[whole]), STEP_S)
            while size.max() > limit:
                at = int(size.argmax())
                breaks[at + STEP_ROWS] = True
                size[max(0, at - STEP_ROWS) : at + STEP_ROWS + 1] = 0.0
    return np.cumsum(breaks)


def _centred(values: Floats, stretch: NDArray[np.int64], kept: NDArray[np.bool_]) -> Floats:
    """Subtract from every stretch the mean of what is kept of it."""
    weight = kept.astype(np.float64)
    count = np.maximum(np.bincount(stretch, weight), 1.0)
    mean: Floats = np.bincount(stretch, weight * values) / count
    return values - mean[stretch]


def _inliers(residual: Floats) -> NDArray[np.bool_]:
    """Pass over what came too late; what came early is no outlier but says where the line is."""
    excess = residual - median(residual)
    sigma = MAD_TO_SIGMA * median(np.abs(excess))
    return (excess <= OUTLIER_SIGMAS * max(sigma, TIGHTEST_S)) & (excess >= -STEP_S)


def _slope_sigma(
    shape: Floats, residual: Floats, stretch: NDArray[np.int64], *fitted: Floats
) -> float:
    """Return the sigma of a slope whose residuals may be correlated or beat.

    A slope is nearly the lowest ordinate of the cosine transform, and as uncertain as its
    neighbours are large: the mean square of the residual along the next `ORDINATES` cosines, less
    what is along the fitted shapes (Mueller, "A theory of robust long-run variance estimation",
    Journal of Econometrics 141, 2007). Exact in white noise; residuals that beat, which have
    least power there, do not count for more than they do. The slope has Student's distribution;
    sigma is widened to its 95 % point.
    """
    known = [shape, *fitted]
    ordinates = min(ORDINATES, len(residual) - len(np.unique(stretch)) - len(known))
    orders = np.arange(ordinates) + 1 + len(known)
    place = (np.arange(len(residual)) + 0.5) / len(residual)
    every = np.ones(len(residual), bool)
    cosines = [_centred(np.cos(np.pi * order * place), stretch, every) for order in orders]
    basis, _ = np.linalg.qr(np.column_stack([*known, *cosines]))
    along = basis[:, len(known) :].T @ residual
    return student_widening(ordinates) * float(np.sqrt(along @ along / ordinates / (shape @ shape)))


def _room_to_creep(
    step_s: float, frame_s: float, span_s: float, phases: NDArray[np.int64]
) -> float:
    """Return by how much the delay of frames may creep within a step without being seen, in s.

    Frames of the length p / q steps come at q phases of a step, again and again: the earliest of
    them may creep by a q-th of a step before the next one takes its place. As far as the two clocks
    are unknown to each other, and the creep is less than that in the whole run, it looks like a
    rate. A ratio without such a q has no room: what creeps falls back and is seen.
    """
    if not step_s > 0.0:
        return 0.0
    ratio = frame_s / step_s
    away = np.abs(phases * ratio - np.round(phases * ratio))
    alike = away < CRYSTALS * ratio * phases + frame_s / span_s
    return step_s / float(phases[alike][0]) if alike.any() else 0.0


def _decimal_step(time_s: Floats) -> float:
    """Return the largest power of ten, in s, up to one, of which all times are multiples; or 0."""
    for step_s in 10.0 ** -np.arange(7.0):
        if (np.abs(time_s - np.round(time_s / step_s) * step_s) < TIGHTEST_S).all():
            return float(step_s)
    return 0.0


def _warmth(x: Floats, temperature_c: Floats, stretch: NDArray[np.int64]) -> Floats:
    """Integral of the temperature over the sample number, about its mean: what the times follow.

    A period that changes with the temperature, T (1 + k (theta - mean)), adds k T times this.
    NaN where it hardly moved.
    """
    known = np.isfinite(temperature_c)
    if known.sum() < FEWEST_ROWS or np.ptp(temperature_c[known]) < LEAST_WARMING_C:
        return np.full(len(x), np.nan)
    number = np.arange(len(x))
    theta = np.interp(number, number[known], temperature_c[known])
    theta -= theta.mean()
    areas = np.diff(x) * (theta[1:] + theta[:-1]) / 2.0
    areas[np.diff(stretch) != 0] = 0.0
    return np.concatenate([[0.0], np.cumsum(areas)])


def _bend(
    shape: Floats, xc: Floats, residual: Floats, stretch: NDArray[np.int64], freedom: int
) -> tuple[float, float]:
    """How much of a shape that is no line is in the residual, and its sigma; NaN if unknown."""
    if freedom < 8 or not np.isfinite(shape).all():
        return np.nan, np.nan
    bend = _centred(shape, stretch, np.ones(len(xc), bool))
    bend -= xc * float(xc @ bend) / float(xc @ xc)
    if not float(bend @ bend) > 0.0:
        return np.nan, np.nan
    share = float(bend @ residual) / float(bend @ bend)
    return share, _slope_sigma(bend, residual - share * bend, stretch, xc)


@dataclass(frozen=True, slots=True)
class ClockError:
    """True rate over nominal rate, minus one, with its 95 % interval."""

    relative: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class RateFit:
    """The sample rate.

    Attributes
    ----------
    nominal_hz : float
        What the device claims; 0 when it claims nothing.
    hz : float
        The best rate that is known.
    source : {'host', 'device', 'nominal'}
        The clock that it was measured with; ``nominal`` as long as it has not been measured.
    uncertainty_ppm : float
        Standard deviation of `hz` relative to that clock; infinite when it was not measured. The
        error of the clock itself comes on top: some 20 to 50 ppm for a computer that is not
        disciplined by NTP, and for the crystal of a device. Where a device's crystal stands in for
        the computer's clock, in the first seconds of a run, its own error is part of it.
    residual_s : float
        Standard deviation of the times about the line.
    span_s : float
        Time over which it was measured.
    drift_ppm_per_h, drift_uncertainty_ppm_per_h : float
        Change of the rate, warm-up of the sensor's oscillator for instance; NaN when not known.
    ppm_per_degc, ppm_per_degc_uncertainty : float
        Change of the rate with the temperature, as far as one follows the other; NaN when not
        known.
    steps : int
        Times at which the delay changed for good: samples lost without a word, a computer that
        slept, a clock that was set.
    host, device : LineFit or None
        Both fits, to compare: how many samples pass in a second of the host, and in a second of
        the device's crystal.
    """

    nominal_hz: float
    hz: float
    source: Literal["host", "device", "nominal"]
    uncertainty_ppm: float = math.inf
    residual_s: float = math.nan
    span_s: float = 0.0
    drift_ppm_per_h: float = math.nan
    drift_uncertainty_ppm_per_h: float = math.nan
    ppm_per_degc: float = math.nan
    ppm_per_degc_uncertainty: float = math.nan
    steps: int = 0
    host: LineFit | None = None
    device: LineFit | None = None

    @property
    def is_measured(self) -> bool:
        """Whether `hz` is more than what the device claims."""
        return self.source != "nominal"

    @property
    def clock_error(self) -> ClockError | None:
        """By how much the sensor's oscillator is off; None until it has been measured."""
        if not self.is_measured or not self.nominal_hz > 0.0:
            return None
        relative = self.hz / self.nominal_hz - 1.0
        half = TWO_SIDED_95 * self.uncertainty_ppm * 1e-6 * self.hz / self.nominal_hz
        return ClockError(relative, relative - half, relative + half)

    @property
    def device_against_host(self) -> float | None:
        """Relative error of the device's crystal as the host sees it; None without both clocks.

        A crystal is off by some ten ppm. Much more says that the device's time is no time, or that
        samples are lost without a trace.
        """
        if self.host is None or self.device is None:
            return None
        return self.host.hz / self.device.hz - 1.0
