"""How large an effect must be for half of them to be named, against an ideal detector.

    python benchmarks/sensitivity.py [--store FOLDER] [--page] [--json FILE]

The size of an effect is d', the square root of twice the log-likelihood ratio of one who knows the
noise and what to look for: the deviations by which it stands out. The draws are those of
`rank_calibration.py`, which makes and keeps them (`--draws`); sizes spread evenly in their
logarithm. The d' at which half are found, under whatever name, and half are named right is that of
a logistic curve in ln d' through the answers, with its standard error. The ideal detector knows the
noise but not the place, and pays the same search: half of what is so large that twice its nats are
the square of d' exceed the price at d' = sqrt(2 price).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from blind_noise import Array
from figures import Figure, written
from rank_calibration import DOCS, STORE, Study, stored, write_table
from rank_effects import STUDIES
from scipy.optimize import minimize

GOAL = 1.3
"""Most of the ideal d' that a kind may need."""
FEWEST = 20
WIDTHS = (0.02, 1.0)
"""Of the logistic curve, in ln d'."""


@dataclass(frozen=True)
class Sensitivity:
    """Of one kind: d' of which half are found, or named right, with standard errors, and ideal."""

    draws: int
    found: tuple[float, float]
    named: tuple[float, float]
    ideal: float

    @property
    def loss(self) -> float:
        """What is needed to be named over what would be ideal."""
        return self.named[0] / self.ideal


def half(d: Array, answers: Array) -> tuple[float, float]:
    """Return the d' at which half of the answers are yes, and its standard error.

    >>> d = np.geomspace(2.0, 20.0, 400)
    >>> value, error = half(d, d > 6.0)
    >>> bool(abs(value - 6.0) < 0.2), bool(error < 0.2)
    (True, True)
    """
    x, yes = np.log(d), np.asarray(answers, float)

    def loss(p: Array) -> float:
        width = np.exp(np.clip(p[1], *np.log(WIDTHS)))
        z = (x - p[0]) / width
        prior = 0.5 * ((p[1] - np.log(0.15)) / 1.0) ** 2  # where answers are few
        return float(np.sum(np.logaddexp(0, -z) * yes + np.logaddexp(0, z) * (1 - yes))) + prior

    best = minimize(loss, [float(np.median(x)), np.log(0.15)], method="Nelder-Mead")
    h = np.array([0.05, 0.0])
    curved = (loss(best.x + h) + loss(best.x - h) - 2 * best.fun) / h[0] ** 2
    middle = float(np.exp(best.x[0]))
    return middle, middle / float(np.sqrt(max(curved, 1e-6)))


def sensitivity(study: Study) -> Sensitivity | None:
    """Return that of a study; None where it has no sizes, or too few draws or findings."""
    known = np.isfinite(study.d)
    prices = study.price[study.price > 0]  # what is read off the values has none
    if np.count_nonzero(known) < FEWEST or len(prices) < 3:
        return None
    d, found = study.d[known], study.found[known]
    named = np.count_nonzero(found == 2)
    if min(named, len(found) - named) < FEWEST // 4:  # all are named, or none: there is no half
        return None
    return Sensitivity(
        len(d), half(d, found > 0), half(d, found == 2), float(np.sqrt(2 * np.median(prices)))
    )


def table(known: dict[str, Sensitivity]) -> list[list[object]]:
    """Return a row for each kind."""
    rows: list[list[object]] = [
        ["kind", "draws", "half found", "half named right", "ideal", "loss"],
    ]
    for name, one in known.items():
        (found, f_error), (named, n_error) = one.found, one.named
        loss = f"{one.loss:.2f} ± {n_error / one.ideal:.2f}{' *' if one.loss > GOAL else ''}"
        sizes = f"{found:.1f} ± {f_error:.1f}", f"{named:.1f} ± {n_error:.1f}", f"{one.ideal:.1f}"
        rows.append([name.replace("_", " "), one.draws, *sizes, loss])
    return rows


def picture(studies: dict[str, Study], known: dict[str, Sensitivity], path: Path) -> None:
    """Draw how many are found and named, in four ranges of d', beside the ideal detector."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import LogLocator
    from scipy.stats import norm

    columns = 6
    rows = -(-len(known) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(12, 1.6 * rows), sharey=True, layout="constrained", squeeze=False
    )
    for panel in axes.flat[len(known) :]:
        panel.set_axis_off()
    for panel, (name, one) in zip(axes.flat, known.items(), strict=False):
        study = studies[name]
        usable = np.isfinite(study.d)
        order = np.argsort(study.d[usable])
        d, found = study.d[usable][order], study.found[usable][order]
        for least, colour, label in ((1, "0.6", "found"), (2, "C0", "named right")):
            parts = np.array_split(np.arange(len(d)), 6)
            at = [float(np.exp(np.mean(np.log(d[part])))) for part in parts]
            panel.plot(at, [np.mean(found[p] >= least) for p in parts], "o-", ms=3, lw=1,
                       color=colour, label=label)  # fmt: skip
        fine = np.geomspace(d[0], d[-1], 100)
        panel.plot(fine, norm.cdf(fine - one.ideal), "--", color="C1", lw=1, label="ideal")
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter("")
        panel.set_title(name.replace("_", " "), fontsize=8)
        panel.tick_params(labelsize=6, which="both")
    axes.flat[0].legend(fontsize=6)
    figure.supxlabel("d', standard deviations", fontsize=9)
    figure.savefig(path, dpi=100)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--store", type=Path, default=STORE)
    parser.add_argument("--page", action="store_true", help="write the page and its picture")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    studies = {name: one for name in STUDIES if (one := stored(options.store, name)) is not None}
    known = {name: own for name, one in studies.items() if (own := sensitivity(one)) is not None}
    if options.page and known:
        picture(studies, known, DOCS / "figures" / "sensitivity.png")
        write_table(DOCS / "explanation" / "sensitivity.csv", table(known))
    figures = [
        Figure(f"d' of half named, {name}", one.named[0], "sd", GOAL * one.ideal, bound=one.ideal)
        for name, one in known.items()
    ]
    figures.append(Figure("kinds with a sensitivity", len(known), ""))
    written(figures, options.json)


if __name__ == "__main__":
    main()
