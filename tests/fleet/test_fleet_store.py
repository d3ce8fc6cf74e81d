"""What is kept on the disk, and what a rotten or torn piece of it costs."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import fsspec
import pytest

from allanscope.__main__ import main
from allanscope.errors import UsageError
from allanscope.fleet import FleetResult, FleetSettings
from allanscope.fleet.inputs import RecordingInput
from allanscope.fleet.lot_files import write_lot
from allanscope.fleet.outcome import Outcome, compressed_result, result_key, result_of_bytes
from allanscope.fleet.store import Store, put_file, result_folder, staged
from allanscope.pipeline import DeviceSettings

DEVICE = DeviceSettings()
PLACE = RecordingInput("/lot/a.mcap", 100, "yesterday")
DONE = Outcome(PLACE.url, "ab" * 32, ("a.mcap",), compressed_result({"x": 1}))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with closing(Store(tmp_path, DEVICE)) as store:
        store.put(store.note(PLACE, DONE), DONE.result)
    return tmp_path


def known(folder: Path, place: RecordingInput, device: DeviceSettings = DEVICE) -> str:
    with closing(Store(folder, device)) as store:
        return store.known(place)


def test_a_result_is_known_by_content_settings_and_version(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = result_key(DONE.sha256, DEVICE)
    assert known(folder, PLACE) == key
    assert known(folder, PLACE, DeviceSettings(part="LSM6DSL")) == ""
    monkeypatch.setattr("allanscope.fleet.outcome.version", lambda name: "next")
    assert known(folder, PLACE) == ""


@pytest.mark.parametrize(
    "changed",
    [
        RecordingInput(PLACE.url, 101, "yesterday"),
        RecordingInput(PLACE.url, 100, "today"),
        RecordingInput(PLACE.url, 100, ""),
        RecordingInput("/lot/b.mcap", 100, "yesterday"),
        RecordingInput(
            PLACE.url, 100, "yesterday", (RecordingInput("/lot/a-001.mcap", 5, "today"),)
        ),
    ],
)
def test_a_file_that_changed_is_looked_at_again(folder: Path, changed: RecordingInput) -> None:
    assert known(folder, changed) == ""


def test_only_a_file_as_long_as_a_known_one_may_be_it(folder: Path) -> None:
    with closing(Store(folder, DEVICE)) as store:
        assert store.may_contain(RecordingInput("/lot/b.mcap", 100, "now"))
        assert not store.may_contain(RecordingInput("/lot/b.mcap", 99, "now"))


@pytest.mark.parametrize("torn", [b'{"url": "/lot/z', b"\xff\xfe\n", b"[1]\n", b'{"url": 1}\n'])
def test_a_torn_index_costs_its_line(folder: Path, torn: bytes) -> None:
    index = folder / "index.jsonl"
    index.write_bytes(index.read_bytes() + torn)
    assert known(folder, PLACE)


def test_a_rotten_result_is_told_of_and_asked_for_again(folder: Path) -> None:
    key = known(folder, PLACE)
    with closing(Store(folder, DEVICE)) as store:
        store.path(key).write_bytes(DONE.result[:-9])
        result = FleetResult({PLACE.url: key})
        write_lot(result, store, FleetSettings((PLACE.url,), folder))
    assert list(result.failures) == [PLACE.url]
    assert "damaged" in result.failures[PLACE.url]
    assert (result.keys, result.table) == ({}, None)
    assert known(folder, PLACE) == ""


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot write to"):
        Store(tmp_path / "file" / "out", DEVICE)


class Full:
    """A file on a full disk."""

    name = "index.jsonl"

    def write(self, text: str) -> None:
        raise OSError(28, "No space left on device")

    def close(self) -> None:
        pass


def test_a_full_disk_is_not_taken_for_a_scheduler_that_went_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(Store(tmp_path, DEVICE)) as store:
        store.close()
        monkeypatch.setattr(store, "_index", Full())
        with pytest.raises(UsageError, match=r"cannot write index.jsonl: No space left"):
            store.note(PLACE, DONE)


def test_packing_is_reproducible_and_refuses_what_is_no_result() -> None:
    result: dict[str, Any] = {"b": [1.5, None], "a": "µ"}
    assert result_of_bytes(compressed_result(result)) == result
    assert compressed_result(result) == compressed_result(result)
    for bad in (b"", b"rot", compressed_result(result)[:-3]):
        with pytest.raises(ValueError, match="damaged"):
            result_of_bytes(bad)


def test_without_the_extra_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("allanscope.fleet.cluster.find_spec", lambda name: None)
    assert main(["fleet", "x.mcap", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install '.[fleet]'" in said


def test_a_remote_result_has_the_files_of_the_last_run_and_no_others() -> None:
    """Parts of a table and pages of units, at a URL; the results themselves stay."""
    filesystem = fsspec.filesystem("memory")
    folder = result_folder("memory://staged/result")
    put_file(folder / "results" / "ab" / "ab.json.gz", b"kept")
    for names in (
        ["lot.html", "lot.parquet/axis=gx/part-0.parquet", "units/a.html", "units/b.html"],
        ["lot.html", "lot.parquet/axis=az/part-0.parquet", "units/b.html"],
    ):
        with staged(folder) as here:
            for name in names:
                (here / name).parent.mkdir(parents=True, exist_ok=True)
                (here / name).write_text(name)
        there = {path.removeprefix("/staged/result/") for path in filesystem.find("/staged")}
        assert there == {*names, "results/ab/ab.json.gz"}
    filesystem.rm("/staged", recursive=True)


@pytest.mark.parametrize("partition", [(), ("axis",)])
def test_a_run_without_results_leaves_what_an_earlier_one_wrote(
    tmp_path: Path, partition: tuple[str, ...]
) -> None:
    table = tmp_path / "lot.parquet"
    table.write_bytes(b"of an earlier run")
    result = FleetResult(failures={PLACE.url: "damaged"})
    with closing(Store(tmp_path, DEVICE)) as store:
        write_lot(result, store, FleetSettings((PLACE.url,), tmp_path, partition=partition))
    assert table.read_bytes() == b"of an earlier run"


def test_a_folder_that_another_fleet_writes_to_is_refused(tmp_path: Path) -> None:
    with (
        closing(Store(tmp_path, DEVICE)),
        pytest.raises(UsageError, match="another fleet is writing"),
    ):
        Store(tmp_path, DEVICE)
    with closing(Store(tmp_path, DEVICE)):
        pass
