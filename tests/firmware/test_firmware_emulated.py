"""The firmware on an emulated STM32L475, through a real serial port.

No test asserts a rate: the emulator keeps time only roughly. Contiguity, values, counters and
answers are asserted.
"""

import time

import numpy as np

from allanscope.samples import StreamInfo
from support.emulated_host import DESCRIBE, PING, SET, START, STOP, Host
from support.synthetic_sensor import check_values


def test_every_sample_is_the_synthetic_sensors_and_none_is_missing(boards):
    with boards.on_pty("virtual") as board, Host(board) as host:
        # What was sent before QEMU had noticed that its port was opened may have been lost.
        assert host.ask(PING, b"\0\1\0") == 0
        seen, before, lost = len(host.blocks), host.samples(), host.lost()
        host.until(lambda: host.samples() > before + 20_000, "20 000 samples")
        check_values(host.blocks)
        indices = np.concatenate([b.index + np.arange(len(b)) for b in host.blocks[seen:]])
        np.testing.assert_array_equal(np.diff(indices), 1)
        assert host.lost() == lost
        assert host.last_status()["dropped"] == 0


def test_commands_are_acknowledged_in_the_middle_of_a_stream(boards):
    with boards.on_pty("paced") as board, Host(board) as host:
        assert host.ask(PING, b"\0\1\0") == 0
        assert host.ask(DESCRIBE) == 0
        assert host.ask(0x90) == 1
        assert host.ask(SET, b"\x0a\x04\x00\x00\xd0\x43") == 0
        assert host.ask(SET, b"\x05\x04\x00\x00\x40\x40") == 3
        assert host.ask(SET, b"\x05\x09") == 2
        host.until(lambda: host.samples() > 100, "samples")
        infos = [event for event in host.events if isinstance(event, StreamInfo)]
        assert [info.nominal_hz for info in infos] == [104.0, 416.0]
        seen = len(host.blocks)
        # What was sent before QEMU had noticed that its port was opened may have been lost.
        answered = len(host.answered())
        host.until(
            lambda: answered <= host.last_status().get("commands", 0) <= host.sent,
            "status after the last command",
        )
        assert host.lost() == host.last_status()["dropped"]
        check_values(host.blocks[seen:])


def test_stop_is_silence_and_start_is_a_new_epoch(boards):
    with boards.on_pty("paced") as board, Host(board) as host:
        host.until(lambda: host.samples() > 20, "samples")
        assert host.ask(STOP) == 0
        seen = host.samples()
        assert host.ask(PING) == 0
        assert host.samples() == seen
        assert host.ask(START) == 0
        host.until(lambda: host.samples() > seen + 20, "samples after the start")
        infos = [event for event in host.events if isinstance(event, StreamInfo)]
        assert infos[-1].epoch == (infos[0].epoch + 1) % 65536
        assert host.blocks[-1].index < 1000


def test_samples_that_find_no_room_are_dropped_and_counted_to_the_sample(boards):
    with boards.on_pty("paced") as board, Host(board) as host:
        assert host.ask(SET, b"\x0a\x04\x00\x80\xcf\x44") == 0  # 1660 Hz
        host.until(lambda: host.samples() > 200, "samples")
        for _ in range(10):  # on a busy machine the board's own clock is slow
            time.sleep(3.0)  # the host does not read: the ring of the device runs over
            after = host.samples()
            host.until(lambda: host.samples() > after + 4000, "samples after the pause")  # noqa: B023
            told = host.last_status().get("uptime_s", 0.0)
            host.until(lambda: host.last_status()["uptime_s"] > told, "a status")  # noqa: B023
            assert host.lost() == host.last_status()["dropped"]
            if host.lost():
                break
        assert host.lost() > 0
        check_values(host.blocks)


def test_a_board_that_is_restarted_is_a_new_segment_and_never_mixed(boards):
    with boards.on_pty("paced") as board:
        with Host(board) as host:
            host.until(lambda: host.samples() > 50, "samples")
        board.kill()
        board.start()
        with Host(board) as again:
            again.until(lambda: again.samples() > 50, "samples after the restart")
            assert again.blocks[0].index < 500
            check_values(again.blocks)
