"""The coefficients that a result publishes: those of the model, N as engineers read it.

N of an axis is all of its noise that is white at 1 Hz and below (`noise.white_level`), with what
other axes bring where they leak in. The fit is of the axis without them: what was taken out is the
slope times the source as measured, whose white part is put back here.
"""

from __future__ import annotations

from collections.abc import Mapping

from allanscope.explain import AxisExplanation
from allanscope.noise import Coefficient, NoiseFit, add_coupled, total_white
from allanscope.quantities import TWO_SIDED_95

__all__ = ["published_coefficients"]


def published_coefficients(
    axis: str, fits: Mapping[str, NoiseFit], loop: Mapping[str, AxisExplanation]
) -> dict[str, Coefficient]:
    """Return the coefficients of one axis; none where it was not fitted.

    Parameters
    ----------
    axis : str
        Its name.
    fits : mapping
        Axis to the fit of its noise beside the effects that were found.
    loop : mapping
        Axis to what was found.
    """
    fit = fits.get(axis)
    if fit is None:
        return {}
    return {**fit.coefficients, "N": _white(axis, fits, loop, ())}


def _white(
    axis: str,
    fits: Mapping[str, NoiseFit],
    loop: Mapping[str, AxisExplanation],
    path: tuple[str, ...],
) -> Coefficient:
    own = total_white(fits[axis])
    leaks: dict[str, tuple[Coefficient, float, float]] = {}
    for source, (slope, error) in _sources(loop.get(axis)).items():
        known = _source(source, axis, fits, loop, path)
        if known is not None:
            leaks[source] = (known, slope, error)
    return add_coupled(own, leaks) if leaks else own


def _source(
    source: str,
    axis: str,
    fits: Mapping[str, NoiseFit],
    loop: Mapping[str, AxisExplanation],
    path: tuple[str, ...],
) -> Coefficient | None:
    """Return N of a source as measured.

    In a ring of couplings, each axis cleaned of the next, the fit without effects is what was
    measured.
    """
    if any(one in _sources(loop.get(source)) for one in (*path, axis)):
        return loop[source].coefficients_before.get("N")
    if source not in fits:
        return None
    return _white(source, fits, loop, (*path, axis))


def _sources(explanation: AxisExplanation | None) -> dict[str, tuple[float, float]]:
    """Return the axes that one was cleaned of, each with its slope and the standard error."""
    found = {}
    for effect in explanation.effects if explanation is not None else ():
        source, slope = effect.parameters.get("source"), effect.parameters.get("slope")
        if source is None or slope is None or isinstance(slope.value, str):
            continue
        if not effect.evidence.get("removed", True):
            continue
        low = slope.value if slope.lower is None else slope.lower
        high = slope.value if slope.upper is None else slope.upper
        found[str(source.value)] = (slope.value, (high - low) / (2 * TWO_SIDED_95))
    return found
