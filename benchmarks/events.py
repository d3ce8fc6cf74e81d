"""What begins at night: when it is found, what a clean night raises, and what watching costs.

    python benchmarks/events.py [--minutes 100] [--speed 100] [--nights 4] [--only night drawn ...]

A simulated night at 104 Hz has eight events of eight kinds, none declared. It is played at many
times its pace through a session, as `allanscope replay` does, and its bytes are then taken in
megabytes, as `allanscope analyse` does; both must find the same at the same samples. Then clean
nights, sample by sample; 200 nights of six axes whose blocks of a second are drawn directly, and
how these compare with blocks of samples; delays over those of oracles; the measured recordings as
streams; and the processor time of watching, and of the Allan deviation over time.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from figures import Figure, written
from numpy.typing import NDArray
from scipy.special import i0

from allanscope.allan import AllanBank
from allanscope.analysis import Analyser, AnalyserSettings
from allanscope.pipeline import Decoding, DeviceSettings
from allanscope.pipeline.analyse_arrays import events_of_columns
from allanscope.pipeline.columns import with_guesses
from allanscope.pipeline.replaying import feed_analyser
from allanscope.pipeline.session import Session
from allanscope.pipeline.table_files import table_of_file
from allanscope.recording import Chunk, write_recording
from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.simulator import Simulator, simulate_blocks
from allanscope.sources import RecordedSource
from allanscope.watch import ALPHA, Event, Watch
from allanscope.watch.counts import RareCounts, scan_p_value
from allanscope.watch.false_alarms import log_weight
from allanscope.watch.lines import LineCusums
from allanscope.watch.scan import Scan
from allanscope.watch.summary import KNOCK_RATIO, LANES, Summariser, groups_of, rows_of_block
from allanscope.watch.watch import log_alphas

RATE = 104.0
MEASURED = Path(__file__).parent.parent / "recordings" / "measured"
ASSUMED_HZ = {"st-gyro": 100.0, "ism330": 104.476, "asm330": 52.0, "ism6hg": 960.0}
KINDS = (
    *("step", "variance_change", "sinusoid", "outliers"),
    *("repeated_samples", "lost_samples", "rate_change", "ramp"),
)
PARTS = ("night", "clean", "drawn", "delays", "measured", "cost", "dynamic")
Ratios = Callable[[int], NDArray[np.float64]]


class Disturbed(Simulator):
    """A sensor to which something happens at each ninth of a night.

    Parameters
    ----------
    seconds : float
        Length of the night.
    seed : int
        Of the sensor.
    """

    def __init__(self, seconds: float, seed: int) -> None:
        super().__init__(rate=RATE, seed=seed, duration_s=seconds)
        self.onset_s = {kind: (i + 1) * seconds / 9 for i, kind in enumerate(KINDS)}
        self._rng = np.random.default_rng(seed)
        self._last: NDArray[np.int16] | None = None

    def read(self, n: int) -> Block:
        block = super().read(n)
        time_s = (block.index + np.arange(n)) / self.clock.true_hz
        since = {kind: time_s - onset for kind, onset in self.onset_s.items()}
        x = block.counts.astype(np.float64)
        x[:, 0] += 12.0 * (since["step"] >= 0)  # 52 mdps
        x[:, 1] += 0.05 * np.maximum(since["ramp"], 0.0)  # 0.8 dps an hour
        x[:, 2] += 4.0 * np.sin(2 * np.pi * 17.3 * time_s) * (since["sinusoid"] >= 0)
        noisy = since["variance_change"] >= 0
        x[:, 3] += 15.0 * self._rng.standard_normal(n) * noisy
        burst = (since["outliers"] >= 0) & (since["outliers"] < 20.0)
        x[:, 4] += 900.0 * (burst & (self._rng.random(n) < 0.01))
        counts = np.clip(np.rint(x), -32768, 32767).astype(np.int16)
        again = (since["repeated_samples"] >= 0) & (self._rng.random(n) < 0.02)
        for row in np.flatnonzero(again):
            before = counts[row - 1] if row else self._last
            counts[row] = counts[row] if before is None else before
        self._last = counts[-1].copy()
        ticks = block.ticks
        late = 300e-6 * np.maximum(since["rate_change"], 0.0)[ticks.offset]
        return replace(block, counts=counts, ticks=replace(ticks, device_s=ticks.device_s + late))


def chunks(sensor: Disturbed, seconds: float, seed: int) -> Iterator[Chunk]:
    """Yield the bytes of the night; from one moment on, for a minute, one read in 50 is lost."""
    rng = np.random.default_rng(seed)
    for host_ns, data in simulate_blocks(seconds / 3600.0, sensor, start_ns=1, seed=seed):
        since_s = host_ns * 1e-9 - sensor.onset_s["lost_samples"]
        if 0.0 <= since_s < 60.0 and len(data) < 2000 and rng.random() < 0.05:
            continue
        yield Chunk(host_ns, data)


def record_night(path: Path, seconds: float, seed: int) -> Disturbed:
    """Write the night as a recording; return the sensor, which knows what happened when."""
    sensor = Disturbed(seconds, seed)
    facts = {"name": "simulated", "wire": "native", "origin": "synthetic"}
    write_recording(path, chunks(sensor, seconds, seed), facts)
    return sensor


def found(analyser: Analyser) -> tuple[Event, ...]:
    state = analyser.state
    assert state is not None
    assert not state.watch_failure
    return state.watch.events(state.clock.rate().hz)


def night(minutes: float, speed: float, seed: int, folder: Path) -> list[Figure]:
    """Play the night, then take it in megabytes; print what was found when."""
    seconds = 60.0 * minutes
    path = folder / "night.mcap"
    sensor = record_night(path, seconds, seed)
    session = Session(RecordedSource(path, speed), decoding(), Analyser())
    began = time.monotonic()
    session.run()
    played = found(session.analyser)
    print(f"played {minutes:g} min in {time.monotonic() - began:.0f} s")
    morning = Analyser(AnalyserSettings(buffered_rows=1 << 17))
    feed_analyser(path, decoding(), morning, quiet=True)
    print(f"{'kind':18}{'true, s':>9}{'found, s':>10} {'interval':>18}{'delay, s':>10}  event")
    missed, delays, other = 0, [], list(played)
    for kind, onset_s in sensor.onset_s.items():
        near = [e for e in other if e.kind == kind and abs(e.occurrences[0].onset_s - onset_s) < 60]
        if not near:
            missed += 1
            print(f"{kind:18}{onset_s:9.1f}{'missed':>10}")
            continue
        once = near[0].occurrences[0]
        other.remove(near[0])
        delays.append(once.found_s - onset_s)
        interval = f"{once.lower_s:.1f} ... {once.upper_s:.1f}"
        print(
            f"{kind:18}{onset_s:9.1f}{once.onset_s:10.1f} {interval:>18}{delays[-1]:10.1f}  "
            f"{near[0].words}"
        )
    for event in other:
        print(f"besides: {event.words}")
    return [
        Figure("events of a night missed, of eight", missed, "", 0),
        Figure("events besides", len(other), "", 0),
        Figure("longest delay", max(delays, default=math.nan), "s"),
        Figure("events that differ in the morning", played != found(morning), "", 0),
    ]


def decoding() -> Decoding:
    return Decoding(DeviceSettings().for_wire())


def clean(nights: int, hours: float) -> Figure:
    """Watch clean simulated nights, sample by sample."""
    alarms = 0
    for seed in range(100, 100 + nights):
        sensor = Simulator(rate=RATE, seed=seed, duration_s=3600 * hours)
        watch = Watch(sensor.info)
        for _ in range(int(hours * 3600 * RATE / 40_960)):
            block = sensor.read(40_960)
            watch.ticks(block.index, block.ticks)
            watch.rows(block.counts)
        for event in watch.events(RATE):
            alarms += 1
            print(f"clean night {seed}: {event.words}, {event.nats:.1f} nats")
    allowed = 6 * nights * ALPHA
    return Figure(f"events of {nights} clean nights of {hours:g} h, 6 axes", alarms, "", allowed)


class Drawn:
    """Blocks of many axes at 104 Hz whose values are drawn, and not made of samples.

    Levels of white, flicker and random-walk noise; powers of the bins as exponential deviates, held
    against references that are learned as `watch.summary` does; isolated outliers.

    Parameters
    ----------
    axes, seed : int
        How many, and of the generator.
    slow : bool
        Whether levels have flicker and random walk.
    """

    bins, bands = 47, 8

    def __init__(self, axes: int, seed: int, slow: bool = True) -> None:
        self.rng = np.random.default_rng(seed)
        self.axes, self.slow, self.blocks = axes, slow, 0
        self.decay = np.exp(-1.0 / 2.0 ** np.arange(14))[:, np.newaxis]
        self.flicker, self.walk = np.zeros((14, axes)), np.zeros(axes)
        self.power = np.ones((groups_of(axes), self.bins, LANES), np.float32)
        self.usual, self.rest = np.ones((2, len(self.power), LANES), np.float32)
        edges = np.linspace(0, self.bins, self.bands + 1).astype(np.int64)
        self.edges, self.widths = edges[:-1], np.diff(edges)[:, np.newaxis]
        self.band_log = np.zeros((axes, self.bands))

    def level(self) -> NDArray[np.float64]:
        """Return the level of a block of each axis, white noise 1."""
        x = self.rng.standard_normal(self.axes)
        if self.slow:
            kick = self.rng.standard_normal(self.flicker.shape)
            self.flicker = self.decay * self.flicker + np.sqrt(1 - self.decay**2) * kick
            self.walk += 0.01 * self.rng.standard_normal(self.axes)
            x += 0.1 * self.flicker.sum(axis=0) + self.walk
        return x

    def noise(self, ratio: float = 1.0) -> NDArray[np.float64]:
        """Return how loud a block of each axis is; `ratio` is of powers."""
        means = self.rng.gamma(6.0, ratio / 6.0, self.band_log.shape)
        away = np.log(means) - self.band_log
        self.band_log += np.clip(away, -2.0, 2.0) / min(self.blocks + 1, 1800)
        return np.sort(3.0 * np.expm1(away / 3.0), axis=1)[:, 1:-1].mean(axis=1)

    def lines(self, amplitude: float = 0.0) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return ratios of a block and their scale, as `watch.summary` has them.

        `amplitude` adds so many times the noise's in one bin.
        """
        power = self.rng.standard_exponential(self.power.shape, np.float32)
        if amplitude:
            both = self.rng.standard_normal((2, len(power), LANES))
            power[:, 20] = ((both[0] + np.sqrt(2.0) * amplitude) ** 2 + both[1] ** 2) / 2.0
        self.line = power[:, 20].ravel()[: self.axes]
        ratio = power / self.power
        means = np.sort(np.add.reduceat(ratio, self.edges, axis=1) / self.widths, axis=1)
        over = means[:, 1:-1].mean(axis=1)
        self.usual += (np.minimum(over, 2.0 * self.usual) - self.usual) / 16.0
        self.rest += (np.minimum(over, 2.0 * self.rest) - self.rest) / min(self.blocks + 1, 1800)
        scale = self.rest / np.where(over > KNOCK_RATIO * self.usual, over, self.usual)
        self.power += (np.minimum(power, 5.0 * self.power) - self.power) / min(
            self.blocks + 2, 1800
        )
        self.blocks += 1
        return ratio.astype(np.float32), scale.astype(np.float32)


def accelerated(nights: int, blocks: int, seed: int = 1) -> list[Figure]:
    """Watch nights of six axes whose blocks are drawn; count the axes that ever raise an alarm."""
    axes = 6 * nights
    drawn, alpha = Drawn(axes, seed), log_alphas(6)
    scan = Scan(2 * axes, np.repeat([alpha["level"], alpha["noise"]], axes))
    lines = LineCusums(axes, drawn.bins, alpha["lines"])
    rare = RareCounts(axes, np.full(axes, alpha["outliers"]))
    held = np.zeros(drawn.power.shape, np.int32)
    alarmed: dict[str, set[int]] = {
        "level": set(),
        "noise": set(),
        "line": set(),
        "outliers": set(),
    }
    for _ in range(blocks):
        for alarm in scan.update(np.concatenate([drawn.level(), drawn.noise()])):
            alarmed["level" if alarm.channel < axes else "noise"].add(alarm.channel % axes)
        alarmed["line"] |= {found.axis for found in lines.update(*drawn.lines(), held)}
        bursts, _ = rare.update(drawn.rng.poisson(0.002, axes))
        alarmed["outliers"] |= {burst.channel for burst in bursts}
    print(f"axes with a false alarm, by kind: { {k: len(v) for k, v in alarmed.items()} }")
    many = len(set().union(*alarmed.values()))
    what = f"axes of {axes} with a false alarm in {blocks / 3600:g} h, drawn as blocks"
    return [Figure(what, many, "", axes * ALPHA), *alike()]


def alike(blocks: int = 3000) -> list[Figure]:
    """Compare drawn blocks with those of samples."""
    rng, rows = np.random.default_rng(2), rows_of_block(RATE)
    real, drawn = Summariser(6, rows), Drawn(6, 3)
    held, other = np.zeros(real.power.shape, np.int32), np.zeros((1, LANES), np.bool_)
    loud: dict[str, list[NDArray[np.float64]]] = {"samples": [], "drawn": []}
    bins: dict[str, list[NDArray[np.float32]]] = {"samples": [], "drawn": []}
    for number in range(blocks):
        block = np.rint(rng.normal(0.0, 20.0, (rows, 6))).astype(np.int16)
        known, mine = real.update(block, held, other), (drawn.noise(), drawn.lines())
        if number >= blocks // 3:
            loud["samples"].append(known.noise)
            bins["samples"].append((known.ratio * known.scale)[..., :6])
            loud["drawn"].append(mine[0])
            bins["drawn"].append(mine[1][0] * mine[1][1])
    spread = np.std(loud["drawn"]) / np.std(loud["samples"])
    tail = np.quantile(bins["drawn"], 0.9999) / np.quantile(bins["samples"], 0.9999)
    return [
        Figure("spread of the noise of drawn blocks over that of samples", float(spread), ""),
        Figure("0.9999 quantile of bins, drawn over of samples", float(tail), ""),
    ]


class Oracle:
    """A CUSUM of the log-likelihood ratios of a change that it knows.

    Its limit is such that it has one false alarm in 40 nights of 12 h: the mean time between them
    is that of a run from zero to zero or the limit over the probability that it ends at the limit,
    which is the mean of 1 / likelihood ratio over runs of the change (Siegmund 1985).

    Parameters
    ----------
    still, changed : callable
        Return ratios of so many blocks without and with the change.
    """

    RUNS, BLOCKS = 20_000, 200

    def __init__(self, still: Ratios, changed: Ratios) -> None:
        low, self.limit = 0.0, 20.0
        gains = [[draw(self.RUNS) for _ in range(self.BLOCKS)] for draw in (still, changed)]
        while self.limit - low > 0.01:
            middle = 0.5 * (low + self.limit)
            length = self._run(gains[0], middle)[1]
            hits = self._run(gains[1], middle)[0]
            low, self.limit = (
                (middle, self.limit) if length < 40 * 43_200.0 * hits else (low, middle)
            )

    def _run(self, gains: list[NDArray[np.float64]], limit: float) -> tuple[float, float]:
        """Return the mean of 1 / ratio where runs hit the limit, and how long they are."""
        total, weight = np.zeros(self.RUNS), np.zeros(self.RUNS)
        length, goes_on = np.zeros(self.RUNS), np.ones(self.RUNS, np.bool_)
        for gain in gains:
            total[goes_on] += gain[goes_on]
            length += goes_on
            weight[goes_on & (total > limit)] = 1.0
            goes_on &= (total > 0.0) & (total <= limit)
        return float(np.mean(weight * np.exp(-total))), float(length.mean())

    def delay(self, gain: NDArray[np.float64]) -> float:
        """Return the median delay in blocks; `gain` has shape (blocks, runs)."""
        total, delay = np.zeros(gain.shape[1]), np.full(gain.shape[1], np.inf)
        for number, more in enumerate(gain, 1):
            total = np.maximum(total + more, 0.0)
            delay[(total > self.limit) & np.isinf(delay)] = number
        return float(np.median(delay))


def compared(name: str, ours: NDArray[np.float64], best: float) -> Figure:
    print(f"{name:12} median delay {np.median(ours):5.1f} s, of an oracle {best:5.1f} s")
    return Figure(f"delay of a {name} over an oracle's", np.median(ours) / best, "", 1.5)


def delays(blocks: int = 3000, after: int = 90, axes: int = 800) -> list[Figure]:
    """Return median delays at three times the limit over those of oracles, for all eight kinds.

    The limit of a level, of the noise or of the rate is what the longest window shows, 0.37
    standard deviations of a block; of a ramp, what shows in four minutes; of a line, 0.7 of the
    noise in its bin. Oracles know the size, and where it is.
    """
    size = 3 * 0.37
    drawn = Drawn(axes, 4, slow=False)
    alpha = log_alphas(6)
    of_series = [alpha["level"], alpha["level"], alpha["noise"], alpha["rate"]]
    scan = Scan(4 * axes, np.repeat(of_series, axes))
    lines = LineCusums(axes, drawn.bins, alpha["lines"])
    held = np.zeros(drawn.power.shape, np.int32)
    slope, strength = 3 * 0.37 / 120.0 * 2.0, 3.0 * math.sqrt(0.7)
    first = np.full((5, axes), np.inf)
    kept: list[list[NDArray[np.float64]]] = [[] for _ in range(5)]
    quiet: list[NDArray[np.float64]] = []
    usual = spread = 0.0
    for number in range(-blocks, after):
        on = number >= 0
        still = drawn.noise((1.0 + size * spread / 3.0) ** 3 if on else 1.0)
        values = [drawn.level() + size * on, drawn.level() + slope * (number + 1) * on, still]
        values.append(drawn.rng.standard_normal(axes) + size * on)
        ratio, scale = drawn.lines(strength if on else 0.0)
        if -500 <= number < 0:
            quiet.append(still)
            usual, spread = float(np.mean(quiet)), float(np.std(quiet))
        found = [divmod(alarm.channel, axes) for alarm in scan.update(np.concatenate(values))]
        found += [(4, one.axis) for one in lines.update(ratio, scale, held)]
        if not on:
            continue
        for kind, axis in found:
            first[kind, axis] = min(first[kind, axis], number + 1)
        moved = slope * (number + 1)
        for kind, more in ((0, size), (1, moved), (3, size)):
            kept[kind].append(more * values[kind] - more**2 / 2)
        kept[2].append(size * (still - usual) / spread - size**2 / 2)
        kept[4].append(gain_of_line(drawn.line, strength))
    normal = Oracle(
        lambda n: size * drawn.rng.standard_normal(n) - size**2 / 2,
        lambda n: size * drawn.rng.standard_normal(n) + size**2 / 2,
    )
    line = Oracle(
        lambda n: gain_of_line(drawn.rng.standard_exponential(n), strength),
        lambda n: gain_of_line(drawn.rng.noncentral_chisquare(2, 2 * strength**2, n) / 2, strength),
    )
    names = ("level shift", "ramp", "white level", "change of the rate", "line")
    oracles = (normal, normal, normal, normal, line)
    figures = [
        compared(name, delay, best.delay(np.array(gain)))
        for name, best, delay, gain in zip(names, oracles, first, kept, strict=True)
    ]
    return [*figures, *rare_delays(blocks, after, axes)]


def gain_of_line(power: NDArray[np.float64], amplitude: float) -> NDArray[np.float64]:
    """Return the log-likelihood ratios of powers with a sine so many times the noise, and none."""
    return np.asarray(np.log(i0(2.0 * amplitude * np.sqrt(power))) - amplitude**2)


def rare_delays(blocks: int, after: int, axes: int) -> list[Figure]:
    """Return the same of bursts, repeats and losses.

    There was one in 500 blocks before; then three times the mean that 16 blocks show half of the
    time.
    """
    before, rng = 1.0 / 500.0, np.random.default_rng(5)
    of = log_alphas(6)
    log_alpha = {
        "burst of outliers": of["outliers"],
        "repetition": of["repeats"] - math.log(2.0),
        "loss": of["losses"],
    }
    figures = []
    for name, alpha in log_alpha.items():
        fewest = least_count(before, blocks, alpha)
        mean = 3.0 * (fewest - 0.33) / 16.0
        rare, first = RareCounts(axes, np.full(axes, alpha)), np.full(axes, np.inf)
        gains = []
        for number in range(-blocks, after):
            counts = rng.poisson(mean if number >= 0 else before, axes)
            for burst in rare.update(counts)[0]:
                if number >= 0:
                    first[burst.channel] = min(first[burst.channel], number + 1)
            if number >= 0:
                gains.append(gain_of_counts(counts, before, mean))
        best = Oracle(
            lambda n, mean=mean: gain_of_counts(rng.poisson(before, n), before, mean),
            lambda n, mean=mean: gain_of_counts(rng.poisson(mean, n), before, mean),
        )
        figures.append(compared(name, first, best.delay(np.array(gains))))
    return figures


def gain_of_counts(counts: NDArray[np.int64], before: float, mean: float) -> NDArray[np.float64]:
    return np.asarray(counts * math.log(mean / before) - (mean - before))


def least_count(before: float, blocks: int, log_alpha: float) -> int:
    """Return how many in 16 blocks are a burst after so many blocks."""
    many = 1
    limit = -(log_alpha + log_weight(blocks))
    while scan_p_value(np.array([1, 1, 1, 1, many]), before * blocks, blocks)[1] < limit:
        many += 1
    return many


def measured() -> Figure:
    """Take the measured recordings as streams."""
    many = 0
    for path in sorted(MEASURED.glob("*.parquet")):
        table, analyser = table_of_file(path), Analyser()
        given = 929.0 if "spresense" in path.name else table.rate_hz
        if given is None and table.columns.time_s is None:
            given = next(hz for name, hz in ASSUMED_HZ.items() if name in path.name)
        columns = with_guesses(table.columns)
        for event in events_of_columns(columns, DeviceSettings(rate_hz=given)):
            analyser.feed(event)
        events = found(analyser)
        many += len(events)
        print(f"{path.stem}: {'; '.join(event.words for event in events) or 'silent'}")
    return Figure("events in the measured recordings", many, "")


def cost(rate: int, blocks: int, goal: float | None = None) -> Figure:
    """Return the processor time of watching six axes, in per cent of the time that they take."""
    info = StreamInfo(axes=AXES, scale=(1e-3,) * 6, nominal_hz=float(rate))
    watch, rng, spent = Watch(info), np.random.default_rng(1), 0.0
    for number in range(-blocks // 2, blocks):
        rows = np.rint(rng.standard_normal((rate, 6), np.float32) * 20.0).astype(np.int16)
        began = time.process_time()
        watch.rows(rows)
        spent += (time.process_time() - began) * (number >= 0)
    return Figure(f"of a core, {rate} Hz x 6 axes", 100 * spent / blocks, "%", goal)


def over_time(hours: float, rate: float) -> list[Figure]:
    """Return the processor time and the memory that the Allan deviation over time adds.

    Banks with and without it are timed by themselves, in turn, the best of three each; their
    difference is set against all that is done with the samples, timed over a quarter of them.
    """
    rng = np.random.default_rng(1)
    blocks = [np.rint(rng.normal(0, 20, (1 << 13, 6))).astype(np.int16) for _ in range(4)]
    many = round(hours * 3600 * rate / (1 << 13))
    spent: dict[bool, list[float]] = {True: [], False: []}
    for kept in (False, True) * 3:
        bank = AllanBank(rate, 6, window=0.0 if kept else None)
        began = time.process_time()
        for number in range(many):
            bank.update(blocks[number % 4])
        spent[kept].append(time.process_time() - began)
        if kept:
            windows, held = len(bank.dynamic().start_s), bank.nbytes
        else:
            plain = bank.nbytes
    analyser = Analyser(AnalyserSettings(over_time=False))
    analyser.feed(StreamInfo(axes=AXES, scale=(1e-3,) * 6, nominal_hz=rate))
    began = time.process_time()
    for number in range(many // 4):
        analyser.feed(Block(number << 13, blocks[number % 4], Ticks.none()))
    whole = 4.0 * (time.process_time() - began)
    more = (min(spent[True]) - min(spent[False])) / whole
    what = f"{hours:g} h x 6 axes at {rate:g} Hz"
    return [
        Figure(f"Allan curve over time, {what}: windows", windows, ""),
        Figure(f"processor time it adds, {what}", 100.0 * more, "%", 5.0),
        Figure(f"memory it adds, {what}", (held - plain) / 2**20, "MiB", 64.0),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=100.0, help="length of the night")
    parser.add_argument("--speed", type=float, default=100.0)
    parser.add_argument("--nights", type=int, default=4, help="clean ones")
    parser.add_argument("--blocks", type=int, default=3000, help="seconds before a change comes")
    parser.add_argument("--axes", type=int, default=800, help="of which delays are the median")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="some parts alone")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    quick, figures = options.quick, []
    if "night" in options.only:
        with tempfile.TemporaryDirectory() as folder:
            speed = math.inf if quick else options.speed
            figures += night(60.0 if quick else options.minutes, speed, 1, Path(folder))
    if "clean" in options.only:
        figures.append(clean(1 if quick else options.nights, 1.0 if quick else 12.0))
    if "drawn" in options.only:
        figures += accelerated(10 if quick else 200, 3600 if quick else 43_200)
    if "delays" in options.only:
        figures += delays(options.blocks, axes=options.axes)
    if "measured" in options.only:
        figures.append(measured())
    if "cost" in options.only:
        figures += [cost(6660, 300, goal=0.5), cost(104, 3000)]
    if "dynamic" in options.only:
        figures += over_time(1.0 if quick else 12.0, RATE)
    written(figures, options.json)


if __name__ == "__main__":
    main()
