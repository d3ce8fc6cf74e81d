"""The library of effects: one file a kind, each registers itself by being imported.

To add a kind:

1. Write ``effects/<kind>.py`` with one frozen dataclass that is a subclass of `EffectKind`, or of
   `SizedSignal` for a slow signal of known form. Its docstring holds the theory: what happens
   physically, the equation, where it shows first, what it is confused with and what tells the two
   apart. Its fields are the numbers of one effect: each `Estimate` is a reported parameter with its
   95 % interval and its unit, all others are evidence. ``words`` says them in a phrase. Declare
   ``kind``, ``meaning``, ``needs``, ``stage``, ``confused_with`` and the traits it has.
2. ``propose(view)`` looks where it shows (`View.ordinates`, `View.power`, `View.innovations`, other
   axes) and yields candidates. The noise is refitted with each: `joint_fit` for a signal given in
   time, `fit_spectrum` with one more component for a process. ``gain`` is the difference of two
   maximised log-likelihoods, ``log_alternatives`` the log of the number of alternatives that were
   looked at. Estimate both on clean records: at most one in 1000 (`ALPHA`) may gain more than the
   penalty, the log of (alternatives / `ALPHA`).
3. ``refine(view)`` estimates the numbers again once other effects are known, ``adequate`` tells
   whether it is what its name says, and ``hold_out(view, candidate)`` judges the numbers on data
   that was not used (`heldout`).
4. If one physical effect can be seen on several axes at once, declare the parameter in which they
   agree as ``shared_by``; if simulated sensors should have it, add ``simulator/effects/<kind>.py``.
5. Test it at fixed seeds in ``tests/explain``: present, clean, against each of ``confused_with``,
   and near the limit; then add it to ``benchmarks/blind_generator.py`` and run the blind benchmark.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from allanscope.explain.effects.base import ALPHA, KINDS, EffectKind, SizedSignal

__all__ = ["ALPHA", "KINDS", "VOCABULARY", "EffectKind", "SizedSignal"]

for _module in sorted(iter_modules(__path__), key=lambda module: module.name):
    import_module(f"{__name__}.{_module.name}")

VOCABULARY = frozenset(name for name, kind in KINDS.items() if not kind.is_coefficient)
"""Kinds that a result may name; the textbook's coefficients only compete with them."""
