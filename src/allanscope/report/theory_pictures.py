"""Pictures of the method: what each estimator passes, and the way of a sample to a number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from allanscope.allan import transfer
from allanscope.report.picture import COMPONENT, CYCLE, MODEL, Picture, ink

__all__ = ["chain_picture", "transfer_picture"]

_SHOWN = (("ostdev", "classical"), ("oadev", "AVAR"), ("mdev", "MVAR"), ("ohdev", "HVAR"))


def transfer_picture(m: int = 64) -> Picture:
    """Draw ``|H|^2`` of the classical, Allan, modified Allan and Hadamard variance over f tau."""

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        cycles = np.geomspace(0.02, m / 2.0, 4000)
        for (kind, label), colour in zip(_SHOWN, CYCLE * 2, strict=False):
            ax.plot(cycles, transfer(kind, cycles / m, m, 1.0), c=colour, lw=1.2, label=label)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_ylim(1e-6, 3.0)
        ax.set_xlabel("frequency × averaging time f τ")
        ax.set_ylabel("|H(f)|²")
        ax.legend(loc="lower left")

    return Picture(draw)


def chain_picture(steps: Sequence[tuple[str, str, str]], in_series: int) -> Picture:
    """Draw a chain of processing: name, what it does with its parameters, and what comes of it.

    Parameters
    ----------
    steps : sequence of (name, what, result)
        From the sensor to the sums; an empty result says that the step hands everything on.
    in_series : int
        Steps that follow each other; the others stand side by side behind them.
    """

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.set_axis_off()
        ax.set_xlim(-0.06, 1.0)
        ax.set_ylim(-len(steps) + 0.4, 0.6)
        for i, (name, what, result) in enumerate(steps):
            box = {"boxstyle": "round,pad=0.3", "fc": "none", "ec": ink(), "lw": 0.8}
            ax.text(0.0, -i, name, va="center", fontweight="bold", bbox=box)
            ax.text(0.27, -i, what, va="center", fontsize="small")
            if result:
                ax.text(1.0, -i, f"→ {result}", va="center", ha="right", fontsize="small", c=MODEL)
            arrow = {"arrowstyle": "->", "color": COMPONENT}
            if i + 1 < in_series:
                ax.annotate("", (0.05, -i - 0.7), (0.05, -i - 0.3), arrowprops=arrow)
            elif i >= in_series:
                ax.annotate("", (-0.005, -i), (-0.05, -i), arrowprops=arrow)
        ax.plot([-0.05, -0.05, 0.0], [1 - len(steps), 1 - in_series, 1 - in_series], c=COMPONENT)

    return Picture(draw, width=10.0, height=0.55 * len(steps) + 0.4)
