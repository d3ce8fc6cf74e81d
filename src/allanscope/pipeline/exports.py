"""The coefficients in the files of others: Kalibr, OpenVINS, ORB-SLAM3, VINS, ROS, MATLAB.

Half of the confusion about IMU noise is about two questions that each of these answers differently:
per sample or per root hertz, and whose units. Every file says so in comments::

    continuous   sigma_c = N in rad/s/sqrt(Hz), K in rad/s^2/sqrt(Hz)      Kalibr, OpenVINS,
                                                                           ORB-SLAM3, MATLAB
    discrete     sigma_d = sigma_c sqrt(rate) for white noise,             VINS, ROS covariance
                 and K sqrt(rate) the way VINS puts it into its filter

Where one number stands for three axes it is that of the worst axis, since a filter that believes in
too little noise diverges.

A short record gives only an upper limit of K, and often of B. A limit is no estimate, and a file
has no way to tell the two apart. So whoever asks for one says what is to be written:
``upper_limits="include"`` the limits, ``"zero"`` 0 for what was not detected. The default is to
refuse.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from allanscope.allan import Deviation
from allanscope.noise import Coefficient, bound_model
from allanscope.quantities import GRAVITY

__all__ = [
    "CONTENTS",
    "LAYOUTS",
    "NotDetected",
    "UpperLimits",
    "bound_yaml",
    "coefficients_file",
]

UpperLimits = Literal["refuse", "include", "zero"]
"""What is written for a coefficient of which only an upper limit is known."""

Coefficients = Mapping[str, Mapping[str, Coefficient]]
"""Axis name to coefficient name to coefficient, as in an Analysis."""

_TO_SI = {"g": float(np.pi / 180), "a": GRAVITY}
_SI = {"g": "rad/s", "a": "m/s^2"}


def coefficients_file(
    layout: str,
    axes: Coefficients,
    rate_hz: float,
    *,
    source: str = "",
    upper_limits: UpperLimits = "refuse",
) -> str:
    """Return the coefficients of a sensor in the file of another program.

    Parameters
    ----------
    layout : str
        One of `LAYOUTS`.
    axes : mapping
        Coefficients of every axis.
    rate_hz : float
        Measured sample rate.
    source : str
        What was measured, for a comment.
    upper_limits : {'refuse', 'include', 'zero'}
        What is written where only an upper limit is known.

    Raises
    ------
    NotDetected
        If an upper limit would be written and `upper_limits` does not allow it.
    ValueError
        If there is no gyro or no accelerometer axis.
    """
    return LAYOUTS[layout](_Values(axes, upper_limits, source), rate_hz)


def _kalibr(values: _Values, rate_hz: float) -> str:
    """Return an ``imu.yaml`` for Kalibr, with the six keys that it wants."""
    lines = [*_densities(values), "rostopic: /imu0", f"update_rate: {rate_hz:.6g}   # Hz"]
    return values.file("#", _continuous("Kalibr"), lines)


def _openvins(values: _Values, rate_hz: float) -> str:
    """Return a ``kalibr_imu_chain.yaml`` for OpenVINS.

    The IMU frame is the body frame and the intrinsics are the identity: `model: "kalibr"`.
    """
    lines = [
        "imu0:",
        "  T_i_b:",
        *(f"    - {_unit_row(k, 4)}" for k in range(4)),
        *(f"  {line}" for line in _densities(values)),
        "  rostopic: /imu0",
        "  time_offset: 0.0",
        f"  update_rate: {rate_hz:.6g}   # Hz",
        '  model: "kalibr"',
    ]
    for name in ("Tw", "R_IMUtoGYRO", "Ta", "R_IMUtoACC"):
        lines += [f"  {name}:", *(f"    - {_unit_row(k, 3)}" for k in range(3))]
    lines += ["  Tg:", *(["    - [0.0, 0.0, 0.0]"] * 3)]
    return "%YAML:1.0\n" + values.file("#", _continuous("OpenVINS"), lines)


def _orb_slam3(values: _Values, rate_hz: float) -> str:
    """Return the five lines on the IMU in the settings file of ORB-SLAM3, to be copied there."""
    gyro_n, gyro_k = values.worst("g", "N"), values.worst("g", "K")
    accel_n, accel_k = values.worst("a", "N"), values.worst("a", "K")
    lines = [
        f"IMU.NoiseGyro: {gyro_n:.6e}   # rad/s/sqrt(Hz)",
        f"IMU.NoiseAcc: {accel_n:.6e}   # m/s^2/sqrt(Hz)",
        f"IMU.GyroWalk: {gyro_k:.6e}   # rad/s^2/sqrt(Hz)",
        f"IMU.AccWalk: {accel_k:.6e}   # m/s^3/sqrt(Hz)",
        f"IMU.Frequency: {rate_hz:.1f}   # Hz",
    ]
    return values.file("#", _continuous("ORB-SLAM3"), lines)


def _each_axis(values: _Values, rate_hz: float) -> str:
    """Return N, B and K of every axis by itself, in SI units."""
    numbers = {
        kind: [values.each(kind, letter) for letter in "NBK"]
        for kind in "ga"
        if any(values.axes.get(f"{kind}{direction}") for direction in "xyz")
    }
    lines = [f"update_rate: {rate_hz:.6g}   # Hz"]
    for kind, columns in numbers.items():
        unit = _SI[kind]
        for direction, (n, b, k) in zip("xyz", zip(*columns, strict=True), strict=True):
            if not values.axes.get(f"{kind}{direction}"):
                continue
            lines += [
                f"{kind}{direction}:",
                f"  noise_density: {n:.6e}   # {unit}/sqrt(Hz), two-sided (N)",
                f"  bias_instability: {b:.6e}   # {unit} (B)",
                f"  random_walk: {k:.6e}   # {unit}/sqrt(s) (K)",
            ]
    about = "Noise of each axis of an IMU, estimated by allanscope."
    return values.file("#", [about, "Continuous-time values of IEEE 952, in SI units."], lines)


def _ros_covariance(values: _Values, rate_hz: float) -> str:
    """Return the covariances of a ROS ``sensor_msgs/Imu`` message, one variance an axis.

    Discrete: the variance of one sample, N^2 rate. With a low-pass in the sensor it is smaller;
    the value here is the one that, used once a sample, integrates correctly.
    """
    lines = []
    for kind, name in (("g", "angular_velocity"), ("a", "linear_acceleration")):
        variances = np.square(values.each(kind, "N")) * rate_hz
        matrix = ", ".join(f"{value:.6e}" for value in np.diag(variances).ravel())
        lines.append(f"{name}_covariance: [{matrix}]   # ({_SI[kind]})^2")
    about = [
        "Covariances of sensor_msgs/Imu, estimated by allanscope.",
        f"Discrete: variance of one sample at {rate_hz:.6g} Hz, N^2 times the rate, row by row.",
    ]
    return values.file("#", about, lines)


def _vins(values: _Values, rate_hz: float) -> str:
    """Return the IMU block of a VINS-Mono or VINS-Fusion configuration.

    Its integration multiplies these numbers by the time step and not by its root, so that they are
    discrete: N sqrt(rate) and K sqrt(rate).
    """
    root = float(np.sqrt(rate_hz))
    gyro_n, gyro_k = (values.worst("g", name) * root for name in "NK")
    accel_n, accel_k = (values.worst("a", name) * root for name in "NK")
    return values.file(
        "#",
        [
            "IMU noise for VINS-Mono and VINS-Fusion, estimated by allanscope.",
            f"Discrete values at {rate_hz:.6g} Hz: continuous-time N and K times sqrt(rate).",
            "Each value is that of the worst axis.",
        ],
        [
            f"acc_n: {accel_n:.6e}   # m/s^2",
            f"gyr_n: {gyro_n:.6e}   # rad/s",
            f"acc_w: {accel_k:.6e}   # m/s^3",
            f"gyr_w: {gyro_k:.6e}   # rad/s^2",
            f"g_norm: {GRAVITY}   # m/s^2",
        ],
    )


def _matlab_imu_sensor(values: _Values, rate_hz: float) -> str:
    """Return a MATLAB script that makes an ``imuSensor`` with this noise, axis by axis.

    Continuous-time and double-sided: `NoiseDensity` is N, `BiasInstability` is B (the floor of the
    Allan deviation over 0.664), `RandomWalk` is K.
    """
    about = [
        "Noise of an IMU for imuSensor, estimated by allanscope.",
        "Continuous-time, double-sided densities (IEEE 952); B is the floor of ADEV over 0.664.",
    ]
    lines = [f"imu = imuSensor('accel-gyro', 'SampleRate', {rate_hz:.9g});"]
    for kind, params in (("g", "Gyroscope"), ("a", "Accelerometer")):
        unit = _SI[kind]
        lines += [
            f"imu.{params}.NoiseType = 'double-sided';",
            f"imu.{params}.NoiseDensity = {values.row(kind, 'N')};   % ({unit})/sqrt(Hz)",
            f"imu.{params}.BiasInstability = {values.row(kind, 'B')};   % {unit}",
            f"imu.{params}.RandomWalk = {values.row(kind, 'K')};   % ({unit})*sqrt(Hz)",
        ]
    return values.file("%", about, lines)


def bound_yaml(curves: Mapping[str, Deviation], *, source: str = "") -> str:
    """Return for each axis a model whose variance is above what was measured at 1 to 1000 s.

    Parameters
    ----------
    curves : mapping
        OADEV of every axis, in dps and g.
    source : str
        What was measured, for a comment.

    Raises
    ------
    ValueError
        If an axis was not measured for long enough.
    """
    comments = [
        "A bound on the noise of an IMU at rest, set by allanscope." + _of(source),
        "White noise, a first-order Gauss-Markov process and a random walk, for each axis: the",
        "variance of the integrated signal that they predict is above that of another such record",
        "at 95 % of the averaging times between from and to. inflation is the mean ratio of the",
        "bound's Allan deviation to the measured one: inflate no further.",
        "Not in this bound, as a record at rest does not show them: errors of scale factor and",
        "alignment, sensitivity to acceleration and vibration, and other temperatures.",
    ]
    lines = []
    for axis, curve in curves.items():
        bound = bound_model(curve)
        if bound is None:
            raise ValueError(f"{axis} was not measured for long enough for a bound at 1 s and more")
        to_si, unit = _TO_SI[axis[0]], _SI[axis[0]]
        lines += [
            f"{axis}:",
            f"  noise_density: {to_si * bound.N:.6e}   # {unit}/sqrt(Hz), two-sided (N)",
            f"  gauss_markov_sigma: {to_si * bound.sigma:.6e}   # {unit}",
            f"  gauss_markov_time: {bound.correlation_time_s:.6g}   # s",
            f"  random_walk: {to_si * bound.K:.6e}   # {unit}/sqrt(s) (K)",
            f"  from: {bound.shortest_s:.4g}   # s",
            f"  to: {bound.longest_s:.4g}   # s",
            f"  inflation: {bound.inflation:.3f}",
        ]
    return "\n".join([*(f"# {text}" for text in comments), *lines, ""])


def _continuous(whose: str) -> list[str]:
    """Return the comments of a file with continuous-time values of the worst axis."""
    return [
        f"Noise of an IMU for {whose}, estimated by allanscope.",
        "Continuous-time values: white noise is N, the two-sided density of IEEE 952",
        "(half of a datasheet's one-sided power density), random walk is K.",
        "Each value is that of the worst axis.",
    ]


def _densities(values: _Values) -> list[str]:
    """Return the four lines on noise that Kalibr and OpenVINS read."""
    gyro_n, gyro_k = values.worst("g", "N"), values.worst("g", "K")
    accel_n, accel_k = values.worst("a", "N"), values.worst("a", "K")
    return [
        f"accelerometer_noise_density: {accel_n:.6e}   # m/s^2/sqrt(Hz)",
        f"accelerometer_random_walk: {accel_k:.6e}   # m/s^3/sqrt(Hz)",
        f"gyroscope_noise_density: {gyro_n:.6e}   # rad/s/sqrt(Hz)",
        f"gyroscope_random_walk: {gyro_k:.6e}   # rad/s^2/sqrt(Hz)",
    ]


def _unit_row(k: int, n: int) -> str:
    return str([float(i == k) for i in range(n)])


CONTENTS: Mapping[str, str] = {
    "kalibr": "N and K of the worst axis for Kalibr, continuous",
    "openvins": "N and K of the worst axis for OpenVINS, continuous",
    "orb-slam3": "N and K of the worst axis for ORB-SLAM3, continuous",
    "vins": "N and K of the worst axis for VINS, discrete",
    "ros": "variances of sensor_msgs/Imu, discrete",
    "axes": "N, B and K of each axis, continuous",
    "matlab": "N, B and K of each axis for imuSensor, continuous",
    "bound": "a bound on the noise of each axis",
}
"""What each file has, to be said when it is written."""


class NotDetected(ValueError):
    """A file would state an upper limit as if it were the coefficient."""


class _Values:
    """The numbers that a file gets, in SI, and which of them are upper limits."""

    def __init__(self, axes: Coefficients, upper_limits: UpperLimits, source: str) -> None:
        if upper_limits not in ("refuse", "include", "zero"):
            raise ValueError(
                f"unknown upper_limits {upper_limits!r}; choose refuse, include or zero"
            )
        self.axes = axes
        self._upper_limits = upper_limits
        self._source = source
        self._limited: dict[str, list[str]] = {}

    def each(self, kind: str, name: str) -> list[float]:
        """Return a coefficient of the three axes of a sensor; 0 for an axis without any."""
        numbers = []
        for axis in (f"{kind}{letter}" for letter in "xyz"):
            found = self.axes.get(axis)
            if not found:
                numbers.append(0.0)
                continue
            if not found[name].detected:
                self._limited.setdefault(name, []).append(axis)
            numbers.append(_TO_SI[kind] * self._number(found[name]))
        return numbers

    def worst(self, kind: str, name: str) -> float:
        """Return the coefficient of the worst axis of a sensor.

        An upper limit below what another axis is known to have changes nothing.
        """
        mine = {axis: found[name] for axis, found in self.axes.items() if axis[0] == kind and found}
        if not mine:
            sensor = "gyro" if kind == "g" else "accelerometer"
            raise ValueError(f"no {sensor} axis was measured for long enough")
        known = max((found.value for found in mine.values() if found.detected), default=0.0)
        for axis, found in sorted(mine.items()):
            if not found.detected and found.upper > known:
                self._limited.setdefault(name, []).append(axis)
        return _TO_SI[kind] * max(known, *(self._number(found) for found in mine.values()))

    def row(self, kind: str, name: str) -> str:
        """Return a coefficient of the three axes of a sensor as a row vector."""
        return "[" + " ".join(f"{value:.6e}" for value in self.each(kind, name)) + "]"

    def file(self, comment: str, about: list[str], lines: list[str]) -> str:
        """Return a file: comments on what it is and on what was not detected, then its lines.

        Raises
        ------
        NotDetected
            Where something was not detected, and that is to be refused.
        """
        remarks = []
        if self._limited:
            what = ", ".join(f"{name} on {' '.join(on)}" for name, on in self._limited.items())
            if self._upper_limits == "refuse":
                raise NotDetected(f"not detected, only an upper limit is known: {what}")
            number = "the upper limit" if self._upper_limits == "include" else "0"
            remarks.append(f"Not detected: {what}; {number} is given instead.")
        comments = [about[0] + _of(self._source), *about[1:], *remarks]
        return "\n".join([*(f"{comment} {text}" for text in comments), *lines, ""])

    def _number(self, found: Coefficient) -> float:
        if found.detected:
            return found.value
        return 0.0 if self._upper_limits == "zero" else found.upper


def _of(source: str) -> str:
    # A name must not end the comment that it stands in.
    shown = "".join(letter if letter.isprintable() else "?" for letter in source)
    return f" Source: {shown}" if source else ""


LAYOUTS: Mapping[str, Callable[[_Values, float], str]] = {
    "kalibr": _kalibr,
    "openvins": _openvins,
    "orb-slam3": _orb_slam3,
    "vins": _vins,
    "ros": _ros_covariance,
    "axes": _each_axis,
    "matlab": _matlab_imu_sensor,
}
"""Every file by whose it is: from coefficients and rate to its text."""
