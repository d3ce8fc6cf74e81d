"""Call every loop over seeded inputs: empty, of one element, at its limits, damaged; print done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from allanscope.allan import AllanBank
from allanscope.allan.archive import Archive
from allanscope.allan.cascade import Cascade
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.estimators.theo1 import theo1_profile, thinned_theo1_variance
from allanscope.allan.shard import ALIGNED, BLOCK, Shard
from allanscope.clock import Clock
from allanscope.explain.burst_rows import find_bursts
from allanscope.explain.effects.random_telegraph import posterior
from allanscope.explain.regression import joint_fit, step_ordinates
from allanscope.explain.series import series_of
from allanscope.explain.stationarity import demodulate
from allanscope.explain.view import View
from allanscope.history import History, Record
from allanscope.noise.amplitudes import maximise
from allanscope.noise.components.correlated import ExponentialCovariance
from allanscope.noise.grid import Grid
from allanscope.noise.remainder import smooth_log_ratio
from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.simulator.noise.power_law import FractionalIntegral
from allanscope.spectrum.ladder import SEGMENT, Ladder
from allanscope.watch import Watch
from allanscope.wire import WireSettings
from allanscope.wire.native import NativeDecoder, NativeEncoder
from allanscope.wire.text.decoder import TextDecoder

RNG = np.random.default_rng(20)


def sums() -> None:
    for axes, per_octave in ((1, 1), (3, 4), (11, 1)):
        for sizes in ((0,), (1,), (31, 1), (255, 1, 1), (5000, 0, 20_000)):
            cascade, archive = Cascade(axes, per_octave), Archive(axes, rows=64)
            for n in sizes:
                for samples in (RNG.normal(size=(n, axes)), np.ones((n, axes), np.int16)):
                    cascade.extend(samples)
                    archive.extend(samples)
            cascade.settled().variances("totdev")
    for most in (1.0, 1e3, 1e5, 1e9):
        cascade = Cascade(2, 16)
        cascade.extend(np.rint(RNG.normal(0.0, most, (5000, 2))))
        cascade.settled()
    for window in (0.0, 3.0):
        bank = AllanBank(100.0, axes=2, window=window)
        for n in (1, 5000, 31, 20_000):
            bank.update(RNG.normal(size=(n, 2)))
            bank.update(RNG.normal(0.0, 9.0, (n, 2)).astype(np.int16))
            bank.dynamic()
            bank.gap()
    for most in (9.0, 90.0):  # in stretches, with a knock that does not fit
        counts = RNG.normal(0.0, most, (20_000, 2)).astype(np.int16)
        counts[[13_000, 13_001], 1] = [-32768, 32767]
        AllanBank(104.0, 2, window=20.0).update(counts)
    data = RNG.normal(size=(ALIGNED, 2))
    shard = Shard(2, 4, data[0])
    shard.extend(data)
    cascade = Cascade(2, 4)
    cascade.join(shard.cascade, shard.block_sums, 0)
    archive = Archive(2, rows=64)
    archive.join(shard.block_sums, BLOCK)


def estimators() -> None:
    for n in (1, 2, 9, 400):
        phase = np.append(0.0, RNG.normal(size=n).cumsum())
        for estimator in REGISTRY.values():
            for m in (1, 2, 3, 4, 33, n // 3, n // 2, n - 1, n):
                if estimator.admits(m, n):
                    with np.errstate(all="ignore"):
                        estimator.exact(phase, m)
    for stride in (1, 3, 150, 500):
        theo1_profile(phase, 64, stride)
    thinned_theo1_variance(phase, 64, 8)


def histories() -> None:
    for dtype in (np.int16, np.float64):
        for axes, rows in ((1, 2), (6, 64)):
            history = History(axes, rows)
            for n in (0, 1, 700, 5, 700):
                temperature_c = np.where(RNG.random(n) < 0.1, np.nan, 25.0)
                history.update(RNG.normal(0.0, 20.0, (n, axes)).astype(dtype), temperature_c)
                history.update(RNG.normal(0.0, 20.0, (n, axes)).astype(dtype))
                history.gap(3)
            history.record(1.0, AXES[:axes], (1.0,) * axes)


def spectra() -> None:
    bank = Ladder(2)
    for n in (0, 1, 47, 1, SEGMENT, 9 * SEGMENT, 5):
        bank.push(RNG.normal(size=(2, n)).astype(np.float32))


def frames() -> None:
    encoder = NativeEncoder()
    info = StreamInfo(AXES, (8.75e-3,) * 3 + (6.1e-5,) * 3, 416.0, "LSM6DSM", epoch=9)
    wire = encoder.describe(info)
    for n in (1, 17, 18, 400):
        counts = RNG.integers(-32768, 32768, (n, 6)) * RNG.integers(0, 2, (n, 6))
        wire += encoder.encode(Block(0, counts.astype(np.int16), Ticks.none()))
    for seed in range(40):
        damage = np.random.default_rng(seed)
        data = np.frombuffer(wire, np.uint8).copy()
        data[damage.integers(0, len(data), 9 * seed)] = damage.integers(0, 256, 9 * seed)
        decoder = NativeDecoder()
        cut = int(damage.integers(0, len(data)))
        for piece in (b"", data[:cut].tobytes(), data[cut:].tobytes(), bytes([255] * seed * 20)):
            decoder.feed(piece, 0.0)


def texts() -> None:
    for late in (0.0, 0.004, 0.02):
        times = np.delete(np.arange(9000) / 104 + RNG.uniform(0, late, 9000), [700, 5000])
        rows = [f"{time:.6f},1e-3,-2,+3.5" for time in np.append(times, times[0]).tolist()]
        decoder = TextDecoder(WireSettings())
        for end in ("\n", "\r\n", "\nnan,1,2,3\n"):
            decoder.feed(end.join(["t[s],gx[dps],gy[dps],gz[dps]", *rows, ""]).encode(), 1.0)
        decoder.finish()


def fits() -> None:
    for p, bins in ((0, 1), (1, 1), (3, 2), (9, 150)):
        columns = RNG.random((p, bins))
        power, count = RNG.random(bins) + 0.1, np.full(bins, 9.0)
        maximise(columns, power, count, np.zeros(bins))
        maximise(columns, power, count, np.full(bins, 0.01), np.ones(p))
        maximise(np.repeat(columns, 2, axis=0), power, count, np.zeros(bins))


def signals() -> None:
    for rows in (17, 300, 20_001):
        record = Record(
            rate_hz=100.0,
            stride=1,
            axes=("gx",),
            values=RNG.normal(size=(rows, 1)),
            lsb=(1e-9,),
            temperature_c=np.full(rows, np.nan),
            start_s=np.arange(rows) / 100.0,
            segments=np.array([[0, rows]]),
        )
        view = View.of(series_of(record), "gx", None)
        for cut in ((), ((1.0, 9.0),), ((0.0, 60.0),)):  # nothing, some, and all is left out
            view = replace(view, excluded=cut)
            joint_fit(view, step_ordinates(view.grid, rows // 2, view.grid.low))


def remainders() -> None:
    for bins in (8, 9, 300):
        smooth_log_ratio(
            np.geomspace(1e-3, 50, bins), RNG.chisquare(9, bins) / 9, np.full(bins, 9.0)
        )
        smooth_log_ratio(np.geomspace(1, 1.1, bins), np.full(bins, 3.0), np.full(bins, 99.0))


def covariances() -> None:
    covariance = ExponentialCovariance((1.0, 1 - 0.1j), (0.1, 1e-3 - 2j), 0.2, 0.1)
    for n in (0, 1, 7, 1000):
        covariance.spectrum(np.linspace(0, np.pi, n))
        covariance.ordinates(np.arange(n), 1000)
    for rows in (3, 130, 20_001):
        grid = Grid(rows, 100.0)
        grid.interpolate(np.linspace(0.0, 1.0, len(grid.nodes)))


def series() -> None:
    for n in (1, 2, 3000):
        posterior(RNG.normal(size=n), 1.0, 0.05, 1.0)
        demodulate(RNG.normal(size=n), 100.0, 3.0, 1)
        FractionalIntegral(0.5, 1e6, RNG).apply(RNG.normal(size=n))
        find_bursts(RNG.normal(size=n), 100.0)
    FractionalIntegral(0.5, 1e6, RNG).apply(np.empty(0))


def watches() -> None:
    for axes, rate in ((1, 32.0), (6, 104.0), (9, 833.0)):
        info = StreamInfo(axes=AXES[:1] * axes, scale=(1.0,) * axes, nominal_hz=rate)
        for dtype in (np.int16, np.float64):
            watch = Watch(info)
            for n in (1, round(rate), 7 * round(rate), 700 * round(rate) if rate < 40 else 0):
                watch.rows(RNG.normal(0.0, 20.0, (n, axes)).astype(dtype))


def clocks() -> None:
    clock = Clock(nominal_hz=104.0)
    for n in (0, 1, 3, 9000):
        offset = np.arange(n)
        seen = np.where(RNG.random(n) < 0.1, np.nan, offset / 103.0 + RNG.exponential(1e-3, n))
        clock.update(0, Ticks(offset, offset / 104.0, seen, np.full(n, np.nan)))
        clock.rate()


if __name__ == "__main__":
    for part in (
        sums,
        estimators,
        histories,
        spectra,
        frames,
        texts,
        fits,
        signals,
        remainders,
        covariances,
        series,
        watches,
        clocks,
    ):
        part()
    print("done")
