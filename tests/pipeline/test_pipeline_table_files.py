"""Arrays and tables in binary files are read as text is; what they claim harms nobody."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from allanscope.__main__ import main
from allanscope.errors import InputError
from allanscope.pipeline import DeviceSettings, analyse_input
from allanscope.pipeline.table_files import kind_of, table_of_file

N = 400
T = np.arange(N) / 100.0
RNG = np.random.default_rng(9)
GYRO = RNG.normal(0, 0.05, (N, 3))
ACCEL = RNG.normal(0, 0.01, (N, 3)) + np.array([0.0, 0.0, 9.81])


@pytest.mark.parametrize(
    ("arrays", "options", "assumed"),
    [
        (
            {"t": T, "gz": GYRO[:, 2], "az[m/s^2]": ACCEL[:, 2]},
            (),
            "no unit of gyro is given: rad/s assumed, as accel is in m/s^2",
        ),
        (
            {"t": T, "gz": GYRO[:, 2], "az[g]": ACCEL[:, 2] / 9.80665},
            (),
            "no unit of gyro is given: dps assumed",
        ),
        ({"gyro_dps": GYRO, "acc_mps2": ACCEL, "rate": 100.0}, (), ""),
        ({"gyro": GYRO, "accel": ACCEL, "mag": GYRO}, ("--rate", "100"), "left out"),
        ({"data": np.hstack([ACCEL, GYRO])}, ("--rate", "100"), "assumed to be ax ay az gx gy gz"),
        ({"data": np.column_stack([T, GYRO, ACCEL])}, (), "assumed to be t gx gy gz ax ay az"),
        (
            {
                "d": np.column_stack([GYRO[:, 2], T, ACCEL[:, 2]]),
                "columns": np.array(["gz[dps]", "t[s]", "az"]),
            },
            (),
            "no unit of accel is given: m/s2 assumed, as gravity has that size",
        ),
        ({"t": T, "data": np.hstack([GYRO, ACCEL])}, (), "assumed to be gx gy gz ax ay az"),
        (
            {
                "d": np.column_stack([T, ACCEL, GYRO[:, 2]]),
                "columns": np.array(["t[s]", "imu_accX", "imu_accY", "imu_accZ", "gz[dps]"]),
            },
            (),
            "no unit of accel is given: m/s2 assumed, as gravity has that size",
        ),
    ],
)
def test_arrays_of_numpy_are_analysed(tmp_path, arrays, options, assumed):
    np.savez(tmp_path / "a.npz", **arrays)
    out = tmp_path / "a.json"
    assert main(["analyse", str(tmp_path / "a.npz"), "--json", str(out), "--quiet", *options]) == 0
    result = json.loads(out.read_text())
    assert result["samples"] == N
    assert result["rate"]["nominal_hz"] == pytest.approx(100.0)
    assert result["axes"]["az"]["level"]["mean"] == pytest.approx(1.0, abs=0.01)
    in_radians = "rad/s assumed" in "; ".join(result["assumptions"])
    mean = GYRO[:, 2].mean() * (180 / np.pi if in_radians else 1.0)
    assert result["axes"]["gz"]["level"]["mean"] == pytest.approx(mean, rel=1e-6)
    assert result["input"]["wire"] == "npz"
    assert assumed in "; ".join(result["assumptions"])
    assert bool(assumed) is bool(result["assumptions"])


def test_a_single_array_is_analysed(tmp_path):
    np.save(tmp_path / "a.npy", np.column_stack([T, GYRO]))
    assert list(table_of_file(tmp_path / "a.npy").columns.axes) == ["gx", "gy", "gz"]


@pytest.mark.parametrize("unit", ["physical", "lsb"])
def test_its_own_parquet_comes_back(tmp_path, unit):
    """Counts with the scale that the file states, whatever the full scale after a reset is."""
    from allanscope.recording import export_parquet
    from allanscope.samples import Block, StreamInfo, Ticks

    counts = RNG.integers(-40, 40, (N, 2)).astype(np.int16)
    info = StreamInfo(("gx", "az"), (70e-3, 0.488e-3), 104.0, part="LSM6DSL")
    export_parquet([info, Block(0, counts, Ticks.none())], tmp_path / "a.parquet", unit=unit)
    out = tmp_path / "a.json"
    assert main(["analyse", str(tmp_path / "a.parquet"), "--json", str(out), "--quiet"]) == 0
    result = json.loads(out.read_text())
    levels = {name: axis["level"]["mean"] for name, axis in result["axes"].items()}
    assert levels == pytest.approx(
        {"gx": counts[:, 0].mean() * 70e-3, "az": counts[:, 1].mean() * 0.488e-3}
    )
    assert result["rate"]["nominal_hz"] == pytest.approx(104.0)
    assert result["part"] == "LSM6DSL"
    assert result["assumptions"] == []


def test_a_full_circle_over_parquet_keeps_holes(tmp_path):
    rows = [f"{T[i]:.2f},{GYRO[i, 0]:.5f}\n" for i in range(N) if i != 100]
    text = "t[s],gx[dps]\n" + "".join(rows)
    (tmp_path / "a.csv").write_text(text)
    main(["export", str(tmp_path / "a.csv"), str(tmp_path / "a.parquet"), "--quiet"])
    out = tmp_path / "a.json"
    assert main(["analyse", str(tmp_path / "a.parquet"), "--json", str(out), "--quiet"]) == 0
    assert json.loads(out.read_text())["lost_samples"] == 1


def _header(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"shape": shape, "fortran_order": False, "descr": descr})
    return file.getvalue()


def _zip(path: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)


@pytest.mark.parametrize("kind", ["large", "pickle", "cut", "many", "no arrays", "bomb", "nan"])
def test_nothing_that_a_file_claims_is_believed(tmp_path, kind, monkeypatch):
    path = tmp_path / "bad.npz"
    if kind == "large":
        _zip(path, {"gx.npy": _header((10**13,)) + bytes(64)})
    elif kind == "pickle":
        np.savez(path, gx=np.array([print, print], dtype=object), allow_pickle=True)
    elif kind == "cut":
        np.savez(path, gx=GYRO[:, 0])
        path.write_bytes(path.read_bytes()[:-40])
    elif kind == "many":
        _zip(path, {f"{i}.npy": _header((0,)) for i in range(999)})
    elif kind == "no arrays":
        _zip(path, {"notes.txt": b"at rest"})
    elif kind == "bomb":
        monkeypatch.setattr("allanscope.pipeline.table_files.arrays.MOST_BYTES", 1 << 16)
        _zip(path, {"gx.npy": _header((10**6,)) + bytes(8 * 10**6)})
    else:
        np.savez(path, gx=np.full(N, np.nan), rate=100.0)
    with pytest.raises(InputError, match=r"bad\.npz"):
        analyse_input(path, DeviceSettings(rate_hz=100.0), quiet=True)


def test_parquet_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path, capsys):
    import pyarrow as pa
    import pyarrow.parquet as pq

    zeros = pa.array(np.zeros(3_000_000))
    pq.write_table(pa.table(dict.fromkeys(("gx", "gy", "gz"), zeros)), tmp_path / "a.parquet")
    assert main(["analyse", str(tmp_path / "a.parquet"), "--rate", "100"]) == 3
    assert "3000000 rows: too many for a file of its size" in capsys.readouterr().err


def test_a_workbook_is_to_be_saved_as_text(tmp_path, capsys):
    _zip(tmp_path / "a.xlsx", {"xl/workbook.xml": b"<x/>"})
    assert main(["analyse", str(tmp_path / "a.xlsx"), "--rate", "100"]) == 3
    assert "save the sheet with the samples as CSV" in capsys.readouterr().err


def test_damaged_parquet_is_one_clear_line(tmp_path, capsys):
    (tmp_path / "bad.parquet").write_bytes(b"PAR1" + bytes(500) + b"PAR1")
    assert main(["analyse", str(tmp_path / "bad.parquet"), "--rate", "100"]) == 3
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("arrays", "options", "axes"),
    [
        ({"gyro_dps": GYRO, "acc_mps2": ACCEL, "Fs": 100.0}, (), "gx gy gz ax ay az"),
        ({"imu": {"t": T, "gyro_dps": GYRO.T, "accel": ACCEL.T}}, (), "gx gy gz ax ay az"),
        ({"omega": GYRO[:, 0], "Fs": 100.0}, (), "gx"),
        ({"data": np.column_stack([T, ACCEL])}, ("--unit", "accel=m/s^2"), "ax ay az"),
    ],
)
@pytest.mark.parametrize("packed", [True, False])
def test_matlab_files_are_analysed(tmp_path, arrays, options, axes, packed):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", arrays, do_compression=packed, long_field_names=True)
    out = tmp_path / "a.json"
    assert main(["analyse", str(tmp_path / "a.mat"), "--json", str(out), "--quiet", *options]) == 0
    result = json.loads(out.read_text())
    assert " ".join(result["axes"]) == axes
    assert result["rate"]["nominal_hz"] == pytest.approx(100.0)
    assert result["input"]["wire"] == "mat"
    if "az" in result["axes"]:
        assert result["axes"]["az"]["level"]["mean"] == pytest.approx(1.0, abs=0.01)
    else:
        assert result["axes"]["gx"]["level"]["mean"] == pytest.approx(GYRO[:, 0].mean(), rel=1e-6)


def matlab_4(name, array, order="<"):
    """Return a matrix of version 4 as its bytes."""
    kind = 0 if order == "<" else 1000
    head = struct.pack(order + "5i", kind, *array.shape, 0, len(name) + 1) + name.encode() + b"\0"
    return head + array.astype(order + "f8").tobytes("F")


@pytest.mark.parametrize("order", ["<", ">", "scipy"])
def test_matlab_files_of_version_4_are_analysed(tmp_path, order):
    from scipy.io import savemat

    path, out = tmp_path / "a.mat", tmp_path / "a.json"
    if order == "scipy":
        savemat(path, {"gyro_dps": GYRO, "acc_mps2": ACCEL, "Fs": 100.0}, format="4")
    else:
        matrices = {"gyro_dps": GYRO, "acc_mps2": ACCEL, "Fs": np.array([[100.0]])}
        path.write_bytes(b"".join(matlab_4(name, a, order) for name, a in matrices.items()))
    assert main(["analyse", str(path), "--json", str(out), "--quiet"]) == 0
    result = json.loads(out.read_text())
    assert " ".join(result["axes"]) == "gx gy gz ax ay az"
    assert result["rate"]["nominal_hz"] == pytest.approx(100.0)
    assert result["axes"]["az"]["level"]["mean"] == pytest.approx(1.0, abs=0.01)
    assert result["axes"]["gx"]["level"]["mean"] == pytest.approx(GYRO[:, 0].mean(), rel=1e-6)


@pytest.mark.parametrize(
    ("at", "value", "message"),
    [
        (4, 2**31 - 1, "truncated"),
        (8, 2**31 - 1, "truncated"),
        (24 + 5 + 9600, -5, "a matrix that is none"),
        (0, 2, "sparse"),
        (None, 30, "truncated"),
        (None, 5, "truncated"),
    ],
)
def test_nothing_that_a_matlab_file_of_version_4_claims_is_believed(tmp_path, at, value, message):
    path, data = tmp_path / "a.mat", bytearray(matlab_4("gyro", GYRO) + matlab_4("acc", ACCEL))
    if at is None:
        data = data[: len(data) - value if value > 5 else len(matlab_4("gyro", GYRO)) + value]
    else:
        data[at : at + 4] = struct.pack("<i", value)
    path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        table_of_file(path)


def test_flipped_bits_of_a_matlab_file_of_version_4_are_read_or_refused(tmp_path):
    path, rng = tmp_path / "a.mat", np.random.default_rng(4)
    whole = matlab_4("gyro_dps", GYRO[:20]) + matlab_4("Fs", np.array([[100.0]]))
    for _ in range(300):
        data = bytearray(whole)
        for bit in rng.integers(0, 8 * len(data), 3).tolist():
            data[bit // 8] ^= 1 << bit % 8
        data[int(rng.integers(0, 29))] = int(rng.integers(0, 256))
        path.write_bytes(data)
        if kind_of(path) == "mat":
            with suppress(InputError):
                table_of_file(path)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("bomb", "bytes of arrays"),
        ("version", "save it with -v7"),
        ("cut", "a.mat"),
        ("none", "no axis among the arrays q r; call them .* or gyro and accel"),
    ],
)
def test_what_is_wrong_with_a_matlab_file_is_said(tmp_path, kind, message, monkeypatch):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    savemat(
        path,
        {"x": np.zeros(1 << 16)} if kind == "bomb" else {"q": T, "r": T[:5]},
        do_compression=True,
    )
    if kind == "bomb":
        monkeypatch.setattr("allanscope.pipeline.table_files.matlab.MOST_BYTES", 1 << 18)
    elif kind == "version":
        path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
    elif kind == "cut":
        path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=message):
        table_of_file(path)


def test_a_matlab_file_with_objects_is_read_without_a_warning(tmp_path):
    from scipy.io import savemat

    path, other = tmp_path / "a.mat", tmp_path / "b.mat"
    savemat(path, {"t": T, "gz": T, "None": T})
    savemat(other, {"None": T})
    path.write_bytes(path.read_bytes() + other.read_bytes()[128:])
    assert set(table_of_file(path).columns.axes) == {"gz"}
