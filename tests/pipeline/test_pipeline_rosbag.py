"""Bags of ROS 2 give the samples that went in; what they claim harms nobody."""

from __future__ import annotations

import json
import math
import sqlite3
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from allanscope.__main__ import main
from allanscope.errors import InputError
from allanscope.pipeline.table_files import is_table_file, rosbag, table_of_file
from support import bags

N = 600
RATE = 200.0
GYRO, ACCEL = bags.sensor(N)
SAID = bags.messages(GYRO, ACCEL, RATE)


def read(path: Path, stream: str = "") -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return rates, accelerations and remarks."""
    columns = table_of_file(path, stream).columns
    rows = np.column_stack(list(columns.axes.values()))
    assert list(columns.axes) == ["gx", "gy", "gz", "ax", "ay", "az"]
    return rows[:, :3], rows[:, 3:], columns.assumed


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunks", [True, False])
def test_every_message_of_an_mcap_bag_comes_back(tmp_path, compression, chunks):
    path = bags.write_mcap(
        tmp_path / "a.mcap", SAID, compression=compression, use_chunking=chunks, chunk_size=20_000
    )
    gyro, accel, said = read(path)
    assert np.array_equal(gyro, GYRO)
    assert np.array_equal(accel, ACCEL)
    assert said == ()


@pytest.mark.parametrize("big", [True, False])
@pytest.mark.parametrize("frame", ["", "a", "imu_link", "base/imu_frame_link_7"])
def test_every_message_of_an_sqlite_bag_comes_back(tmp_path, big, frame):
    said = bags.messages(GYRO, ACCEL, RATE, frame=frame, big=big)
    gyro, accel, _ = read(bags.write_sqlite(tmp_path / "a.db3", said))
    assert np.array_equal(gyro, GYRO)
    assert np.array_equal(accel, ACCEL)


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16le"])
@pytest.mark.parametrize(
    "change",
    [
        "UPDATE messages SET id = id + 100000 WHERE id > 300",
        "UPDATE messages SET timestamp = 'late' WHERE id % 50 = 7",
        "UPDATE messages SET timestamp = '' WHERE id % 50 = 7",
        "UPDATE messages SET data = 'words' WHERE id % 50 = 7",
        "UPDATE messages SET topic_id = 9 WHERE id % 50 = 7",
        "UPDATE messages SET timestamp = 'late' WHERE id BETWEEN 100 AND 300",
    ],
)
def test_rows_that_are_none_cost_no_others(tmp_path, monkeypatch, change, encoding):
    """Rows are read together by ranges: one that is odd sends its range to be read one by one."""
    monkeypatch.setattr(rosbag, "_BATCH", 64)
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as base:
        base.execute(f"PRAGMA encoding = '{encoding}'")
    bags.write_sqlite(path, SAID)
    with sqlite3.connect(path) as base:
        base.execute(change)
    number = np.arange(1, N + 1)
    odd = (number >= 100) & (number <= 300) if "BETWEEN" in change else number % 50 == 7
    kept = ~odd if "%" in change or "BETWEEN" in change else np.ones(N, bool)
    gyro, accel, _ = read(path)
    assert np.array_equal(gyro, GYRO[kept])
    assert np.array_equal(accel, ACCEL[kept])


@pytest.mark.parametrize("times", [None, "1,,3", "1,2,", "1,2.5,3", "1," + 30 * "9" + ",3"])
def test_times_that_are_none_are_not_read_together(times):
    assert not rosbag._read_joined((3, 1, times, b"abc"), None)


@pytest.mark.parametrize("joined", [(3, 1, "1,3", b"ab"), (3, 2, "1,2,3", b"abcde")])
def test_rows_without_a_time_or_of_other_lengths_are_not_read_together(joined):
    """Of three: one has no time and another nothing in it; one is shorter than the others."""
    assert not rosbag._read_joined(joined, None)


def test_times_are_those_of_the_device_and_not_of_the_recorder(tmp_path):
    columns = table_of_file(bags.write_mcap(tmp_path / "a.mcap", SAID)).columns
    assert columns.time_s is not None
    assert np.abs(columns.time_s - np.arange(N) / RATE).max() < 1e-9


@pytest.mark.parametrize("kind", ["mcap", "sqlite"])
def test_messages_without_times_of_their_own_get_those_of_the_bag(tmp_path, kind):
    said = [
        (topic, at, bags.imu(0, g, a))
        for (topic, at, _), g, a in zip(SAID, GYRO, ACCEL, strict=True)
    ]
    write = bags.write_mcap if kind == "mcap" else bags.write_sqlite
    columns = table_of_file(write(tmp_path / "a", said)).columns
    assert columns.time_s is not None
    assert columns.time_s[2] == pytest.approx(2 / RATE + 4e-3)  # the one that was written late
    assert "have no time stamps" in columns.assumed[0]


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_split_bag_is_read_in_the_order_of_its_numbers(tmp_path, kind):
    parts = [SAID[i : i + 50] for i in range(0, N, 50)]  # twelve: 10 comes before 2 as a word
    bag = bags.write_bag(tmp_path / "night", kind, parts)
    gyro, _, said = read(bag)
    assert np.array_equal(gyro, GYRO)
    assert said == ()  # nothing had to be put in order


def test_the_imu_among_other_topics_is_found_by_its_type(tmp_path):
    others = [("/tf", at + 1, bytes(120)) for _, at, _ in SAID[::2]]
    both = sorted([*SAID, *others], key=lambda one: one[1])
    path = bags.write_mcap(tmp_path / "a.mcap", both, {"/tf": "tf2_msgs/msg/TFMessage"})
    assert np.array_equal(read(path)[0], GYRO)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_of_two_sensors_the_one_with_more_messages_or_the_one_asked_for(tmp_path, kind):
    other = bags.messages(GYRO[::2] + 1.0, ACCEL[::2], RATE / 2, topic="/other/imu")
    both = sorted([*SAID, *other], key=lambda one: one[1])
    path = (bags.write_mcap if kind == "mcap" else bags.write_sqlite)(tmp_path / f"a.{kind}", both)
    gyro, _, said = read(path)
    assert np.array_equal(gyro, GYRO)
    assert "the topic is /imu/data; --stream selects another: /other/imu" in said[0]
    assert np.array_equal(read(path, "/other/imu")[0], GYRO[::2] + 1.0)
    with pytest.raises(InputError, match="no Imu topic /nowhere; there is /imu/data /other/imu"):
        table_of_file(path, "/nowhere")


@pytest.mark.parametrize("without", ["gyro", "accel", "zeros"])
def test_what_a_message_does_not_have_is_no_axis(tmp_path, without):
    gyro = GYRO * (without != "zeros")
    said = bags.messages(gyro, ACCEL, RATE, without=without)
    axes = table_of_file(bags.write_mcap(tmp_path / "a.mcap", said)).columns.axes
    assert "".join(sorted({axis[0] for axis in axes})) == ("g" if without == "accel" else "a")


def test_messages_out_of_order_are_sorted_and_said(tmp_path):
    swapped = [SAID[1], SAID[0], *SAID[2:]]
    gyro, _, said = read(bags.write_mcap(tmp_path / "a.mcap", swapped))
    assert np.array_equal(gyro, GYRO)
    assert "out of order" in said[0]


def test_a_frame_that_changes_its_name_goes_on(tmp_path):
    said = bags.messages(GYRO[:300], ACCEL[:300], RATE)
    later = bags.messages(GYRO, ACCEL, RATE, frame="another_frame")[300:]
    assert np.array_equal(read(bags.write_mcap(tmp_path / "a.mcap", [*said, *later]))[0], GYRO)


def test_a_missing_message_is_a_lost_sample(tmp_path):
    bags.write_mcap(tmp_path / "a.mcap", [*SAID[:100], *SAID[103:]])
    out = tmp_path / "a.json"
    assert main(["analyse", str(tmp_path / "a.mcap"), "--json", str(out), "--quiet"]) == 0
    result = json.loads(out.read_text())
    assert (result["samples"], result["lost_samples"]) == (N - 3, 3)
    assert result["input"]["wire"] == "rosbag2"
    assert result["rate"]["nominal_hz"] == pytest.approx(RATE)
    level = result["axes"]["gx"]["level"]["mean"]
    kept = np.delete(GYRO[:, 0], [100, 101, 102])
    assert level == pytest.approx(math.degrees(kept.mean()), rel=1e-9)
    assert result["axes"]["az"]["level"]["mean"] == pytest.approx(
        ACCEL[:, 2].mean() / 9.80665, 1e-4
    )


def test_a_bag_that_was_killed_gives_what_it_has(tmp_path):
    path = bags.write_mcap(tmp_path / "a.mcap", SAID, chunk_size=20_000)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    gyro, _, said = read(path)
    assert 0 < len(gyro) < N
    assert np.array_equal(gyro, GYRO[: len(gyro)])
    assert "never closed" in said[0]


def test_a_damaged_chunk_is_left_out_and_said(tmp_path):
    path = bags.write_mcap(
        tmp_path / "a.mcap", SAID, compression=CompressionType.NONE, chunk_size=20_000
    )
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    gyro, _, said = read(path)
    assert N - 70 < len(gyro) < N
    assert "1 chunks are left out (a chunk has the wrong checksum)" in said[0]


def _bad(path: Path, kind: str) -> None:
    """Write a bag that claims what is not so."""
    whole = bags.write_mcap(path, SAID[:20], compression=CompressionType.NONE).read_bytes()
    chunk = whole.index(b"\x06", 8 + 9 + 20)
    if kind == "claim":
        path.write_bytes(whole[: chunk + 25] + struct.pack("<Q", 1 << 40) + whole[chunk + 33 :])
    elif kind == "other":
        bags.write_mcap(path, [("/tf", 1, bytes(50))], {"/tf": "tf2_msgs/msg/TFMessage"})
    elif kind == "short":
        bags.write_mcap(path, [("/imu", 1, SAID[0][2][:200])])
    elif kind == "long frame":
        data = bytearray(SAID[0][2])
        data[12:16] = struct.pack("<I", 1 << 31)
        bags.write_mcap(path, [("/imu", 1, bytes(data))])
    elif kind == "empty":
        bags.write_mcap(path, [])
    elif kind == "view":
        path.unlink()
        base = sqlite3.connect(path)
        base.execute("CREATE TABLE topics(id, name, type)")
        base.execute(f"INSERT INTO topics VALUES(1, '/imu', '{bags.IMU}')")
        base.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i+1 FROM n) "
            "SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(332) AS data FROM n"
        )
        base.commit()
        base.close()
    elif kind == "foreign":
        path.unlink()
        sqlite3.connect(path).execute("CREATE TABLE pictures(id)").connection.close()
    elif kind == "many":
        bags.write_mcap(path, SAID)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("claim", "claims to unpack to"),
        ("other", "no topic of type sensor_msgs/msg/Imu; it has /tf"),
        ("short", "is not a sensor_msgs/Imu"),
        ("long frame", "is not a sensor_msgs/Imu"),
        ("empty", "no topic of type"),
        ("view", "not a ROS 2 bag"),
        ("foreign", "not a ROS 2 bag"),
        ("many", "more than 500 messages"),
    ],
)
def test_nothing_that_a_bag_claims_is_believed(tmp_path, kind, message, monkeypatch, capsys):
    path = tmp_path / "bad.mcap"
    monkeypatch.setattr(rosbag, "MOST_ROWS", 500)
    _bad(path, kind)
    assert main(["analyse", str(path)]) == 3
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_bag_with_flipped_bits_is_read_or_refused(tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    (bags.write_mcap if kind == "mcap" else bags.write_sqlite)(path, SAID[:60])
    whole = path.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(150):
        data = bytearray(whole)
        for at in rng.integers(16, len(data), 3):
            data[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        if not is_table_file(path):
            continue
        with suppress(InputError):
            table_of_file(path)


def test_an_imported_bag_gives_the_result_of_the_bag(tmp_path):
    bag = bags.write_mcap(tmp_path / "a.mcap", [*SAID[:100], *SAID[103:]])
    recording = tmp_path / "imported.mcap"
    assert main(["import", str(bag), str(recording), "--part", "LSM6DSL", "--quiet"]) == 0
    results = []
    for path in (bag, recording):
        out = tmp_path / "out.json"
        assert main(["analyse", str(path), "--json", str(out), "--quiet", "--part", "LSM6DSL"]) == 0
        results.append(json.loads(out.read_text()))
    ours, theirs = results
    assert theirs["part"] == "LSM6DSL"
    assert (theirs["samples"], theirs["lost_samples"]) == (N - 3, 3)
    for name, axis in ours["axes"].items():
        other = theirs["axes"][name]["curves"]["oadev"]["deviation"]
        assert other == pytest.approx(axis["curves"]["oadev"]["deviation"], rel=1e-9)


@pytest.mark.usefixtures("undrawn")
def test_a_bag_is_replayed(tmp_path, capsys):
    path = bags.write_mcap(tmp_path / "a.mcap", SAID)
    assert main(["replay", str(path), "--view", "none"]) == 0
    assert f"{len(SAID):,} samples".replace(",", " ") in capsys.readouterr().out


def test_of_a_bag_of_ros_1_it_is_said_how_to_convert_it(tmp_path, capsys):
    path = tmp_path / "night.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(4096))
    assert main(["analyse", str(path)]) == 3
    assert "rosbags-convert --src night.bag --dst night" in capsys.readouterr().err
