"""The budgets of input on the page are those of the program; refusals come after counted work."""

from __future__ import annotations

import gzip
import math
import re
import tracemalloc
import zlib
from importlib import import_module
from pathlib import Path

import pytest

from allanscope.analysis import Analyser
from allanscope.errors import InputError
from allanscope.pipeline import Decoding, DeviceSettings
from allanscope.recording import most_unpacked
from allanscope.sources import FileSource
from allanscope.wire import WireSettings, format_named
from allanscope.wire.text import labelled

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
BYTES_WITHOUT_SAMPLES = 1 << 18
"""An eighth of what it is otherwise, so that these tests take an eighth."""
READ_BYTES = 1 << 18
ROW = b"0.1,0.2,0.3,0.01,0.02,1.0\n"
HEADER = b"gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g]\n"


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give up on what is fruitless early."""
    monkeypatch.setattr("allanscope.pipeline.decoding.BYTES_WITHOUT_SAMPLES", BYTES_WITHOUT_SAMPLES)


def budgets() -> dict[str, str]:
    """Return each constant on the page, with the words beside it."""
    table = PAGE.read_text("utf-8").partition("## Budgets of input")[2]
    rows = [line.strip("|").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    return {name: row[1] for row in rows[1:] for name in re.findall(r"`([\w.]+)`", row[2])}


def test_every_budget_on_the_page_is_that_of_the_program() -> None:
    found = budgets()
    assert len(found) == 13
    for name, words in found.items():
        module, _, constant = name.rpartition(".")
        value = getattr(import_module(f"allanscope.{module}"), constant)
        written = f"{value >> 20} MiB" if value % (1 << 20) == 0 and "MiB" in words else str(value)
        assert re.search(rf"\b{written}\b", words), (name, words, value)


def packed(path: Path, begin: bytes, again: bytes, times: int) -> Path:
    """Write a file of so many repetitions, compressed."""
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    with path.open("wb") as file:
        file.write(packer.compress(begin))
        for _ in range(times):
            file.write(packer.compress(again))
        file.write(packer.flush())
    return path


def read_until_refused(path: Path, wire: str = "") -> int:
    """Read a file until it is refused; return the bytes that were looked at."""
    source, decoding = FileSource(path), Decoding(DeviceSettings().for_wire(), wire)
    seen = 0

    def read() -> None:
        nonlocal seen
        while (chunk := source.read()).event != "end":
            seen += len(chunk.data)
            decoding.feed(chunk)

    with pytest.raises(InputError):
        read()
    source.close()
    return seen


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize("wire", ["native", "tmsg", "datalog", "text"])
def test_zeros_are_refused_after_the_first_megabytes(tmp_path: Path, wire: str) -> None:
    path = packed(tmp_path / "zeros.gz", b"", bytes(1 << 20), 100)
    assert read_until_refused(path, wire) <= BYTES_WITHOUT_SAMPLES + READ_BYTES


def test_identical_rows_are_refused_long_before_they_are_unpacked(tmp_path: Path) -> None:
    """They are sound samples; that they pack to a 400th is what nobody's sensor does."""
    path = packed(tmp_path / "rows.csv.gz", HEADER, ROW * 40_000, 60)  # 62 MB in 150 kB
    seen = read_until_refused(path)
    assert seen < most_unpacked(path.stat().st_size)
    assert seen < 30_000_000


def test_noise_that_packs_well_is_read(tmp_path: Path) -> None:
    """A sensor that changes one digit now and then, 40 times smaller when packed."""
    rows = b"".join(b"0.1,0.2,0.3,0.01,0.0%d,1.0\n" % (i % 7) for i in range(20_000))
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(HEADER + rows))
    source = FileSource(tmp_path / "a.csv.gz")
    read = b""
    while (chunk := source.read()).event != "end":
        read += chunk.data
    assert read == HEADER + rows


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize(
    "line", [b"ax=1 " * 79, b"Acc: " * 79, b"a " * 198 + b":", b"gyr " * 95 + b":"]
)
def test_labels_without_end_are_refused(tmp_path: Path, line: bytes, monkeypatch) -> None:
    (tmp_path / "labels.txt").write_bytes((line + b"\n") * 3_000)
    calls = []
    monkeypatch.setattr(labelled, "_read_part", lambda part, found: calls.append(part))
    assert read_until_refused(tmp_path / "labels.txt", "text") <= BYTES_WITHOUT_SAMPLES + READ_BYTES
    assert len(calls) <= (BYTES_WITHOUT_SAMPLES + READ_BYTES) / len(line)


def test_blanks_between_labels_cost_nothing() -> None:
    """They cost their square: a line of 400 took 6 ms."""
    parts = []
    line = "Acc" + " " * 380 + ": 1 2 3"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(labelled, "_read_part", lambda part, found: parts.append(part))
        labelled.read_labelled(line)
    assert parts == ["Acc : 1 2 3"]


@pytest.mark.usefixtures("little")
def test_a_port_may_say_nothing_of_use_for_as_long_as_it_likes() -> None:
    from allanscope.sources import Chunk

    decoding = Decoding(WireSettings(), "text")
    for second in range(1, 6):
        decoding.feed(Chunk(second * 10**9, b"hello\n" * (BYTES_WITHOUT_SAMPLES // 12)))
    assert decoding.stats.bytes > 2 * BYTES_WITHOUT_SAMPLES


def test_a_rate_that_no_sensor_has_takes_no_memory() -> None:
    """A second of it would be gigabytes."""
    rows = "".join(f"{i * 0.001:.3f},0.1\n" for i in range(300))
    decoder, analyser = format_named("text").decoder(WireSettings()), Analyser()
    tracemalloc.start()
    for event in decoder.feed(f"t[us],gx[dps]\n{rows}".encode(), math.nan):
        analyser.feed(event)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert analyser.state is not None
    assert analyser.state.info.nominal_hz == 1e9
    assert most < 64 << 20
