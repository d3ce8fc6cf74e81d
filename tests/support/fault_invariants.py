"""What must hold of a live session, whatever failed around it."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from pathlib import Path

from mcap.stream_reader import StreamReader

from allanscope.analysis import Analyser
from allanscope.pipeline import Decoding
from allanscope.recording import Recording
from allanscope.wire import WireSettings
from support.fault_simulation import Plan, Ran, device_bytes, folder_of, run

__all__ = ["simulate", "violations"]


def violations(ran: Ran) -> list[str]:
    """Return what does not hold of a run, in words."""
    return [
        *_of_threads(ran),
        *_of_the_end(ran),
        *_of_the_result(ran),
        *_of_the_counters(ran),
        *_of_the_recording(ran),
        *_of_the_lines(ran),
    ]


def _of_threads(ran: Ran) -> Iterator[str]:
    for error in ran.thread_errors:
        yield f"a thread ended with {error}"
    if "Traceback" in ran.err or "internal error" in ran.err:
        yield f"an internal error: {ran.err.strip()[-200:]}"
    left = [one.name for one in threading.enumerate() if one.name in ("recorder", "refresh")]
    if left:
        yield f"threads are left behind: {left}"


def _of_the_end(ran: Ran) -> Iterator[str]:
    complete = (ran.folder / "result.json").exists() and (ran.folder / "report.html").exists()
    if ran.code not in (0, 2, 6):
        yield f"exit code {ran.code}"
    if ran.code == 0 and not (ran.analysis and complete):
        yield "exit code 0 without result and report"
    if ran.analysis is None:
        if ran.code != 2:
            yield f"no result, exit code {ran.code}: {ran.err[-200:]}"
        return
    failures = ran.analysis.failures
    if (ran.code == 6) != bool(failures):
        yield f"exit code {ran.code} with failures {failures}"
    if "stderr" not in ran.struck and any(one[:60] not in ran.err for one in failures):
        yield f"a failure is not told: {failures}, told {ran.err!r}"
    silent = {"refresh", "view", "report"} & ran.struck
    if silent and not failures:
        yield f"{silent} failed and nobody is told"


def _of_the_result(ran: Ran) -> Iterator[str]:
    if ran.analysis is None:
        return
    places = [*ran.folder.glob("result.json"), *ran.spare.rglob("result.json")]
    if places:
        if json.loads(places[0].read_text())["samples"] != ran.analysis.samples:
            yield "the result that is written is another one"
    elif not any("result.json is lost" in one for one in ran.analysis.failures):
        yield "the result is nowhere, and nothing says so"
    rest = [one.name for one in ran.folder.iterdir() if one.name.endswith((".part", "reserve"))]
    if rest and "unlink" not in ran.struck:
        yield f"left behind: {rest}"


def _of_the_counters(ran: Ran) -> Iterator[str]:
    if ran.analysis is None:
        return
    sent = sum(count for _, count in device_bytes())
    kept, lost = ran.analysis.samples, ran.analysis.lost_samples
    if kept != ran.arrived:
        yield f"{ran.arrived} samples arrived, {kept} are in the result"
    if not kept + lost <= sent or sent - kept - lost > 64:  # frames after the last are not missed
        yield f"{sent} sent, {kept} kept and {lost} lost"
    if ran.analysis.link.suspect:
        yield "suspect samples behind a checksum"


def _of_the_recording(ran: Ran) -> Iterator[str]:
    if ran.analysis is None or ran.recorder is None:
        return
    files = sorted(ran.folder.glob("session*.mcap"))
    if not files:
        yield "no recording"
        return
    for path in files:
        with path.open("rb") as file:
            try:
                times = [one.log_time for one in StreamReader(file).records if _is_message(one)]
            except Exception:  # a file whose end was refused: what there is, is read below
                continue
        if times != sorted(times):
            yield f"log times of {path.name} run backwards"
    recording = Recording(ran.folder)
    decoding, analyser = Decoding(WireSettings(), "native"), Analyser()
    host_ns = []
    for buffer in recording.buffers():
        host_ns += buffer.host_ns.tolist()
        for event in decoding.feed_buffer(buffer):
            analyser.feed(event)
    for event in decoding.finish():
        analyser.feed(event)
    if host_ns != sorted(host_ns):
        yield "the times of reads run backwards"
    replayed = analyser.state.samples if analyser.state is not None else 0
    if replayed > ran.analysis.samples:
        yield f"{replayed} samples recorded of {ran.analysis.samples}"
    if replayed < ran.analysis.samples and not ran.recorder.failure:
        yield f"{replayed} samples recorded of {ran.analysis.samples}, and nothing says so"
    if ran.recorder.failure and ran.recorder.failure[:60] not in str(ran.analysis.failures):
        yield f"the recorder failed ({ran.recorder.failure}) and the result does not say so"


def _is_message(record: object) -> bool:
    return type(record).__name__ == "Message"


_TIME = re.compile(r"^ {0,10}([\d.]+) (s|ms)  ", re.MULTILINE)


def _of_the_lines(ran: Ran) -> Iterator[str]:
    times = [float(at) * (1e-3 if unit == "ms" else 1.0) for at, unit in _TIME.findall(ran.out)]
    if times != sorted(times):
        yield f"the times of lines run backwards: {times}"


def simulate(seed: int, place: Path) -> list[str]:
    """Run one seed and return what does not hold."""
    with folder_of(place, seed) as folder:
        return violations(run(Plan.of(seed), folder))
