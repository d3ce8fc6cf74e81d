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

from allanscope.errors import ExitCode, UsageError

__all__ = ["parser"]


# --- commands ---------------------------------------------------------------------------------


def live(options: Namespace) -> int:
    """Watch a device, draw its curves while they grow, keep every byte."""
    from allanscope.pipeline.live import run_live

    return _print_result(run_live(options), options)


def replay(options: Namespace) -> int:
    """Run a recording through the same path as a live device."""
    from allanscope.pipeline.live import run_replay

    return _print_result(run_replay(options), options)


def analyse(options: Namespace) -> int:
    """Analyse a recording, a raw capture or a text file to the end."""
    from allanscope.pipeline.analyse import analyse_input
    from allanscope.pipeline.outputs import write_json, write_report

    analysis = analyse_input(options.input, _settings(options), quiet=options.quiet)
    if options.report:
        write_report(analysis, Path(options.report))
    if options.json is not None and options.json != "-":
        write_json(analysis, Path(options.json))
    elif options.json == "-":
        json.dump(analysis.to_dict(), sys.stdout, indent=1, allow_nan=False)
        print()
    if not options.quiet and options.json != "-":
        from allanscope.view.terminal import summary_lines

        print("\n".join(summary_lines(analysis)))
    return ExitCode.DONE


def simulate(options: Namespace) -> int:
    """Record the simulated device, much faster than real time."""
    from allanscope.pipeline.simulate import simulate_recording

    simulate_recording(options)
    return ExitCode.DONE


def device(options: Namespace) -> int:
    """Run the simulated device on a virtual serial port until it is stopped."""
    from allanscope.pipeline.simulate import run_virtual_device

    run_virtual_device(options)
    return ExitCode.DONE


def import_data(options: Namespace) -> int:
    """Turn a text file or a raw capture into a recording."""
    from allanscope.pipeline.convert import import_capture

    import_capture(options.input, options.out, _settings(options), quiet=options.quiet)
    return ExitCode.DONE


def export_data(options: Namespace) -> int:
    """Write a recording's samples as CSV or Parquet, or its coefficients as imu.yaml."""
    from allanscope.pipeline.convert import export_recording

    export_recording(options.recording, options.out, _settings(options), quiet=options.quiet)
    return ExitCode.DONE


def recover(options: Namespace) -> int:
    """Save everything before the tear of a damaged recording."""
    from allanscope.recording import recover as recover_recording

    print(recover_recording(Path(options.damaged), Path(options.out)))
    return ExitCode.DONE


def check(options: Namespace) -> int:
    """Compare a recording's coefficients with the limits of a specification."""
    from allanscope.pipeline.check import check_against

    for line in check_against(options.recording, Path(options.against), _settings(options)):
        print(line)
    return ExitCode.DONE


def report(options: Namespace) -> int:
    """Write one HTML report from one session or several, compared."""
    from allanscope.pipeline.outputs import report_sessions

    print(report_sessions([Path(path) for path in options.sessions], Path(options.out)))
    return ExitCode.DONE


def fleet(options: Namespace) -> int:
    """Analyse many recordings on Dask."""
    from allanscope.fleet import run_fleet

    return run_fleet(options.pattern, Path(options.out), options.scheduler, quiet=options.quiet)


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

    add = _command(commands, "live", live, "allanscope live            # finds the board by itself")
    add.add_argument("port", nargs="?", default="auto", help=_PORT_HELP)
    _device_arguments(add)
    _session_arguments(add)
    add.add_argument("--resume", metavar="DIR", help="continue the session in DIR after a crash")
    add.add_argument("--for", dest="duration", type=_duration, metavar="TIME", help=_FOR_HELP)
    add.add_argument("--fault", action="append", default=[], help="with sim: a fault to inject")
    add.add_argument("--effect", action="append", default=[], help="with sim: KIND:param=value,...")
    add.add_argument("--seed", type=int, default=0, help="with sim: seed of its noise")

    add = _command(commands, "replay", replay, "allanscope replay session.mcap --speed max")
    add.add_argument("recording", help="a recording or the folder of a session")
    add.add_argument("--speed", default="max", type=_speed, help="1, 10 or max (default)")
    _device_arguments(add)
    _session_arguments(add)
    add.set_defaults(duration=None)

    add = _command(commands, "analyse", analyse, "allanscope analyse log.csv --rate 104 --json -")
    add.add_argument("input", help="a recording, a raw serial capture, or delimited text")
    add.add_argument("--json", metavar="FILE", help="write the result; - for standard output")
    add.add_argument("--report", metavar="FILE.html", help="write the report")
    _device_arguments(add)
    _common_arguments(add)

    add = _command(commands, "simulate", simulate, "allanscope simulate night.mcap --hours 12")
    add.add_argument("out", help="the recording to write")
    add.add_argument("--hours", type=float, default=1.0)
    add.add_argument("--seed", type=int, default=0)
    add.add_argument("--truth", metavar="JSON", help="a result whose model is to be simulated")
    add.add_argument("--effect", action="append", default=[], metavar="KIND:param=value,...")
    _device_arguments(add)
    _common_arguments(add)

    add = _command(commands, "device", device, "allanscope device --wire tmsg --rate 104")
    add.add_argument("--seed", type=int, default=0)
    add.add_argument("--effect", action="append", default=[], metavar="KIND:param=value,...")
    add.add_argument("--fault", action="append", default=[], metavar="KIND:param=value,...")
    add.add_argument("--for", dest="duration", type=_duration, metavar="TIME", help=_FOR_HELP)
    add.add_argument("--emulated", action="store_true", help="real firmware on QEMU's STM32L475")
    _device_arguments(add)
    _common_arguments(add)

    add = _command(commands, "import", import_data, "allanscope import log.csv log.mcap --rate 104")
    add.add_argument("input")
    add.add_argument("out", help="the recording to write")
    _device_arguments(add)
    _common_arguments(add)

    add = _command(commands, "export", export_data, "allanscope export session.mcap night.csv")
    add.add_argument("recording")
    add.add_argument("out", help="a name that ends in .csv, .parquet or .yaml")
    _device_arguments(add)
    _common_arguments(add)

    add = _command(commands, "recover", recover, "allanscope recover session.mcap saved.mcap")
    add.add_argument("damaged")
    add.add_argument("out")
    _common_arguments(add)

    add = _command(commands, "check", check, "allanscope check night.mcap --against spec.toml")
    add.add_argument("recording")
    add.add_argument("--against", required=True, metavar="SPEC.toml")
    _device_arguments(add)
    _common_arguments(add)

    add = _command(commands, "report", report, "allanscope report night-1 night-2 --out both.html")
    add.add_argument("sessions", nargs="+", help="folders of sessions, or result.json files")
    add.add_argument("--out", default="report.html", metavar="FILE.html")
    _common_arguments(add)

    add = _command(commands, "fleet", fleet, "allanscope fleet 'rack/**/*.mcap' --out lot")
    add.add_argument("pattern", metavar="GLOB")
    add.add_argument("--out", required=True, metavar="DIR")
    add.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="an existing Dask cluster")
    _common_arguments(add)

    add = _command(commands, "ports", ports, "allanscope ports")
    _common_arguments(add)
    return top


_PORT_HELP = "a device path, any pyserial URL, auto (default) or sim, the simulated SensorTile"
_FOR_HELP = "how long, e.g. 90s, 10m, 12h"


def _command(  # type: ignore[no-untyped-def]
    commands, name: str, run, example: str
) -> ArgumentParser:
    """Add one command, whose help is the first line of its function."""
    summary = run.__doc__.splitlines()[0]
    one: ArgumentParser = commands.add_parser(
        name, help=summary, description=summary, epilog=f"Example: {example}"
    )
    one.set_defaults(command=run)
    return one


def _common_arguments(one: ArgumentParser) -> None:
    one.add_argument("--quiet", action="store_true", help="say nothing but results and errors")
    one.add_argument("--debug", action="store_true", help="show a traceback when something fails")


def _device_arguments(one: ArgumentParser) -> None:
    group = one.add_argument_group("what the stream does not say by itself")
    group.add_argument("--part", default="", help="LSM6DS3H, LSM6DSL or LSM6DSM")
    group.add_argument("--rate", type=float, metavar="HZ", help="nominal sample rate")
    group.add_argument("--gyro-fs", type=float, metavar="DPS", help="gyro full scale")
    group.add_argument("--accel-fs", type=float, metavar="G", help="accelerometer full scale")
    group.add_argument("--wire", default="", help="wire format; found by listening if not given")
    group.add_argument(
        "--unit", action="append", default=[], type=_unit, metavar="gyro=dps", help="unit of text"
    )


def _session_arguments(one: ArgumentParser) -> None:
    one.add_argument("--out", metavar="DIR", help="folder of the session; must not hold one yet")
    one.add_argument("--view", default="auto", choices=["auto", "window", "web", "none"])
    one.add_argument("--json", action="store_true", help="print the result at the end")
    _common_arguments(one)


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


def _settings(options: Namespace):  # type: ignore[no-untyped-def]
    """Return what the user said about the device, checked."""
    from allanscope.pipeline.settings import device_settings

    return device_settings(options)


def _print_result(analysis, options: Namespace) -> int:  # type: ignore[no-untyped-def]
    if analysis is None:
        raise UsageError("nothing was measured")
    if options.json:
        json.dump(analysis.to_dict(), sys.stdout, indent=1, allow_nan=False)
        print()
    return ExitCode.DONE
