"""The parts that a noise model is made of, one a file, each in discrete time.

A component is anything that follows `Component`: a frozen dataclass whose fields are its numbers,
with a density, the three variances and the expected DCT ordinates. Most are closed forms that are
exact for samples; what a component does not say follows from its density by exact integrals. A new
component is one new file in this folder: defining the class enters it into `COMPONENTS`.

====================  ====================================  ============================
symbol                class                                 numbers
====================  ====================================  ============================
Q                     AngleQuantization                     Q
N                     White                                 N
B                     Flicker                               B
K                     RandomWalk                            K
R                     Ramp                                  R
rounding              Rounding                              none: known from the LSB
band_limit            BandLimitedWhite, takes N's place     N, cutoff
gauss_markov          GaussMarkov                           sigma, correlation_time
narrowband            Narrowband                            sigma, frequency, bandwidth
sinusoid              Sinusoid                              amplitude, frequency
====================  ====================================  ============================
"""

from importlib import import_module
from pkgutil import iter_modules

from allanscope.noise.components.angle_quantization import AngleQuantization
from allanscope.noise.components.band_limit import BandLimitedWhite
from allanscope.noise.components.base import COMPONENTS, Component, Quantity
from allanscope.noise.components.flicker import Flicker
from allanscope.noise.components.gauss_markov import GaussMarkov
from allanscope.noise.components.narrowband import Narrowband
from allanscope.noise.components.ramp import Ramp
from allanscope.noise.components.random_walk import RandomWalk
from allanscope.noise.components.rounding import Rounding
from allanscope.noise.components.sinusoid import Sinusoid
from allanscope.noise.components.white import White

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = [
    "COMPONENTS",
    "AngleQuantization",
    "BandLimitedWhite",
    "Component",
    "Flicker",
    "GaussMarkov",
    "Narrowband",
    "Quantity",
    "Ramp",
    "RandomWalk",
    "Rounding",
    "Sinusoid",
    "White",
]
