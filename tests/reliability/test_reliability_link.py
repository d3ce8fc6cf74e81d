"""Everything that can happen to a cable, through a real port from another process."""

from __future__ import annotations

import json
import os
import threading
import tty
from collections.abc import Callable
from pathlib import Path

import pytest

from allanscope.errors import DeviceError, InputError
from allanscope.recording import Recording
from support.device_process import DeviceProcess
from support.live_session import watch, watch_in_full
from support.survey import missing, survey

Plug = Callable[..., DeviceProcess]


def test_every_sample_that_is_lost_on_the_way_is_reported_lost(
    plug_in: Plug, tmp_path: Path
) -> None:
    """Pulled cable, damaged bytes, silence: the device numbers its samples, so the sum is exact."""
    faults = [
        "unplug:at=2,seconds=1",
        "stall:at=4.5,seconds=3.6",
        "bit_flip:rate=1e-4",
        "byte_loss:rate=1e-4,length=7",
        "garbage:rate=5e-5",
    ]
    device = plug_in({"faults": faults, "rate": 833.0})
    analysis = watch(device.url, tmp_path / "S", 10.0)
    (ledger,) = device.ledgers()
    (stretch,) = survey(tmp_path / "S")
    assert ledger["faults"]["bit_flip"] > 2
    assert {"unplug", "stall", "garbage", "byte_loss"} <= set(ledger["faults"])
    assert analysis.lost_samples == missing(ledger, stretch) > 500
    assert analysis.samples + analysis.lost_samples == stretch.stop - stretch.first
    assert analysis.unknown_losses == 0
    assert analysis.reconnects == 1
    assert analysis.link.crc_errors + analysis.link.resyncs > 2
    assert "no data from the device" in analysis.remarks
    events = [chunk.event for chunk in Recording(tmp_path / "S").chunks() if chunk.event]
    assert events == ["disconnected", "reconnected", "stalled", "resumed"]


def test_a_reset_is_a_new_segment_whose_loss_nobody_can_know(plug_in: Plug, tmp_path: Path) -> None:
    device = plug_in({"faults": ["reset:at=2"]})
    analysis = watch(device.url, tmp_path / "S", 4.0)
    (ledger,) = device.ledgers()
    before, after = survey(tmp_path / "S")
    assert (analysis.segments, analysis.unknown_losses) == (2, 1)
    assert analysis.lost_samples == missing(ledger, before) + missing(ledger, after)
    assert analysis.samples == before.received + after.received
    assert after.info.epoch != before.info.epoch


def test_another_configuration_is_never_mixed_with_the_first(plug_in: Plug, tmp_path: Path) -> None:
    """The board goes, comes back with another scale, and once more as it was at first."""
    first = {"seconds": 4.0, "gyro_fs": 125.0}
    device = plug_in(first, {"seconds": 3.0, "gyro_fs": 2000.0}, first)
    analysis = watch(device.url, tmp_path / "S", 11.0)
    device.ledgers()
    one, other, again = survey(tmp_path / "S")
    assert one.info.scale == again.info.scale != other.info.scale
    assert analysis.samples == one.received + again.received
    assert analysis.segments == 2
    assert f"{other.received} samples of other configurations" in analysis.remarks[0]
    assert analysis.reconnects == 2
    level = analysis.axes["az"].level
    assert level is not None
    assert level.mean == pytest.approx(1.0, abs=0.2)


def test_stock_firmware_that_is_pulled_is_told_to_start_again(
    plug_in: Plug, tmp_path: Path
) -> None:
    life = {"wire": "tmsg", "seconds": 2.5}
    device = plug_in(life, life)
    analysis = watch(device.url, tmp_path / "S", 6.0)
    device.ledgers()
    assert analysis.segments == 2
    assert analysis.reconnects == 1
    assert analysis.samples > 60
    assert [chunk.data for chunk in Recording(tmp_path / "S").tx()]


def test_a_port_that_speaks_something_else_is_one_clear_line_and_kept(
    tmp_path: Path,
) -> None:
    near, far = os.openpty()
    tty.setraw(far)
    stop = threading.Event()

    def babble() -> None:
        while not stop.wait(0.01):
            os.write(near, b"\x80\x9f\xc3(" * 60)

    talker = threading.Thread(target=babble, daemon=True)
    talker.start()
    try:
        with pytest.raises(InputError, match="none of the formats") as caught:
            watch_in_full(os.ttyname(far), tmp_path / "S", 20.0)
    finally:
        stop.set()
        talker.join()
        os.close(near)
        os.close(far)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith("; at a UART, check --baud")
    assert b"\x80\x9f\xc3(" in next(Recording(tmp_path / "S").buffers()).data


def test_a_port_that_says_nothing_ends_in_time_and_says_so(tmp_path: Path) -> None:
    near, far = os.openpty()
    try:
        with pytest.raises(DeviceError, match="no samples received"):
            watch_in_full(os.ttyname(far), tmp_path / "S", 1.0)
    finally:
        os.close(near)
        os.close(far)
    assert not (tmp_path / "S").exists(), "nothing is left of a session that heard nothing"


def test_a_session_that_ends_while_the_device_is_away_leaves_all_it_should(
    plug_in: Plug, tmp_path: Path
) -> None:
    device = plug_in({"faults": ["unplug:at=1,seconds=60"], "rate": 104.0})
    analysis = watch_in_full(device.url, tmp_path / "S", 2.5)
    assert json.loads((tmp_path / "S" / "result.json").read_text())["samples"] == analysis.samples
    assert (tmp_path / "S" / "report.html").stat().st_size > 10_000
    assert Recording(tmp_path / "S").damage == []
