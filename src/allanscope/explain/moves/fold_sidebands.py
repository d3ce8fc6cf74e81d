"""Replace a carrier and its equal sidebands by the one modulated tone that they are."""

from __future__ import annotations

from allanscope.explain.effects.unexplained import tones_left_over, united
from allanscope.explain.search_path import SearchPath
from allanscope.explain.tones import sidebands
from allanscope.explain.view import View

__all__ = ["fold_sidebands"]


def fold_sidebands(view: View, path: SearchPath) -> View:
    """Return the view with the tone in the place of the family of lines, if there is one."""
    family = sidebands([c for c in view.accepted if c.kind == "sinusoid"])
    if not family:
        return view
    bare = view.without(*family)
    whole = tones_left_over(bare, family)
    if whole is None:
        return view
    bare, tone = united(bare, whole)
    path.note("fold sidebands", tone, "accepted")
    return bare.accept(tone)
