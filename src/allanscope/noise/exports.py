"""The coefficients in the files of those who use them: Kalibr, ROS, VINS, MATLAB.

Half of the confusion about IMU noise is about two questions that each of these answers differently:
per sample or per root hertz, and whose units. Every file says so in comments::

    continuous   sigma_c = N in rad/s/sqrt(Hz), K in rad/s^2/sqrt(Hz)      Kalibr, MATLAB
    discrete     sigma_d = sigma_c sqrt(rate) for white noise,             VINS, ROS covariance
                 and K sqrt(rate) the way VINS puts it into its filter

One number stands for three axes: that of the worst axis, since a filter that believes in too little
noise diverges. Where K was not detected, its upper limit is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from allanscope.noise.coefficients import Coefficient
from allanscope.quantities import GRAVITY

__all__ = ["LAYOUTS", "kalibr_yaml", "matlab_imu_sensor", "ros_covariance_yaml", "vins_yaml"]

Coefficients = Mapping[str, Mapping[str, Coefficient]]
"""Axis name to coefficient name to coefficient, as in an Analysis."""

_TO_SI = {"g": float(np.pi / 180), "a": GRAVITY}
_SI = {"g": "rad/s", "a": "m/s^2"}


def kalibr_yaml(
    axes: Coefficients, rate_hz: float, *, rostopic: str = "/imu0", source: str = ""
) -> str:
    """Return an ``imu.yaml`` for Kalibr, with the six keys that it wants.

    Parameters
    ----------
    axes : mapping
        Coefficients of every axis.
    rate_hz : float
        Measured sample rate.
    rostopic : str
        Topic of the bag.
    source : str
        What was measured, for a comment.

    Raises
    ------
    ValueError
        If there is no gyro or no accelerometer axis.
    """
    gyro, accel = _worst(axes, "g"), _worst(axes, "a")
    return "\n".join(
        [
            "# Noise of an IMU for Kalibr, estimated by allanscope." + _of(source),
            "# Continuous-time values: white noise is N, the two-sided density of IEEE 952",
            "# (half of a datasheet's one-sided power density), random walk is K.",
            "# Each value is that of the worst axis.",
            *_remarks(gyro, accel),
            f"accelerometer_noise_density: {accel.white:.6e}   # m/s^2/sqrt(Hz)",
            f"accelerometer_random_walk: {accel.walk:.6e}   # m/s^3/sqrt(Hz)",
            f"gyroscope_noise_density: {gyro.white:.6e}   # rad/s/sqrt(Hz)",
            f"gyroscope_random_walk: {gyro.walk:.6e}   # rad/s^2/sqrt(Hz)",
            f"rostopic: {rostopic}",
            f"update_rate: {rate_hz:.6g}   # Hz",
            "",
        ]
    )


def ros_covariance_yaml(axes: Coefficients, rate_hz: float, *, source: str = "") -> str:
    """Return the covariances of a ROS ``sensor_msgs/Imu`` message, one variance an axis.

    Discrete: the variance of one sample, N^2 rate. With a low-pass in the sensor it is smaller;
    the value here is the one that, used once a sample, integrates correctly.
    """
    rows = [
        "# Covariances of sensor_msgs/Imu, estimated by allanscope." + _of(source),
        f"# Discrete: variance of one sample at {rate_hz:.6g} Hz, N^2 times the rate, row by row.",
    ]
    for kind, name in (("g", "angular_velocity"), ("a", "linear_acceleration")):
        variances = [
            (axes[axis]["N"].value * _TO_SI[kind]) ** 2 * rate_hz if axes.get(axis) else 0.0
            for axis in (f"{kind}{letter}" for letter in "xyz")
        ]
        matrix = ", ".join(f"{value:.6e}" for value in np.diag(variances).ravel())
        rows.append(f"{name}_covariance: [{matrix}]   # ({_SI[kind]})^2")
    return "\n".join([*rows, ""])


def vins_yaml(axes: Coefficients, rate_hz: float, *, source: str = "") -> str:
    """Return the IMU block of a VINS-Mono or VINS-Fusion configuration.

    Its integration multiplies these numbers by the time step and not by its root, so that they are
    discrete: N sqrt(rate) and K sqrt(rate).
    """
    gyro, accel = _worst(axes, "g"), _worst(axes, "a")
    root = float(np.sqrt(rate_hz))
    return "\n".join(
        [
            "# IMU noise for VINS-Mono and VINS-Fusion, estimated by allanscope." + _of(source),
            f"# Discrete values at {rate_hz:.6g} Hz: continuous-time N and K times sqrt(rate).",
            "# Each value is that of the worst axis.",
            *_remarks(gyro, accel),
            f"acc_n: {accel.white * root:.6e}   # m/s^2",
            f"gyr_n: {gyro.white * root:.6e}   # rad/s",
            f"acc_w: {accel.walk * root:.6e}   # m/s^3",
            f"gyr_w: {gyro.walk * root:.6e}   # rad/s^2",
            f"g_norm: {GRAVITY}   # m/s^2",
            "",
        ]
    )


def matlab_imu_sensor(axes: Coefficients, rate_hz: float, *, source: str = "") -> str:
    """Return a MATLAB script that makes an ``imuSensor`` with this noise, axis by axis.

    Continuous-time and double-sided: `NoiseDensity` is N, `BiasInstability` is B (the floor of the
    Allan deviation over 0.664), `RandomWalk` is K.
    """
    lines = [
        "% Noise of an IMU for imuSensor, estimated by allanscope." + _of(source),
        "% Continuous-time, double-sided densities (IEEE 952); B is the floor of ADEV over 0.664.",
        "% What was not detected is 0.",
        f"imu = imuSensor('accel-gyro', 'SampleRate', {rate_hz:.9g});",
    ]
    for kind, params in (("g", "Gyroscope"), ("a", "Accelerometer")):
        unit = _SI[kind]
        lines += [
            f"imu.{params}.NoiseType = 'double-sided';",
            f"imu.{params}.NoiseDensity = {_row(axes, kind, 'N')};   % ({unit})/sqrt(Hz)",
            f"imu.{params}.BiasInstability = {_row(axes, kind, 'B')};   % {unit}",
            f"imu.{params}.RandomWalk = {_row(axes, kind, 'K')};   % ({unit})*sqrt(Hz)",
        ]
    return "\n".join([*lines, ""])


LAYOUTS: Mapping[str, Callable[..., str]] = {
    "kalibr": kalibr_yaml,
    "ros": ros_covariance_yaml,
    "vins": vins_yaml,
    "matlab": matlab_imu_sensor,
}
"""Every file by whose it is: from axes, rate and ``source=`` to its text."""


@dataclass(frozen=True, slots=True)
class _Worst:
    """White noise and random walk of the worst axis of one sensor, in SI."""

    white: float
    walk: float
    limits: tuple[str, ...]


def _worst(axes: Coefficients, kind: str) -> _Worst:
    mine = {name: found for name, found in axes.items() if name.startswith(kind) and found}
    if not mine:
        sensor = "gyro" if kind == "g" else "accelerometer"
        raise ValueError(f"no {sensor} axis was measured for long enough")
    return _Worst(
        white=_TO_SI[kind] * max(found["N"].value for found in mine.values()),
        walk=_TO_SI[kind] * max(_or_limit(found["K"]) for found in mine.values()),
        limits=tuple(sorted(name for name, found in mine.items() if not found["K"].detected)),
    )


def _or_limit(coefficient: Coefficient) -> float:
    return coefficient.value if coefficient.detected else coefficient.upper


def _row(axes: Coefficients, kind: str, name: str) -> str:
    values = []
    for letter in "xyz":
        found = axes.get(f"{kind}{letter}")
        values.append(found[name].value * _TO_SI[kind] if found and found[name].detected else 0.0)
    return "[" + " ".join(f"{value:.6e}" for value in values) + "]"


def _remarks(*sensors: _Worst) -> list[str]:
    names = [name for sensor in sensors for name in sensor.limits]
    if not names:
        return []
    return [f"# Random walk not detected on {' '.join(names)}: its upper limit was taken there."]


def _of(source: str) -> str:
    # A name must not end the comment that it stands in.
    shown = "".join(letter if letter.isprintable() else "?" for letter in source)
    return f" Source: {shown}" if source else ""
