"""Folders of HSDatalog 2 give the samples that the firmware wrote, and what was lost on the way."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.errors import InputError
from allanscope.fleet.inputs import find_inputs
from allanscope.fleet.worker_tasks import analyse_recording, fingerprint_recording
from allanscope.pipeline import DeviceSettings
from allanscope.pipeline.table_files import table_of_file

RATE, PER_FRAME, FRAMES, OFFSET = 833.0, 200, 20, 0.05
RNG = np.random.default_rng(4)
COUNTS = {
    "gyro": RNG.normal(0, 5, (PER_FRAME * FRAMES, 3)).round().astype(np.int16),
    "acc": RNG.normal([0, 0, 8197], 20, (PER_FRAME * FRAMES, 3)).round().astype(np.int16),
}
SCALES = {"gyro": 0.00875, "acc": 0.000122}


def status(kind: str, **other: object) -> dict[str, object]:
    """Return what device_config.json says of one sensor, float32 as the firmware prints them."""
    return {
        "enable": True,
        "samples_per_ts": PER_FRAME,
        "dim": 3,
        "ioffset": OFFSET,
        "measodr": RATE,
        "usb_dps": 480,
        "sd_dps": 2048,
        "sensitivity": float(np.float32(SCALES[kind])),
        "data_type": "int16",
        "c_type": 0,
        **other,
    }


def packets(counts: np.ndarray, size: int, late_s: float = 0.0, older: bool = False) -> list[bytes]:
    """Return frames cut into packets, each behind the number of bytes up to its end.

    Of older firmware, up to its beginning.
    """
    stream = b""
    for frame in range(FRAMES):
        stream += counts[frame * PER_FRAME : (frame + 1) * PER_FRAME].astype("<i2").tobytes()
        last = (frame + 1) * PER_FRAME - 1
        stream += struct.pack("<d", OFFSET + late_s + last / RATE)
    pieces = [stream[at : at + size] for at in range(0, len(stream), size)]
    sizes = np.array([len(piece) for piece in pieces])
    counters = (np.cumsum(sizes) - sizes * older).tolist()
    return [struct.pack("<I", count) + piece for count, piece in zip(counters, pieces, strict=True)]


def folder(
    path: Path,
    interface: int = 1,
    part: str = "lsm6dsl",
    lost: tuple[int, ...] = (),
    older: bool = False,
) -> Path:
    """Write a folder; `lost` packets of the gyroscope never reached it.

    `older` is the form of FP-SNS-DATALOG2 1.1, as in six recordings of a STWIN.box that are public
    (Ishaan2602/Sensor-datalogging-framework_-STWIN.box-STM32-Nucleo-, `examples`).
    """
    path.mkdir(exist_ok=True)
    about = {"interface": interface, "data_ext": ".dat", "data_fmt": "HSD_2.0.0"}
    (path / "acquisition_info.json").write_text(json.dumps(about))
    of_old = {"samples_per_ts": {"val": PER_FRAME, "min": 0, "max": 1000}} if older else {}
    components = [{f"{part}_{kind}": status(kind, **of_old)} for kind in COUNTS]
    if older:
        components[0][f"{part}_gyro"]["sensitivity"] = 8.75
    components.append({"firmware_info": {"alias": "X"}})
    (path / "device_config.json").write_text(json.dumps({"devices": [{"components": components}]}))
    for kind, counts in COUNTS.items():
        sent = packets(counts, 480 if interface else 2044, older=older)
        kept = [one for i, one in enumerate(sent) if kind == "acc" or i not in lost]
        (path / f"{part}_{kind}.dat").write_bytes(b"".join(kept))
    return path


@pytest.mark.parametrize("older", [False, True])
@pytest.mark.parametrize("interface", [0, 1])
def test_every_count_comes_back(tmp_path, interface, older):
    found = table_of_file(folder(tmp_path / "a", interface, older=older))
    axes = found.columns.axes
    assert list(axes) == ["gx", "gy", "gz", "ax", "ay", "az"]
    assert np.array_equal(np.column_stack(list(axes.values())), np.hstack(list(COUNTS.values())))
    assert found.columns.scales["gx"] == 0.00875
    assert found.columns.scales["az"] == 0.000122
    assert found.part == "LSM6DSL"
    assert found.columns.time_s is not None
    expected = OFFSET + np.arange(PER_FRAME * FRAMES) / RATE
    assert np.abs(found.columns.time_s - expected).max() < 1e-9
    said = ("a gyroscope's sensitivity of 8.75 is assumed to be in mdps, not dps",)
    assert found.columns.assumed == (said if older else ())


def test_a_folder_is_analysed_and_imported(tmp_path):
    path, out = folder(tmp_path / "a"), tmp_path / "a.json"
    assert main(["analyse", str(path), "--json", str(out), "--quiet"]) == 0
    result = json.loads(out.read_text())
    assert result["input"]["wire"] == "hsdatalog"
    assert result["part"] == "LSM6DSL"
    assert result["rate"]["measured_hz"] == pytest.approx(RATE, rel=1e-6)
    assert result["axes"]["az"]["level"]["mean"] == pytest.approx(1.0, abs=1e-3)
    assert main(["import", str(path), str(tmp_path / "a.mcap"), "--quiet"]) == 0


@pytest.mark.usefixtures("undrawn")
def test_a_folder_is_replayed_as_its_recording_is(tmp_path):
    path, imported = folder(tmp_path / "a"), tmp_path / "a.mcap"
    assert main(["import", str(path), str(imported), "--quiet"]) == 0
    results = []
    for source in (path, imported):
        out = tmp_path / f"of-{source.name}"
        assert main(["replay", str(source), "--out", str(out), "--view", "none", "--quiet"]) == 0
        found = json.loads((out / "result.json").read_text())
        results.append({key: found[key] for key in ("part", "samples", "rate", "axes")})
    assert results[0] == results[1]
    assert results[0]["samples"] == PER_FRAME * FRAMES


def test_folders_are_recordings_of_a_fleet(tmp_path):
    for name in ("a", "b"):
        folder(tmp_path / name)
    (tmp_path / "other").mkdir()
    for pattern in (str(tmp_path / "*"), str(tmp_path / "a")):
        found = find_inputs([pattern])
        assert [place.name for place in found] == ["a", "b"][: len(found)]
    place = find_inputs([str(tmp_path / "*")])[1]
    outcome = analyse_recording(place, DeviceSettings())
    assert outcome.error == ""
    assert outcome.sha256 == fingerprint_recording(place, DeviceSettings()).sha256
    result = json.loads(gzip.decompress(outcome.result))["analysis"]
    assert (result["part"], result["samples"]) == ("LSM6DSL", PER_FRAME * FRAMES)


@pytest.mark.parametrize("older", [False, True])
def test_lost_packets_are_lost_samples_and_shift_nothing(tmp_path, older):
    """A packet of 480 bytes is 80 rows, or 78.7 and a time; rows cut in two are lost as well."""
    path = folder(tmp_path / "a", lost=(7, 8, 30), older=older)
    found = table_of_file(path)
    axes = found.columns.axes
    assert len(axes) == 6  # of the accelerometer the same rows, though it lost none
    rows = np.column_stack(list(axes.values()))
    assert 237 <= PER_FRAME * FRAMES - len(rows) <= 244
    assert found.columns.time_s is not None
    index = np.rint((found.columns.time_s - OFFSET) * RATE).astype(int)
    assert np.array_equal(rows, np.hstack(list(COUNTS.values()))[index])


def test_an_accelerometer_of_another_rate_is_left_out_and_said(tmp_path):
    path = folder(tmp_path / "a")
    (path / "lsm6dsl_acc.dat").write_bytes(b"".join(packets(COUNTS["acc"], 480, late_s=0.4 / RATE)))
    found = table_of_file(path)
    assert list(found.columns.axes) == ["gx", "gy", "gz"]
    assert "the accelerometer is ignored" in found.columns.assumed[0]


def test_a_lost_first_packet_shifts_nothing(tmp_path):
    found = table_of_file(folder(tmp_path / "a", lost=(0,)))
    rows = np.column_stack(list(found.columns.axes.values()))
    assert np.array_equal(rows, np.hstack(list(COUNTS.values()))[80:])


def test_of_two_parts_the_one_asked_for(tmp_path):
    path = folder(tmp_path / "a", part="ism330dhcx")
    told = json.loads((path / "device_config.json").read_text())
    told["devices"][0]["components"].append({"iis2dh_acc": status("acc")})
    (path / "device_config.json").write_text(json.dumps(told))
    (path / "iis2dh_acc.dat").write_bytes((path / "ism330dhcx_acc.dat").read_bytes())
    found = table_of_file(path)
    assert len(found.columns.axes) == 6
    assert found.part == "ISM330DHCX"
    assert "the part is ism330dhcx; --stream selects another: iis2dh" in found.columns.assumed[0]
    assert list(table_of_file(path, "iis2dh").columns.axes) == ["ax", "ay", "az"]
    with pytest.raises(InputError, match="no sensor lis2; there is ism330dhcx iis2dh"):
        table_of_file(path, "lis2")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"samples_per_ts": 0}, "samples_per_ts is 0"),
        ({"samples_per_ts": 10**12}, "samples_per_ts is"),
        ({"sensitivity": "x"}, "sensitivity is 'x'"),
        ({"usb_dps": None}, "usb_dps is None"),
        ({"usb_dps": 481}, "counters do not increase"),
        ({"data_type": "int32"}, "not three axes of int16"),
        ({"samples_per_ts": 9999}, "contains no whole frame"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, change, message):
    path = folder(tmp_path / "a")
    told = {"devices": [{"components": [{"lsm6dsl_gyro": status("gyro", **change)}]}]}
    (path / "device_config.json").write_text(json.dumps(told))
    with pytest.raises(InputError, match=message):
        table_of_file(path)


@pytest.mark.parametrize("text", ["", "[]", "[" * 100_000, "{}", '{"devices": 3}', "\xff"])
@pytest.mark.parametrize("name", ["acquisition_info.json", "device_config.json"])
def test_damaged_json_is_one_line(tmp_path, name, text, capsys):
    path = folder(tmp_path / "a")
    (path / name).write_text(text, "latin-1")
    assert main(["analyse", str(path)]) == 3
    assert capsys.readouterr().err.count("\n") == 1


def test_flipped_bits_are_read_or_refused(tmp_path):
    path = folder(tmp_path / "a")
    file = path / "lsm6dsl_gyro.dat"
    whole = file.read_bytes()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 5):
            data[at] ^= 1 << int(rng.integers(8))
        file.write_bytes(data)
        try:
            found = table_of_file(path)
        except InputError:
            continue
        assert found.columns.time_s is not None
        assert (np.diff(found.columns.time_s) > 0).all()


OF_ST = Path(__file__).with_name("hsdatalog_of_st")
"""Two of ST's own acquisitions over USB, of a SensorTile.box PRO and a STWIN, as ST published them.

Folders ``20240916_15_27_31`` and ``20240916_15_21_49`` of STMicroelectronics/stdatalog_examples at
4ca4e1f, without what is no gyroscope or accelerometer.
"""


@pytest.mark.parametrize(
    ("part", "rows", "per_frame", "rate_hz"),
    [("lsm6dsv16x", 2040, 120, 123.0633), ("ism330dhcx", 1352, 104, 107.7814)],
)
def test_what_sts_own_firmware_wrote_is_read_to_the_count(part, rows, per_frame, rate_hz):
    """The packets are taken apart here once more: 4 bytes of counter, then frames and a time."""
    (config,) = json.loads((OF_ST / part / "device_config.json").read_text())["devices"]
    status = {name: one for item in config["components"] for name, one in item.items()}
    found = table_of_file(OF_ST / part)
    assert (found.part, found.columns.assumed) == (part.upper(), ())
    for kind, axes in (("gyro", ("gx", "gy", "gz")), ("acc", ("ax", "ay", "az"))):
        said = status[f"{part}_{kind}"]
        assert said["samples_per_ts"] == per_frame
        raw, size = (OF_ST / part / f"{part}_{kind}.dat").read_bytes(), 4 + said["usb_dps"]
        stream = b"".join(raw[at + 4 : at + size] for at in range(0, len(raw), size))
        form = np.dtype([("counts", "<i2", (per_frame, 3)), ("last_s", "<f8")])
        frames = np.frombuffer(stream[: len(stream) // form.itemsize * form.itemsize], form)
        counts = frames["counts"].reshape(-1, 3)
        assert len(counts) == rows
        read = np.stack([found.columns.axes[axis] for axis in axes], axis=1)
        assert np.array_equal(read, counts)
        assert found.columns.scales[axes[0]] == pytest.approx(said["sensitivity"], rel=1e-6)
        last = found.columns.time_s[per_frame - 1 :: per_frame]
        assert np.abs(last - frames["last_s"]).max() < 0.5e-3
    measured = (rows - 1) / np.ptp(found.columns.time_s)
    assert measured == pytest.approx(rate_hz, rel=1e-4)
