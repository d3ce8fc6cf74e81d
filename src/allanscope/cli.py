"""The command line: one short function per command, and the parser that calls it.

Nothing heavy is imported here: a command imports the rooms it needs when it runs, so that
``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import json
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from allanscope.errors import ExitCode

if TYPE_CHECKING:
    from allanscope.analysis.result import Analysis
    from allanscope.pipeline.settings import DeviceSettings, SessionSettings, SimulatedSettings

__all__ = ["parser"]


# --- commands ---------------------------------------------------------------------------------


def live(options: Namespace) -> int:
    """Watch a device, draw its curves while they grow, keep every byte."""
    from allanscope.pipeline.live import run_live

    analysis = run_live(
        options.port,
        _device_settings(options),
        _session_settings(options, options.duration),
        _simulated_settings(options),
        resume=Path(options.resume) if options.resume else None,
    )
    return _print_json(analysis, options.json)


def replay(options: Namespace) -> int:
    """Run a recording through the same path as a live device."""
    from allanscope.pipeline.live import run_replay

    analysis = run_replay(
        Path(options.recording),
        options.speed,
        _device_settings(options),
        _session_settings(options, None),
    )
    return _print_json(analysis, options.json)


def analyse(options: Namespace) -> int:
    """Analyse a recording, a raw capture or a text file to the end."""
    from allanscope.pipeline.analyse import analyse_input
    from allanscope.pipeline.outputs import write_json, write_report

    analysis = analyse_input(Path(options.input), _device_settings(options), options.quiet)
    if options.report or options.figures:
        page, figures = (Path(x) if x else None for x in (options.report, options.figures))
        write_report(analysis, page, figures)
    if options.json == "-":
        return _print_json(analysis, True)
    if options.json:
        write_json(analysis, Path(options.json))
    if not options.quiet:
        from allanscope.view.terminal import summary_lines

        print("\n".join(summary_lines(analysis)))
    return ExitCode.DONE


def simulate(options: Namespace) -> int:
    """Record the simulated device, much faster than real time."""
    from allanscope.pipeline.simulate import simulate_recording

    simulate_recording(
        Path(options.out),
        options.hours,
        _device_settings(options),
        _simulated_settings(options),
        options.quiet,
    )
    return ExitCode.DONE


def device(options: Namespace) -> int:
    """Run the simulated device on a virtual serial port until it is stopped."""
    from allanscope.pipeline.simulate import run_emulated_device, run_virtual_device

    link = Path(options.link) if options.link else None
    asked = _device_settings(options), _simulated_settings(options), options.duration, link
    if options.emulated:
        run_emulated_device(*asked)
        return ExitCode.DONE
    ledger = run_virtual_device(*asked)
    if options.json:
        json.dump(ledger.to_dict(), sys.stdout, indent=1)
        print()
    return ExitCode.DONE


def import_data(options: Namespace) -> int:
    """Turn a text file or a raw capture into a recording."""
    from allanscope.pipeline.convert import import_capture

    import_capture(Path(options.input), Path(options.out), _device_settings(options), options.quiet)
    return ExitCode.DONE


def export_data(options: Namespace) -> int:
    """Write samples as CSV or Parquet, or coefficients for Kalibr, ROS, VINS or MATLAB."""
    from allanscope.pipeline.convert import export_recording

    export_recording(
        Path(options.recording),
        Path(options.out),
        _device_settings(options),
        options.quiet,
        options.layout,
    )
    return ExitCode.DONE


def recover(options: Namespace) -> int:
    """Save everything before the tear of a damaged recording."""
    from allanscope.recording import Recording
    from allanscope.recording import recover as recover_recording
    from allanscope.view.progress import progress

    damaged = Path(options.damaged)
    whole = Recording(damaged).unpacked_bytes
    with progress(whole, "recovering", unit="B", quiet=options.quiet) as advance:
        report = recover_recording(damaged, Path(options.out), advance)
    print(report)
    return ExitCode.DONE


def check(options: Namespace) -> int:
    """Compare a recording's coefficients with the limits of a specification."""
    from allanscope.pipeline.check import check_against

    recording, specification = Path(options.recording), Path(options.against)
    for line in check_against(recording, specification, _device_settings(options)):
        print(line)
    return ExitCode.DONE


def report(options: Namespace) -> int:
    """Write one HTML report from one session or several, compared."""
    from allanscope.pipeline.outputs import report_sessions

    paths, figures = [Path(path) for path in options.sessions], options.figures
    page = report_sessions(
        paths, Path(options.out), options.quiet, Path(figures) if figures else None
    )
    print(page)
    return ExitCode.DONE


def fleet(options: Namespace) -> int:
    """Analyse many recordings on Dask, into one table and a report of the lot."""
    from allanscope.fleet import FleetSettings, run_fleet, summary_lines

    settings = FleetSettings(
        patterns=tuple(options.recordings),
        out=Path(options.out),
        scheduler=options.scheduler,
        workers=options.workers,
        unit_pattern=options.unit_name,
        quiet=options.quiet,
    )
    result = run_fleet(settings, _device_settings(options))
    for line in result.failures.values():
        print(f"allanscope: {line}", file=sys.stderr)
    print("\n".join(summary_lines(result)))
    return ExitCode.INPUT if result.failures else ExitCode.DONE


def ports(options: Namespace) -> int:
    """List what is plugged in, and say which port `auto` would take."""
    from allanscope.sources import describe_ports

    print("\n".join(describe_ports()))
    return ExitCode.DONE


# --- the parser -------------------------------------------------------------------------------


def parser() -> ArgumentParser:
    """Return the parser of the whole command line."""
    top = ArgumentParser(
        prog="allanscope",
        description="Live Allan-variance monitor for LSM6DS3H / LSM6DSL / LSM6DSM sensors.",
        epilog="Without a device: allanscope live sim",
    )
    top.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    for name, (run, arguments, example) in _COMMANDS.items():
        summary = (run.__doc__ or "").splitlines()[0]
        one = commands.add_parser(
            name, help=summary, description=summary, epilog=f"Example: allanscope {example}"
        )
        one.set_defaults(command=run)
        arguments(one)
        one.add_argument("--quiet", action="store_true", help="say only results and errors")
        one.add_argument("--debug", action="store_true", help="show a traceback on an error")
    return top


def _live_arguments(one: ArgumentParser) -> None:
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


def _replay_arguments(one: ArgumentParser) -> None:
    one.add_argument("recording", help="a recording or the folder of a session")
    one.add_argument("--speed", default="max", type=_speed, help="1, 10 or max (default)")
    _session_arguments(one)
    _device_arguments(one)


def _analyse_arguments(one: ArgumentParser) -> None:
    one.add_argument("input", help="a recording, a raw serial capture, or delimited text")
    one.add_argument("--json", metavar="FILE", help="write the result; - for standard output")
    one.add_argument("--report", metavar="FILE.html", help="write the report")
    _figures_argument(one)
    _device_arguments(one)


def _simulate_arguments(one: ArgumentParser) -> None:
    one.add_argument("out", help="the recording to write")
    one.add_argument("--hours", type=float, default=1.0)
    _device_arguments(one)
    _simulated_arguments(one)


def _virtual_device_arguments(one: ArgumentParser) -> None:
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


def _import_arguments(one: ArgumentParser) -> None:
    one.add_argument("input", help="a raw serial capture or delimited text")
    one.add_argument("out", help="the recording to write")
    _device_arguments(one)


def _export_arguments(one: ArgumentParser) -> None:
    one.add_argument("recording")
    one.add_argument("out", help="a name that ends in .csv, .parquet, .yaml or (MATLAB's) .m")
    one.add_argument(
        "--layout", default="kalibr", choices=["kalibr", "ros", "vins"], help="whose .yaml"
    )
    _device_arguments(one)


def _recover_arguments(one: ArgumentParser) -> None:
    one.add_argument("damaged", help="a recording that was cut off or has rotten places")
    one.add_argument("out", help="the recording to write")


def _check_arguments(one: ArgumentParser) -> None:
    one.add_argument("recording")
    one.add_argument("--against", required=True, metavar="SPEC.toml", help="limits per axis")
    _device_arguments(one)


def _report_arguments(one: ArgumentParser) -> None:
    one.add_argument("sessions", nargs="+", help="folders of sessions, or recordings")
    one.add_argument("--out", default="report.html", metavar="FILE.html")
    _figures_argument(one)


def _fleet_arguments(one: ArgumentParser) -> None:
    one.add_argument(
        "recordings", nargs="+", help="recordings, folders or quoted globs; also URLs of fsspec"
    )
    one.add_argument("--out", required=True, metavar="DIR", help="results; gone on with if there")
    one.add_argument(
        "--scheduler", default="", metavar="tcp://HOST:PORT", help="an existing Dask cluster"
    )
    one.add_argument("--workers", type=_workers, metavar="N", help="processes on this machine")
    one.add_argument(
        "--unit-name", default="", metavar="REGEX", help="its first group in the path is the unit"
    )
    _device_arguments(one)


def _no_arguments(one: ArgumentParser) -> None:
    del one


_COMMANDS = {
    "live": (live, _live_arguments, "live            # finds the board by itself"),
    "replay": (replay, _replay_arguments, "replay session.mcap --speed max"),
    "analyse": (analyse, _analyse_arguments, "analyse log.csv --rate 104 --report log.html"),
    "simulate": (simulate, _simulate_arguments, "simulate night.mcap --hours 12 --rate 104"),
    "device": (device, _virtual_device_arguments, "device --wire tmsg --rate 104"),
    "import": (import_data, _import_arguments, "import log.csv log.mcap --rate 104"),
    "export": (export_data, _export_arguments, "export session.mcap night.csv"),
    "recover": (recover, _recover_arguments, "recover session.mcap saved.mcap"),
    "check": (check, _check_arguments, "check night.mcap --against spec.toml"),
    "report": (report, _report_arguments, "report night-1 night-2 --out both.html"),
    "fleet": (fleet, _fleet_arguments, "fleet 'lot/**/*.mcap' --out lot-result"),
    "ports": (ports, _no_arguments, "ports"),
}


def _device_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("what the stream does not say by itself")
    group.add_argument("--part", default="", help="LSM6DS3H, LSM6DSL or LSM6DSM")
    group.add_argument("--rate", type=float, metavar="HZ", help="nominal sample rate")
    group.add_argument("--gyro-fs", type=float, metavar="DPS", help="gyro full scale")
    group.add_argument("--accel-fs", type=float, metavar="G", help="accelerometer full scale")
    group.add_argument(
        "--wire",
        default="",
        metavar="FORMAT",
        help="native, tmsg, tmsg-sensortile, datalog, datalog11 or text; "
        "found by listening if not given",
    )
    group.add_argument(
        "--unit", action="append", default=[], type=_unit, metavar="gyro=dps", help="unit of text"
    )


def _simulated_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("the simulated SensorTile")
    group.add_argument("--seed", type=int, default=0, help="seed of its noise")
    group.add_argument(
        "--effect", action="append", default=[], metavar="KIND:param=value,...", help="an effect"
    )
    group.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:param=value,...",
        help="bit_flip, byte_loss, byte_repeat, garbage, stall, unplug or reset, "
        "e.g. bit_flip:rate=1e-5 (per byte) or unplug:at=5,seconds=2",
    )
    group.add_argument("--truth", metavar="JSON", help="a result whose model is to be simulated")


def _session_arguments(one: ArgumentParser) -> None:
    one.add_argument("--out", metavar="DIR", help="folder of the session")
    one.add_argument("--view", default="auto", choices=["auto", "window", "web", "none"])
    one.add_argument("--json", action="store_true", help="print the result at the end")


def _figures_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--figures", metavar="DIR", help="also write every figure there, as SVG and as PNG"
    )


def _duration_argument(one: ArgumentParser) -> None:
    one.add_argument(
        "--for", dest="duration", type=_duration, metavar="TIME", help="e.g. 90s, 10m or 12h"
    )


# --- argument types ---------------------------------------------------------------------------


def _duration(text: str) -> float:
    """Seconds from `90`, `90s`, `10m`, `12h` or `2d`."""
    units = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
    number, unit = (text[:-1], text[-1]) if text and text[-1] in units else (text, "s")
    try:
        seconds = float(number) * units[unit]
    except ValueError:
        seconds = 0.0
    if not 0.0 < seconds < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is no time; write e.g. 90s, 10m or 12h")
    return seconds


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


class _Version(argparse.Action):
    """Print the version; looked up only then, because it reads the package's metadata."""

    def __call__(self, top: ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        print(f"allanscope {version('allanscope')}")
        top.exit()


# --- from arguments to settings -----------------------------------------------------------------


def _device_settings(options: Namespace) -> DeviceSettings:
    from allanscope.pipeline.settings import DeviceSettings

    return DeviceSettings(
        part=options.part,
        rate_hz=options.rate,
        gyro_fs=options.gyro_fs,
        accel_fs=options.accel_fs,
        wire=options.wire,
        units=tuple(options.unit),
    )


def _session_settings(options: Namespace, duration_s: float | None) -> SessionSettings:
    from allanscope.pipeline.settings import SessionSettings

    return SessionSettings(
        out=Path(options.out) if options.out else None,
        view=options.view,
        quiet=options.quiet or options.json,
        duration_s=duration_s,
    )


def _simulated_settings(options: Namespace) -> SimulatedSettings:
    from allanscope.pipeline.settings import SimulatedSettings

    return SimulatedSettings(
        seed=options.seed,
        effects=tuple(options.effect),
        faults=tuple(options.fault),
        truth=Path(options.truth) if options.truth else None,
    )


def _print_json(analysis: Analysis, wanted: bool) -> int:
    if wanted:
        json.dump(analysis.to_dict(), sys.stdout, indent=1, allow_nan=False)
        print()
    return ExitCode.DONE
