"""Every figure of speed that was promised, beside its goal, in one run of five minutes.

    python benchmarks/goals.py [--json FILE] [--quick] [--only night live ...]

Wall times are those of whole commands, as a user has them, and mean something only on a machine
with nothing else to do: the load is printed. A start from nothing finds no bytecode of any package.
A night is half an hour of six axes at 6.66 kHz: the sums take 24 times as long for 12 h, the final
analysis as long as here, because it has as many rows. With ``--quick`` live runs are short, and a
night is three minutes.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from figures import Figure, written
from long_recording import make
from replay import NIGHT_H
from startup import seconds

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # a user's commands keep what they compile
ALLANSCOPE = [sys.executable, "-m", "allanscope"]
PIECE = 1 << 18
"""Bytes of text that are decoded at a time."""

WARM_S = 5.0
"""A live run costs what it costs when all is loaded and the first results were shown."""

UNTIL_OPENED = """
import os, sys
wanted = os.path.realpath(sys.argv[1])
def hook(event, given):
    if event == "open" and isinstance(given[0], str | os.PathLike):
        if os.path.realpath(given[0]) == wanted:
            os._exit(0)
sys.addaudithook(hook)
from allanscope.__main__ import main
main(sys.argv[2:])
os._exit(1)
"""
"""A command that ends when it opens its input: all that it needs to begin is loaded by then."""

EFFECTS = (
    "sinusoid:axis=gx,amplitude=0.02,frequency=12",
    "narrowband:axis=gy,frequency=20,bandwidth=1,sigma=0.01",
    "gauss_markov:axis=gz,sigma=0.02,correlation_time=5",
    "random_telegraph:axis=ax,amplitude=0.0005,dwell=20",
    "warm_up:axis=ay,amplitude=0.002,time_constant=600",
    "step:axis=az,size=0.0005,time=3000",
)
"""One of an axis."""


@dataclass
class Watched:
    """What a live run showed of itself, in s since it was started, and what it cost.

    Attributes
    ----------
    lines : list of (float, str)
        What it wrote, and when.
    cost : list of (float, float, float)
        Time, processor time with that of its reader, resident memory in MB; twice a second.
    """

    lines: list[tuple[float, str]] = field(default_factory=list)
    cost: list[tuple[float, float, float]] = field(default_factory=list)
    whole_s: float = 0.0

    def at(self, words: str) -> float:
        """Return when a line with these words came; infinity if none did."""
        return next((at for at, line in self.lines if words in line), float("inf"))

    def percent(self, begin_s: float, end_s: float) -> float:
        """Return what it took of one core between two moments."""
        within = [(at, cpu) for at, cpu, _ in self.cost if begin_s <= at <= end_s]
        (a, b), (c, d) = within[0], within[-1]
        return 100.0 * (d - b) / (c - a)

    def memory_mb(self, end_s: float) -> float:
        """Return the resident memory at a moment."""
        return [mb for at, _, mb in self.cost if at <= end_s][-1]


def live(port: str, for_s: float, cache: Path | None = None, rate: str = "104") -> Watched:
    """Run ``live`` as a user does, without viewer, and watch it from outside."""
    env = dict(os.environ, **({"PYTHONPYCACHEPREFIX": str(cache)} if cache else {}))
    with tempfile.TemporaryDirectory() as folder:
        command = [*ALLANSCOPE, "live", port, "--view", "none", "--for", f"{for_s:g}s"]
        command += ["--out", f"{folder}/session", *(["--rate", rate] if port == "sim" else [])]
        began = time.monotonic()
        run = subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8", env=env)
        assert run.stdout is not None
        os.set_blocking(run.stdout.fileno(), False)
        watched, text, due_s = Watched(), "", 0.0
        while run.poll() is None:
            time.sleep(0.01)
            now_s = time.monotonic() - began
            with contextlib.suppress(BlockingIOError, TypeError):
                text += run.stdout.read() or ""
            *whole_lines, text = text.split("\n")
            watched.lines += [(now_s, line) for line in whole_lines]
            if now_s >= due_s:
                due_s = now_s + 0.5
                with contextlib.suppress(OSError, IndexError):
                    watched.cost.append((now_s, _cpu_s(run.pid), _memory_mb(run.pid)))
        watched.whole_s = time.monotonic() - began
        if run.returncode or not Path(folder, "session", "report.html").is_file():
            raise SystemExit(f"{' '.join(command)} ended with code {run.returncode}")
    return watched


def _cpu_s(pid: int) -> float:
    """Return the processor time of a process and its children, those that have ended included."""
    ticks = 0
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            fields = (process / "stat").read_text().rpartition(")")[2].split()
            if process.name == str(pid):
                ticks += sum(map(int, fields[11:15]))
            elif fields[1] == str(pid):
                ticks += sum(map(int, fields[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def _memory_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    return float(status.partition("VmRSS:")[2].split()[0]) / 1024.0


@contextlib.contextmanager
def device() -> Iterator[str]:
    """Yield the port of a simulated device in a process of its own, at its highest rate."""
    command = [*ALLANSCOPE, "device", "--rate", "6660"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def busy() -> Iterator[None]:
    """Keep every core busy."""
    loops = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(os.cpu_count() or 1)
    ]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def first_use(folder: Path, quick: bool) -> list[Figure]:
    """Measure the first run ever on a machine, and a start with both cores busy."""
    for_s = 10.0 if quick else 60.0
    first = live("sim", for_s, folder / "cache")
    with busy():
        beside = live("sim", 3.0, folder / "another cache")
    return [
        Figure("first run ever: first curve", first.at(" N = "), "s", goal=5.0),
        Figure("the same with both cores busy", beside.at(" N = "), "s", goal=10.0),
        Figure(f"first run ever, live sim --for {for_s:g}s", first.whole_s, "s", goal=for_s + 6.0),
    ]


def starts(folder: Path, quick: bool) -> list[Figure]:
    """Measure how long commands take to begin, warm, and a first analysis beside a later one."""
    made = folder / "ten.mcap"
    _run("simulate", str(made), "--hours", "0.1667", "--quiet")
    analyse = [*ALLANSCOPE, "analyse", str(made), "--quiet", "--json", str(folder / "ten.json")]
    bare, later = (seconds(analyse, folder / "cache") for _ in range(2))
    _forget_files()
    first = seconds(analyse)
    rows = [
        Figure("first analyse over a later one, as pip leaves it", first[0] / later[0], "", 1.3),
        Figure("the same without bytecode", bare[0] / later[0], "", goal=1.3),
    ]
    for name, words in (
        ("replay", ["replay", str(made), "--view", "none", "--out", str(folder / "out")]),
        ("analyse", ["analyse", str(made)]),
        ("report", ["report", str(made), "--out", str(folder / "ten.html")]),
    ):
        command = [sys.executable, "-c", UNTIL_OPENED, str(made), *words]
        wall_s, cpu_s = min(seconds(command) for _ in range(3))
        rows.append(Figure(f"{name}: start to its input", wall_s, "s", goal=0.7))
        rows.append(Figure(f"{name}: start to its input, processor time", cpu_s, "s"))
    return rows


def _forget_files() -> None:
    """Let the system forget what it has read of files, where that is allowed (Linux, as root)."""
    os.sync()
    with contextlib.suppress(OSError):
        Path("/proc/sys/vm/drop_caches").write_text("3\n")


def _run(*words: str) -> None:
    subprocess.run([*ALLANSCOPE, *words], check=True, stdout=subprocess.DEVNULL)


def text(folder: Path, quick: bool) -> list[Figure]:
    """Measure two hours of text at 104 Hz to the result, without and with effects."""
    hours = 0.2 if quick else 2.0
    rows = []
    for name, effects, goal in (("", (), 6.0), (", an effect on each axis", EFFECTS, 9.0)):
        made, csv = folder / f"text{goal:g}.mcap", folder / f"text{goal:g}.csv"
        chosen = [word for effect in effects for word in ("--effect", effect)]
        _run("simulate", str(made), "--hours", f"{hours:g}", *chosen, "--quiet")
        _run("export", str(made), str(csv), "--quiet")
        if not effects:
            rows.append(Figure(f"{hours:g} h of text: rows read", _read_s(csv), "s", goal=0.5))
        result = str(folder / "text.json")
        wall_s, cpu_s = seconds([*ALLANSCOPE, "analyse", str(csv), "--quiet", "--json", result])
        what = f"{hours:g} h x 104 Hz x 6 of text to the result{name}"
        rows.append(Figure(what, wall_s, "s", goal=goal))
        rows.append(Figure("the same, processor time", cpu_s, "s"))
        csv.unlink()
    return rows


def _read_s(csv: Path) -> float:
    """Return the processor time of decoding a file of text, from its bytes to rows."""
    from allanscope.pipeline import Decoding
    from allanscope.recording import Chunk
    from allanscope.wire import WireSettings

    content, decoding = csv.read_bytes(), Decoding(WireSettings())
    pieces = [content[at : at + PIECE] for at in range(0, len(content), PIECE)]
    began = time.process_time()
    for number, piece in enumerate(pieces):
        decoding.feed(Chunk(number, piece))
    decoding.finish()
    return time.process_time() - began


def night(folder: Path, quick: bool) -> list[Figure]:
    """Measure a recording at the highest rate, and say what a night of it would take."""
    hours = 0.05 if quick else 0.5
    path = make(folder / "night.mcap", hours, 6660.0)
    together = _replayed(path)
    each = together["stages_ns"]
    path.unlink()
    times = NIGHT_H / hours
    axis_samples = 6 * together["samples"]
    night_s = together["sums_wall_s"] * times + together["result_wall_s"]
    return [
        Figure("decode", each["decode"], "ns/sample/axis", goal=4.0),
        Figure("spectrum", each["spectrum"], "ns/sample/axis", goal=5.0),
        Figure("deviations of ten estimators", each["deviations"], "ns/sample/axis", goal=10.0),
        Figure("all sums", 1e9 * together["sums_cpu_s"] / axis_samples, "ns/sample/axis", 22.0),
        Figure(f"a night to the result, from {hours:g} h", night_s, "s", goal=30.0),
        Figure("its final analysis", together["result_wall_s"], "s", goal=6.0),
        Figure("its final analysis, processor time", together["result_cpu_s"], "s"),
    ]


def _replayed(path: Path) -> dict[str, Any]:
    """Return what replay.py measures, with one thread of BLAS in each process as in a command."""
    result = path.with_suffix(".json")
    words = [Path(__file__).with_name("replay.py"), "--recording", path, "--json", result]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run(
        [sys.executable, *map(str, words)], check=True, env=environment, stdout=subprocess.DEVNULL
    )
    found: dict[str, Any] = json.loads(result.read_text())
    return found


def watching(folder: Path, quick: bool) -> list[Figure]:
    """Measure a live run at the highest rate, warm, from outside."""
    for_s = 15.0 if quick else 60.0
    with device() as port:
        run = live(port, for_s)
    heard_s = run.at("wire format")
    stopped_s = heard_s + for_s
    half_s, of_core = heard_s + for_s / 2, "% of a core"
    return [
        Figure(
            "live, from 5 s on", run.percent(heard_s + WARM_S, stopped_s - 1), of_core, goal=3.0
        ),
        Figure("live, second half", run.percent(half_s, stopped_s - 1), of_core, goal=3.0),
        Figure("live, resident memory", run.memory_mb(stopped_s - 1), "MB", goal=150.0),
        Figure("first curve after the first byte", run.at(" N = ") - heard_s, "s", goal=1.0),
        Figure(
            "end of live after --for, 6.66 kHz, report written",
            run.whole_s - stopped_s,
            "s",
            goal=3.0,
        ),
    ]


def ends(folder: Path, quick: bool) -> list[Figure]:
    """Measure the end of a run at the default rate."""
    for_s = 5.0 if quick else 30.0
    run = live("sim", for_s)
    after_s = run.whole_s - (run.at("wire format") + for_s)
    return [
        Figure("live sim: first curve, warm", run.at(" N = "), "s"),
        Figure("end of live sim after --for, report written", after_s, "s", goal=3.0),
    ]


PARTS: dict[str, Callable[[Path, bool], list[Figure]]] = {
    "first": first_use,
    "starts": starts,
    "text": text,
    "night": night,
    "live": watching,
    "end": ends,
}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="short runs: a minute and a half")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results here too")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), metavar="PART", help="some parts")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    figures = []
    for part in options.only or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            figures += PARTS[part](Path(folder), options.quick)
    written(figures, options.json, load_at_the_beginning=load)


if __name__ == "__main__":
    main()
