"""Effects: what real records hold and the textbook model of noise does not, one kind a file.

Each module holds one `EffectKind` named ``KIND`` with a small function that states the equation. A
new file here is all that a new effect needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from allanscope.simulator.effects.base import EffectKind, Scene, Setting

__all__ = ["EffectKind", "Scene", "Setting", "effect_kinds"]


@cache
def effect_kinds() -> Mapping[str, EffectKind]:
    """Return all kinds of effects by name.

    Examples
    --------
    >>> effect_kinds()["step"].summary
    'a change of the level at one time'
    """
    names = (module.name for module in iter_modules(__path__) if module.name != "base")
    kinds = (import_module(f"{__name__}.{name}").KIND for name in names)
    return {kind.name: kind for kind in kinds}
