"""Replace a band by the two resonances that it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from allanscope.explain.effects.narrowband import Narrowband, halved
from allanscope.explain.gates import judge
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["split_bands"]


def split_bands(view: View, path: SearchPath) -> View:
    """Return the view with two resonances in the place of the band accepted last, if it is two.

    Alone, each is fitted to the sum, and the next one to what such a fit leaves: neither holds. So
    they are fitted together, pay for one band more, and are judged each beside the other.
    """
    last = view.accepted[-1] if view.accepted else None
    if last is None or not isinstance(last.effect, Narrowband):
        return view
    bare = view.without(last)
    price = last.penalty + path.spent + len(view.accepted) * float(np.log(2))
    pair = halved(bare, last, price)
    if pair is None:
        return view
    path.evaluations += 2
    judged = []
    for own, other in (pair, pair[::-1]):
        found, why = judge(bare.accept(other), own)
        if found is None or not isinstance(found.effect, Narrowband):
            path.note("split", own, why if found is None else "adequacy: it is no band")
            return view
        judged.append(replace(found, rivals=last.rivals))
    path.accept("split", *judged)
    return bare.accept(judged[0]).accept(judged[1])
