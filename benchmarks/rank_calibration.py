"""Whether intervals are right as a whole: ranks of the truth within what a fit says of it.

    python benchmarks/rank_calibration.py [--draws N] [--only NAME ...] [--seed 1] [--store FOLDER]
                                          [--page] [--quick] [--json FILE]

Simulation-based calibration. Truths are drawn from a prior, records from the truths; the rank is
the confidence that is placed below the truth (`rank_draws.py`). Where every interval of every level
is right, ranks are uniform: their empirical distribution stays within the simultaneous 95 % band of
Saeilynoja, Buerkner and Vehtari (arXiv 2103.10522).

Draws are kept in a store, a small table for each study, which every run extends up to `--draws`
lines: it can be stopped at any time. Without the option the store is shown as it is, and `--page`
writes the table and the picture of docs/explanation/calibration.md from it.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from blind_noise import Array
from figures import Figure, written
from rank_draws import DRAWS, READ_OFF, Outcome
from scipy.stats import binom

STORE = Path(__file__).parent / "ranks"
DOCS = Path(__file__).parents[1] / "docs"
POINTS = np.linspace(0.01, 0.99, 99)
FIXED = ("draw", "d", "found", "gain", "price")
FEWEST = 20
"""Ranks from which a distribution is looked at."""


@dataclass(frozen=True)
class Study:
    """What the store holds of one study.

    Attributes
    ----------
    d, found, gain, price : ndarray, shape (draws,)
        See `Outcome`.
    ranks : dict
        Parameter to its ranks, shape (draws,), NaN where there is none.
    """

    d: Array
    found: Array
    gain: Array
    price: Array
    ranks: dict[str, Array]


def extended(store: Path, name: str, draw: int, seed: int) -> None:
    """Make one draw of a study and append it to its table."""
    outcome = DRAWS[name](np.random.default_rng([seed, zlib.crc32(name.encode()), draw]))
    path = store / f"{name}.csv"
    header = _header(path)
    columns = [*header, *(k for k in outcome.ranks if k not in header)]
    if columns != header:  # a parameter that no draw had before
        lines = path.read_text(encoding="utf-8").splitlines()[1:] if header else []
        more = "," * (len(columns) - len(header)) if header else ""
        rows = [",".join(columns or FIXED), *(line + more for line in lines)]
        path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    with path.open("a", encoding="utf-8") as table:
        table.write(_line(draw, outcome, columns) + "\n")


def _header(path: Path) -> list[str]:
    if not path.exists():
        path.write_text(",".join(FIXED) + "\n", encoding="utf-8")
    with path.open(encoding="utf-8") as table:
        return next(csv.reader(table))


def _line(draw: int, outcome: Outcome, columns: list[str]) -> str:
    fixed = [str(draw), *(_short(v, 2) for v in (outcome.d,)), str(outcome.found)]
    fixed += [_short(v, 1) for v in (outcome.gain, outcome.price)]
    ranks = [_short(outcome.ranks.get(name, np.nan), 4) for name in columns[len(FIXED) :]]
    return ",".join(fixed + ranks)


def _short(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".removeprefix("0") if np.isfinite(value) else ""


def stored(store: Path, name: str) -> Study | None:
    """Return what there is of a study; None where nothing is."""
    path = store / f"{name}.csv"
    if not path.exists():
        return None
    with path.open(encoding="utf-8") as table:
        header, *rows = csv.reader(table)
    if not rows:
        return None
    rows = [row + [""] * (len(header) - len(row)) for row in rows]
    values = np.array([[float(cell or "nan") for cell in row] for row in rows]).T
    of = dict(zip(header, values, strict=True))
    ranks = {name: of[name] for name in header[len(FIXED) :]}
    return Study(of["d"], of["found"], of["gain"], of["price"], ranks)


def run(store: Path, names: list[str], draws: int, seed: int) -> None:
    """Extend every study in turn."""
    store.mkdir(parents=True, exist_ok=True)
    have = {name: len(study.found) if (study := stored(store, name)) else 0 for name in names}
    for round_ in range(draws):
        for name in names:
            if have[name] <= round_:
                extended(store, name, have[name], seed)
                have[name] += 1


@cache
def band(count: int, level: float = 0.95, runs: int = 2000) -> tuple[Array, Array]:
    """Return the simultaneous band of an empirical distribution of uniform ranks at `POINTS`.

    Pointwise binomial limits at a level that is found by simulation, so that all hold at once.
    """
    rng = np.random.default_rng(20260101)
    ranks = np.sort(rng.random((runs, count)), axis=1)
    counts = np.array([np.searchsorted(row, POINTS, side="right") for row in ranks])
    below = binom.cdf(np.arange(count + 1)[:, np.newaxis], count, POINTS)
    at = np.arange(len(POINTS))
    above = 1 - np.where(counts > 0, below[np.maximum(counts - 1, 0), at], 0.0)
    least = 2 * np.minimum(below[counts, at], above).min(axis=1)
    gamma = float(np.quantile(least, 1 - level))
    low = binom.ppf(gamma / 2, count, POINTS) / count
    high = binom.ppf(1 - gamma / 2, count, POINTS) / count
    return low, high


def outside(ranks: Array) -> float:
    """Return how far the distribution of ranks goes towards its band; beyond 1, outside.

    Where few ranks let the band reach 0 or 1, no distribution can leave it there: that none is
    below the first percentile of 50 says nothing.
    """
    low, high = band(len(ranks))
    low, high = np.where(low > 0, low, -np.inf), np.where(high < 1, high, np.inf)
    away = np.searchsorted(np.sort(ranks), POINTS, side="right") / len(ranks) - POINTS
    room = np.maximum(np.where(away > 0, high - POINTS, POINTS - low), 1e-9)
    return float(np.max(np.abs(away) / room))


def ranked(studies: dict[str, Study]) -> Iterator[tuple[str, str, Array]]:
    """Yield study, parameter and ranks of what was found often enough."""
    for name, study in studies.items():
        for parameter, ranks in study.ranks.items():
            known = ranks[np.isfinite(ranks)]
            if len(known) >= FEWEST and parameter not in READ_OFF:
                yield name, parameter, known


def table(studies: dict[str, Study]) -> list[list[object]]:
    """Return a row for each study: draws, how many were named right, and each parameter."""
    rows: list[list[object]] = [["drawn", "draws", "named right", "distances"]]
    for name, study in studies.items():
        cells = []
        for parameter, ranks in study.ranks.items():
            known = ranks[np.isfinite(ranks)]
            label = "" if parameter == name else parameter.replace("_", " ") + " "
            if parameter in READ_OFF:
                cells.append(f"{label}held by {np.sum(known == 0.5)} of {len(known)}")
            elif len(known) >= FEWEST:
                distance = outside(known)
                text = f"{label}{distance:.2f} ({len(known)})"
                cells.append(f"{text} *" if distance > 1 else text)
            elif len(known):
                cells.append(f"{label}({len(known)})")
        right = int(np.sum(study.found == 2))
        rows.append([name.replace("_", " "), len(study.found), right, ", ".join(cells)])
    return rows


def write_table(path: Path, rows: list[list[object]]) -> None:
    """Write a table of the documentation, which the site puts into its page (docs/conf.py)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def picture(studies: dict[str, Study], path: Path) -> None:
    """Draw the distributions of ranks less the uniform one, with their bands."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    shown = list(ranked(studies))
    columns = 6
    rows = -(-len(shown) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(12, 1.5 * rows), sharex=True, layout="constrained", squeeze=False
    )
    for panel in axes.flat[len(shown) :]:
        panel.set_axis_off()
    for panel, (name, parameter, ranks) in zip(axes.flat, shown, strict=False):
        low, high = band(len(ranks))
        share = np.searchsorted(np.sort(ranks), POINTS, side="right") / len(ranks)
        panel.fill_between(POINTS, low - POINTS, high - POINTS, color="0.85", lw=0)
        panel.axhline(0.0, color="0.6", lw=0.8)
        panel.plot(POINTS, share - POINTS, color="C0" if outside(ranks) <= 1 else "C3", lw=1.2)
        panel.set_title(title(name, parameter).replace("_", " "), fontsize=7)
        panel.tick_params(labelsize=6)
    figure.supxlabel("rank of the truth", fontsize=9)
    figure.supylabel("distribution of ranks less the uniform one", fontsize=9)
    figure.savefig(path, dpi=100)


def title(name: str, parameter: str) -> str:
    """Return what the ranks are of.

    >>> title("step", "size"), title("Q", "Q")
    ('step, size', 'Q')
    """
    return parameter if name == parameter else f"{name}, {parameter}"


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=0, help="lines of each study, at the least")
    parser.add_argument("--only", nargs="+", choices=DRAWS, metavar="NAME", help="of studies")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--store", type=Path, default=STORE)
    parser.add_argument("--page", action="store_true", help="write the page and its pictures")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    names = options.only or list(DRAWS)
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) if options.quick else options.store
        run(store, names, 1 if options.quick else options.draws, options.seed)
        studies = {name: one for name in names if (one := stored(store, name)) is not None}
    figures = [
        Figure(
            f"ranks of {title(name, parameter)} ({len(ranks)})", outside(ranks), "of the band", 1.0
        )
        for name, parameter, ranks in ranked(studies)
    ]
    figures.append(Figure("studies drawn from", len(studies), ""))
    if options.page:
        if any(True for _ in ranked(studies)):
            picture(studies, DOCS / "figures" / "rank_calibration.png")
        write_table(DOCS / "explanation" / "ranks.csv", table(studies))
    written(figures, options.json, cpu_seconds=time.process_time() - started)


if __name__ == "__main__":
    main()
