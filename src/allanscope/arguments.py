"""The arguments of each command, and what may be written for them.

One function for each command, of the same name, and below them what several have in common. Nothing
heavy is imported: a word that names a part or an effect is checked when the command runs.
"""

from __future__ import annotations

import argparse
import re
from argparse import ArgumentParser

__all__ = [
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


def live(one: ArgumentParser) -> None:
    """Take what a live run needs."""
    one.add_argument(
        "port",
        nargs="?",
        default="auto",
        help="a device path, any pyserial URL, auto (default), or sim, the simulated SensorTile",
    )
    one.add_argument("--resume", metavar="DIR", help="continue the session in DIR after a crash")
    _duration_argument(one)
    _session_arguments(one)
    _device_arguments(one)
    _simulated_arguments(one)


def replay(one: ArgumentParser) -> None:
    """Take what a replay needs."""
    one.add_argument("recording", help="a recording or the folder of a session")
    one.add_argument("--speed", default="max", type=_speed, help="1, 10 or max (default)")
    _session_arguments(one)
    _device_arguments(one)


def open_view(one: ArgumentParser) -> None:
    """Take what opening the charts of a session needs."""
    one.add_argument(
        "session", help="the folder of a session, its .rrd, or the address that a live run prints"
    )
    one.add_argument(
        "--view",
        default="auto",
        choices=["auto", "window", "web"],
        help="where to show; auto (default) is a window where there is a display, else web",
    )
    _view_port_argument(one)


def analyse(one: ArgumentParser) -> None:
    """Take what an analysis needs."""
    one.add_argument(
        "input",
        help="a recording, a raw serial capture, delimited text, a bag of ROS 2 (.mcap, .db3 or "
        "its folder), a folder of HSDatalog, .npz, .npy, .mat or Parquet",
    )
    one.add_argument("--json", metavar="FILE", help="write the result; - for standard output")
    one.add_argument("--report", metavar="FILE.html", help="write the report")
    one.add_argument("--table", metavar="FILE.csv", help="write every curve as a table")
    _compare_argument(one)
    _figures_argument(one)
    _heading_arguments(one)
    _curve_arguments(one)
    _device_arguments(one)


def simulate(one: ArgumentParser) -> None:
    """Take what a simulated recording needs."""
    one.add_argument("out", help="the recording to write")
    one.add_argument("--hours", type=float, default=1.0, help="length of the record")
    _device_arguments(one)
    _simulated_arguments(one, with_line=False)


def device(one: ArgumentParser) -> None:
    """Take what the simulated device needs."""
    one.add_argument(
        "--emulated",
        action="store_true",
        help="run the real firmware on an emulated STM32L475 instead; from a checkout, with "
        "gcc-arm-none-eabi, make and qemu-system-arm 10 on the machine",
    )
    one.add_argument("--link", metavar="PATH", help="make the port here; else in a new folder")
    one.add_argument("--json", action="store_true", help="print at the end what became of samples")
    _duration_argument(one)
    _device_arguments(one)
    _simulated_arguments(one)


def import_data(one: ArgumentParser) -> None:
    """Take what an import needs."""
    one.add_argument("input", help="a raw serial capture, delimited text or a file of arrays")
    one.add_argument("out", help="the recording to write")
    _device_arguments(one)


def export_data(one: ArgumentParser) -> None:
    """Take what an export needs."""
    one.add_argument("recording", help="a recording, the folder of a session, a capture or text")
    one.add_argument("out", help="a name that ends in .csv, .parquet, .yaml or (MATLAB's) .m")
    one.add_argument(
        "--layout", default="kalibr", choices=["kalibr", "ros", "vins"], help="format of a .yaml"
    )
    one.add_argument(
        "--upper-limits",
        default="refuse",
        choices=["include", "zero", "refuse"],
        help="what a coefficient that was not detected becomes in a .yaml or .m: its upper limit, "
        "0, or (by default) a line that says what is missing, and no file",
    )
    one.add_argument(
        "--bound",
        action="store_true",
        help="in a .yaml: the least white, Gauss-Markov and random-walk noise of each axis whose "
        "variance is above the measured one at 1 to 1000 s",
    )
    _device_arguments(one)


def recover(one: ArgumentParser) -> None:
    """Take what a recovery needs."""
    one.add_argument("damaged", help="a truncated or corrupted recording")
    one.add_argument("out", help="the recording to write")


def check(one: ArgumentParser) -> None:
    """Take what a gate needs."""
    one.add_argument("recording", help="a recording, the folder of a session, a capture or text")
    one.add_argument("--against", required=True, metavar="SPEC.toml", help="limits per axis")
    one.add_argument("--junit", metavar="FILE.xml", help="also write a JUnit report")
    one.add_argument("--json", metavar="FILE", help="also write the verdicts as JSON; - prints it")
    _device_arguments(one)


def report(one: ArgumentParser) -> None:
    """Take what a report needs."""
    one.add_argument("sessions", nargs="+", help="folders of sessions, or recordings")
    one.add_argument("--out", default="report.html", metavar="FILE.html")
    _figures_argument(one)
    _heading_arguments(one)
    _curve_arguments(one)
    _device_arguments(one)


def together(one: ArgumentParser) -> None:
    """Take what recordings of one bench need."""
    one.add_argument("recordings", nargs="+", help="two to twelve recordings of one bench")
    one.add_argument("--json", metavar="FILE", help="write the curves; - for standard output")
    _device_arguments(one)


def fleet(one: ArgumentParser) -> None:
    """Take what a lot of recordings needs."""
    one.add_argument(
        "recordings", nargs="+", help="recordings, folders or quoted globs; also URLs of fsspec"
    )
    one.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder or URL of the results; continued if it has some",
    )
    one.add_argument(
        "--scheduler", default="", metavar="tcp://HOST:PORT", help="an existing Dask cluster"
    )
    one.add_argument("--workers", type=_workers, metavar="N", help="processes on this machine")
    one.add_argument(
        "--unit-name",
        default="",
        metavar="REGEX",
        help="pattern in the path; its first group names the unit",
    )
    _device_arguments(one)


def doctor(one: ArgumentParser) -> None:
    """Take what looking at the machine needs."""
    one.add_argument(
        "folder", nargs="?", default=".", help="where sessions are to be written (default: here)"
    )


def completion(one: ArgumentParser) -> None:
    """Take the name of a shell."""
    one.add_argument("shell", choices=["bash", "zsh", "fish"], help="the shell")


def verify(one: ArgumentParser) -> None:
    """Take what a verification needs."""
    one.add_argument(
        "--json",
        metavar="FILE",
        help="also write every value, with versions, processor and checksums; - prints it",
    )


def convert(one: ArgumentParser) -> None:
    """Take what a conversion between densities and deviations needs."""
    quantities = ["S_y", "S_phi", "L", "adev"]
    one.add_argument("input", help="a table of frequency in Hz, or tau in s, and the quantity")
    one.add_argument("out", help="the table to write")
    one.add_argument(
        "--from",
        dest="given",
        required=True,
        choices=quantities,
        help="one-sided density of the rate, of the phase (rad^2/Hz), L(f) in dBc/Hz, or deviation",
    )
    one.add_argument("--to", dest="wanted", required=True, choices=quantities, help="likewise")
    one.add_argument("--rate", type=float, metavar="HZ", help="sample rate: densities end at half")
    one.add_argument(
        "--carrier", type=float, default=0.0, metavar="HZ", help="of a phase; 0 (default): an angle"
    )


def stability(one: ArgumentParser) -> None:
    """Take what a single quantity of the theory needs."""
    one.add_argument(
        "name",
        choices=[*("fit", "identify", "avlr", "mtie", "tierms", "gcodev", "hat"), "edf", "cov"],
        help="coefficients of power laws; noise types; one line of known slope; time errors; the "
        "noise that two records share; three-cornered hat of three; degrees of freedom and limits; "
        "covariance of variances under a model",
    )
    one.add_argument(
        "inputs",
        nargs="*",
        metavar="INPUT",
        help="recordings, tables, or text with one number a line; gcodev: A-B and A-C; hat: A-B, "
        "B-C and C-A; edf and cov: none",
    )
    one.add_argument("--axis", default="", help="of a recording (default: its first)")
    one.add_argument("--data", default="rate", choices=["rate", "phase"], help="of one column")
    one.add_argument("--taus", default="octave", type=_taus, metavar="NAME|LIST", help="as analyse")
    one.add_argument("--kind", default="oadev", help="estimator of hat, edf, cov and identify")
    one.add_argument("--letters", default="auto", help="fit: of QPNBKFD; avlr: one of QNBKR")
    one.add_argument("--low", type=float, default=0.0, metavar="S", help="avlr: from this tau")
    one.add_argument("--high", type=float, default=1e12, metavar="S", help="avlr: to this tau")
    one.add_argument("--noise-type", default="WFM", metavar="NAME", help="edf: WPM to RRFM")
    one.add_argument("--model", default="", metavar="N=...,B=...", help="cov: of QPNBKR")
    one.add_argument("--samples", type=int, default=0, metavar="N", help="edf, cov: of the run")
    one.add_argument("--out", metavar="FILE.csv", help="write the table (default: print it)")
    _device_arguments(one)


def chart(one: ArgumentParser) -> None:
    """Take what a chart of the method needs."""
    one.add_argument("name", choices=["transfer", "chain"], help="what to draw")
    one.add_argument("out", help="the name of the files, written as .svg and as .png")
    _device_arguments(one)


def nothing(one: ArgumentParser) -> None:
    """Take nothing."""
    del one


def _device_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("settings that the stream does not carry")
    group.add_argument("--part", default="", help="LSM6DS3H, LSM6DSL or LSM6DSM")
    group.add_argument("--rate", type=float, metavar="HZ", help="nominal sample rate")
    group.add_argument("--gyro-fs", type=float, metavar="DPS", help="gyro full scale")
    group.add_argument("--accel-fs", type=float, metavar="G", help="accelerometer full scale")
    group.add_argument(
        "--wire",
        default="",
        metavar="FORMAT",
        help="native, tmsg, tmsg-sensortile, datalog, datalog11 or text; detected if not given",
    )
    group.add_argument(
        "--unit", action="append", default=[], type=_unit, metavar="gyro=dps", help="unit of text"
    )
    group.add_argument(
        "--stream",
        default="",
        metavar="NAME",
        help="which sensor of an input that holds several: the topic of a bag, the part of an "
        "HSDatalog folder (default: the one with the most samples)",
    )


def _curve_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("the curves")
    group.add_argument(
        "--kinds",
        default=[],
        type=lambda text: text.lower().replace(",", " ").split(),
        metavar="NAMES",
        help="estimators, e.g. oadev,mdev,hdev (default: all; oadev is always among them)",
    )
    group.add_argument(
        "--taus",
        default="",
        type=_taus,
        metavar="octave|decade|many|all|LIST",
        help="averaging times: powers of two, 1-2-4 in each decade, 24 in each octave, every one, "
        "or e.g. 0.1,1,10 in s; a time without a value is an error. Default: --per-octave",
    )
    group.add_argument(
        "--per-octave", type=int, default=4, metavar="N", help="averaging times in each octave"
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
        help="WPM FPM WFM FFM RWFM FWFM or RRFM at every tau, for limits and bias, instead of the "
        "one that is identified",
    )
    group.add_argument(
        "--bias",
        default="usual",
        choices=["usual", "none", "all"],
        help="remove the bias of MTOT, TTOT, HTOT (default), of none, or of TOTDEV, THEO1 too",
    )
    group.add_argument(
        "--variance", action="store_true", help="variances (AVAR) in tables, charts and JSON"
    )
    group.add_argument(
        "--simple-limits",
        action="store_true",
        help="also DT0064's limits, deviation -+ deviation / sqrt(terms)",
    )
    _window_argument(one)
    group.add_argument(
        "--power-laws",
        default="",
        metavar="LETTERS",
        help="also fit these together, with intervals: Q P (phase noise) N B K F (flicker walk) "
        "D (random run); auto: N, B, K and those that are identified",
    )


def _taus(text: str) -> str | tuple[float, ...]:
    """Return a name, or times in s."""
    if not text[:1].isdecimal() and text[:1] != ".":
        return text
    try:
        return tuple(float(one) for one in text.replace(",", " ").split())
    except ValueError:
        why = f"{text!r} are no times in s; write e.g. 0.1,1,10"
        raise argparse.ArgumentTypeError(why) from None


def _simulated_arguments(one: ArgumentParser, *, with_line: bool = True) -> None:
    group = one.add_argument_group("the simulated SensorTile")
    group.add_argument("--seed", type=int, default=0, help="seed of its noise")
    group.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="KIND:param=value,...",
        help="an effect to simulate, e.g. step:size=0.1,time=600,axis=gx; "
        "a wrong kind lists all, a kind alone what it takes",
    )
    group.add_argument(
        "--noise",
        action="append",
        default=[],
        metavar="NAME=value,...",
        help="noise of an axis instead of the typical one: N B K Q P (flicker PM) F (flicker walk) "
        "D (random run) R, or n1 n2 of dx/dt = n1 x + n2 w; e.g. N=0.003,F=1e-6,axis=gx",
    )
    group.add_argument("--truth", metavar="JSON", help="a result whose model is to be simulated")
    if not with_line:  # nothing can fail on it
        one.set_defaults(fault=[])
        return
    group.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:param=value,...",
        help="bit_flip, byte_loss, byte_repeat, garbage, stall, unplug or reset, "
        "e.g. bit_flip:rate=1e-5 (per byte) or unplug:at=5,seconds=2",
    )


def _session_arguments(one: ArgumentParser) -> None:
    one.add_argument("--out", metavar="DIR", help="folder of the session")
    one.add_argument(
        "--view",
        default="auto",
        choices=["auto", "window", "web", "none"],
        help="where to draw; auto (default) is a window where there is a display, else web",
    )
    _view_port_argument(one)
    _compare_argument(one)
    one.add_argument(
        "--on-event",
        default="",
        metavar="COMMAND",
        help="run this for each event, without a shell; the event is a JSON line on its input",
    )
    one.add_argument(
        "--events-to", metavar="FILE", help="a pipe, file or /dev/fd/N for a JSON line an event"
    )
    _window_argument(one)
    one.add_argument("--json", action="store_true", help="print the result at the end")


def _window_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--window",
        type=_duration,
        default=0.0,
        metavar="TIME",
        help="length of the windows of the Allan deviation over time, e.g. 10m; by default they "
        "grow with the run",
    )


def _view_port_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--port",
        dest="view_port",
        type=_view_port,
        metavar="N",
        help="serve the page of the web viewer at 127.0.0.1:N and its data at N+1 (default: any "
        "free ports)",
    )


def _compare_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--compare",
        metavar="DIR",
        help="draw the curves of an earlier session beside, and say where these are higher; or a "
        "mask, a CSV file with tau in s and gyro, accel, gx ... az in dps and g",
    )


def _figures_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--figures", metavar="DIR", help="also write every figure there, as SVG and as PNG"
    )


def _heading_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("the report")
    group.add_argument("--title", default="", metavar="TEXT", help="its title")
    group.add_argument("--operator", default="", metavar="NAME", help="who measured")
    group.add_argument(
        "--full", action="store_true", help="open what is folded otherwise, also for printing"
    )


def _duration_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--for",
        dest="duration",
        type=_duration,
        metavar="TIME",
        help="stop after e.g. 90s, 10m or 1h30m",
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
        raise argparse.ArgumentTypeError(f"{text!r} is no time; write e.g. 90s, 10m or 1h30m")
    return seconds


_SECONDS = {"d": 86400.0, "h": 3600.0, "m": 60.0, "s": 1.0}
_PART_OF_TIME = re.compile(r"(?P<number>[0-9]+(\.[0-9]*)?|\.[0-9]+)(?P<unit>[dhms])")


def _view_port(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 65535):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no network port for the viewer; write e.g. 9876 (a serial port stands "
            "without --port)"
        )
    return int(text)


def _workers(text: str) -> int:
    if not (text.isdecimal() and 0 < int(text) <= 1024):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of processes; write e.g. 4")
    return int(text)


def _speed(text: str) -> float:
    """Return a multiple of real time; infinity for `max`."""
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = 0.0
    if not speed > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no speed; write 1, 10 or max")
    return speed


def _unit(text: str) -> tuple[str, str]:
    sensor, _, unit = text.partition("=")
    if sensor not in ("gyro", "accel", "t", "temp") or not unit:
        raise argparse.ArgumentTypeError(f"{text!r} is no unit; write e.g. gyro=dps or accel=mg")
    return sensor, unit
