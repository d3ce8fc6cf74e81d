"""Give rows back to the coupling that they are: what another axis does then, this one follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.outliers import Outliers
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["give_back"]

_LOUDER = 2.0
"""Mean square of rows, in units of the noise, from which a burst is left in them."""


def give_back(view: View, path: SearchPath) -> View:
    """Return the view without the bursts and outliers that the coupling accepted last explains.

    They are taken out before anything else is known. Once the rows are back, and the coupling is
    fitted to them as well, those are looked for again in what it leaves.
    """
    last = view.accepted[-1]
    taken = [c for c in view.accepted if _is_taken_out(c)]
    if "source" not in last.effect.parameters or not taken:
        return view
    whole = view.without(last, *taken)
    path.evaluations += 1
    again = _again(whole, last)
    if again is None:
        return view
    left = whole.accept(again)
    still = [c for kind in {type(c.effect) for c in taken} for c in kind.candidates(left)]
    gone = [
        c
        for c in taken
        if not any(c.kind == s.kind and c.effect.is_same(s.effect, view.grid) for s in still)
        and (isinstance(c.effect, Outliers) or _is_noise(left, c))
    ]
    if not gone:
        return view
    for one in gone:
        path.drop(one)
    bare = view.without(last, *gone)
    return bare.accept(_again(bare, last) or again)


def _is_taken_out(candidate: Candidate) -> bool:
    effect = candidate.effect
    return candidate.signal is not None and (
        effect.motion == "burst" or isinstance(effect, Outliers)
    )


def _is_noise(view: View, burst: Candidate) -> bool:
    """Return whether the rows of a burst are no louder than the noise that a view has there."""
    assert burst.signal is not None
    return float(np.mean(view.innovations[burst.signal != 0] ** 2)) < _LOUDER


def _again(view: View, coupling: Candidate) -> Candidate | None:
    """Return a coupling fitted again; None where it is another one now, or none."""
    source = coupling.effect.parameters["source"].value
    for found in type(coupling.effect).candidates(view):
        if found.effect.parameters["source"].value == source:
            return replace(found, held_out=coupling.held_out, rivals=coupling.rivals)
    return None
