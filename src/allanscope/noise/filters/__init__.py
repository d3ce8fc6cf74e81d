"""What stands between the noise and its samples, and multiplies its density; one a file.

======================  ==========================  ===================  ======================
symbol                  class                       numbers              acts on
======================  ==========================  ===================  ======================
band_limit              OnePole                     cutoff               N, B and K
band_limit              Butterworth                 cutoff, order        N, B and K
band_limit              AnalogueLowPass             cutoff, order        N, B and K
band_limit              Averaging                   cutoff, order        N, B and K
band_limit              MovingAverage               none: counted        N, B and K
high_pass               HighPass                    corner, slope        N, B and K
repeated_samples        HeldSamples                 fraction             N
repeated_samples        HeldPattern                 none: counted        N
remainder               Remainder                   none: smooth         all but lines
======================  ==========================  ===================  ======================
"""

from allanscope.noise.filters.held_samples import (
    HeldPattern,
    HeldSamples,
    combined_response,
    made_white_share,
)
from allanscope.noise.filters.high_pass import HighPass
from allanscope.noise.filters.low_pass import (
    AnalogueLowPass,
    Averaging,
    Butterworth,
    LowPass,
    MovingAverage,
    OnePole,
)
from allanscope.noise.filters.remainder import Remainder
from allanscope.noise.part import Filter

__all__ = [
    "AnalogueLowPass",
    "Averaging",
    "Butterworth",
    "Filter",
    "HeldPattern",
    "HeldSamples",
    "HighPass",
    "LowPass",
    "MovingAverage",
    "OnePole",
    "Remainder",
    "combined_response",
    "made_white_share",
]
