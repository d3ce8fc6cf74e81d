"""What an LSM6DS3H, LSM6DSL or LSM6DSM is: scales, rates, filters, temperature, datasheet noise.

Values are those of the ST datasheets DocID028475 Rev 7 (LSM6DSL) and DocID028165 (LSM6DSM), and of
ST's register drivers. What ST does not publish is None here and is reported as such. DSL and DSM
share a WHO_AM_I, and so do DS3 and DS3H: a stream cannot tell them apart, the user must.

Parts beyond these three (`Part.beyond`) come with the boards of today, whose streams and files name
them: scales, rates and what of the noise we found written, so that a verdict is possible. Their
filters are not known here and are left to the fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from allanscope.errors import UsageError

__all__ = [
    "ACCEL_CUTOFF_SHARES",
    "ACCEL_SCALES",
    "GYRO_CUTOFF_SHARE",
    "GYRO_LPF1_HZ",
    "GYRO_SCALES",
    "OSCILLATOR_TOLERANCE",
    "PARTS",
    "RESET_FULL_SCALES",
    "Mode",
    "Part",
    "full_scale_of",
    "part_named",
]

GYRO_SCALES: Mapping[float, float] = {
    125.0: 4.375e-3,
    250.0: 8.75e-3,
    500.0: 17.5e-3,
    1000.0: 35e-3,
    2000.0: 70e-3,
}
"""dps per count at each full scale in dps. Not full scale / 32768: 2000 dps reaches 2293.76."""

_WIDE_GYRO_SCALES: Mapping[float, float] = {**GYRO_SCALES, 4000.0: 140e-3}
"""The same for parts that reach 4000 dps."""

ACCEL_SCALES: Mapping[float, float] = {2.0: 0.061e-3, 4.0: 0.122e-3, 8.0: 0.244e-3, 16.0: 0.488e-3}
"""g per count at each full scale in g."""

GYRO_LPF1_HZ: Mapping[float, tuple[float, ...]] = {
    833.0: (293.0, 245.0, 195.0, 155.0),
    1660.0: (505.0, 315.0, 224.0, 168.0),
    3330.0: (925.0, 343.0, 234.0, 172.0),
    6660.0: (937.0, 351.0, 237.0, 173.0),
}
"""Cutoffs in Hz that LPF1 of the gyro can be set to (FTYPE) at each rate: datasheet table 68."""

GYRO_CUTOFF_SHARE = 0.32
"""Cutoff of the gyro's fixed LPF2 as a part of the rate, below 833 Hz. The datasheets print no
table; a public driver gives 66.8 Hz at 208 Hz for a sibling. Offered to a fit, never assumed."""

ACCEL_CUTOFF_SHARES = (1 / 2, 1 / 4, 1 / 9, 1 / 50, 1 / 100, 1 / 400)
"""Cutoffs of the accelerometer's LPF1 and LPF2 settings as parts of the rate: table 73."""

RESET_FULL_SCALES: Mapping[str, float] = {"gyro": 250.0, "accel": 2.0}
"""Full scales in dps and g that these parts have until somebody writes to their registers."""

OSCILLATOR_TOLERANCE = 0.1
"""The sample rate of no part is off by a larger share: the datasheets say 6.5 or 7 per cent."""

Mode = Literal["high-performance", "normal", "low-power"]
"""Power mode, on which the published noise depends."""


@dataclass(frozen=True, slots=True)
class Part:
    """One sensor part number.

    Attributes
    ----------
    name : str
        As ST writes it.
    who_am_i : int
        Content of register 0x0F.
    rates_hz : tuple of float
        Output data rates that the part offers to both sensors.
    gyro_density : float or None
        Typical rate noise density in high-performance mode, dps/sqrt(Hz), one-sided.
    accel_density : mapping or None
        Typical acceleration noise density in high-performance mode for each full scale in g,
        g/sqrt(Hz), one-sided.
    gyro_rms, accel_rms : float, mapping or None
        Typical rms noise in normal and low-power mode (dps; g for each full scale).
    zero_rate_dps, zero_g_g : float or None
        Typical offset.
    zero_rate_dps_per_c, zero_g_g_per_c : float or None
        Typical change of the offset with temperature.
    temperature_lsb_per_c : float
        Sensitivity of the temperature output; 0 counts mean 25 degC.
    source : str
        Where the noise values come from.
    gyro_scales, accel_scales : mapping
        dps and g per count at each full scale, ascending.
    beyond : bool
        True for a part beyond the three that the program is made for.
    second_hand : bool
        True where `source` is one that quotes the datasheet: figures that were not verified in
        it. A verdict says so.
    """

    name: str
    who_am_i: int
    rates_hz: tuple[float, ...]
    gyro_density: float | None
    accel_density: Mapping[float, float] | None
    gyro_rms: float | None
    accel_rms: Mapping[float, float] | None
    zero_rate_dps: float | None
    zero_g_g: float | None
    zero_rate_dps_per_c: float | None
    zero_g_g_per_c: float | None
    temperature_lsb_per_c: float
    source: str
    gyro_scales: Mapping[float, float] = field(default_factory=lambda: GYRO_SCALES)
    accel_scales: Mapping[float, float] = field(default_factory=lambda: ACCEL_SCALES)
    beyond: bool = False
    second_hand: bool = False

    def gyro_scale(self, full_scale_dps: float) -> float:
        """Return dps per count; UsageError for a full scale that the part does not have."""
        return _scale(self.gyro_scales, full_scale_dps, "gyro", "dps")

    def accel_scale(self, full_scale_g: float) -> float:
        """Return g per count; UsageError for a full scale that the part does not have."""
        return _scale(self.accel_scales, full_scale_g, "accelerometer", "g")

    def mode(self, rate_hz: float, *, high_performance: bool = True) -> Mode:
        """Return the power mode at a rate: what the HM_MODE bits leave open, the rate decides.

        With high performance switched off, 104 and 208 Hz are normal mode and lower rates low
        power; higher rates are always high performance (datasheet sections 5.2 and 5.3).

        Examples
        --------
        >>> part_named("LSM6DSL").mode(104.0, high_performance=False)
        'normal'
        """
        if high_performance or rate_hz > 300.0:
            return "high-performance"
        return "normal" if rate_hz > 75.0 else "low-power"

    def cutoffs_hz(self, axis: str, rate_hz: float) -> tuple[float, ...]:
        """Return the -3 dB frequencies that the part's digital filters may have at a rate.

        Only those below the Nyquist frequency; they are where a fit of the band limit starts. None
        for parts whose filters are not known here.

        Examples
        --------
        >>> part_named("LSM6DSM").cutoffs_hz("gx", 208.0)
        (66.56,)
        """
        if self.beyond:
            return ()
        if axis.startswith("a"):
            return tuple(share * rate_hz for share in ACCEL_CUTOFF_SHARES if share < 0.5)
        settings = [GYRO_LPF1_HZ[rate] for rate in GYRO_LPF1_HZ if abs(rate_hz / rate - 1) < 0.1]
        if settings:
            return tuple(cutoff for cutoff in settings[0] if cutoff < rate_hz / 2)
        return (GYRO_CUTOFF_SHARE * rate_hz,)


def _scale(table: Mapping[float, float], full_scale: float, sensor: str, unit: str) -> float:
    if full_scale not in table:
        choices = ", ".join(f"{value:g}" for value in table)
        raise UsageError(
            f"no {sensor} full scale of {full_scale:g} {unit}; choose one of {choices}"
        )
    return table[full_scale]


_RATES = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1660.0, 3330.0, 6660.0)
_RATES_OF_TODAY = (7.5, 15.0, 30.0, 60.0, 120.0, 240.0, 480.0, 960.0, 1920.0, 3840.0, 7680.0)
_ACCEL_RMS = {2.0: 1.8e-3, 4.0: 2.0e-3, 8.0: 2.4e-3, 16.0: 3.0e-3}
_UNPUBLISHED = "not published"


def _hardly_published(
    name: str,
    who_am_i: int,
    rates_hz: tuple[float, ...],
    *,
    gyro_density: float | None = None,
    accel_density: Mapping[float, float] | None = None,
    source: str = _UNPUBLISHED,
) -> Part:
    """Return a part of today of whose noise at most the densities could be read anywhere."""
    return Part(
        name=name,
        who_am_i=who_am_i,
        rates_hz=rates_hz,
        gyro_density=gyro_density,
        accel_density=accel_density,
        gyro_rms=None,
        accel_rms=None,
        zero_rate_dps=None,
        zero_g_g=None,
        zero_rate_dps_per_c=None,
        zero_g_g_per_c=None,
        temperature_lsb_per_c=256.0,
        source=source,
        gyro_scales=_WIDE_GYRO_SCALES,
        beyond=True,
        second_hand=source != _UNPUBLISHED,
    )


PARTS: Mapping[str, Part] = {
    "LSM6DS3H": Part(
        name="LSM6DS3H",
        who_am_i=0x69,
        rates_hz=tuple(rate for rate in _RATES if rate <= 1660.0),
        gyro_density=None,
        accel_density=None,
        gyro_rms=None,
        accel_rms=None,
        zero_rate_dps=None,
        zero_g_g=None,
        zero_rate_dps_per_c=None,
        zero_g_g_per_c=None,
        temperature_lsb_per_c=16.0,
        source=_UNPUBLISHED,
    ),
    "LSM6DSL": Part(
        name="LSM6DSL",
        who_am_i=0x6A,
        rates_hz=_RATES,
        gyro_density=4e-3,
        accel_density={2.0: 80e-6, 4.0: 80e-6, 8.0: 90e-6, 16.0: 130e-6},
        gyro_rms=75e-3,
        accel_rms=_ACCEL_RMS,
        zero_rate_dps=3.0,
        zero_g_g=40e-3,
        zero_rate_dps_per_c=15e-3,
        zero_g_g_per_c=0.1e-3,
        temperature_lsb_per_c=256.0,
        source="LSM6DSL datasheet DocID028475 Rev 7, tables 3 and 4",
    ),
    "LSM6DSM": Part(
        name="LSM6DSM",
        who_am_i=0x6A,
        rates_hz=_RATES,
        gyro_density=3.8e-3,
        accel_density={2.0: 90e-6, 4.0: 90e-6, 8.0: 90e-6, 16.0: 130e-6},
        gyro_rms=75e-3,
        accel_rms=_ACCEL_RMS,
        zero_rate_dps=3.0,
        zero_g_g=40e-3,
        zero_rate_dps_per_c=15e-3,
        zero_g_g_per_c=0.1e-3,
        temperature_lsb_per_c=256.0,
        source="LSM6DSM datasheet, tables 3 and 4",
    ),
    "LSM6DSO": Part(
        name="LSM6DSO",
        who_am_i=0x6C,
        rates_hz=_RATES,
        gyro_density=3.8e-3,
        accel_density={2.0: 70e-6, 4.0: 75e-6, 8.0: 80e-6, 16.0: 110e-6},
        gyro_rms=None,
        accel_rms=_ACCEL_RMS,
        zero_rate_dps=1.0,
        zero_g_g=20e-3,
        zero_rate_dps_per_c=10e-3,
        zero_g_g_per_c=None,
        temperature_lsb_per_c=256.0,
        source="LSM6DSO datasheet DS12140 Rev 2, table 2",
        beyond=True,
    ),
    "ISM330DHCX": Part(
        name="ISM330DHCX",
        who_am_i=0x6B,
        rates_hz=_RATES,
        gyro_density=5e-3,
        accel_density={2.0: 60e-6},
        gyro_rms=None,
        accel_rms=None,
        zero_rate_dps=1.0,
        zero_g_g=10e-3,
        zero_rate_dps_per_c=None,
        zero_g_g_per_c=0.1e-3,
        temperature_lsb_per_c=256.0,
        source="ISM330DHCX datasheet DS13012 Rev 6, as quoted in public course notes",
        gyro_scales=_WIDE_GYRO_SCALES,
        beyond=True,
        second_hand=True,
    ),
    **{
        part.name: part
        for part in (
            _hardly_published(
                "LSM6DSV",
                0x70,
                _RATES_OF_TODAY,
                gyro_density=2.8e-3,
                accel_density={2.0: 60e-6},
                source="LSM6DSV datasheet, as quoted by Luxonis",
            ),
            _hardly_published("LSM6DSV16X", 0x70, _RATES_OF_TODAY),
            *(
                _hardly_published(name, 0x6B, _RATES)
                for name in ("LSM6DSR", "ASM330LHH", "ASM330LHHX")
            ),
        )
    },
}
"""Every part that allanscope knows, by name."""


def full_scale_of(axis: str, scale: float) -> float | None:
    """Return the full scale in dps or g that has a scale per count; None where none has.

    Examples
    --------
    >>> full_scale_of("gx", 8.75e-3), full_scale_of("ax", 1.0)
    (250.0, None)
    """
    table = _WIDE_GYRO_SCALES if axis.startswith("g") else ACCEL_SCALES
    return next((full for full, step in table.items() if abs(scale / step - 1) < 1e-3), None)


def part_named(name: str) -> Part:
    """Return a part by its name, in any case.

    Raises
    ------
    UsageError
        If there is none; the message lists all.

    Examples
    --------
    >>> part_named("lsm6dsm").gyro_density
    0.0038
    """
    part = PARTS.get(name.upper())
    if part is None:
        raise UsageError(f"unknown part {name!r}; choose one of {', '.join(PARTS)}")
    return part
