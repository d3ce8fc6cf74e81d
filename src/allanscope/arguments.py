"""The arguments of each command.

One function for each command, of the same name; below them the groups of options that several
commands share. Nothing heavy is imported: names of parts and effects are checked when the command
runs.
"""

from __future__ import annotations

import argparse
import re
from argparse import ArgumentParser, Namespace, _ActionsContainer
from collections.abc import Mapping

__all__ = [
    "SUGGESTIONS",
    "analyse",
    "chart",
    "check",
    "completion",
    "convert",
    "device",
    "doctor",
    "export_data",
    "fleet",
    "import_data",
    "live",
    "nothing",
    "open_view",
    "recover",
    "replay",
    "report",
    "simulate",
    "stability",
    "together",
    "verify",
]

SUGGESTIONS: Mapping[str, tuple[str, ...]] = {
    "port": ("auto", "sim", "iio"),
    "part": (
        *("LSM6DS3H", "LSM6DSL", "LSM6DSM", "LSM6DSO", "LSM6DSR", "LSM6DSV", "LSM6DSV16X"),
        *("ISM330DHCX", "ASM330LHH", "ASM330LHHX"),
    ),
    "wire": ("native", "sdatalog", "tmsg", "tmsg-sensortile", "datalog", "datalog11", "text"),
    "taus": ("octave", "decade", "many", "all"),
    "noise_type": ("WPM", "FPM", "WFM", "FFM", "RWFM", "FWFM", "RRFM"),
    "speed": ("1", "10", "max"),
}
"""Values that a shell offers for arguments that take others too, or are checked later."""


def live(one: ArgumentParser) -> None:
    """Add the arguments of a live run."""
    one.add_argument(
        "port",
        nargs="?",
        default="auto",
        help="device path, pyserial URL, iio or iio:NAME (sensor of Linux IIO), auto (find the "
        "board; default) or sim (simulated board)",
    )
    one.add_argument(
        "--baud",
        type=int,
        metavar="N",
        help="baud rate of a UART (default: 115200; 1843200 with --wire sdatalog)",
    )
    one.add_argument("--resume", metavar="DIR", help="continue an interrupted session, at its port")
    _duration_argument(one)
    _session_arguments(one)
    _device_arguments(one)
    _simulated_arguments(one)


def replay(one: ArgumentParser) -> None:
    """Add the arguments of a replay."""
    one.add_argument("recording", help="recording or session folder")
    one.add_argument(
        "--speed", default="max", type=_speed, help="1 (real time), 10 or max (default)"
    )
    _session_arguments(one)
    _device_arguments(one)


def open_view(one: ArgumentParser) -> None:
    """Add the arguments of opening the charts of a session."""
    one.add_argument(
        "session", help="session folder, its .rrd, or the address that a live run prints"
    )
    one.add_argument(
        "--view",
        default="auto",
        choices=["auto", "window", "web"],
        help="viewer; auto (default): a window if there is a display, else the browser",
    )
    _view_port_argument(one)


def analyse(one: ArgumentParser) -> None:
    """Add the arguments of an analysis."""
    one.add_argument(
        "input",
        help="recording, session folder, raw serial capture, delimited text, ROS 2 bag (.mcap, "
        ".db3 or its folder), HSDatalog or libiio folder, .ulg, .npz, .npy, .mat or Parquet",
    )
    one.add_argument("--json", metavar="FILE", help="write the result as JSON; - prints it")
    one.add_argument("--report", metavar="FILE.html", help="write the report")
    one.add_argument("--table", metavar="FILE.csv", help="write all curves as a table")
    _compare_argument(one)
    _report_arguments(one)
    _curve_arguments(one)
    _device_arguments(one)


def simulate(one: ArgumentParser) -> None:
    """Add the arguments of a simulated recording."""
    one.add_argument("out", help="recording to write")
    one.add_argument(
        "--hours", type=float, default=1.0, help="length of the recording (default: 1)"
    )
    _sensor_arguments(one)
    _simulated_arguments(one, with_line=False)


def device(one: ArgumentParser) -> None:
    """Add the arguments of the simulated device."""
    one.add_argument(
        "--emulated",
        action="store_true",
        help="run the real firmware on an emulated STM32L475; needs a checkout, "
        "gcc-arm-none-eabi, make and qemu-system-arm 10",
    )
    one.add_argument("--link", metavar="PATH", help="path of the port (default: in a new folder)")
    one.add_argument(
        "--json", action="store_true", help="print the counts of sent and lost samples at the end"
    )
    _duration_argument(one)
    _sensor_arguments(one)
    _simulated_arguments(one)


def import_data(one: ArgumentParser) -> None:
    """Add the arguments of an import."""
    one.add_argument(
        "input", help="raw serial capture, delimited text, ROS 2 bag or file of arrays"
    )
    one.add_argument("out", help="recording to write")
    _device_arguments(one)


def export_data(one: ArgumentParser) -> None:
    """Add the arguments of an export."""
    one.add_argument("recording", help="recording, session folder, raw capture or text")
    one.add_argument("out", help="file to write: .csv, .parquet, .yaml or .m (MATLAB)")
    one.add_argument(
        "--layout",
        choices=["kalibr", "openvins", "orb-slam3", "vins", "ros", "axes"],
        help="format of the .yaml; axes: every axis by itself (default: kalibr)",
    )
    one.add_argument(
        "--upper-limits",
        choices=["include", "zero", "refuse"],
        help="undetected coefficients in a .yaml or .m: write the upper limit, write 0, or write "
        "no file and name them (default)",
    )
    one.add_argument(
        "--bound",
        action="store_true",
        help="in a .yaml: the smallest white, Gauss-Markov and random-walk noise of each axis "
        "whose Allan variance bounds the measured one from 1 to 1000 s",
    )
    _device_arguments(one)


def recover(one: ArgumentParser) -> None:
    """Add the arguments of a recovery."""
    one.add_argument("damaged", help="truncated or corrupted recording")
    one.add_argument("out", help="recording to write")


def check(one: ArgumentParser) -> None:
    """Add the arguments of a gate."""
    one.add_argument("recording", help="recording, session folder, raw capture or text")
    one.add_argument(
        "--against", required=True, metavar="SPEC.toml", help="limits for each sensor or axis"
    )
    one.add_argument("--junit", metavar="FILE.xml", help="write a JUnit report")
    one.add_argument("--json", metavar="FILE", help="write the verdicts as JSON; - prints them")
    _device_arguments(one)


def report(one: ArgumentParser) -> None:
    """Add the arguments of a report."""
    one.add_argument("sessions", nargs="+", help="session folders or recordings")
    one.add_argument(
        "--out",
        default="report.html",
        metavar="FILE.html",
        help="file to write (default: report.html)",
    )
    _report_arguments(one)
    _curve_arguments(one)
    _device_arguments(one)


def together(one: ArgumentParser) -> None:
    """Add the arguments of recordings of one bench."""
    one.add_argument(
        "recordings", nargs="+", help="two to twelve recordings made at once on one bench"
    )
    one.add_argument("--json", metavar="FILE", help="write the curves as JSON; - prints them")
    _device_arguments(one)


def fleet(one: ArgumentParser) -> None:
    """Add the arguments of a lot of recordings."""
    one.add_argument(
        "recordings", nargs="+", help="recordings, folders or quoted globs; fsspec URLs too"
    )
    one.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder or URL of the results; existing results are kept",
    )
    one.add_argument(
        "--scheduler", default="", metavar="tcp://HOST:PORT", help="use this Dask cluster"
    )
    one.add_argument(
        "--workers", type=_workers, metavar="N", help="number of processes on this machine"
    )
    one.add_argument(
        "--unit-name",
        default="",
        metavar="REGEX",
        help="pattern in the path; its first group is the name of the unit",
    )
    one.add_argument(
        "--against", metavar="SPEC.toml", help="accept units within these limits, as check does"
    )
    one.add_argument(
        "--compare", default="", metavar="DIR", help="compare with the results of another lot"
    )
    one.add_argument(
        "--partition",
        type=_partition,
        default=(),
        metavar="COLUMN,...",
        help="partition the table by these columns: part, axis, sensor_unit, unit, firmware",
    )
    _device_arguments(one)


def doctor(one: ArgumentParser) -> None:
    """Add the arguments of looking at the machine."""
    one.add_argument(
        "folder",
        nargs="?",
        default=".",
        help="folder for sessions, whose disk is checked (default: here)",
    )
    one.add_argument(
        "--rate",
        type=float,
        default=6664.0,
        metavar="HZ",
        help="sample rate for which the buffers are judged (default: 6664)",
    )


def completion(one: ArgumentParser) -> None:
    """Add the name of the shell."""
    one.add_argument("shell", choices=["bash", "zsh", "fish"], help="shell")


def verify(one: ArgumentParser) -> None:
    """Add the arguments of a verification."""
    one.add_argument(
        "--json",
        metavar="FILE",
        help="write every value, versions, processor and checksums; - prints them",
    )


def convert(one: ArgumentParser) -> None:
    """Add the arguments of a conversion between densities and deviations."""
    one.add_argument("input", help="table of frequency in Hz, or tau in s, and the quantity")
    one.add_argument("out", help="table to write")
    one.add_argument(
        "--from",
        dest="given",
        required=True,
        metavar="QUANTITY",
        help="S_y (one-sided density of the rate), S_phi (of the phase, rad^2/Hz), L (dBc/Hz), or "
        "a deviation: adev mdev tdev hdev pdev theo1 totdev ...",
    )
    one.add_argument(
        "--to",
        dest="wanted",
        required=True,
        metavar="QUANTITY",
        help="the same quantities; a density made from a deviation is that of the nearest power "
        "laws, because no variance has an exact inverse (stdev has none at all)",
    )
    one.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="sample rate; densities end at half of it (default: twice the highest frequency, or "
        "one sample in the shortest tau)",
    )
    one.add_argument(
        "--carrier",
        type=float,
        default=0.0,
        metavar="HZ",
        help="carrier frequency of a phase; 0 (default): the phase is an angle",
    )


def stability(one: ArgumentParser) -> None:
    """Add the arguments of a single quantity of the theory."""
    one.add_argument(
        "name",
        metavar="QUANTITY",
        choices=[*("fit", "identify", "avlr", "mtie", "tierms", "gcodev", "hat"), "edf", "cov"],
        help="fit: power-law coefficients; identify: noise types; avlr: one line of known slope; "
        "mtie, tierms: time errors; gcodev: common noise of two records; hat: three-cornered hat; "
        "edf: degrees of freedom and limits; cov: covariance of variances under a model",
    )
    one.add_argument(
        "inputs",
        nargs="*",
        default=[],
        metavar="INPUT",
        help="recordings, tables, or text with one number on each line; gcodev: A-B and A-C; hat: "
        "A-B, B-C and C-A; edf and cov: none",
    )
    one.add_argument("--axis", default="", help="axis of a recording (default: its first)")
    one.add_argument(
        "--data",
        default="rate",
        choices=["rate", "phase"],
        help="what the numbers are: rate (default) or phase",
    )
    one.add_argument(
        "--taus", default="octave", type=_taus, metavar="NAME|LIST", help="as for analyse"
    )
    one.add_argument(
        "--kind", default="oadev", help="estimator of hat, edf, cov and identify (default: oadev)"
    )
    one.add_argument("--letters", default="auto", help="fit: any of QPNBKFD; avlr: one of QNBKR")
    one.add_argument("--low", type=float, default=0.0, metavar="S", help="avlr: smallest tau")
    one.add_argument("--high", type=float, default=1e12, metavar="S", help="avlr: largest tau")
    one.add_argument(
        "--noise-type", default="WFM", metavar="NAME", help="edf: WPM to RRFM (default: WFM)"
    )
    one.add_argument("--model", default="", metavar="N=...,B=...", help="cov: any of QPNBKFDR")
    one.add_argument(
        "--samples", type=int, default=0, metavar="N", help="edf, cov: length of the run"
    )
    one.add_argument("--out", metavar="FILE.csv", help="write the table (default: print)")
    _device_arguments(one)


def chart(one: ArgumentParser) -> None:
    """Add the arguments of a chart of the method."""
    one.add_argument(
        "name",
        metavar="CHART",
        choices=["transfer", "slopes", "chain"],
        help="transfer: estimators over frequency; slopes: variances of every noise over tau; "
        "chain: signal chain",
    )
    one.add_argument("out", help="file to write, as .svg and as .png")
    _sensor_arguments(one)


def nothing(one: ArgumentParser) -> None:
    """Add no argument."""
    del one


def _sensor_arguments(
    one: ArgumentParser, title: str = "sensor", wire: str = "native"
) -> argparse._ArgumentGroup:
    group = one.add_argument_group(title)
    group.add_argument(
        "--part",
        default="",
        help="LSM6DS3H, LSM6DSL or LSM6DSM; also LSM6DSO, LSM6DSR, LSM6DSV, LSM6DSV16X, "
        "ISM330DHCX, ASM330LHH, ASM330LHHX",
    )
    group.add_argument("--rate", type=float, metavar="HZ", help="nominal sample rate")
    group.add_argument("--gyro-fs", type=float, metavar="DPS", help="gyro full scale")
    group.add_argument("--accel-fs", type=float, metavar="G", help="accelerometer full scale")
    group.add_argument(
        "--wire",
        default="",
        metavar="FORMAT",
        help="native, sdatalog, tmsg, tmsg-sensortile, datalog, datalog11 or text (default: "
        f"{wire})",
    )
    one.set_defaults(unit=[], stream="")
    return group


def _device_arguments(one: ArgumentParser) -> None:
    group = _sensor_arguments(one, "input", "detected")
    group.description = "what the data themselves do not state"
    group.add_argument(
        "--unit",
        action="append",
        default=[],
        type=_unit,
        metavar="gyro=dps",
        help="unit of a sensor in text or arrays",
    )
    group.add_argument(
        "--stream",
        default="",
        metavar="NAME",
        help="sensor, if the input has several: topic of a bag or log, part in a folder "
        "(default: most samples)",
    )


def _curve_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("curves")
    group.add_argument(
        "--kinds",
        default=[],
        type=lambda text: text.lower().replace(",", " ").split(),
        metavar="NAMES",
        help="estimators, e.g. oadev,mdev,hdev (default: all; oadev is always included)",
    )
    group.add_argument(
        "--taus",
        default="",
        type=_taus,
        metavar="octave|decade|many|all|LIST",
        help="averaging times: octave (powers of two), decade (1-2-4), many (24 an octave), all, "
        "or seconds, e.g. 0.1,1,10 (default: --per-octave)",
    )
    group.add_argument(
        "--per-octave",
        type=int,
        default=4,
        metavar="N",
        help="averaging times per octave (default: 4)",
    )
    group.add_argument(
        "--hadamard",
        default="sp1065",
        choices=["sp1065", "dt0064"],
        help="factor of the Hadamard variance: 1/6 (default), or the 1/2 of ST's DT0064",
    )
    group.add_argument(
        "--noise-type",
        metavar="NAME",
        help="noise type for intervals and bias at every tau: WPM FPM WFM FFM RWFM FWFM or RRFM "
        "(default: identified)",
    )
    group.add_argument(
        "--bias",
        default="usual",
        choices=["usual", "none", "all"],
        help="bias correction: MTOT, TTOT and HTOT (default), none, or TOTDEV and THEO1 too",
    )
    group.add_argument("--variance", action="store_true", help="variances in place of deviations")
    group.add_argument(
        "--simple-limits",
        action="store_true",
        help="add DT0064's limits: deviation -+ deviation / sqrt(terms)",
    )
    _window_argument(group)
    group.add_argument(
        "--power-laws",
        default="",
        metavar="LETTERS",
        help="fit these together: Q P (phase noise) N B K F (flicker walk) D (random run), or auto "
        "(N, B, K and those the likelihood asks for)",
    )


def _taus(text: str) -> str | tuple[float, ...]:
    """Return a name, or times in s."""
    if not text[:1].isdecimal() and text[:1] != ".":
        return text
    try:
        return tuple(float(one) for one in text.replace(",", " ").split())
    except ValueError:
        why = f"{text!r} is not a list of times in s; write e.g. 0.1,1,10"
        raise argparse.ArgumentTypeError(why) from None


def _simulated_arguments(one: ArgumentParser, *, with_line: bool = True) -> None:
    group = one.add_argument_group("simulation")
    group.add_argument("--seed", type=int, default=0, help="seed of the noise (default: 0)")
    group.add_argument(
        "--effect",
        action=_AddOrList,
        default=[],
        metavar="KIND:param=value,...",
        help="add an effect, e.g. step:size=0.1,time=600,axis=gx; --effect help "
        "lists kinds and parameters",
    )
    group.add_argument(
        "--noise",
        action="append",
        default=[],
        metavar="NAME=value,...",
        help="noise of an axis (default: typical of the part): N B K Q P (flicker PM) F (flicker "
        "walk) D (random run) R, B_dt0064 (B by the 1/f generator of ST's DT0064), or n1 n2 of "
        "dx/dt = n1 x + n2 w; e.g. N=0.003,F=1e-6,axis=gx",
    )
    group.add_argument("--truth", metavar="RESULT.json", help="simulate the model of this result")
    if not with_line:  # nothing can fail on it
        one.set_defaults(fault=[])
        return
    group.add_argument(
        "--fault",
        action=_AddOrList,
        default=[],
        metavar="KIND:param=value,...",
        help="add a fault, e.g. bit_flip:rate=1e-5 (per byte) or unplug:at=5,seconds=2; "
        "--fault help lists kinds and parameters",
    )


class _AddOrList(argparse.Action):
    """Add a specification to the list; ``help`` prints the kinds there are, and ends."""

    def __call__(
        self, parser: ArgumentParser, namespace: Namespace, values: object, _: str | None = None
    ) -> None:
        if values == "help":
            from allanscope.simulator import effect_help, fault_help

            print(effect_help() if self.dest == "effect" else fault_help())
            parser.exit()
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), values])


def _session_arguments(parser: ArgumentParser) -> None:
    one = parser.add_argument_group("session")
    one.add_argument("--out", metavar="DIR", help="session folder (default: a new one)")
    one.add_argument(
        "--view",
        default="auto",
        choices=["auto", "window", "web", "none"],
        help="viewer; auto (default): a window if there is a display, else the browser",
    )
    _view_port_argument(one)
    _compare_argument(one)
    one.add_argument(
        "--on-event",
        default="",
        metavar="COMMAND",
        help="run this at each event, without a shell; the event is a JSON line on its input",
    )
    one.add_argument(
        "--events-to",
        metavar="FILE",
        help="write each event as a JSON line to a file, pipe or /dev/fd/N",
    )
    _window_argument(one)
    one.add_argument("--json", action="store_true", help="print the result as JSON at the end")


def _window_argument(one: _ActionsContainer) -> None:
    one.add_argument(
        "--window",
        type=_duration,
        default=0.0,
        metavar="TIME",
        help="window of the dynamic Allan deviation, e.g. 10m (default: grows with the run)",
    )


def _view_port_argument(one: _ActionsContainer) -> None:
    one.add_argument(
        "--port",
        dest="view_port",
        type=_view_port,
        metavar="N",
        help="serve the web viewer at 127.0.0.1:N and its data at N+1 (default: free ports)",
    )


def _compare_argument(one: _ActionsContainer) -> None:
    one.add_argument(
        "--compare",
        metavar="DIR|MASK.csv",
        help="compare with an earlier session, or with a mask: a CSV file with tau in s and gyro, "
        "accel, gx ... az in dps and g; exit code 5 if a curve is higher",
    )


def _report_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("report")
    group.add_argument("--figures", metavar="DIR", help="write every figure as SVG and PNG")
    group.add_argument("--title", default="", metavar="TEXT", help="title of the report")
    group.add_argument("--operator", default="", metavar="NAME", help="name of the operator")
    group.add_argument(
        "--full", action="store_true", help="open all folded sections, also in print"
    )


def _duration_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--for",
        dest="duration",
        type=_duration,
        metavar="TIME",
        help="duration, e.g. 90s, 10m or 1h30m",
    )


def _duration(text: str) -> float:
    """Seconds from `90`, `90s`, `1.5h`, `1h30m` or `2d`."""
    seconds, end = 0.0, 0
    for found in _PART_OF_TIME.finditer(text):
        if found.start() != end:
            break
        seconds += float(found["number"]) * _SECONDS[found["unit"]]
        end = found.end()
    if end == 0 and text.replace(".", "", 1).isascii() and text.replace(".", "", 1).isdecimal():
        seconds, end = float(text), len(text)
    if end != len(text) or not 0.0 < seconds < 1e9:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a duration; write e.g. 90s, 10m or 1h30m"
        )
    return seconds


_SECONDS = {"d": 86400.0, "h": 3600.0, "m": 60.0, "s": 1.0}
_PART_OF_TIME = re.compile(r"(?P<number>[0-9]+(\.[0-9]*)?|\.[0-9]+)(?P<unit>[dhms])")


def _view_port(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 65535):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a network port; write e.g. --port 9876 (a serial port is given "
            "without --port)"
        )
    return int(text)


def _partition(text: str) -> tuple[str, ...]:
    """Return the columns by which a table is parted."""
    names = tuple(name.strip() for name in text.split(","))
    known = ("part", "axis", "sensor_unit", "unit", "firmware")
    if len(set(names)) < len(names) or not set(names) <= set(known):
        raise argparse.ArgumentTypeError(f"{text!r} is none; columns: {', '.join(known)}")
    return names


def _workers(text: str) -> int:
    if not (text.isdecimal() and 0 < int(text) <= 1024):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes; write e.g. 4")
    return int(text)


def _speed(text: str) -> float:
    """Return a multiple of real time; infinity for `max`."""
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = 0.0
    if not speed > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a speed; write 1, 10 or max")
    return speed


def _unit(text: str) -> tuple[str, str]:
    sensor, _, unit = text.partition("=")
    if sensor not in ("gyro", "accel", "t", "temp") or not unit:
        raise argparse.ArgumentTypeError(f"{text!r} is not a unit; write e.g. gyro=dps or accel=mg")
    return sensor, unit
