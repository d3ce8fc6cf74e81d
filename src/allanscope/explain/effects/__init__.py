"""The library of effects: one file a kind, each registers itself by being imported."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from allanscope.explain.effects.base import ALPHA, KINDS, EffectKind, estimate

__all__ = ["ALPHA", "KINDS", "EffectKind", "estimate"]

for _module in sorted(iter_modules(__path__), key=lambda module: module.name):
    import_module(f"{__name__}.{_module.name}")
