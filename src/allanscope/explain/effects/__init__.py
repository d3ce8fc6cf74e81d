"""The library of effects: one file a kind, each registers itself by being imported.

To add a kind:

1. Write ``effects/<kind>.py`` with one subclass of `EffectKind`. Its docstring holds the theory:
   what happens physically, the equation, where it shows first, what it is confused with and what
   tells the two apart. Declare ``kind``, ``meaning``, ``needs``, ``stage`` and ``confused_with``.
2. ``propose(view)`` looks where it shows (`View.ordinates`, `View.power`, `View.innovations`, other
   axes) and yields candidates. The noise is refitted with each: `joint_fit` for a signal given in
   time, `fit_spectrum` with one more component for a process. ``gain`` is the difference of two
   maximised log-likelihoods, ``price`` the log of (alternatives looked at / `ALPHA`). Estimate both
   on clean records: at most one in 1000 may gain more than the price.
3. ``refine(view, candidate)`` estimates the numbers again once other effects are known, and
   ``hold_out(view, candidate)`` judges them on data that was not used (`heldout`). Every parameter
   carries a 95 % interval and its unit.
4. If it can be seen on several axes at once, add what locates it to ``merge``; if simulated
   sensors should have it, add ``simulator/effects/<kind>.py``.
5. Test it at fixed seeds in ``tests/explain``: present, clean, against each of ``confused_with``,
   and near the limit; then add it to ``benchmarks/blind_generator.py`` and run the blind benchmark.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from allanscope.explain.effects.base import ALPHA, KINDS, EffectKind, estimate

__all__ = ["ALPHA", "KINDS", "EffectKind", "estimate"]

for _module in sorted(iter_modules(__path__), key=lambda module: module.name):
    import_module(f"{__name__}.{_module.name}")
