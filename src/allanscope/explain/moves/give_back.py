"""Give bursts back to the coupling that they are: what another axis does then, this one follows."""

from __future__ import annotations

from dataclasses import replace

from allanscope.explain.candidate import Candidate
from allanscope.explain.moves import SearchPath
from allanscope.explain.shock_rows import find_shock_rows
from allanscope.explain.view import View

__all__ = ["give_back"]


def give_back(view: View, path: SearchPath) -> View:
    """Return the view without the bursts that the coupling accepted last explains.

    Bursts are taken out before anything else is known. Once the rows are back, and the coupling is
    fitted to them as well, those are looked for again in what it leaves.
    """
    last = view.accepted[-1]
    bursts = [c for c in view.accepted if c.effect.motion == "burst" and c.signal is not None]
    if "source" not in last.effect.parameters or not bursts:
        return view
    whole = view.without(last, *bursts)
    path.evaluations += 1
    again = _again(whole, last)
    if again is None:
        return view
    left = whole.accept(again)
    rows = {axis: view.cleaned_source(axis) for axis in view.series.axes} | {view.axis: left.data}
    steps = dict(zip(view.series.axes, view.series.lsb, strict=True))
    shocks = find_shock_rows(rows, view.grid.rate_hz, steps)
    still = [(one.first, one.stop) for one in shocks if view.axis in one.axes]
    gone = [c for c in bursts if not any(_touches(c, *rows) for rows in still)]
    if not gone:
        return view
    for burst in gone:
        path.drop(burst)
    bare = view.without(last, *gone)
    return bare.accept(_again(bare, last) or again)


def _again(view: View, coupling: Candidate) -> Candidate | None:
    """Return a coupling fitted again; None where it is another one now, or none."""
    source = coupling.effect.parameters["source"].value
    for found in type(coupling.effect).candidates(view):
        if found.effect.parameters["source"].value == source:
            return replace(found, held_out=coupling.held_out, rivals=coupling.rivals)
    return None


def _touches(burst: Candidate, first: int, stop: int) -> bool:
    assert burst.signal is not None
    return bool(burst.signal[first:stop].any())
