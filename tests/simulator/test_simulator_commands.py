"""The firmware obeys what a host asks, in every wire format that can ask."""

from __future__ import annotations

import pytest

from allanscope.samples import Block, Notice, StreamInfo
from allanscope.simulator import Firmware, Simulator
from allanscope.simulator.firmware import reconfigure
from allanscope.wire import Command, WireSettings, format_named


class Host:
    """A host of the native format on a firmware without a port."""

    def __init__(self, **sensor):
        self.firmware = Firmware(Simulator(rate=104.0, seed=1, **sensor))
        self.format = format_named("native")
        self.decoder = self.format.decoder(WireSettings())
        self.firmware.host_connected()

    def hear(self, seconds):
        self.firmware.advance(self.firmware.now_s + seconds)
        events = []
        while data := self.firmware.pending():
            self.firmware.written(len(data))
            events += self.decoder.feed(data, self.firmware.now_s)
        return events

    def say(self, *messages):
        for message in messages:
            self.firmware.receive(message)


def kinds(events):
    return [type(event) for event in events]


def test_a_native_device_streams_from_power_up():
    events = Host().hear(1.0)
    assert kinds(events)[0] is StreamInfo
    assert Block in kinds(events)


def test_stop_silences_and_start_begins_a_new_epoch():
    host = Host()
    host.hear(1.0)
    epoch = host.firmware.epoch
    host.say(*host.format.stop())
    events = host.hear(2.0)
    assert [e.text for e in events if isinstance(e, Notice)] == ["stop: ok"]
    assert Block not in kinds(events)
    host.say(*host.format.start(WireSettings()))
    events = host.hear(1.0)
    info = next(e for e in events if isinstance(e, StreamInfo))
    assert info.epoch == host.firmware.epoch == (epoch + 1) & 0xFFFF
    assert next(e for e in events if isinstance(e, Block)).index == 0


def test_device_time_goes_on_while_it_is_stopped():
    host = Host()
    host.hear(1.0)
    host.say(*host.format.stop())
    host.hear(5.0)
    host.say(*host.format.start(WireSettings()))
    block = next(e for e in host.hear(1.0) if isinstance(e, Block))
    assert block.ticks.device_s[0] == pytest.approx(6.0, abs=0.05)


def test_start_of_a_streaming_device_changes_nothing():
    host = Host()
    host.hear(1.0)
    epoch = host.firmware.epoch
    host.say(*host.format.start(WireSettings()))
    host.hear(1.0)
    assert host.firmware.epoch == epoch
    assert host.decoder.stats.lost_samples == 0


def test_set_changes_rate_and_full_scales_of_the_same_specimen():
    host = Host()
    host.hear(1.0)
    before = host.firmware.sensor
    host.say(*host.format.start(WireSettings(rate_hz=416.0, gyro_fs=500.0, accel_fs=8.0)))
    events = host.hear(1.0)
    info = [e for e in events if isinstance(e, StreamInfo)][-1]
    assert info.nominal_hz == 416.0
    assert info.scale == pytest.approx((17.5e-3,) * 3 + (0.244e-3,) * 3)
    assert host.firmware.sensor.truth == before.truth
    assert host.firmware.sensor.clock.relative_error == before.clock.relative_error
    samples = sum(len(e) for e in events if isinstance(e, Block))
    assert samples == pytest.approx(416.0, rel=0.06)


def test_set_of_what_is_set_already_changes_nothing():
    host = Host()
    host.hear(1.0)
    epoch = host.firmware.epoch
    host.say(*host.format.start(WireSettings(rate_hz=104.0, gyro_fs=125.0)))
    assert "set: ok" in [e.text for e in host.hear(1.0) if isinstance(e, Notice)]
    assert host.firmware.epoch == epoch


@pytest.mark.parametrize("settings", [{"rate_hz": 150.0}, {"gyro_fs": 300.0}])
def test_set_of_what_the_part_has_not_is_refused_and_changes_nothing(settings):
    host = Host()
    host.hear(1.0)
    sensor = host.firmware.sensor
    host.say(*host.format.start(WireSettings(**settings)))
    texts = [e.text for e in host.hear(1.0) if isinstance(e, Notice)]
    assert "set: failed" in texts
    assert host.firmware.sensor is sensor


def test_axes_can_be_set():
    sensor = Simulator()
    changed = reconfigure(sensor, Command("set", fields={"axes": ("gz", "ax")}))
    assert changed.info.axes == ("gz", "ax")


def test_replies_come_through_a_full_ring():
    host = Host()
    host.firmware.advance(600.0)  # fills the ring many times over
    assert host.firmware.ledger.dropped > 0
    host.say(*host.format.stop())
    assert "stop: ok" in [e.text for e in host.hear(0.1) if isinstance(e, Notice)]


def test_a_host_that_only_asks_does_not_fill_the_memory():
    host = Host()
    for _ in range(1000):
        host.say(*host.format.stop(), *host.format.describe())
    waiting = 0
    while data := host.firmware.pending():
        waiting += len(data)
        host.firmware.written(len(data))
    assert 0 < waiting < 65536 + 5000
    assert host.firmware.ledger.commands == 2000


def test_noise_from_the_host_is_no_command():
    host = Host()
    host.say(bytes(range(256)) * 20)
    assert host.firmware.ledger.commands == 0
    assert Block in kinds(host.hear(1.0))
