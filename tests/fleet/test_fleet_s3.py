"""Recordings and results on S3, from a server of this machine that speaks its protocol."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pyarrow.parquet as pq
import pytest
from moto.server import ThreadedMotoServer

from allanscope.errors import InputError, UsageError
from allanscope.fleet import FleetSettings, run_fleet
from allanscope.fleet.inputs import find_inputs
from allanscope.fleet.lot_files import find_lot
from allanscope.fleet.store import Store, result_folder
from allanscope.fleet.worker_tasks import analyse_recording
from allanscope.pipeline import DeviceSettings

DEVICE = DeviceSettings()


@pytest.fixture(scope="module")
def s3() -> Iterator[fsspec.AbstractFileSystem]:
    """Return the file system of a server that all processes of this test reach by environment."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "key")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        fsspec.get_filesystem_class("s3").clear_instance_cache()
        yield fsspec.filesystem("s3")
        fsspec.get_filesystem_class("s3").clear_instance_cache()
    server.stop()


@pytest.fixture(scope="module")
def bench(s3: fsspec.AbstractFileSystem, lot: Path) -> str:
    """Return the URL of a lot."""
    s3.mkdir("bench")
    s3.put(str(lot), "bench/lot", recursive=True)
    return "s3://bench/lot"


def command(*arguments: object) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "allanscope", "fleet", *map(str, arguments), "--workers", "1"]
    return subprocess.run(call, capture_output=True, text=True, timeout=200, check=False)


def test_a_fleet_reads_from_s3_and_writes_there(
    s3: fsspec.AbstractFileSystem, bench: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And goes on there: in parts in the place of the whole table, and against an earlier lot."""
    monkeypatch.chdir(tmp_path)
    out = "s3://bench/result"
    ended = command(f"{bench}/**/*.mcap", "--out", out)
    assert ended.stdout.splitlines() == [
        "3 recordings analysed; 1 failed",
        f"Saved: {out}/lot.parquet",
        f"Saved: {out}/lot.html",
    ], ended.stderr
    assert ended.returncode == 3
    assert f"{bench}/two/bad.mcap is not an MCAP file" in ended.stderr
    assert os.listdir(tmp_path) == []  # no local folder by the name "s3:"
    with s3.open("bench/result/lot.parquet") as file:
        table = pq.read_table(file)
    assert table.num_rows == 18
    assert set(table.column("unit").to_pylist()) == {"0001", "0002"}
    s3.invalidate_cache()
    results = s3.glob("bench/result/results/*/*.json.gz")
    assert len(results) == 3

    s3.copy("bench/result/lot.parquet", "bench/whole/lot.parquet")
    again = command(f"{bench}/**/?.mcap", "--out", out, "--partition", "unit,axis")
    assert again.stdout.startswith("3 recordings analysed earlier"), again.stderr
    assert again.returncode == 0
    s3.invalidate_cache()
    assert not s3.isfile("bench/result/lot.parquet")
    assert len(s3.glob("bench/result/lot.parquet/unit=*/axis=*/*.parquet")) == 12
    for place in (out, f"{out}/", f"{out}/lot.parquet", "s3://bench/whole"):
        lot = find_lot(place)
        assert lot is not None
        assert len(lot) == 18
        assert set(lot.units) == {"0001", "0002"}

    s3.copy("bench/result/lot.parquet", "bench/parted/lot.parquet", recursive=True)
    last = command(f"{bench}/**/?.mcap", "--out", out, "--compare", "s3://bench/parted")
    assert last.returncode == 0, last.stderr
    with pytest.raises(InputError, match="s3://bench/nothing is not the result of a fleet"):
        find_lot("s3://bench/nothing")


def test_a_recording_on_s3_gives_the_same_result(bench: str, lot: Path) -> None:
    [there] = find_inputs([f"{bench}/one/a.mcap"])
    [here] = find_inputs([str(lot / "one" / "a.mcap")])
    one, other = analyse_recording(there, DEVICE), analyse_recording(here, DEVICE)
    assert not one.error
    assert one.sha256 == other.sha256
    axes = [json.loads(gzip.decompress(x.result))["analysis"]["axes"] for x in (one, other)]
    assert axes[0] == axes[1]


def test_an_object_that_was_replaced_is_looked_at_again(
    s3: fsspec.AbstractFileSystem, lot: Path, bench: str
) -> None:
    """The same name, length and second: the ETag alone tells."""
    data = (lot / "one" / "a.mcap").read_bytes()
    s3.pipe_file("bench/again/a.mcap", data)
    [before] = find_inputs(["s3://bench/again"])
    s3.pipe_file("bench/again/a.mcap", data[:-1] + bytes([data[-1] ^ 1]))
    [after] = find_inputs(["s3://bench/again"])
    assert (before.url, before.size) == (after.url, after.size)
    assert before.stamp != after.stamp


def test_a_bucket_that_is_not_there_is_refused_before_any_work(bench: str) -> None:
    settings = FleetSettings((bench,), "s3://nosuchbucket/out")
    with pytest.raises(UsageError, match="cannot write to s3://nosuchbucket/out"):
        run_fleet(settings, DEVICE)
    with pytest.raises(UsageError, match="The specified bucket does not exist"):
        find_inputs(["s3://nosuchbucket/**/*.mcap"])


def test_a_url_that_cannot_be_written_to_is_refused(lot: Path) -> None:
    for out, why in (
        ("http://127.0.0.1:9/out", "cannot write to http"),
        ("nosuchprotocol://x/out", "cannot write to nosuchprotocol"),
    ):
        with pytest.raises(UsageError, match=why):
            Store(out, DEVICE)
    with pytest.raises(UsageError, match="give a URL as text"):
        result_folder(Path("s3://bench/out"))


def test_a_file_url_is_a_folder_of_this_machine(tmp_path: Path) -> None:
    assert result_folder(f"file://{tmp_path}/out") == tmp_path / "out"
