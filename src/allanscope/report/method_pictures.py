"""Pictures of the method itself: what estimators pass, how noises rise and fall, where numbers sit.

They need no measurement; the parameters in them are those that the program works with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from allanscope.allan import KINDS, transfer, variance_name
from allanscope.allan.noise_type import NAMES, Family, unit_hadamard, unit_variance
from allanscope.report.chain import ChainStep
from allanscope.report.curve_pictures import scale_loglog
from allanscope.report.picture import COMPONENT, CYCLE, MODEL, Picture, ink

__all__ = ["chain_picture", "slopes_picture", "transfer_picture"]

_PANELS: tuple[tuple[str, Family], ...] = (("adev", "avar"), ("mdev", "mvar"), ("hdev", "hvar"))
_WITH_ALLAN = 5
"""Power laws that have an Allan variance: from white PM to random walk FM."""
_INDENT = 0.022
_HYBRID = "theoh"
"""OAVAR up to a tenth of the run, THEOBR above: it has no transfer function of its own."""


def transfer_picture(highest: float = 32.0, points: int = 4000) -> Picture:
    """Draw ``|H|^2`` of every estimator over f tau; that of TVAR over tau^2.

    Estimators of one transfer function share a line: a total has that of what it estimates.

    Parameters
    ----------
    highest : float
        Largest f tau, up to 32.
    points : int
        Of a line.
    """
    m = 64
    cycles = np.geomspace(0.02, highest, points)
    lines: list[tuple[list[str], NDArray[np.float64]]] = []
    for kind in KINDS:
        if kind == _HYBRID:
            continue
        passed = transfer(kind, cycles / m, m, 1.0)
        if kind in ("tdev", "ttotdev"):
            passed = passed / m**2
        same = next((names for names, known in lines if np.allclose(known, passed)), None)
        if same is None:
            lines.append(([variance_name(kind)], passed))
        else:
            same.append(variance_name(kind))

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharey=True, gridspec_kw={"wspace": 0.05})
        for i, ((names, passed), colour) in enumerate(zip(lines, CYCLE * 2, strict=False)):
            label = ", ".join(names) + (" (over τ²)" if names[0] == "TVAR" else "")
            panels[i % 2].plot(cycles, passed, c=colour, lw=1.1, label=label)
        for ax in panels:
            ax.set_ylim(1e-8, 6.0)
            scale_loglog(ax, "frequency × averaging time f τ", "")
            ax.legend(loc="lower left", fontsize="small")
        panels[0].text(0.98, 0.95, "|H(f)|²", ha="right", transform=panels[0].transAxes)

    return Picture(draw, width=10.0, height=4.6)


def slopes_picture() -> Picture:
    """Draw the variances of every power law over averaging time, of one level at m = 16.

    The design tip's figure 3 for AVAR, beside it MAVAR, which parts white from flicker phase noise,
    and HVAR, the only one of the three that has an expectation for flicker walk and random run. Of
    these two the others show the slowest part, a ramp, whose level grows with the record.
    """
    m = 2.0 ** np.arange(11)
    names = list(NAMES.values())
    steep = " and ".join(names[_WITH_ALLAN:])
    saturated = f"{steep}: slope saturates at 2,\nlevel grows with the record"

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 3, sharey=True)
        for ax, (kind, family) in zip(panels, _PANELS, strict=True):
            unit = unit_hadamard(m) if family == "hvar" else unit_variance(family, m)
            for name, values, colour in zip(names, unit, CYCLE * 2, strict=False):
                level = values / values[4]
                slope = round(float(np.log2(level[-1] / level[-2])), 1) + 0.0
                ax.plot(m, level, c=colour, lw=1.3, label=f"{name}, slope {slope:g}")
            if family != "hvar":
                ax.plot(m, (m / m[4]) ** 2, c=ink(), lw=1.1, ls=(0, (4, 3)), label=saturated)
            scale_loglog(ax, "averaging factor m = τ / τ₀", "")
            ax.set_title(variance_name(kind), fontsize="medium")
            ax.legend(loc="upper center", fontsize="x-small")
        panels[0].set_ylabel("σ²(τ) / σ²(16 τ₀)")

    return Picture(draw, width=10.0, height=4.2, fixed=False)


def chain_picture(steps: Sequence[ChainStep]) -> Picture:
    """Draw a chain of processing as a tree: each step, its parameters, and what comes of it."""

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.set_axis_off()
        ax.set_xlim(0.0, 1.0)
        ax.set_ylim(-len(steps) + 0.4, 0.6)
        arrow = {"arrowstyle": "->", "color": COMPONENT, "shrinkA": 0.0, "shrinkB": 2.0}
        box = {"boxstyle": "round,pad=0.25", "fc": "none", "ec": ink(), "lw": 0.8}
        above: dict[int, int] = {}
        for i, step in enumerate(steps):
            left = _INDENT * step.depth
            ax.text(left, -i, step.name, va="center", fontweight="bold", bbox=box)
            ax.text(0.33, -i, step.what, va="center", fontsize="small")
            ax.text(
                1.0, -i, f"→ {step.numbers}", va="center", ha="right", fontsize="small", c=MODEL
            )
            if step.depth:
                trunk = left - _INDENT / 2.0
                start = above[step.depth - 1] - 0.0
                ax.plot([trunk, trunk], [-start - 0.32, -i], c=COMPONENT, lw=1.0)
                ax.annotate("", (left - 0.003, -i), (trunk, -i), arrowprops=arrow)
            above[step.depth] = i

    return Picture(draw, width=13.0, height=0.42 * len(steps) + 0.3)
