"""Which format a port speaks, and what is said of one that speaks none."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.sanitize import excerpt, plain_line, text_of, without_escapes
from allanscope.wire import format_named, formats, sniff

PROSE = b"It was a dark and stormy night; the rain fell in torrents, except at intervals. " * 40
NOT_OURS = {
    "nothing": b"",
    "zeros": bytes(5000),
    "noise": np.random.default_rng(1).integers(0, 256, 100_000, np.uint8).tobytes(),
    "a compressed file": zlib.compress(np.random.default_rng(2).bytes(30_000)),
    "a picture": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + np.random.default_rng(3).bytes(20_000),
    "a program": b"\x7fELF\x02\x01\x01" + bytes(57) + np.random.default_rng(4).bytes(20_000),
    "prose": PROSE,
    "lines of prose": PROSE.replace(b". ", b".\n"),
    "source": b"for (int i = 0; i < 3; i++) { ax[i] = gyro_x * 2.5; }\n" * 50,
    "JSON": b'{"ax": 1.0, "name": "imu", "values": [1, 2, 3]}\n' * 50,
    "NMEA": b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n" * 50,
    "a table of something else": b"pressure,humidity,co2\n" + b"1013.2,40.1,412\n" * 200,
    "a column of numbers": b"123\n" * 200,
    "modem probes": b"AT\r\nATE0\r\n+CME ERROR: 3\r\n" * 20,
    "firmware chatter": b"Sending: Press=1013 Hum=40 Temp=25 Temp2=25 \r\n" * 50,
    "MAVLink-like": (b"\xfd\x09\x00\x00\x01\x01\x01\x00\x00\x00" + b"\x00" * 9 + b"\x12\x34") * 200,
}


@pytest.mark.parametrize("name", NOT_OURS)
def test_what_is_no_capture_fits_nothing(name: str) -> None:
    found = sniff(NOT_OURS[name])
    assert found.name is None, found.scores
    assert max(found.scores.values()) < 0.1
    assert set(found.scores) == set(formats())
    assert found.excerpt.isprintable()
    assert len(found.excerpt) < 220


def test_an_excerpt_is_escaped_and_short() -> None:
    assert excerpt(b"\x1b]0;evil\x07\x00\xff ok\r\n") == r"\x1b]0;evil\x07\x00\xff ok\r\n"
    assert excerpt(b"a" * 1000) == "a" * 160 + "…"
    assert excerpt(b"") == ""
    assert excerpt(bytes(1000)) == r"\x00" * 40 + "…"
    assert excerpt(b"PK\3\4", 8) == r"PK\x03…" + " (a ZIP archive, as .npz and .xlsx files are)"


@given(st.binary(max_size=400))
def test_whatever_is_shown_is_printable(data: bytes) -> None:
    assert excerpt(data).isprintable()
    assert text_of(data).isprintable()
    assert plain_line(data).replace("\t", "").isprintable()
    assert b"\x1b[" not in without_escapes(data.replace(b"\x1b", b"\x1b["))[:0]


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\x1b[1;32mgreen\x1b[0m", "green"),
        (b"\x1b]0;title\x07after", "after"),
        (b"\x1b]8;;http://x\x1b\\link\x1b]8;;\x1b\\", "link"),
        (b"\x1bPq#0\x1b\\sixel", "sixel"),
        (b"\x1bcreset \x1b(Bset", "reset set"),
        (b"bell\x07\x08\x7f", "bell"),
        (b"24.5 \xb0C", "24.5 °C"),
        ("24.5 °C".encode(), "24.5 °C"),
        (b"a\tb\r\n", "a b"),
        ("right-to-left \u202e".encode(), "right-to-left"),
        (b"x" * 300, "x" * 199 + "…"),
        (b"\x1b", ""),
        (b"\x1b[", ""),
    ],
)
def test_control_characters_never_leave_the_room(data: bytes, text: str) -> None:
    assert text_of(data) == text


@pytest.mark.parametrize("name", formats())
def test_one_frame_or_record_in_a_sea_of_noise_is_enough_for_the_checked_formats(
    name: str,
) -> None:
    if name == "text":
        pytest.skip("text has nothing to check by")
    encoder = format_named(name).encoder()
    head = encoder.describe(StreamInfo(AXES, (70e-3,) * 3 + (61e-6,) * 3, 104.0))
    wire = head + encoder.encode(Block(0, np.full((6, 6), 3, np.int16), Ticks.none()))
    end = {"native": b"\0", "tmsg": b"\xf0", "tmsg-sensortile": b"\xf0"}.get(name, b"\r\n")
    noise = np.random.default_rng(7).bytes(20_000)
    assert sniff(noise + end + wire + end + noise).name == name


def test_a_long_sample_is_looked_at_only_so_far() -> None:
    encoder = format_named("native").encoder()
    assert sniff(bytes(1 << 18) + encoder.describe(StreamInfo(AXES, (1.0,) * 6))).name is None
