/* All compiled loops, for one level of the processor; compiled once for each. */

#include "amplitudes.c"
#include "cascade.c"
#include "clock.c"
#include "covariance.c"
#include "estimators.c"
#include "history.c"
#include "remainder.c"
#include "series.c"
#include "spectrum.c"
#include "text.c"
#include "watch.c"
#include "wire.c"
