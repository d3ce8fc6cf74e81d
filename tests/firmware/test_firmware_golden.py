"""One byte stream that the host's build, the sanitized build, the board and Python all give."""

import hashlib
import re
import struct
import subprocess
import zlib
from itertools import islice
from pathlib import Path

import numpy as np

from allanscope.wire.native.framing import cobs_encode
from allanscope.wire.native.layout import VERSION
from support.synthetic_sensor import count

ROOT = Path(__file__).parents[2] / "firmware_protocol"
LENGTH = 60_000
SHA256 = "f9287811896b0b5e469d44ec29e765398a7b1988dcdc429293699983c7beff6a"
RATE, FRAME = 104.0, 3
PERIOD_US = 1_000_000
F = np.float32


def samples_us(n):
    """Return the time of n samples as the device reckons it, in single precision."""
    return int(F(n) * F(1e6) / F(RATE))


def frames():
    """Yield what a device with the virtual clock sends, frame by frame."""
    seq = produced = now = 0
    next_read, next_periodic = samples_us(FRAME), PERIOD_US

    def frame(kind, flags, n, body):
        nonlocal seq
        plain = struct.pack("<BBHHBB", kind, 0x12, seq, 0x4C41, flags, n) + body
        seq += 1
        return cobs_encode(plain + zlib.crc32(plain).to_bytes(4, "little")) + b"\0"

    yield b"\0" + frame(2, 0, len(descriptor()), descriptor())
    while True:
        now = next_read
        due = now * 208 // 2_000_000
        while True:
            n = min(due - produced, FRAME)
            if n:
                first = max(now - samples_us(due - produced), 0)
                rows = [count(k, axis) for k in range(produced, produced + n) for axis in range(6)]
                ticks, warmth = int(F(40000) / F(RATE)) * produced, produced >> 8 & 0xFF
                head = struct.pack("<IQIh", produced, first, ticks, warmth)
                yield frame(1, 3, n, head + struct.pack(f"<{6 * n}h", *rows))
                produced += n
            if now >= next_periodic:
                yield frame(2, 0, len(descriptor()), descriptor())
                body = struct.pack("<Q6I", now, produced, produced, 0, 0, 0, 0)
                yield frame(3, 0, len(body), body)
                next_periodic += PERIOD_US
            if n < FRAME:
                break
        next_read += samples_us(FRAME)


def descriptor():
    def entry(tag, *floats):
        return bytes([tag, 4 * len(floats)]) + struct.pack(f"<{len(floats)}f", *floats)

    return b"".join(
        [
            b"\x01\x01\x07LSM6DSM\x02\x01\x6a\x03\x051.2.0",
            entry(5, 250.0) + entry(6, 8.75e-3) + entry(7, 2.0) + entry(8, 0.061e-3),
            entry(9, 256.0, 25.0) + entry(10, RATE),
            b"\x0b\x04"
            + struct.pack("<I", 25000)
            + b"\x0c\x01\x3f\x0d\x01\x03\x12\x01\x03\x10\x01\x10",
        ]
    )


def build(compiler, out, *flags):
    """Build the firmware for the host, its main under another name."""
    names = ("main", "device", "descriptor", "imu", "synthetic", "board_host")
    sources = [*(ROOT / "device" / f"{name}.c" for name in names), *ROOT.glob("encoder/*.c")]
    objects = []
    for source in sources:
        rename = ["-Dmain=firmware_main"] if source.name == "main.c" else []
        objects.append(out / f"{source.stem}.o")
        command = [compiler, "-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion"]
        command += ["-Werror", "-DVIRTUAL_CLOCK", f"-I{ROOT / 'encoder'}", *rename, *flags]
        subprocess.run([*command, "-c", str(source), "-o", str(objects[-1])], check=True)
    subprocess.run([compiler, *flags, "-o", str(out / "device"), *map(str, objects)], check=True)
    return out / "device"


def digest(data):
    return hashlib.sha256(data).hexdigest()


def test_python_foretells_every_byte():
    stream = b""
    for frame in islice(frames(), 5000):
        stream += frame
        if len(stream) >= LENGTH:
            break
    assert digest(stream[:LENGTH]) == SHA256


def test_all_that_states_a_version_states_the_same_one():
    """The first two numbers of the firmware's are those of the protocol that it speaks."""
    norm = (ROOT / "PROTOCOL.md").read_text()
    (layout,) = re.findall(r"AS_VERSION = 0x(\d)(\d)", (ROOT / "encoder/as_layout.h").read_text())
    (title,) = re.findall(r"protocol, version (\d)\.(\d)\n", norm)
    (example,) = re.findall(r'"0x03": "(\d)\.(\d)\.\d+ ', norm)
    source = (ROOT / "device" / "descriptor.c").read_text()
    (firmware,) = re.findall(r'firmware_version\[\] = "(\d)\.(\d)\.\d+"', source)
    assert layout == title == example == firmware == (str(VERSION >> 4), str(VERSION & 15))


def test_the_hosts_build_gives_the_golden_stream(compiler, tmp_path):
    ran = subprocess.run([build(compiler, tmp_path), str(LENGTH)], capture_output=True, check=True)
    assert digest(ran.stdout) == SHA256


def test_the_sanitized_build_gives_it_too_and_finds_nothing(compiler, tmp_path):
    flags = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    ran = subprocess.run(
        [build(compiler, tmp_path, *flags), str(LENGTH)], capture_output=True, check=True
    )
    assert ran.stderr == b""
    assert digest(ran.stdout) == SHA256


def test_the_board_gives_it_too(boards, tmp_path):
    out = tmp_path / "usart"
    with boards.to_file("virtual", out) as board:
        board.wait_until(lambda: out.exists() and out.stat().st_size >= LENGTH)
    assert digest(out.read_bytes()[:LENGTH]) == SHA256
