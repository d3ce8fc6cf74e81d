"""What the loop says of measured recordings, beside a reading that owes it nothing.

    python -m benchmarks measured [--only NAME] [--json FILE] [--folder FOLDER] [--quick]

One line an axis of every recording in `recordings/measured`: N of the result beside N read from
the flat part of Welch's density, allantools' OADEV at 1 s and its least, the error before and after
the loop on the record and held out, and the processor time. Below it stands what was found. An axis
whose N differs from the reading by more than 3 % (and twice the reading's standard error) must say
so in a remark; an error after the loop that is larger than before is marked with an exclamation
mark, as is everything else that should not be.
"""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from figures import Figure, all_cpu_s
from independent_reading import Reading, reading_of, samples_of

import allanscope
from allanscope.analysis import Analysis, AxisAnalysis

FOLDER = Path(__file__).parents[1] / "recordings" / "measured"
QUICK_ROWS = 30_000
AGREES = 0.03
FLAG = re.compile(r"\bN\b.*\bfrom the fit\b|\bN is its level below\b")
"""A remark that says N is not what the record shows by itself, or not all of it."""
BETTER = 1.02
"""An error that is larger by less than this is the same."""


@dataclass(frozen=True)
class Row:
    """One axis: numbers in dps and g, NaN where there are none."""

    recording: str
    axis: str
    N: float
    N_lower: float
    N_upper: float
    reading: Reading
    flagged: bool
    chi2: tuple[float, float]
    rms_percent: tuple[float, float]
    sampling_percent: float
    worst_band_z: tuple[float, float]
    held_out: tuple[float, float]
    explained: bool
    found: tuple[str, ...]
    trouble: str
    cpu_s: float
    samples: int

    @property
    def off(self) -> float:
        """N over its reading, less 1."""
        return self.N / self.reading.N - 1

    @property
    def agrees(self) -> bool | None:
        """Whether N, or its upper limit, is what the density shows; None without a reading."""
        allowed = AGREES + 2 * self.reading.N_error / self.reading.N
        if math.isnan(self.N):  # only a limit is known
            least = self.N_upper / self.reading.N - 1
            return None if math.isnan(least) else least >= -allowed
        return None if math.isnan(self.off) else abs(self.off) <= allowed

    @property
    def worse(self) -> tuple[str, ...]:
        """Which errors grew, by more than sampling leaves of a model that is right."""
        pairs = {
            "chi2": (*self.chi2, 2.0), "rms": (*self.rms_percent, 1.5 * self.sampling_percent),
            "band": (abs(self.worst_band_z[0]), abs(self.worst_band_z[1]), 4.0),
        }  # fmt: skip
        return tuple(
            name
            for name, (before, after, sampling) in pairs.items()
            if after > BETTER * max(before, sampling)
        )


def rows_of(path: Path) -> Iterator[Row]:
    """Analyse a recording and yield what is said of each axis."""
    samples = samples_of(path)
    readings = {axis: reading_of(x, samples.rate_hz) for axis, x in samples.axes.items()}
    size = len(next(iter(samples.axes.values())))
    began = all_cpu_s()
    try:
        analysis: Analysis | None = allanscope.analyse(path, rate=samples.stated_hz)
        trouble = ""
    except Exception as error:  # a crash is a result here
        analysis, trouble = None, f"crash: {type(error).__name__}: {error}"
    cpu_s = (all_cpu_s() - began) / len(readings)
    for axis, reading in readings.items():
        found = None if analysis is None else analysis.axes.get(axis)
        yield _row(path.stem, axis, found, reading, trouble, cpu_s, size)


def _row(
    recording: str, axis: str, one: AxisAnalysis | None, reading: Reading,
    trouble: str, cpu_s: float, size: int,
) -> Row:  # fmt: skip
    nothing = (math.nan, math.nan)
    if one is None:
        return Row(
            recording, axis, math.nan, *nothing, reading, False, nothing, nothing, math.nan,
            nothing, nothing, False, (), trouble or "missing", cpu_s, size,
        )  # fmt: skip
    N, loop = one.coefficients.get("N"), one.explanation
    detected = N is not None and N.detected
    remarks = (*one.remarks, *(loop.remarks if loop else ()))
    errors = (loop.before, loop.after) if loop else ()
    trouble = one.failure or (loop.failure or loop.hindrance if loop else "no loop")
    return Row(
        recording, axis,
        N.value if detected else math.nan,
        N.lower if detected else math.nan,
        N.upper if N is not None else math.nan,
        reading,
        any(FLAG.search(remark) for remark in remarks),
        _pair([e.chi2_per_dof for e in errors]),
        _pair([e.rms_percent for e in errors]),
        errors[1].expected_rms_percent if errors else math.nan,
        _pair([e.worst_band_z for e in errors]),
        (loop.held_out_nats, loop.held_out_nats_se) if loop else nothing,
        bool(loop and loop.explained),
        tuple(_words(effect) for effect in loop.effects) if loop else (),
        trouble, cpu_s, size,
    )  # fmt: skip


def _pair(values: list[float]) -> tuple[float, float]:
    return (values[0], values[1]) if len(values) == 2 else (math.nan, math.nan)


def _words(effect: Any) -> str:
    words = effect.evidence.get("words") or ", ".join(
        f"{name} {p.value:.4g} {p.unit}" if isinstance(p.value, float) else f"{name} {p.value}"
        for name, p in effect.parameters.items()
    )
    return f"{effect.kind}: {words}"


def table(rows: list[Row]) -> str:
    """Return one line an axis; mdps or ug, and their /sqrt(Hz)."""
    head = (
        f"{'recording':20} {'ax':2} {'N':>7} {'interval':>15} {'read':>7} {'off %':>6}  "
        f"{'band Hz':>11} {'1 s':>6} {'least':>6} {'at s':>5}  {'chi2':>12} {'rms %':>10} "
        f"{'samp':>4} {'worst z':>10} {'held out':>13} {'found':>5} {'CPU s':>6}"
    )
    lines = [head]
    for row in rows:
        unit = 1e3 if row.axis.startswith("g") else 1e6
        read = row.reading
        flag = "" if row.agrees is None else " " if row.agrees else "f" if row.flagged else "!"
        marks = row.worse
        lines.append(
            f"{row.recording:20} {row.axis:2} {_g(row.N * unit)} "
            f"{_g(row.N_lower * unit)} {_g(row.N_upper * unit)} {_g(read.N * unit)} "
            f"{100 * row.off:+5.1f}{flag or ' '}  {_g(read.band[0], 5)} {_g(read.band[1], 5)} "
            f"{_g(read.oadev_1s * unit, 6)} {_g(read.least * unit, 6)} {_g(read.least_at_s, 5)}  "
            f"{_arrow(row.chi2, 'chi2' in marks)} {_arrow(row.rms_percent, 'rms' in marks, 4)} "
            f"{_g(row.sampling_percent, 4)} {_arrow(row.worst_band_z, 'band' in marks, 4)} "
            f"{row.held_out[0]:6.0f} +-{row.held_out[1]:4.0f} {len(row.found):5d} {row.cpu_s:6.1f}"
        )
    return "\n".join(lines)


def _g(value: float, width: int = 7) -> str:
    """Return three digits in so many columns."""
    text = f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"
    return f"{'-' if math.isnan(value) else text:>{width}}"


def _arrow(pair: tuple[float, float], worse: bool, width: int = 5) -> str:
    return f"{_g(pair[0], width)}>{_g(pair[1], width)}{'!' if worse else ' '}"


def findings(rows: list[Row]) -> str:
    """Return what was found on each axis."""
    lines = []
    for row in rows:
        state = row.trouble or ("explained" if row.explained else "not explained")
        lines.append(f"{row.recording} {row.axis}: {state}")
        lines += [f"    {words}" for words in row.found]
    return "\n".join(lines)


def figures_of(rows: list[Row]) -> list[Figure]:
    """Return what the benchmarks' common table shows."""
    searched = [row for row in rows if not row.trouble]
    judged = [row for row in rows if row.agrees is not None]
    silent = [row for row in judged if not row.agrees and not row.flagged]
    cost = [row.cpu_s / max(row.samples / 1e6, 1.0) for row in rows]
    return [
        Figure("axes of measured recordings", len(rows), "axes"),
        Figure("searched by the loop", len(searched), "axes"),
        Figure("crashed or failed", sum("rror" in row.trouble for row in rows), "axes", 0),
        Figure("N off by more than 3 % and unsaid", len(silent), "axes", 0),
        Figure("N beside a reading", len(judged), "axes"),
        Figure("chi2 larger after the loop", _count(searched, "chi2"), "axes", 0),
        Figure("rms larger after the loop", _count(searched, "rms"), "axes", 0),
        Figure("worst band farther off after the loop", _count(searched, "band"), "axes", 0),
        Figure("called explained", sum(row.explained for row in searched), "axes"),
        Figure("processor time of an axis, most, per 1e6 rows or less", max(cost), "s", 10.0),
    ]


def _count(rows: list[Row], name: str) -> int:
    return sum(name in row.worse for row in rows)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", metavar="NAME", help="recordings whose name contains this")
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--quick", action="store_true", help=f"up to {QUICK_ROWS} rows")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    paths = sorted(options.folder.glob("*.parquet"))
    paths = [path for path in paths if (options.only or "") in path.stem]
    if not paths:
        parser.error(f"no recording in {options.folder} is called {options.only}")
    if options.quick:
        paths = [p for p in paths if len(next(iter(samples_of(p).axes.values()))) <= QUICK_ROWS]
    rows: list[Row] = []
    for path in paths:
        rows += rows_of(path)
        print(f"{path.stem}: {rows[-1].cpu_s:.1f} s of processor time an axis", flush=True)
    print(f"\n{table(rows)}\n\n{findings(rows)}\n")
    figures = figures_of(rows)
    for figure in figures:
        print(f"{figure.what}: {figure.value:.3g} {figure.unit}")
    if options.json:
        whole = {
            "figures": [asdict(figure) for figure in figures],
            "rows": [asdict(r) for r in rows],
        }
        options.json.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
