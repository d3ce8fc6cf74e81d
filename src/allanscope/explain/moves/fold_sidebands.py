"""Replace a carrier and its equal sidebands by the one modulated tone that they are."""

from __future__ import annotations

from allanscope.explain.effects.sinusoid import Sinusoid, sidebands
from allanscope.explain.effects.unexplained import tones_left_over, united
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["fold_sidebands"]


def fold_sidebands(view: View, path: SearchPath) -> View:
    """Return the view with the tone in the place of the family of lines, if there is one."""
    lines = [(c, c.effect) for c in view.accepted if isinstance(c.effect, Sinusoid)]
    family = sidebands([line for _, line in lines])
    if not family:
        return view
    members = [(c, line.frequency.value) for c, line in lines if line in family]
    bare = view.without(*(c for c, _ in members))
    whole = tones_left_over(bare, members)
    if whole is None:
        return view
    bare, tone = united(bare, whole)
    path.note("fold sidebands", tone, "accepted")
    return bare.accept(tone)
