"""Two hidden levels in white noise: forward, backward and most probable path."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["posterior"]

Array = NDArray[np.float64]


def posterior(
    data: Array, size: float, rate: float, variance: float
) -> tuple[Array, Array, float, float, float]:
    """Return what the data say about a signal that hops between +size and -size.

    Parameters
    ----------
    data : ndarray, shape (n,)
        Signal plus white noise of the given variance.
    rate : float
        Probability of a switch between two samples.

    Returns
    -------
    mean : ndarray, shape (n,)
        Posterior mean of the state (-1 to 1).
    path : ndarray, shape (n,)
        Most probable path of -1 and +1.
    log_evidence, log_joint : float
        Of the data, all paths summed; of the data with that path.
    switches : float
        Expected number of switches.
    """
    mean, path, log_z, log_joint, switches = _posterior(
        np.ascontiguousarray(data), float(size), float(rate), float(variance)
    )
    return mean, path, float(log_z), float(log_joint), float(switches)


@njit(cache=True, nogil=True)
def _posterior(data, size, rate, variance):  # type: ignore[no-untyped-def] # noqa: PLR0915
    n = data.size
    stay, leave = 1.0 - rate, rate
    forward = np.empty((n, 2))
    scale = np.empty(n)
    best = np.empty((n, 2))
    come = np.zeros((n, 2), np.int8)
    log_stay, log_leave = np.log(stay), np.log(leave)
    log_z = 0.0
    for k in range(n):
        up = -((data[k] - size) ** 2) / (2 * variance)
        down = -((data[k] + size) ** 2) / (2 * variance)
        top = max(up, down)
        like0, like1 = np.exp(down - top), np.exp(up - top)
        if k == 0:
            a0, a1 = 0.5 * like0, 0.5 * like1
            best[k, 0], best[k, 1] = np.log(0.5) + down, np.log(0.5) + up
        else:
            p0, p1 = forward[k - 1, 0], forward[k - 1, 1]
            a0 = (p0 * stay + p1 * leave) * like0
            a1 = (p0 * leave + p1 * stay) * like1
            for s in range(2):
                same = best[k - 1, s] + log_stay
                other = best[k - 1, 1 - s] + log_leave
                if other > same:
                    come[k, s] = 1 - s
                    best[k, s] = other
                else:
                    come[k, s] = s
                    best[k, s] = same
            best[k, 0] += down
            best[k, 1] += up
        scale[k] = a0 + a1
        forward[k, 0], forward[k, 1] = a0 / scale[k], a1 / scale[k]
        log_z += np.log(scale[k]) + top
    mean = np.empty(n)
    b0, b1 = 1.0, 1.0
    mean[n - 1] = forward[n - 1, 1] - forward[n - 1, 0]
    switches = 0.0
    for k in range(n - 2, -1, -1):
        up = -((data[k + 1] - size) ** 2) / (2 * variance)
        down = -((data[k + 1] + size) ** 2) / (2 * variance)
        top = max(up, down)
        e0 = np.exp(down - top) * b0 / scale[k + 1]
        e1 = np.exp(up - top) * b1 / scale[k + 1]
        f0, f1 = forward[k, 0], forward[k, 1]
        switches += (f0 * e1 + f1 * e0) * leave
        b0, b1 = stay * e0 + leave * e1, leave * e0 + stay * e1
        total = f0 * b0 + f1 * b1
        mean[k] = (f1 * b1 - f0 * b0) / total
    path = np.empty(n)
    s = 1 if best[n - 1, 1] > best[n - 1, 0] else 0
    log_joint = best[n - 1, s]
    for k in range(n - 1, -1, -1):
        path[k] = 2.0 * s - 1.0
        s = come[k, s]
    return mean, path, log_z, log_joint, switches
