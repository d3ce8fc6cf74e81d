"""Every wire format over a pty, as a user runs it, while the line fails.

    python benchmarks/wire_faults.py [--rates 104 6660] [--seconds 8] [--formats native tmsg ...]

For each format, rate and fault one ``allanscope device`` on a pty and one ``allanscope live`` on
that port, two processes. Then what the session reports as lost (``result.json``) is compared with
what was lost: the samples are made again from the device's seed, the recording is decoded again,
and each delivered run of samples is looked up among them, as in
``tests/pipeline/test_pipeline_wire_faults.py``.

A line of the table ends with ``exact`` when every hole has its right number, ``open`` when some
holes are reported as of unknown length (the format's time stamps cannot tell), and with what is
wrong otherwise. ``B/s`` is what the format takes; a pty has no limit, a UART at 921600 baud carries
92,160 B/s and USB full speed about 1.2 MB/s.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "pipeline"))
import test_pipeline_wire_faults as check  # noqa: E402

from allanscope.pipeline.decoding import Decoding  # noqa: E402
from allanscope.pipeline.settings import DeviceSettings, SimulatedSettings  # noqa: E402
from allanscope.pipeline.simulate import simulator  # noqa: E402
from allanscope.recording import Recording  # noqa: E402
from allanscope.simulator import Ledger  # noqa: E402
from allanscope.wire import formats  # noqa: E402
from allanscope.wire.base import WireSettings  # noqa: E402

UART, USB = 92_160, 1_200_000
SEED = 5
PROGRAM = [sys.executable, "-m", "allanscope"]


def faults(kind: str, wire: str, rate: float, seconds: float) -> list[str]:
    """Return the faults of one line of the table, about a dozen for noise."""
    if kind == "noise":
        return list(check.noise(4.0 / (rate * seconds * check.BYTES[wire])))
    return [f"stall:at={seconds / 3:g},seconds=2" if kind == "stall" else
            f"unplug:at={seconds / 3:g},seconds=1.5"]  # fmt: skip


def session(wire: str, rate: float, wrong: list[str], seconds: float, folder: Path):
    """Run device and live, each a process; return the device's ledger and the folder's result."""
    link, out = folder / "ttySensorTile0", folder / "session"
    command = [*PROGRAM, "device", "--wire", wire, "--rate", f"{rate:g}", "--gyro-fs", "250"]
    command += ["--seed", str(SEED), "--link", str(link), "--json"]
    for one in wrong:
        command += ["--fault", one]
    device = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        device.stdout.readline()
        command = [*PROGRAM, "live", str(link), "--for", f"{seconds:g}s", "--view", "none"]
        live = subprocess.run(
            [*command, "--out", str(out), "--json"], capture_output=True, text=True, check=False
        )
        time.sleep(0.2)
        device.send_signal(signal.SIGTERM)
        book = json.loads(device.stdout.read())
    finally:
        device.kill()
        device.wait()
    if live.returncode:
        raise RuntimeError(live.stderr.strip())
    return book, json.loads(live.stdout), out


def heard(wire: str, rate: float, book: dict, out: Path) -> check.Run:
    """Decode the recording again and put it beside what the device made."""
    decoding = Decoding(WireSettings(), wire)
    events = []
    for chunk in Recording(out).chunks():
        events += decoding.feed(chunk)
    events += decoding.finish()
    ledger = Ledger()
    for loss in book["losses"]:
        ledger.lose(**loss)
    sensor = simulator(DeviceSettings(rate_hz=rate, gyro_fs=250.0), SimulatedSettings(seed=SEED))
    made = sensor.read(book["produced"]).counts * np.asarray(sensor.info.scale)
    return check.Run(events, decoding.stats, ledger, None, wire, 0, 0, made)


def verdict(told: list, result: dict) -> str:
    """Return whether the result says what was lost."""
    lost = sum(number or 0 for number, _ in told)
    unknown = sum(number is None for number, _ in told)
    if (result["lost_samples"], result["unknown_losses"]) != (lost, unknown):
        return f"WRONG: {result['lost_samples']} and {result['unknown_losses']} in the result"
    if any(number not in (None, missing) for number, missing in told):
        return "WRONG: a hole has the wrong number"
    return "open" if unknown else "exact"


def line(wire: str, rate: float, kind: str, seconds: float) -> str:
    """Run one line of the table."""
    with tempfile.TemporaryDirectory(prefix="allanscope-") as folder:
        book, result, out = session(
            wire, rate, faults(kind, wire, rate, seconds), seconds, Path(folder)
        )
        told = check.hold_against_the_truth(heard(wire, rate, book, out))
    speed = book["bytes_sent"] / max(book["sent"], 1) * rate
    carried = "UART, USB" if speed < UART else "USB" if speed < USB else "neither"
    missing = sum(number for _, number in told)
    return (
        f"| {wire} | {rate:g} | {speed:.0f} | {carried} | {kind} | {result['samples']} | {missing} "
        f"| {result['lost_samples']} | {result['unknown_losses']} "
        f"| {result['link']['reconnects']} | {verdict(told, result)} |"
    )


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    options.add_argument("--rates", type=float, nargs="+", default=[104.0, 6660.0])
    options.add_argument("--seconds", type=float, default=8.0)
    options.add_argument("--formats", nargs="+", default=list(formats()))
    options.add_argument("--kinds", nargs="+", default=["noise", "stall", "unplug"])
    asked = options.parse_args()
    print("| format | Hz | B/s | carried by | fault | delivered | missing | reported lost ", end="")
    print("| holes of unknown length | reconnections | verdict |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for rate in asked.rates:
        for wire in asked.formats:
            for kind in asked.kinds:
                try:
                    print(line(wire, rate, kind, asked.seconds), flush=True)
                except Exception as error:
                    said = (str(error) or repr(error)).splitlines()[0]
                    print(f"| {wire} | {rate:g} | | | {kind} | | | | | | FAILED: {said} |")


if __name__ == "__main__":
    main()
