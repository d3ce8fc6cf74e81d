"""Effects injected into measured noise: how many are found, and how much of what is found is true.

    python -m benchmarks injection [--trials 10] [--seed 1] [--only NAME] [--kinds KIND,...]
                                   [--times 1,3] [--no-controls] [--keep FOLDER] [--quick]
                                   [--json FILE]

With ``--keep`` the carriers and the outcome of every trial are kept in files of their own: a run
can be interrupted, continued and extended. They are those of one version of the loop.

The carriers are axes of `recordings/measured` without gaps on which the loop finds at most a few
effects, which are known then, and whose noise spans a few steps; long recordings are cut into
pieces. Into each goes one effect of every kind at 1, 2, 3, 5 and 10 times its limit of detection
(`injection_effects.py`), before the values are rounded. Found is what has the right name at the
right place; of what is named beside it, everything is false that was not there before, under
whatever name. The place of a band is its width. Of kinds that one spectrum cannot tell apart either
counts.

In the null controls the noise of a carrier, whitened by its model, has the signs of its ordinates
drawn anew, or its blocks of a second permuted: the spectrum stays, and every line, step and
coupling goes. What is named there that was not named in the carrier is false.

Intervals are those of Wilson at 95 %.
"""

from __future__ import annotations

import argparse
import pickle
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from blind_noise import Array
from figures import Figure, written
from independent_reading import samples_of
from injection_effects import FORMS, KINDS, Carrier, Injector, Truth
from scipy.fft import dct, idct

import allanscope
from allanscope.explain import AxisExplanation, Effect, explain
from allanscope.history import Record
from allanscope.quantities import DEVIATION
from allanscope.samples import unit_of

T = TypeVar("T")

FOLDER = Path(__file__).parents[1] / "recordings" / "measured"
TIMES = (1.0, 2.0, 3.0, 5.0, 10.0)
ALSO = {
    "drifting_line": {"narrowband"},
    "narrowband": {"drifting_line"},
    "random_telegraph": {"gauss_markov"},
    "gauss_markov": {"random_telegraph"},
    "outliers": {"shock"},
}
"""Names of the same spectrum, or of neighbouring outliers."""
QUIET = {"ism330dhcx-fan-on": "ism330dhcx-fan-off"}
"""The record of the same board, at the same settings, in which its low-pass is not hidden."""
PIECE_ROWS, MOST_KNOWN = 50_000, 4
STEPS = 1.5
"""Least scatter of the differences in steps: noise within one step is another benchmark's."""
NEAR_S, NEAR = 5.0, 0.05
"""Distance in time, and in frequency as a share, up to which two effects are at one place."""
LIMITS = re.compile(r"detection limits in .*: line ([\d.e+-]+) .*? step ([\d.e+-]+) ")
QUICK = ("ism330dhcx-fan-off",)


@dataclass(frozen=True)
class Outcome:
    """What came of one injection: found or not, how much beside it was false, and all in words."""

    right: bool
    false: int
    said: str = ""


@dataclass
class Tally:
    """What was injected and found, by kind and times the limit."""

    asked: Counter[tuple[str, float]] = field(default_factory=Counter)
    right: Counter[tuple[str, float]] = field(default_factory=Counter)
    false: Counter[float] = field(default_factory=Counter)
    named: Counter[float] = field(default_factory=Counter)
    wrong: defaultdict[tuple[str, float], list[str]] = field(
        default_factory=lambda: defaultdict(list)
    )
    controls: int = 0
    control_false: list[str] = field(default_factory=list)

    def enter(self, kind: str, times: float, outcome: Outcome) -> None:
        """Enter the outcome of one injection."""
        self.asked[kind, times] += 1
        self.right[kind, times] += outcome.right
        self.named[times] += outcome.right + outcome.false
        self.false[times] += outcome.false
        if outcome.said:
            self.wrong[kind, times].append(outcome.said)

    def enter_control(self, named: list[str]) -> None:
        """Enter what was named in one control."""
        self.controls += 1
        self.control_false += named


class Kept:
    """What was computed before, in a folder; nothing is kept without one."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def once(self, name: str, compute: Callable[[], T]) -> T:
        """Return what was computed under this name, now or before."""
        path = self.folder / f"{name}.pickle" if self.folder is not None else None
        if path is not None and path.exists():
            return cast(T, pickle.loads(path.read_bytes()))
        found = compute()
        if path is not None:
            path.with_suffix(".new").write_bytes(pickle.dumps(found))
            path.with_suffix(".new").replace(path)
        return found


def carriers(paths: list[Path], axes: tuple[str, ...] = ()) -> Iterator[Carrier]:
    """Yield the axes on which little is found; of some axes only where they are named."""
    filters: dict[str, tuple[Effect, ...]] = {}
    for path in paths:
        record = allanscope.analyse(path, rate=samples_of(path).stated_hz).record
        if record is None or record.stride > 1 or len(record.segments) > 1:
            continue
        for axis in axes or record.axes:
            pieces = _pieces(record, axis)
            for k, piece in enumerate(pieces):
                name = f"{path.stem} {axis}" + f" {k + 1}" * (len(pieces) > 1)
                one = _carrier(piece, name)
                if one is not None:
                    effects = one.known.effects
                    filters[name] = tuple(e for e in effects if e.kind == "band_limit")
                    hidden = filters.get(f"{QUIET.get(path.stem, '')} {axis}", ())
                    yield replace(one, known=replace(one.known, effects=effects + hidden))


def _pieces(record: Record, axis: str) -> list[Record]:
    """Return an axis beside another one of its sensor, or beside another piece of itself."""
    same = [one for one in record.axes if one[0] == axis[0]]
    other = same[(same.index(axis) + 1) % len(same)]
    columns = [record.axes.index(one) for one in (axis, other)]
    rows = len(record.values)
    count = max(1, rows // PIECE_ROWS)
    size = min(rows, PIECE_ROWS) if count > 1 else rows
    tables = [record.values[k * size : (k + 1) * size, columns] for k in range(count)]
    if other == axis:
        other = axis[0] + "yzx"["xyz".index(axis[1])]
        tables = [
            np.column_stack([table[:, 0], tables[k - 1][:, 0]]) for k, table in enumerate(tables)
        ]
        tables = tables if count > 1 else []
    return [
        replace(
            record,
            axes=(axis, other),
            values=table,
            lsb=tuple(record.lsb[column] for column in columns),
            temperature_c=np.full(size, np.nan),
            start_s=record.start_s[:size],
            segments=np.array([[0, size]], np.int64),
            filled=None,
        )
        for table in tables
    ]


def _carrier(record: Record, name: str) -> Carrier | None:
    axis, samples = record.axes[0], record.values[:, 0]
    if np.std(np.diff(samples)) < STEPS * np.median(np.diff(np.unique(samples))):
        return None
    dither = np.random.default_rng(0).uniform(-0.5, 0.5, (2, *record.values.shape)).sum(axis=0)
    record = replace(record, values=record.values + dither * np.array(record.lsb))
    whole = explain(rounded(record, record.values))
    found = whole.axes[axis]
    limits = [m for r in found.remarks if (m := LIMITS.search(r))]
    if found.hindrance or not limits or len(found.own_effects) > MOST_KNOWN:
        return None
    clean, rate = whole.cleaned[axis], record.rate_hz
    n = len(clean)  # the search takes a length whose transform is quick
    f = np.arange(1, n) * rate / (2 * n)
    return Carrier(
        name,
        replace(
            record,
            values=record.values[:n],
            temperature_c=record.temperature_c[:n],
            start_s=record.start_s[:n],
            segments=np.array([[0, n]], np.int64),
        ),
        found,
        float(limits[0][1]) / DEVIATION[unit_of(axis)].factor,
        float(limits[0][2]) / DEVIATION[unit_of(axis)].factor,
        whole.models_after[axis].density(f) * rate / 2,
        clean,
    )


def rounded(record: Record, values: Array, temperature: Array | None = None) -> Record:
    """Return the record with other samples, as its converter gives them."""
    steps = np.array([lsb or 1e-12 for lsb in record.lsb])
    record = replace(record, values=np.round(values / steps) * steps)
    if temperature is None:
        return record
    noise = np.random.default_rng(1).normal(0, 0.02, len(temperature))
    return replace(record, temperature_c=np.round((temperature + noise) * 256) / 256)


def is_right(kind: str, truth: Truth, effect: Effect, carrier: Carrier) -> bool:
    """Tell whether an effect is what was injected, at its place."""
    kind, parameter = FORMS.get(kind, (kind, ""))
    if not {effect.kind, *effect.equivalent} & {kind, *ALSO.get(kind, ())}:
        return False
    if parameter and parameter not in effect.parameters:
        return False
    for name, room in (("frequency", NEAR), ("time", 0.0)):
        if name in truth and name in effect.parameters:
            value, at = effect.parameters[name].value, truth[name]
            unit = 2.0 / carrier.record.start_s[-1] if name == "frequency" else NEAR_S
            if abs(float(value) - float(at)) > max(room * float(at), unit):
                return False
    return "source" not in truth or effect.parameters["source"].value == truth["source"]


def was_there(effect: Effect, known: AxisExplanation) -> bool:
    """Tell whether an effect was found before the injection as well, by whatever name."""
    return any(_is_same(effect, one) for one in known.effects)


def _is_same(effect: Effect, known: Effect) -> bool:
    here, there = _place(effect), _place(known)
    if here is None or there is None:
        return effect.kind == known.kind
    if here[0] != there[0]:
        return False
    room = NEAR_S if here[0] == "time" else NEAR * here[1]
    return there[1] - room <= here[2] and here[1] <= there[2] + room


def _place(effect: Effect) -> tuple[str, float, float] | None:
    """Return where an effect is: in time or in frequency, from where to where."""
    for name in ("time", "frequency"):
        if name in effect.parameters:
            at = float(effect.parameters[name].value)
            width = effect.parameters.get("bandwidth")
            half = 0.0 if width is None else float(width.value) / 2
            return name, at - half, at + half
    if effect.evidence.get("domain") == "spectrum":
        low, high = (effect.parameters[f"frequency_{end}"].value for end in ("low", "high"))
        return "frequency", float(low), float(high)
    return None


def named(found: AxisExplanation) -> list[Effect]:
    """Return the effects that have a name."""
    return [e for e in found.own_effects if e.kind != "unexplained"]


def trial(carrier: Carrier, kind: str, times: float, seed: list[int]) -> Outcome | None:
    """Inject one effect and return what the loop says; None where the carrier has no room."""
    put = Injector(np.random.default_rng(seed), carrier).inject(kind, times)
    if put is None:
        return None
    truth, values, temperature = put
    found = explain(rounded(carrier.record, values, temperature)).axes[carrier.axis]
    effects = named(found)
    right = [e for e in effects if is_right(kind, truth, e, carrier)]
    new = [e for e in effects if e not in right and not was_there(e, carrier.known)]
    if right and not new:
        return Outcome(True, 0)
    said = ", ".join(e.kind for e in found.own_effects if not was_there(e, carrier.known))
    mark = "found, and " if right else ""
    return Outcome(bool(right), len(new), f"{carrier.name}: {mark}{said or 'nothing'}")


def control(carrier: Carrier, blocks: bool, seed: list[int]) -> list[str]:
    """Scramble the noise of a carrier and return what is named in it."""
    rng = np.random.default_rng(seed)
    root = np.sqrt(carrier.variance)
    white = dct(carrier.clean - carrier.clean.mean(), norm="ortho")[1:] / root
    if blocks:
        series = idct(np.concatenate([[0.0], white]), norm="ortho")
        size = max(16, int(carrier.record.rate_hz))
        pieces = np.array_split(series, max(2, len(series) // size))
        series = np.concatenate([pieces[i] for i in rng.permutation(len(pieces))])
        white = dct(series - series.mean(), norm="ortho")[1:]
    else:
        white = white * rng.choice([-1.0, 1.0], len(white))
    values = idct(np.concatenate([[0.0], white * root]), norm="ortho") + carrier.clean.mean()
    both = np.column_stack([values, carrier.record.values[:, 1]])
    found = explain(rounded(carrier.record, both)).axes[carrier.axis]
    how = "blocks" if blocks else "signs"
    return [
        f"{carrier.name} ({how}): {effect.kind}"
        for effect in named(found)
        if not was_there(effect, carrier.known)
    ]


def interval(right: int, asked: int) -> tuple[float, float]:
    """Return Wilson's interval in per cent.

    >>> [round(x, 1) for x in interval(90, 100)]
    [82.6, 94.5]
    """
    if not asked:
        return 0.0, 100.0
    z, p = 1.96, right / asked
    middle = (p + z**2 / (2 * asked)) / (1 + z**2 / asked)
    half = z * np.sqrt(p * (1 - p) / asked + z**2 / (4 * asked**2)) / (1 + z**2 / asked)
    return 100 * (middle - half), 100 * (middle + half)


def measure(
    found: list[Carrier],
    trials: int,
    seed: int,
    times: tuple[float, ...],
    kinds: tuple[str, ...] = KINDS,
    controls: bool = True,
    kept: Kept | None = None,
) -> Tally:
    """Run so many rounds over all kinds; the carriers that have room take turns."""
    tally, kept = Tally(), kept or Kept(None)
    for index in range(trials):
        for kind in kinds:
            k = KINDS.index(kind)
            order = np.random.default_rng([seed, index, k]).permutation(len(found))
            for size in times:
                for c in order:
                    one = [seed, index, k, int(c), int(10 * size)]
                    name = "-".join(map(str, (kind, *one)))
                    outcome = kept.once(name, partial(trial, found[c], kind, size, one))
                    if outcome is not None:
                        tally.enter(kind, size, outcome)
                        break
        for blocks in (False, True) if controls else ():
            for c, carrier in enumerate(found[index % 2 :: 2]):
                one = [seed, index, 99 + c, blocks]
                name = "-".join(map(str, ("control", *one)))
                tally.enter_control(kept.once(name, partial(control, carrier, blocks, one)))
        if index + 1 < trials:
            print(f"after {index + 1} of {trials} rounds\n{table(tally, times)}", flush=True)
    return tally


def table(tally: Tally, times: tuple[float, ...]) -> str:
    """Return completeness by kind and size, and reliability."""
    lines = ["| kind | " + " | ".join(f"{t:g} x" for t in times) + " |"]
    lines.append("|---|" + "---|" * len(times))
    for kind in dict.fromkeys(kind for kind, _ in tally.asked):
        cells = [
            f"{tally.right[kind, t]} of {tally.asked[kind, t]}" if tally.asked[kind, t] else "-"
            for t in times
        ]
        lines.append(f"| `{kind}` | " + " | ".join(cells) + " |")
    for what, good, of in (
        ("found, %", *_sums(tally, times)),
        ("true of what is named, %",
         {t: tally.named[t] - tally.false[t] for t in times}, tally.named),
    ):  # fmt: skip
        cells = []
        for t in times:
            low, high = interval(good[t], of[t])
            value = 100 * good[t] / max(of[t], 1)
            cells.append(f"{value:.0f} [{low:.0f}, {high:.0f}]")
        lines.append(f"| **{what}** | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _sums(tally: Tally, times: tuple[float, ...]) -> tuple[dict[float, int], dict[float, int]]:
    right = {t: sum(tally.right[k, t] for k in KINDS) for t in times}
    return right, {t: sum(tally.asked[k, t] for k in KINDS) for t in times}


def figures_of(tally: Tally, times: tuple[float, ...]) -> list[Figure]:
    """Return what the benchmarks' common table shows."""
    right, asked = _sums(tally, times)
    whole = sum(tally.named.values())
    true = 100 * (1 - sum(tally.false.values()) / max(whole, 1))
    figures = [Figure("true of all that is named", true, "%", 98.0, more=True)]
    for t in times:
        goal = 90.0 if t == 3.0 else None
        share = 100 * right[t] / max(asked[t], 1)
        figures.append(Figure(f"found at {t:g} x the limit", share, "%", goal, more=True))
    figures.append(Figure("named in null controls", len(tally.control_false), "effects"))
    figures.append(Figure("null controls", tally.controls, "axes"))
    return figures


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", metavar="NAME", help="recordings whose name contains this")
    parser.add_argument("--kinds", default=",".join(KINDS), help="by default all")
    parser.add_argument("--times", default=",".join(f"{t:g}" for t in TIMES), metavar="1,3")
    parser.add_argument("--no-controls", action="store_true")
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    paths = [p for p in sorted(FOLDER.glob("*.parquet")) if (options.only or "") in p.stem]
    if options.quick:
        paths = [p for p in paths if p.stem in QUICK]
    kept = Kept(options.keep)
    chosen = "quick" if options.quick else options.only or "all"
    found = kept.once(f"carriers-{chosen}", lambda: list(carriers(paths)))
    if not found:
        parser.error("no axis on which little is found")
    times = (3.0, 10.0) if options.quick else tuple(map(float, options.times.split(",")))
    print(f"{len(found)} carriers: {', '.join(one.name for one in found)}", flush=True)
    trials, kinds = 1 if options.quick else options.trials, tuple(options.kinds.split(","))
    tally = measure(found, trials, options.seed, times, kinds, not options.no_controls, kept)
    print(table(tally, times))
    for (kind, size), said in sorted(tally.wrong.items()):
        print(f"{kind} at {size:g} x: {'; '.join(said)}")
    print(f"null controls: {tally.controls}; {'; '.join(tally.control_false) or 'nothing named'}")
    figures = figures_of(tally, times)
    written(figures, options.json)


if __name__ == "__main__":
    main()
