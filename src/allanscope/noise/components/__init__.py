"""The parts that a noise model is made of, one a file, each in discrete time.

A component is anything that follows `Component`: a frozen dataclass whose fields are its numbers,
with a density, the three variances and the expected DCT ordinates. Most are closed forms that are
exact for samples; what a component does not say follows from its density by exact integrals.

====================  ====================================  ============================
symbol                class                                 numbers
====================  ====================================  ============================
Q                     AngleQuantization                     Q
N                     White                                 N
B                     Flicker                               B
P                     FlickerPhase                          P
K                     RandomWalk                            K
F                     FlickerWalk                           F
D                     RandomRun                             D
R                     Ramp                                  R
power_law             PowerLaw                              P, exponent
rounding              Rounding                              none: known from the LSB
floor                 Floor                                 floor
gauss_markov          GaussMarkov                           sigma, correlation_time
random_telegraph      RandomTelegraph                       amplitude, dwell
narrowband            Narrowband, WanderingLine,            sigma, frequency, bandwidth
                      MovingLine, BandPassed, PeakFiltered
cycle                 IrregularCycles                       sigma, frequency, bandwidth
sinusoid              Sinusoid                              amplitude, frequency
drifting_line         LineProfile                           none: measured
====================  ====================================  ============================
"""

from allanscope.noise.components.angle_quantization import AngleQuantization
from allanscope.noise.components.flicker import Flicker
from allanscope.noise.components.flicker_phase import FlickerPhase
from allanscope.noise.components.flicker_walk import FlickerWalk
from allanscope.noise.components.floor import Floor
from allanscope.noise.components.gauss_markov import GaussMarkov
from allanscope.noise.components.line_profile import LineProfile
from allanscope.noise.components.narrowband import (
    BandPassed,
    IrregularCycles,
    MovingLine,
    Narrowband,
    PeakFiltered,
    WanderingLine,
)
from allanscope.noise.components.power_law import PowerLaw
from allanscope.noise.components.ramp import Ramp
from allanscope.noise.components.random_run import RandomRun
from allanscope.noise.components.random_telegraph import RandomTelegraph
from allanscope.noise.components.random_walk import RandomWalk
from allanscope.noise.components.rounding import Rounding
from allanscope.noise.components.sinusoid import Sinusoid
from allanscope.noise.components.white import White
from allanscope.noise.part import Component

__all__ = [
    "AngleQuantization",
    "BandPassed",
    "Component",
    "Flicker",
    "FlickerPhase",
    "FlickerWalk",
    "Floor",
    "GaussMarkov",
    "IrregularCycles",
    "LineProfile",
    "MovingLine",
    "Narrowband",
    "PeakFiltered",
    "PowerLaw",
    "Ramp",
    "RandomRun",
    "RandomTelegraph",
    "RandomWalk",
    "Rounding",
    "Sinusoid",
    "WanderingLine",
    "White",
]
