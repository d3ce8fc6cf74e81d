"""Calibration of the limits: degrees of freedom where no equation has them, and their last digits.

    python benchmarks/calibrate_limits.py [--runs 5000] [--seed 1] [--write] [--json FILE] [--quick]
    python benchmarks/calibrate_limits.py --scale theobr --alphas 0 --seed 2 --write    again, these

Discrete power-law noise is generated ``--runs`` times and each estimator evaluated at windows of
n / w samples, for two tables.

`edf`: nothing is published for TOTDEV and HTOTDEV of phase noise, nor for the ratio that TheoBR is
scaled with, and the fit for THEO1 of random-walk FM fails. Kept are twice the squared mean of the
variance over its variance.

`scale`: a mean of squares with a few large eigenvalues is no chi-square of that many degrees; near
the end of the run its limits hold in 98 % and more. Kept is the multiple of the degrees of freedom
with which the 95 % limits hold in 95.7 % of the runs, the noise being found by the program: what
it errs in that widens or narrows them too. It starts from the table that is kept. In the shortest
runs, where hardly any noise can be found, it is told.

``--write`` puts both into the package, where `allanscope.allan.edf` interpolates in the logarithms.
5000 runs are good to 0.3 % in coverage; runs of 4096 samples are an eighth as many.
"""

from __future__ import annotations

import argparse
import time
import tomllib
from pathlib import Path

import numpy as np
from figures import Figure, written
from interval_coverage import phases_of, power_law, truth
from numpy.typing import NDArray

from allanscope.allan import AllanBank, edf
from allanscope.allan.confidence import enclosing_limits
from allanscope.allan.edf import calibrated_scale
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.noise_type import NAMES, one_noise

Array = NDArray[np.float64]

TABLE = Path(__file__).parent.parent / "src/allanscope/allan/edf_calibration.toml"
LENGTHS = (64, 256, 1024)
LONG = 4096
"""Length that degrees of freedom are simulated for too: those of phase noise depend on it."""
SHORTEST_RATIO = 89
"""Samples from which on TheoBR has a ratio."""
FEWEST_SAMPLES = 4
CAUTIOUS = 0.957
"""Share of the runs in which the limits are to hold: where noises meet it is less."""
GOOD_ENOUGH = 0.005
MEETING: dict[tuple[str, int], dict[float, float]] = {
    ("totdev", 2): {2: 0.9, 4: 0.9},
    ("totdev", 1): {8 / 3: 0.88, 8: 0.88},
    ("totdev", 0): {8 / 3: 0.92, 8: 0.92},
    ("totdev", -1): {2: 0.93, 4: 0.93},
    ("theobr", 0): {1: 1.29, 4 / 3: 1.0, 2: 0.97, 8 / 3: 0.78, 4: 0.72, 8: 0.83, 16: 0.95},
    ("theobr", -1): {1: 1.05, 4 / 3: 0.92, 2: 0.9, 8 / 3: 0.92, 4: 0.9, 8: 0.89, 16: 0.94},
    ("theobr", -2): {1: 1.06, 4 / 3: 0.92, 2: 1.05, 8 / 3: 1.1, 4: 0.94, 8: 0.87, 16: 0.86},
    ("htotdev", -2): {8: 0.87, 16: 1.0},
    ("htotdev", -3): {8: 0.93, 16: 1.0},
    ("htotdev", -4): {8: 0.8, 16: 0.97, 32: 0.95, 64: 1.0},
}
"""What a scale is multiplied by once more at these windows and between them, so that limits hold in
93 to 97 % of the runs with one noise and in those where a slower one begins, of which the record
shows little: the levels found are those of too many noises (`interval_coverage.py --beside --seed
11`, and of TOTDEV at seed 21)."""

NO_EQUATION = {
    "totdev": (2, 1),
    "htotdev": (2, 1),
    "theobr": (2, 1, 0, -1, -2),
    "theo1": (-2,),
}
"""Estimators and power laws whose degrees of freedom are simulated."""
OCTAVES = (1, 2, 4, 8, 16, 32, 64, 128, 256)

END = {
    "totdev": (2, 8 / 3, 4, 16 / 3, 8, 16),
    "mtotdev": (3, 10 / 3, 4, 16 / 3, 8, 16),
    "htotdev": (3, 10 / 3, 4, 16 / 3, 8, 16),
    "theobr": (1, 8 / 7, 4 / 3, 2, 8 / 3, 4, 8, 16),
    "theo1": (1, 8 / 7, 4 / 3, 2, 8 / 3, 4, 8, 16),
}
"""Windows at the end of the run, where the chi-square is none."""
ON = {"htotdev": (2, 1, 0, -3, -4), "theobr": (0, -1, -2), "theo1": (-1, -2), "totdev": (2, 1)}
"""Power laws whose degrees of freedom are less well known and calibrated further on."""

HEAD = """\
# [edf]: degrees of freedom by simulation where no equation has them. [scale]: what degrees of
# freedom are multiplied by for 95 % limits that hold. For each estimator and power law, at windows
# of n / `windows` samples in runs of `samples` (rows).
# Written by: python benchmarks/calibrate_limits.py --runs {runs} --write
"""


def factors_of(kind: str, n: int, windows: list[float]) -> list[int]:
    """Return the averaging factors of windows that runs of `n` samples are long enough for."""
    estimator = REGISTRY[kind]
    step = 2 if estimator.even else 1
    factors = [step * round(n / w / step) for w in windows]
    return [m for m in factors if m >= FEWEST_SAMPLES and estimator.needed(m) <= n]


def scale(value: Array, unbiased: Array, degrees: Array) -> float:
    """Return the multiple of the degrees of freedom with which limits hold as often as they should.

    Parameters
    ----------
    value, unbiased : ndarray, shape (runs,)
        Deviations over the true one, as they are given and without the bias that is expected.
    degrees : ndarray, shape (runs,)
        Degrees of freedom of each, calibrated so far; 1 is good enough if limits hold in 95.2 to
        96.2 % with them.
    """

    def held(times: float) -> float:
        lower, upper = enclosing_limits(value, unbiased, np.maximum(times * degrees, 1.0), 0.95)
        return float(np.mean((lower <= 1.0) & (upper >= 1.0)))

    if abs(held(1.0) - CAUTIOUS) <= GOOD_ENOUGH:
        return 1.0
    least, most = 0.4, 2.5
    while most / least > 1.002:
        middle = float(np.sqrt(least * most))
        least, most = (middle, most) if held(middle) > CAUTIOUS else (least, middle)
    return least


def where_noises_meet(kind: str, alpha: int, windows: Array) -> Array:
    """Return `MEETING` at some windows, in their logarithms; 1 outside of it."""
    table = MEETING.get((kind, alpha), {1.0: 1.0})
    known = np.log(np.array(list(table)))
    at = np.log(windows)
    between = np.exp(np.interp(at, known, np.log(list(table.values()))))
    inside = (at > known[0] - 0.02) & (at < known[-1] + 0.02)
    return np.asarray(np.where(inside, between, 1.0))


def values_of(kind: str, phases: Array, factors: list[int]) -> Array:
    """Return the variances of each run, shape (factors, runs)."""
    return np.array([REGISTRY[kind].curve(phase, factors) for phase in phases])[..., 0].T


def degrees(kind: str, phases: Array, windows: list[float]) -> list[float]:
    """Return the degrees of freedom of the scatter at each window."""
    every = values_of(kind, phases, factors_of(kind, phases.shape[1] - 1, windows))
    return [round(float(2.0 * one.mean() ** 2 / one.var(ddof=1)), 2) for one in every]


def scales(kind: str, alpha: int, phases: Array, windows: list[float]) -> list[float]:
    """Return the multiple of the degrees of freedom at each window with which limits hold."""
    estimator, n = REGISTRY[kind], phases.shape[1] - 1
    factors = factors_of(kind, n, windows)
    m, tau = np.array(factors), estimator.tau(factors, n)
    noise = one_noise(NAMES[alpha])
    if n > min(LENGTHS):
        bank = AllanBank(1.0, axes=len(phases), per_octave=1)
        bank.update(np.diff(phases, axis=1).T)
        noise = bank.noise_types(tau)
    whole = np.full_like(m, n)
    edf_of, expected, _ = estimator.of_mixture(noise, m, whole, np.ones_like(m))
    steepest = np.maximum(noise.at(tau, tau).alpha, estimator.lowest_alpha)
    raw = values_of(kind, phases, factors).T / truth(kind, tau, phases, alpha)
    value = np.sqrt(raw / estimator.correction(steepest, m, whole))
    # A mixture has the multiples of its noises in parts: what it needs is put on that of the noise.
    meeting = where_noises_meet(kind, alpha, n / m)
    edf_of = edf_of * estimator.limit_scale(noise, m, whole) / meeting
    columns = zip(
        value.T, np.sqrt(raw / expected).T, np.broadcast_to(edf_of, raw.shape).T, strict=True
    )
    needed = np.array([scale(*one) for one in columns])
    return [round(one, 3) for one in (needed * calibrated_scale(kind, alpha, m, whole)).tolist()]


Table = dict[str, tuple[list[float], dict[int, list[float]]]]


def simulated(runs: int, seed: int, *, limits: bool, kinds: list[str], alphas: list[int]) -> Table:
    """Return windows, and degrees of freedom or scales at each for runs of every length."""
    table: Table = {}
    for alpha in alphas:
        for n in LENGTHS if limits else (*LENGTHS, LONG):
            rng = np.random.default_rng([seed, n, alpha + 9, limits])
            phases = phases_of(power_law(alpha, n, runs if n < LONG else max(runs // 8, 50), rng))
            for kind, end in ((kind, END[kind]) for kind in kinds):
                windows = list(OCTAVES)
                if limits:
                    windows = [*end, *(OCTAVES[5:] if alpha in ON.get(kind, ()) else ())]
                unknown = limits and alpha >= REGISTRY[kind].lowest_alpha
                unknown = unknown and not (kind == "theobr" and alpha > 0)
                wanted = unknown if limits else alpha in NO_EQUATION.get(kind, ())
                if not wanted or (kind == "theobr" and n < SHORTEST_RATIO):
                    continue
                first = LONG // max(factors_of(kind, LONG, windows))
                windows = [w for w in windows if w >= first]
                rows = table.setdefault(f"{kind}.{NAMES[alpha]}", (windows, {}))[1]
                if limits:
                    rows[n] = scales(kind, alpha, phases, windows)
                else:
                    rows[n] = degrees(kind, phases, windows)
                print(kind, NAMES[alpha], n, rows[n], flush=True)
    return table


def text_of(column: str, table: Table) -> str:
    """Return a table of the file."""
    text = ""
    for name, (windows, rows) in sorted(table.items()):
        lines = ",\n".join(f"    {row}" for row in rows.values())
        text += f"\n[{column}.{name}]\nsamples = {list(rows)}\n"
        text += f"windows = {[round(w, 3) for w in windows]}\n{column} = [\n{lines},\n]\n"
    return text


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scale", nargs="*", choices=list(END), help="only scales, of these")
    parser.add_argument("--alphas", nargs="*", type=int, default=list(range(2, -5, -1)))
    parser.add_argument("--write", action="store_true", help="put the table into the package")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="a hundred runs")
    options = parser.parse_args()
    runs = 100 if options.quick else options.runs
    began = time.process_time()
    kept = TABLE.read_text(encoding="utf-8")
    kinds, alphas = options.scale or list(END), options.alphas
    before = tomllib.loads(kept)
    if options.scale:
        head, _, _ = kept.partition("[scale.")
        old = before["scale"]
    else:
        table = simulated(runs, options.seed, limits=False, kinds=kinds, alphas=alphas)
        head = HEAD.format(runs=runs) + text_of("edf", table) + "\n"
        # Limits rest on the new degrees of freedom.
        edf._calibration = lambda: tomllib.loads(head) | {"scale": before["scale"]}  # noqa: SLF001
        old = {}
    table = {
        f"{kind}.{noise}": (rows["windows"], dict(zip(rows["samples"], rows["scale"], strict=True)))
        for kind, noises in old.items()
        for noise, rows in noises.items()
    }
    table |= simulated(runs, options.seed, limits=True, kinds=kinds, alphas=alphas)
    text = head.rstrip() + "\n" + text_of("scale", table)
    print(f"{time.process_time() - began:.0f} s of processor time")
    worst = 1.0
    for old, new in zip(_numbers(kept), _numbers(text), strict=False):
        worst = max(worst, old / new, new / old)
    if options.write:
        TABLE.write_text(text, encoding="utf-8")
    if options.json:
        written([Figure("largest ratio to the kept table", worst, "")], options.json)


def _numbers(text: str) -> list[float]:
    return [
        number
        for column, kinds in tomllib.loads(text).items()
        for tables in kinds.values()
        for table in tables.values()
        for row in table[column]
        for number in row
    ]


if __name__ == "__main__":
    main()
