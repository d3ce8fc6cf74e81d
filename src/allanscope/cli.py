"""The command line: one short function per command, and the parser that calls it.

Nothing heavy is imported here: a command imports the rooms it needs when it runs, so that
``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from argparse import ArgumentParser, Namespace
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from allanscope import arguments
from allanscope.errors import ExitCode, UsageError
from allanscope.sanitize import print_error, sanitize

if TYPE_CHECKING:
    from allanscope.allan import CurveChoices
    from allanscope.analysis import Analysis, ReferenceCurve
    from allanscope.pipeline import DeviceSettings, SessionSettings, SimulatedSettings

__all__ = ["WITH_SETTINGS", "keep_inputs", "parser"]

WITH_SETTINGS = ("live", "replay", "open")
"""Commands that take defaults from the settings file."""


# --- commands ---------------------------------------------------------------------------------


def live(options: Namespace) -> int:
    """Watch a sensor live: plot its Allan curves and record every byte."""
    from allanscope.pipeline import run_live

    analysis = run_live(
        options.port,
        _device_settings(options),
        _session_settings(options, options.duration),
        _simulated_settings(options),
        resume=Path(options.resume) if options.resume else None,
    )
    _print_json(analysis, options.json)
    return _exit_code(analysis)


def replay(options: Namespace) -> int:
    """Replay a recording as if it came from a live device."""
    from allanscope.pipeline import run_replay

    analysis = run_replay(
        Path(options.recording),
        options.speed,
        _device_settings(options),
        _session_settings(options, None),
        lambda analysis: _print_json(analysis, options.json),
    )
    return _exit_code(analysis)


def open_view(options: Namespace) -> int:
    """Show the charts of a session again, in a window or in the browser."""
    from allanscope.pipeline import open_charts

    def report(line: str) -> None:
        print(sanitize(line), flush=True)

    open_charts(options.session, options.view, options.view_port, report)
    return ExitCode.DONE


def analyse(options: Namespace) -> int:
    """Analyse a complete recording, raw capture or text file."""
    if not options.report and (options.title or options.operator or options.full):
        raise UsageError("--title, --operator and --full need --report FILE")
    from allanscope.pipeline import reuse_memory, search_process

    reuse_memory()
    source = Path(options.input)
    with search_process(source) as workers:  # before anything heavy is loaded here
        _require_writable(options.report, options.json, options.table)
        references = _references(options)
        from allanscope.pipeline import analyse_input

        asked = source, _device_settings(options), options.quiet, _curve_choices(options)
        analysis = analyse_input(*asked, workers)
    from allanscope.analysis import with_comparison
    from allanscope.pipeline import write_json, write_report, write_table

    analysis = with_comparison(analysis, references)
    # The numbers first: whatever drawing may run into, they are there.
    if options.json == "-":
        _print_json(analysis, True)
    elif options.json:
        write_json(analysis, Path(options.json))
    if options.table:
        write_table(analysis, Path(options.table))
    if options.report or options.figures:
        page, figures = (Path(x) if x else None for x in (options.report, options.figures))
        write_report(analysis, page, figures, **_heading(options))
    if not options.quiet and options.json != "-":
        from allanscope.view import summary_lines

        print("\n".join(summary_lines(analysis)))
    _name_outputs(options, options.report, options.figures, options.json, options.table)
    return _exit_code(analysis)


def simulate(options: Namespace) -> int:
    """Record the simulated device, much faster than real time."""
    from allanscope.pipeline import simulate_recording

    file = simulate_recording(
        Path(options.out),
        options.hours,
        _device_settings(options),
        _simulated_settings(options),
        options.quiet,
    )
    _name_outputs(options, str(file))
    return ExitCode.DONE


def device(options: Namespace) -> int:
    """Run the simulated device on a virtual serial port until it is stopped."""
    from allanscope.pipeline import run_emulated_device, run_virtual_device

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
    """Convert text, a raw capture, a log or a bag into a recording."""
    from allanscope.pipeline import import_capture

    source, out = Path(options.input), Path(options.out)
    file = import_capture(source, out, _device_settings(options), options.quiet)
    _name_outputs(options, str(file))
    return ExitCode.DONE


def export_data(options: Namespace) -> int:
    """Write samples as CSV or Parquet, or coefficients for Kalibr, OpenVINS, MATLAB, ..."""
    from allanscope.pipeline import export_recording

    export_recording(
        Path(options.recording),
        Path(options.out),
        _device_settings(options),
        options.quiet,
        options.layout,
        options.upper_limits,
        options.bound,
    )
    return ExitCode.DONE


def recover(options: Namespace) -> int:
    """Save what is readable of a truncated or damaged recording."""
    from allanscope.recording import Recording
    from allanscope.recording import recover as recover_recording
    from allanscope.view import progress

    damaged = Path(options.damaged)
    whole = Recording(damaged).unpacked_bytes
    with progress(whole, "recovering", unit="B", quiet=options.quiet) as advance:
        report = recover_recording(damaged, Path(options.out), advance)
    print(report)
    return ExitCode.DONE


def check(options: Namespace) -> int:
    """Compare a recording's coefficients with the limits of a specification."""
    from allanscope.atomic_write import write_text
    from allanscope.pipeline import check_against, check_failure, to_json, to_junit

    asked = Path(options.recording), Path(options.against)
    _require_writable(options.junit, options.json)
    verdicts = check_against(*asked, _device_settings(options))
    if options.junit:
        write_text(Path(options.junit), to_junit(verdicts, *asked))
    if options.json == "-":
        print(to_json(verdicts, *asked), end="")
    else:
        print("\n".join(str(verdict) for verdict in verdicts))
    if options.json and options.json != "-":
        write_text(Path(options.json), to_json(verdicts, *asked))
    failed = check_failure(verdicts)
    if failed is not None:
        raise failed
    return ExitCode.DONE


def verify(options: Namespace) -> int:
    """Compare what this machine computes with certified values."""
    from allanscope.atomic_write import write_text
    from allanscope.errors import CheckFailed
    from allanscope.verify import table_lines, to_json, verify

    _require_writable(options.json)

    def report(name: str) -> None:
        if not options.quiet:
            print(f"checking {name} ...", file=sys.stderr, flush=True)

    checks = verify(report)
    document = to_json(checks) if options.json else ""
    print(document if options.json == "-" else "\n".join(table_lines(checks)), flush=True)
    if options.json and options.json != "-":
        write_text(Path(options.json), document)
        _name_outputs(options, options.json)
    missed = [check.name for check in checks if not check.passed]
    if missed:
        raise CheckFailed(f"{len(missed)} of {len(checks)} checks failed: {', '.join(missed)}")
    return ExitCode.DONE


def report(options: Namespace) -> int:
    """Write one HTML report on a session, or on several compared."""
    from allanscope.pipeline import report_sessions, reuse_memory

    reuse_memory()
    paths, figures = [Path(path) for path in options.sessions], options.figures
    page = report_sessions(
        paths,
        Path(options.out),
        _device_settings(options),
        options.quiet,
        Path(figures) if figures else None,
        _curve_choices(options),
        **_heading(options),
    )
    if options.quiet:  # the result of the command
        print(page)
    _name_outputs(options, str(page), figures)
    return ExitCode.DONE


def together(options: Namespace) -> int:
    """Separate what boards on one bench have in common from the noise of each."""
    from allanscope.atomic_write import write_text
    from allanscope.pipeline import analyse_together

    _require_writable(options.json)
    paths = [Path(path) for path in options.recordings]
    found = analyse_together(paths, _device_settings(options), options.quiet)
    if options.json == "-":
        print(found.json(), end="")
        return ExitCode.DONE
    if options.json:
        write_text(Path(options.json), found.json())
    print("\n".join(map(sanitize, found.lines_of_text())))
    _name_outputs(options, options.json)
    return ExitCode.DONE


def fleet(options: Namespace) -> int:
    """Analyse many recordings with Dask; write one table and one report."""
    from allanscope.fleet import FleetSettings, problem_lines, run_fleet, summary_lines

    settings = FleetSettings(
        patterns=tuple(options.recordings),
        out=options.out,
        scheduler=options.scheduler,
        workers=options.workers,
        unit_pattern=options.unit_name,
        limits=Path(options.against) if options.against else None,
        compare=options.compare,
        partition=options.partition,
        quiet=options.quiet,
    )
    result = run_fleet(settings, _device_settings(options))
    for line in problem_lines(result):
        print_error(line)
    print("\n".join(map(sanitize, summary_lines(result))))
    if result.left:
        return ExitCode.STOPPED
    if result.failures:
        return ExitCode.INPUT
    rejected = result.acceptance is not None and result.acceptance.rejected
    return ExitCode.CHECK_FAILED if rejected else ExitCode.DONE


def convert(options: Namespace) -> int:
    """Convert a spectral density into a deviation, or back."""
    from allanscope.pipeline import convert_table

    convert_table(
        Path(options.input),
        Path(options.out),
        options.given,
        options.wanted,
        options.rate,
        options.carrier,
    )
    _name_outputs(options, options.out)
    return ExitCode.DONE


def stability(options: Namespace) -> int:
    """Compute one quantity: power-law fit, noise type, MTIE, GCODEV, degrees of freedom, ..."""
    from allanscope.pipeline import StabilityRequest, stability_table

    request = StabilityRequest(
        name=options.name,
        inputs=tuple(Path(path) for path in options.inputs),
        axis=options.axis,
        is_phase=options.data == "phase",
        taus=options.taus,
        kind=options.kind.lower(),
        letters=options.letters,
        low_s=options.low,
        high_s=options.high,
        noise_type=options.noise_type,
        model=options.model,
        samples=options.samples,
        device=_device_settings(options),
        quiet=options.quiet,
    )
    table = stability_table(request)
    if options.out:
        from allanscope.atomic_write import write_text

        write_text(Path(options.out), table)
        _name_outputs(options, options.out)
    else:
        print(table, end="")
    return ExitCode.DONE


def chart(options: Namespace) -> int:
    """Draw transfer functions of estimators, slopes of noise types, or the signal chain."""
    from allanscope.pipeline import draw_chart

    draw_chart(options.name, Path(options.out), _device_settings(options))
    stem = Path(options.out).with_suffix("")
    _name_outputs(options, f"{stem}.svg", f"{stem}.png")
    return ExitCode.DONE


def ports(options: Namespace) -> int:
    """List the serial ports and the one that `auto` would choose."""
    from allanscope.sources import describe_ports

    print("\n".join(describe_ports()))
    return ExitCode.DONE


def doctor(options: Namespace) -> int:
    """Check this machine, and print the command that fixes what is wrong."""
    from allanscope.pipeline import machine_checks

    bad = False
    for one in machine_checks(Path(options.folder), options.rate):
        print(sanitize(str(one), keep="\n"), flush=True)
        bad = bad or one.grade == "bad"
    return ExitCode.CHECK_FAILED if bad else ExitCode.DONE


def completion(options: Namespace) -> int:
    """Print the script that completes commands and options in a shell."""
    from allanscope import shell

    print(shell.completion(parser(), options.shell), end="")
    return ExitCode.DONE


# --- the parser -------------------------------------------------------------------------------


def parser() -> ArgumentParser:
    """Return the parser of the whole command line."""
    top = _Parser(
        prog="allanscope",
        description="Live Allan-variance monitor for LSM6DS3H / LSM6DSL / LSM6DSM sensors.",
        epilog="Without a device: allanscope live sim",
    )
    top.add_argument("--version", action=_Version, nargs=0, help="print the versions and exit")
    top.add_argument(
        "--show-settings", action=_Settings, nargs=0, help="print the settings file and exit"
    )
    top.set_defaults(command=lambda _: _help(top), debug=False)
    commands = top.add_subparsers(metavar="COMMAND")
    for name, (run, takes, example) in _COMMANDS.items():
        summary = (run.__doc__ or "").splitlines()[0]
        one = commands.add_parser(
            name, help=summary, description=summary, epilog=f"Example: allanscope {example}"
        )
        one.set_defaults(command=run)
        takes(one)
        one.add_argument("--quiet", action="store_true", help="print only results and errors")
        one.add_argument("--debug", action="store_true", help="show a traceback on an error")
    return top


_COMMANDS = {
    "live": (live, arguments.live, "live            # finds the board by itself"),
    "replay": (replay, arguments.replay, "replay session.mcap --speed max"),
    "open": (open_view, arguments.open_view, "open session-folder"),
    "analyse": (analyse, arguments.analyse, "analyse log.csv --rate 104 --report log.html"),
    "simulate": (simulate, arguments.simulate, "simulate night.mcap --hours 12 --rate 104"),
    "device": (device, arguments.device, "device --wire tmsg --rate 104"),
    "import": (import_data, arguments.import_data, "import log.csv log.mcap --rate 104"),
    "export": (export_data, arguments.export_data, "export session.mcap night.csv"),
    "recover": (recover, arguments.recover, "recover session.mcap saved.mcap"),
    "check": (check, arguments.check, "check night.mcap --against spec.toml"),
    "report": (report, arguments.report, "report night-1 night-2 --out both.html"),
    "together": (together, arguments.together, "together board-1.mcap board-2.mcap board-3.mcap"),
    "fleet": (fleet, arguments.fleet, "fleet 'lot/**/*.mcap' --out lot-result"),
    "convert": (convert, arguments.convert, "convert density.csv adev.csv --from S_y --to adev"),
    "stability": (stability, arguments.stability, "stability mtie night.mcap --axis gx"),
    "chart": (chart, arguments.chart, "chart transfer transfer.svg"),
    "ports": (ports, arguments.nothing, "ports"),
    "doctor": (doctor, arguments.doctor, "doctor"),
    "completion": (completion, arguments.completion, "completion bash"),
    "verify": (verify, arguments.verify, "verify --json verified.json"),
}


_PACKAGES = ("numpy", "scipy", "rerun-sdk", "mcap", "pyserial", "matplotlib")
"""Whose versions matter when something is wrong."""


def _help(top: ArgumentParser) -> int:
    """Say what there is to do, to whoever names no command."""
    top.print_help()
    return ExitCode.DONE


class _Parser(ArgumentParser):
    """A parser that complains in one line; those of the commands are of the same class."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse what is not known here, so that the error names the command that was called."""
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            meant = _did_you_mean(unknown[0], list(self._option_string_actions))
            self.error(f"unrecognized arguments: {' '.join(unknown)}{meant}")
        return known, unknown

    def error(self, message: str) -> NoReturn:
        """Print what is wrong with the call and where to look, like every other error."""
        wrong = _INVALID_CHOICE.fullmatch(message)
        if wrong:
            what, value, choices = wrong.groups()
            names = re.findall(r"[\w-]+", choices)
            meant = _did_you_mean(value, names) or f"; choose one of {', '.join(names)}"
            message = f"unknown {what.lower()} {value!r}{meant}"
        see = " See" if message.endswith("?") else "; see"
        self.exit(ExitCode.USAGE, f"allanscope: {sanitize(message)}{see} {self.prog} --help\n")


_INVALID_CHOICE = re.compile(
    r"argument (\S+): invalid choice: '(.*)'(?:, maybe .*)? \(choose from (.*)\)", re.S
)
"""What argparse says of a value that is none of the choices, in every version of Python."""


def _did_you_mean(value: str, names: list[str]) -> str:
    """Return the end of a message that names what is most like a value, if anything is."""
    import difflib

    like = difflib.get_close_matches(value.split("=", maxsplit=1)[0], names, 1, 0.8)
    return f"; did you mean {like[0]}?" if like else ""


class _Version(argparse.Action):
    """Print the version; looked up only then, because it reads the package's metadata."""

    def __call__(self, top: ArgumentParser, *_: object) -> None:
        import platform
        from importlib.metadata import PackageNotFoundError, version

        print(f"allanscope {version('allanscope')}")
        print(f"Python {platform.python_version()}, {platform.platform(terse=True)}")
        for name in _PACKAGES:
            with suppress(PackageNotFoundError):
                print(f"{name} {version(name)}")
        top.exit()


class _Settings(argparse.Action):
    """Print the settings file, with what could stand in it."""

    def __call__(self, top: ArgumentParser, *_: object) -> None:
        from allanscope.shell import settings_lines

        print(sanitize("\n".join(settings_lines()), keep="\n"))
        top.exit()


# --- from arguments to settings -----------------------------------------------------------------


def _device_settings(options: Namespace) -> DeviceSettings:
    from allanscope.pipeline import DeviceSettings

    return DeviceSettings(
        part=options.part,
        rate_hz=options.rate,
        gyro_fs=options.gyro_fs,
        accel_fs=options.accel_fs,
        wire=options.wire,
        units=tuple(options.unit),
        stream=options.stream,
        baud=getattr(options, "baud", None),
    )


def _heading(options: Namespace) -> dict[str, Any]:
    return {name: getattr(options, name) for name in ("title", "operator", "full")}


def _curve_choices(options: Namespace) -> CurveChoices:
    from allanscope.allan import CurveChoices

    try:
        return CurveChoices(
            kinds=tuple(options.kinds),
            taus=options.taus,
            per_octave=options.per_octave,
            hadamard=options.hadamard,
            noise=options.noise_type,
            bias_corrected="all" if options.bias == "all" else options.bias == "usual",
            variance=options.variance,
            simple_limits=options.simple_limits,
            window_s=options.window,
            power_laws=options.power_laws,
        )
    except ValueError as error:
        raise UsageError(str(error)) from None


def _session_settings(options: Namespace, duration_s: float | None) -> SessionSettings:
    from allanscope.pipeline import SessionSettings

    return SessionSettings(
        out=Path(options.out) if options.out else None,
        view=options.view,
        quiet=options.quiet or options.json,
        duration_s=duration_s,
        folder=Path(getattr(options, "folder", None) or "."),
        view_port=options.view_port,
        on_event=options.on_event,
        events_to=Path(options.events_to) if options.events_to else None,
        window_s=options.window,
        references=_references(options),
    )


def _references(options: Namespace) -> dict[str, ReferenceCurve]:
    from allanscope.analysis import read_reference

    return read_reference(Path(options.compare)) if options.compare else {}


def _simulated_settings(options: Namespace) -> SimulatedSettings:
    from allanscope.pipeline import SimulatedSettings

    return SimulatedSettings(
        seed=options.seed,
        effects=tuple(options.effect),
        faults=tuple(options.fault),
        noise=tuple(options.noise),
        truth=Path(options.truth) if options.truth else None,
    )


def _name_outputs(options: Namespace, *names: str | None) -> None:
    """Say which files and folders a command has written; not what went to a pipe or a device."""
    # Standard output may be the result itself, which others read.
    stream = sys.stderr if getattr(options, "json", None) == "-" else sys.stdout
    for name in names:
        if name and not options.quiet and (Path(name).is_file() or Path(name).is_dir()):
            print(f"Saved: {name}", file=stream)


_OUTPUTS = ("out", "json", "report", "table", "junit")
"""Options and arguments that name a file to write."""


def keep_inputs(options: Namespace) -> None:
    """Refuse to write a file over one that is read.

    Raises
    ------
    UsageError
        Naming the file.
    """
    read: list[str] = []
    written: list[str] = []
    for name, given in vars(options).items():
        words = given if isinstance(given, list) else [given]
        # A title or a command that is no name of a file, such as one too long for it, is none here.
        files = [word for word in words if isinstance(word, str) and os.path.isfile(word)]
        (written if name in _OUTPUTS else read).extend(files)
    for out in written:
        if any(os.path.samefile(out, file) for file in read):
            raise UsageError(f"{out} is read, and would be overwritten; choose another name")


def _require_writable(*names: str | None) -> None:
    """Say before long work is begun that a result could not be written; `-` is standard output."""
    from allanscope.atomic_write import require_writable

    for name in names:
        if name and name != "-":
            require_writable(Path(name))


def _print_json(analysis: Analysis, wanted: bool) -> None:
    if wanted:
        json.dump(analysis.to_dict(), sys.stdout, indent=1, allow_nan=False)
        print()


def _exit_code(analysis: Analysis) -> int:
    """Return how a command ends that has a result, and say what is missing of it."""
    failed = {name: axis.failure for name, axis in analysis.axes.items() if axis.failure}
    lines = [
        f"the analysis of {name} failed: {why}; the other axes are complete"
        for name, why in failed.items()
    ]
    not_passed = _not_passed(analysis)
    for line in (*lines, *analysis.failures, *not_passed):
        print_error(line)
    if failed:
        return ExitCode.UNEXPECTED
    if not_passed:
        return ExitCode.CHECK_FAILED
    return ExitCode.INCOMPLETE if analysis.failures else ExitCode.DONE


def _not_passed(analysis: Analysis) -> list[str]:
    """Return why the curves do not pass the reference of ``--compare``; nothing where they do."""
    if not analysis.reference:
        return []
    compared = {name: one.comparison for name, one in analysis.axes.items() if one.comparison}
    if not compared:  # as a limit that the recording is too short for
        return [f"no curve at the averaging times of {analysis.reference}: nothing was compared"]
    higher = [name for name, one in compared.items() if not one.passed]
    if not higher:
        return []
    many = f"{len(higher)} of {len(compared)} axes"
    return [f"higher than {analysis.reference}: {', '.join(higher)} ({many})"]
