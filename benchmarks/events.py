"""What begins at night: when it is found, what a clean night raises, and what watching costs.

    python benchmarks/events.py [--minutes 100] [--speed 100] [--nights 4] [--quick] [--json FILE]

A simulated night at 104 Hz has eight events of eight kinds, none declared. It is played at many
times its pace through a session, as `allanscope replay` does, and its bytes are then taken in
megabytes, as `allanscope analyse` does; both must find the same at the same samples. Then clean
nights, sample by sample; the series of 200 nights of six axes, levels of white, flicker and random
walk noise drawn directly as values of a second; the measured recordings as streams; and the
processor time of watching six axes at 6.66 kHz, over that of the stream.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from figures import Figure, written
from numpy.typing import NDArray

from allanscope.analysis import Analyser, AnalyserSettings
from allanscope.pipeline import Decoding, DeviceSettings
from allanscope.pipeline.analyse_arrays import events_of_columns
from allanscope.pipeline.columns import with_guesses
from allanscope.pipeline.replaying import analysed
from allanscope.pipeline.session import Session
from allanscope.pipeline.table_files import table_of_file
from allanscope.recording import Chunk, write_recording
from allanscope.samples import AXES, Block, StreamInfo
from allanscope.simulator import Simulator, simulate_blocks
from allanscope.sources import RecordedSource
from allanscope.watch import ALPHA, Event, Watch
from allanscope.watch.scan import Scan

RATE = 104.0
MEASURED = Path(__file__).parent.parent / "recordings" / "measured"
ASSUMED_HZ = {"st-gyro": 100.0, "ism330": 104.476, "asm330": 52.0, "ism6hg": 960.0}
KINDS = (
    *("step", "variance_change", "sinusoid", "outliers"),
    *("repeated_samples", "lost_samples", "rate_change", "ramp"),
)


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


def found(analyser: Analyser) -> tuple[Event, ...]:
    state = analyser.state
    assert state is not None
    assert not state.watch_failure
    return state.watch.events(state.clock.rate().hz)


def night(minutes: float, speed: float, seed: int, folder: Path) -> list[Figure]:
    """Play the night, then take it in megabytes; print what was found when."""
    seconds = 60.0 * minutes
    sensor = Disturbed(seconds, seed)
    path = folder / "night.mcap"
    facts = {"name": "simulated", "wire": "native", "origin": "synthetic"}
    write_recording(path, chunks(sensor, seconds, seed), facts)
    session = Session(RecordedSource(path, speed), decoding(), Analyser())
    began = time.monotonic()
    session.run()
    played = found(session.analyser)
    print(f"played {minutes:g} min in {time.monotonic() - began:.0f} s")
    morning = Analyser(AnalyserSettings(gathered_rows=1 << 17))
    analysed(path, decoding(), morning, quiet=True)
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


def series(nights: int, blocks: int, seed: int = 1) -> Figure:
    """Scan the levels of many nights, drawn as values of a second."""
    rng, axes = np.random.default_rng(seed), 6 * nights
    scan = Scan(axes, np.full(axes, np.log(ALPHA / 5)))
    # Flicker as a sum of first-order processes an octave apart; random walk; white noise.
    decay = np.exp(-1.0 / 2.0 ** np.arange(14))[:, np.newaxis]
    slow, walk = np.zeros((14, axes)), np.zeros(axes)
    alarmed: set[int] = set()
    for _ in range(blocks):
        slow = decay * slow + np.sqrt(1 - decay**2) * rng.standard_normal(slow.shape)
        walk += 0.01 * rng.standard_normal(axes)
        level = rng.standard_normal(axes) + 0.1 * slow.sum(axis=0) + walk
        alarmed |= {alarm.channel for alarm in scan.take(level)}
    what = f"axes of {axes} with a false shift in {blocks / 3600:g} h"
    return Figure(what, len(alarmed), "", axes * ALPHA)


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
            analyser.take(event)
        events = found(analyser)
        many += len(events)
        print(f"{path.stem}: {'; '.join(event.words for event in events) or 'silent'}")
    return Figure("events in the measured recordings", many, "")


def cost(blocks: int) -> Figure:
    """Return the processor time of watching over that of the stream."""
    rate = 6660
    info = StreamInfo(axes=AXES, scale=(1e-3,) * 6, nominal_hz=float(rate))
    watch, rng = Watch(info), np.random.default_rng(1)
    rows = [np.rint(rng.normal(0, 20, (rate, 6))).astype(np.int16) for _ in range(8)]
    for number in range(blocks // 2):
        watch.rows(rows[number % 8])
    began = time.process_time()
    for number in range(blocks):
        watch.rows(rows[number % 8])
    share = (time.process_time() - began) / blocks
    return Figure("of a core, 6.66 kHz x 6 axes", 100 * share, "%", 0.5)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=100.0, help="length of the night")
    parser.add_argument("--speed", type=float, default=100.0)
    parser.add_argument("--nights", type=int, default=4, help="clean ones")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    quick = options.quick
    with tempfile.TemporaryDirectory() as folder:
        speed = math.inf if quick else options.speed
        figures = night(60.0 if quick else options.minutes, speed, 1, Path(folder))
    figures += [
        clean(1 if quick else options.nights, 1.0 if quick else 12.0),
        series(20 if quick else 200, 3600 if quick else 43_200),
        measured(),
        cost(300),
    ]
    written(figures, options.json)


if __name__ == "__main__":
    main()
