"""Noise synthesis: every named noise is a power law, and every power law is one filtered white one.

::

    white numbers ──▶ fractional integral (0 <= d < 1) ──▶ sums or differences ──▶ samples

A rate whose two-sided density is ``h |f|^alpha`` is white noise integrated ``d = -alpha / 2`` times
(`power_law`). The whole part of d is plain sums or differences; the fractional part is a bank of
first-order filters that share one input. The named noises only translate the
coefficients of IEEE 952 into `h`:

===========  ==============  =================  ==========================  ===================
alpha        generator       coefficient        two-sided density of rate   slope of log ADEV
===========  ==============  =================  ==========================  ===================
+2           WhitePhase      Q (angle)          (2 pi f)^2 Q^2 t0           -1
+1           FlickerPhase    P (angle)          2 pi f P^2                  -1 (nearly)
0            White           N                  N^2                         -1/2
-1           Flicker         B                  B^2 / (2 pi f)              0
-1           OctaveFlicker   B_dt0064           B^2 / (2 pi f), nearly      0 (nearly)
-2           RandomWalk      K                  (K / 2 pi f)^2              +1/2
-3           FlickerWalk     F (rate / s)       F^2 / (2 pi f)^3            +1 (HDEV)
-4           RandomRun       D (rate / s^1.5)   D^2 / (2 pi f)^4            +3/2 (HDEV)
===========  ==============  =================  ==========================  ===================

`OctaveFlicker` is the generator of ST's design tip. `GaussMarkov` and `Narrowband` are no power
laws: they have a memory of their own. All are streams
with one method, `take`: however a record is cut into portions, the samples are the same, bit for
bit.

Each draws from a random stream of its own (`stream`): then adding an effect, leaving an axis out or
reading in other portions changes nothing else. The name is part of the seed, so no process needs to
know which others exist.
"""

from typing import TYPE_CHECKING
from zlib import crc32

from numpy.random import SFC64, Generator, SeedSequence

from allanscope.errors import UsageError
from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.simulator.noise.gauss_markov import GaussMarkov, Narrowband
    from allanscope.simulator.noise.octaves import OctaveFlicker
    from allanscope.simulator.noise.power_law import (
        Flicker,
        FlickerPhase,
        FlickerWalk,
        PowerLaw,
        RandomRun,
        RandomWalk,
        White,
        WhitePhase,
    )

__all__ = [
    "Flicker",
    "FlickerPhase",
    "FlickerWalk",
    "GaussMarkov",
    "Narrowband",
    "OctaveFlicker",
    "PowerLaw",
    "RandomRun",
    "RandomWalk",
    "White",
    "WhitePhase",
    "stream",
]

_POWER_LAWS = "Flicker FlickerPhase FlickerWalk PowerLaw RandomRun RandomWalk White WhitePhase"

__getattr__, __dir__ = lazily(
    __name__,
    dict.fromkeys(_POWER_LAWS.split(), "power_law")
    | dict.fromkeys(("GaussMarkov", "Narrowband"), "gauss_markov")
    | {"OctaveFlicker": "octaves"},
)


def stream(seed: int, *name: str) -> Generator:
    """Return the generator that belongs to `seed` and to a name such as ``("gx", "flicker")``.

    Raises
    ------
    UsageError
        If the seed is negative.

    Examples
    --------
    >>> stream(1, "gx", "white").random() == stream(1, "gx", "white").random()
    True
    >>> stream(1, "gx", "white").random() == stream(1, "gy", "white").random()
    False
    """
    if seed < 0:
        raise UsageError(f"a seed is 0 or more, not {seed}")
    return Generator(SFC64(SeedSequence([seed, *(crc32(word.encode()) for word in name)])))
