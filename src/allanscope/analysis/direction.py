"""The direction of a disturbance: what it is on three axes of a sensor is one vector.

The amplitude and phase of a line on all axes are a vector of complex numbers. It is what its parts
in time have in common: the principal component of their products, in units of the noise of each
axis, so that a line that drifts has a direction too. Of a step it is the change of the means. Of a
burst it is the principal component of what its rows have more of than those about it.

A rotation about an axis at a distance accelerates. What the accelerometer shows beyond the tilt of
gravity, over the angular acceleration that the gyroscope shows, is that distance: a board turns
about a point within centimetres of it; a distance of a metre and more is no rotation of the board.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.analysis.line_origin import LineSums
from allanscope.quantities import GRAVITY, MAD_TO_SIGMA, TWO_SIDED_95, number

__all__ = ["Direction", "Motion", "motion_of_burst", "motion_of_line", "motion_of_step"]

Array = NDArray[np.float64]

_SENSORS = {"gyro": ("gx", "gy", "gz"), "accel": ("ax", "ay", "az")}
_SEEN = 4.5
"""Standard errors from which a sensor shows a disturbance at all."""
_ABOVE_NOISE = 1.5
"""Largest component over what it is of noise alone (Marchenko and Pastur)."""
_NEAR_M, _FAR_M = 0.1, 1.0
"""Distance of the axis of a rotation of the board, and from which on it is none."""
_SECTIONS = 16
_STEP_S = 5.0
_BURST_ROWS = 12
"""Fewest independent rows of a burst that have a direction."""
_ELSEWHERE = 200


@dataclass(frozen=True, slots=True)
class Direction:
    """What a disturbance is on one sensor.

    Attributes
    ----------
    sensor : {'gyro', 'accel'}
    vector : (float, float, float)
        Unit vector along which it is largest; the largest component is positive but for a step.
    error_deg : float
        Standard error of its direction.
    amplitude, lower, upper : float
        Along it, with its 95 % interval, in `unit`; the peak of a line, the rms of a burst.
    unit : str
    roundness : float
        Across over along it: 0 of a line or a burst to and fro, 1 of a circle.
    """

    sensor: str
    vector: tuple[float, float, float]
    error_deg: float
    amplitude: float
    lower: float
    upper: float
    unit: str
    roundness: float = 0.0


@dataclass(frozen=True, slots=True)
class Motion:
    """The directions of a disturbance, and what moves.

    Attributes
    ----------
    directions : tuple of Direction
        Of each sensor that has three axes and shows it.
    kind : {'rotation', 'translation', 'both', ''}
        Empty where one sensor is missing or the disturbance is none of the board.
    arm_m : float or None
        Distance of the axis of a rotation that would account for the acceleration.
    words : str
        In a phrase.
    """

    directions: tuple[Direction, ...]
    kind: str
    arm_m: float | None
    words: str


def motion_of_line(
    line: LineSums,
    axes: Sequence[str],
    rows: int,
    level: Array,
    frequency_hz: float | None,
    sections: int = _SECTIONS,
) -> Motion | None:
    """Return the direction of a line; None where no sensor has three axes that show it.

    Parameters
    ----------
    line : LineSums
        Of all axes.
    axes : sequence of str
        Their names.
    rows : int
        In all sums together.
    level : ndarray, shape (axes,)
        Mean of each axis in dps or g: that of the accelerometer is gravity.
    frequency_hz : float or None
        True frequency, to tell rotation from translation; None where it is none of the board.
    sections : int
        Parts of the record in which the phase may differ.
    """
    parts = np.array([one.sum(axis=1) for one in np.array_split(line.sums, sections, axis=1)]).T
    noise = np.sqrt(line.level / sections)
    white = parts / noise[:, None]
    values, vectors = np.linalg.eigh(white @ white.conj().T / sections)
    if values[-1] < _ABOVE_NOISE * (1.0 + math.sqrt(len(white) / sections)) ** 2:
        return None
    size = math.sqrt(float(values[-1]) - 1.0)
    scale = 2.0 * sections / rows
    vector = np.asarray(vectors[:, -1] * size * noise * scale, np.complex128)
    error = noise * scale / math.sqrt(2.0 * sections)
    return _motion(vector, error, axes, level, frequency_hz)


def motion_of_step(
    values: Array, times_s: Array, axes: Sequence[str], time_s: float
) -> Motion | None:
    """Return the direction of a change of the level.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
        Rows.
    times_s : ndarray, shape (n,)
        When each begins.
    time_s : float
        When the level changes.
    """
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    reach = min(_STEP_S, 0.1 * float(times_s[-1] - times_s[0]))

    def change(at: Array) -> Array:
        edges = np.searchsorted(times_s, np.stack([at - reach, at, at + reach]))
        count = np.maximum(np.diff(edges, axis=0), 1)[:, :, None]
        means = np.diff(sums[edges], axis=0) / count
        return np.asarray(means[1] - means[0])

    found = change(np.array([time_s]))[0]
    grid = np.linspace(times_s[0] + reach, times_s[-1] - reach, _ELSEWHERE)
    # What the level does anyway over as long a time.
    error = MAD_TO_SIGMA * np.median(np.abs(change(grid)), axis=0)
    return _motion(found.astype(np.complex128), error, axes, values.mean(axis=0), None)


def motion_of_burst(
    values: Array, times_s: Array, axes: Sequence[str], start_s: float, stop_s: float
) -> Motion | None:
    """Return the direction of a shock or of a loud stretch; None where it has none.

    Noise that grows on each axis by itself has no direction.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
        Rows.
    times_s : ndarray, shape (n,)
        When each begins.
    start_s, stop_s : float
        When it begins and ends.
    """
    first, stop = np.searchsorted(times_s, [start_s, stop_s])
    length = max(int(stop - first), _BURST_ROWS)
    beside = values[max(0, first - 4 * length) : first], values[stop : stop + 4 * length]
    quiet = np.concatenate([part - part.mean(axis=0) for part in beside if len(part) > 1] or beside)
    loud = values[first:stop]
    if min(len(loud), len(quiet)) < _BURST_ROWS:
        return None
    loud = loud - loud.mean(axis=0)
    seconds = float(np.median(np.diff(times_s)))
    known, limits, omegas = {}, {}, {}
    for sensor, names in _SENSORS.items():
        if not set(names) <= set(axes):
            continue
        at = [axes.index(name) for name in names]
        limits[sensor] = _ABOVE_NOISE * float(np.max(quiet[:, at].std(axis=0)))
        found = _loudest(sensor, loud[:, at], quiet[:, at])
        if found is not None:
            known[sensor] = found
            wave = loud[:, at] @ np.array(found.vector)
            omegas[sensor] = float(np.std(np.diff(wave)) / np.std(wave)) / seconds
    if not known:
        return None
    kind, arm = "", None
    if len(limits) == len(_SENSORS):
        gravity = _level(beside, [axes.index(name) for name in _SENSORS["accel"]])
        omega = omegas.get("gyro", omegas.get("accel", 0.0))
        kind, arm = _kind(known, limits, gravity, omega / (2.0 * math.pi))
    directions = tuple(known.values())
    return Motion(directions, kind, arm, _words(directions, kind, arm))


def _level(beside: tuple[Array, Array], columns: Sequence[int]) -> Array:
    """Return the mean of some columns before and after a burst."""
    return np.asarray(np.concatenate(beside)[:, list(columns)].mean(axis=0))


def _loudest(sensor: str, loud: Array, quiet: Array) -> Direction | None:
    """Return the direction in which a burst exceeds the rows about it; None without one."""
    noise = np.array([_noise(*columns) for columns in zip(loud.T, quiet.T, strict=True)])
    values, vectors = np.linalg.eigh(np.cov(loud / noise, rowvar=False))
    # The burst may ring; what is across it says how many independent rows the noise has.
    rows = _independent((loud / noise) @ vectors[:, -2])
    if rows < _BURST_ROWS:
        return None
    scatter = (1.0 + math.sqrt(len(noise) / rows)) ** 2
    # Above noise at all, and above what is as loud across as along.
    if values[-1] < _ABOVE_NOISE * scatter * max(values[-2], 1.0):
        return None
    along, across = float(values[-1]), float(values[-2])
    vector = vectors[:, -1] * noise
    size = float(np.linalg.norm(vector))
    unit = vector / size
    unit = unit * np.sign(unit[int(np.argmax(np.abs(unit)))])
    amplitude = size * math.sqrt(along - 1.0)
    off = math.sqrt(2.0 * across / rows / (along - across))
    relative = TWO_SIDED_95 * math.sqrt((along - 0.5) / rows) / (along - 1.0)
    return Direction(
        sensor=sensor,
        vector=(float(unit[0]), float(unit[1]), float(unit[2])),
        error_deg=math.degrees(math.atan(off)),
        amplitude=amplitude,
        lower=amplitude * max(1.0 - relative, 0.0),
        upper=amplitude * (1.0 + relative),
        unit="dps" if sensor == "gyro" else "g",
        roundness=math.sqrt(max(across - 1.0, 0.0) / (along - 1.0)),
    )


def _noise(loud: Array, quiet: Array) -> float:
    """Return the deviation of quiet rows of an axis; of their rounding where they do not change.

    Of what never changes it may be anything: nothing is divided by it.
    """
    deviation = float(quiet.std())
    if deviation > 0.0:
        return deviation
    steps = np.diff(np.unique(loud))
    return float(steps.min()) / math.sqrt(12.0) if len(steps) else 1.0


def _independent(wave: Array) -> float:
    """Return how many independent rows these are worth."""
    n = len(wave)
    power = np.abs(np.fft.rfft(wave, 2 * n)) ** 2
    products = np.fft.irfft(power)[:n]
    if products[0] <= 0.0:  # an axis that stands still
        return 0.0
    squares = (products[1:] / products[0]) ** 2
    of_white = np.arange(n - 1, 0, -1) / n**2
    return float(n / (1.0 + 2.0 * max(np.sum(squares - of_white), 0.0)))


def _motion(
    vector: NDArray[np.complex128],
    error: Array,
    axes: Sequence[str],
    level: Array,
    frequency_hz: float | None,
) -> Motion | None:
    known, limits = {}, {}
    for sensor, names in _SENSORS.items():
        if not set(names) <= set(axes):
            continue
        at = [axes.index(name) for name in names]
        limits[sensor] = _SEEN * float(np.max(error[at]))
        # Values of one code have no error: their square must not be 0.
        if float(np.sum((np.abs(vector[at]) / np.maximum(error[at], 1e-150)) ** 2)) > _SEEN**2:
            known[sensor] = _direction(sensor, vector[at], error[at])
    if not known:
        return None
    kind, arm = "", None
    if frequency_hz and len(limits) == len(_SENSORS):
        gravity = level[[axes.index(name) for name in _SENSORS["accel"]]]
        kind, arm = _kind(known, limits, gravity, frequency_hz)
    found = tuple(known.values())
    return Motion(found, kind, arm, _words(found, kind, arm))


def _direction(sensor: str, vector: NDArray[np.complex128], error: Array) -> Direction:
    """Return a vector turned in phase until its real part is longest."""
    turned = vector * np.exp(-0.5j * np.angle(np.sum(vector**2)))
    along, across = turned.real, turned.imag
    size = float(np.linalg.norm(along))
    unit = along / size
    is_step = bool(np.all(vector.imag == 0))
    if not is_step and unit[int(np.argmax(np.abs(unit)))] < 0:
        unit = -unit
    if is_step and float(unit @ vector.real) < 0:
        unit = -unit
    off = math.sqrt(max(float(np.sum(error**2)) - float(np.sum((unit * error) ** 2)), 0.0))
    own = float(np.linalg.norm(unit * error))
    return Direction(
        sensor=sensor,
        vector=(float(unit[0]), float(unit[1]), float(unit[2])),
        error_deg=math.degrees(math.atan(off / size)),
        amplitude=size,
        lower=max(size - TWO_SIDED_95 * own, 0.0),
        upper=size + TWO_SIDED_95 * own,
        unit="dps" if sensor == "gyro" else "g",
        roundness=min(1.0, float(np.linalg.norm(across)) / size),
    )


def _kind(
    known: dict[str, Direction], limits: dict[str, float], gravity: Array, frequency_hz: float
) -> tuple[str, float | None]:
    """Return what moves, and how far away the axis of a rotation would have to be."""
    omega = 2.0 * math.pi * frequency_hz
    turn = known["gyro"].amplitude if "gyro" in known else limits["gyro"]
    push = known["accel"].amplitude if "accel" in known else limits["accel"]
    rate = math.radians(turn)
    axis = np.array(known["gyro"].vector) if "gyro" in known else np.zeros(3)
    tilt = float(np.linalg.norm(np.cross(axis, gravity))) * rate / omega
    arm = math.sqrt(max(push**2 - tilt**2, 0.0)) * GRAVITY / (rate * omega)
    if "accel" not in known:
        return ("rotation", arm) if arm < _FAR_M else ("", arm)
    if "gyro" not in known:
        return ("translation", arm) if arm > _NEAR_M else ("", arm)
    if arm <= _NEAR_M:
        return "rotation", arm
    return ("translation" if arm >= _FAR_M else "both"), arm


def _words(found: Sequence[Direction], kind: str, arm: float | None) -> str:
    parts = []
    for one in found:
        vector = ", ".join(f"{component:z.2f}" for component in one.vector)
        what = {"gyro": "rotation about", "accel": "acceleration along"}[one.sensor]
        parts.append(f"{what} ({vector}) ±{number(one.error_deg, 2)}°")
    if kind and len(found) == 1:
        unseen, pickup = (
            ("acceleration", "gyroscope")
            if kind == "rotation"
            else (
                "rotation",
                "accelerometer",
            )
        )
        parts.append(f"no {unseen} seen: {kind} of the board, or pickup in the {pickup}")
    elif kind and arm is not None:
        what = {
            "rotation": "rotation of the board",
            "translation": "translation",
            "both": "rotation and translation",
        }[kind]
        parts.append(f"{what} (axis at {number(100 * arm, 2)} cm)")
    return "; ".join(parts)
