"""Boards on one bench: what they share is told from what each has alone, whatever their rates."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.analysis import aligned, separated

RATE = 104.0
FINE = 10 * RATE
SECONDS = 120.0


def bench(seed, boards, ratio=10.0, seconds=SECONDS):
    """Return records of unit white noise each, shaken by one motion up to 3 Hz; rates and starts.

    The rates are within 4 %, gains within 2 %, clocks within 20 ppm, starts within 8 s.
    """
    rng = np.random.default_rng(seed)
    n = int((seconds + 10) * FINE)
    hz = np.fft.rfftfreq(n, 1 / FINE)
    wave = np.fft.irfft(np.fft.rfft(rng.normal(size=n)) / np.sqrt(1 + (hz / 3.0) ** 4), n)
    angle = np.concatenate([[0.0], np.cumsum(ratio * wave / wave.std())]) / FINE
    records, rates, starts = [], [], []
    for _ in range(boards):
        rate, start = RATE * (1 + rng.uniform(-0.04, 0.04)), rng.uniform(0, 8)
        m = int(seconds * rate)
        ends = start + np.arange(m + 1) / rate
        moved = np.diff(np.interp(ends, np.arange(n + 1) / FINE, angle)) * rate
        records.append(((1 + 0.02 * rng.normal()) * moved + rng.normal(size=m))[:, None])
        rates.append(rate * (1 + 20e-6 * rng.normal()))
        starts.append(start)
    return records, rates, np.array(starts)


def test_records_are_brought_to_one_clock_by_what_they_share():
    records, rates, starts = bench(1, 4)
    clock = aligned(records, rates)
    assert clock.is_common
    assert clock.lag_s == pytest.approx(starts - starts[0], abs=1e-3)
    apart = np.diff(clock.values[:, :, 0], axis=0)
    assert apart.std() < 0.2 * clock.values.std()


def test_records_that_share_nothing_are_not_brought_together():
    rng = np.random.default_rng(2)
    assert not aligned([rng.normal(size=(9000, 1)) for _ in range(3)], [RATE] * 3).is_common


@pytest.mark.parametrize("boards", [3, 5])
def test_intervals_cover_the_noise_of_each_board_under_motion_ten_times_larger(boards):
    covered, larger = [], []
    for seed in range(16):
        records, rates, _ = bench(seed, boards)
        clock = aligned(records, rates)
        found = separated(clock.values[:, :, 0], clock.rate_hz)
        assert found.is_individual
        for one, rate in zip(found.own, rates, strict=True):
            true = 1 / np.sqrt(found.tau * rate)
            covered.append((one.lower <= true) & (true <= one.upper))
            larger.append(one.measured / true)
    assert np.median(larger) > 10
    # Of some 400 values, each record of which is one: 95 % within three standard errors.
    assert 0.91 < np.mean(covered) < 0.99


def test_a_quiet_and_a_loud_board_keep_their_own_noise():
    rng = np.random.default_rng(5)
    sizes = np.array([0.5, 1.0, 2.0, 1.0])
    values = sizes[:, None] * rng.normal(size=(4, 20_000)) + 10 * rng.normal(size=20_000)
    found = separated(values, 10.0)
    for size, one in zip(sizes, found.own, strict=True):
        assert one.deviation[0] * np.sqrt(found.tau[0] * 10.0) == pytest.approx(size, rel=0.1)
    assert found.common[0] * np.sqrt(found.tau[0] * 10.0) == pytest.approx(10.0, rel=0.1)


def test_the_gain_of_a_board_is_not_taken_for_noise():
    rng = np.random.default_rng(6)
    gains = np.array([1.05, 1.0, 0.95])
    values = rng.normal(size=(3, 20_000)) + gains[:, None] * 10 * rng.normal(size=20_000)
    found = separated(values, 10.0)
    assert [one.gain for one in found.own] == pytest.approx(gains, abs=0.005)
    assert found.own[0].deviation[0] * np.sqrt(found.tau[0] * 10.0) == pytest.approx(1.0, rel=0.1)


def test_two_boards_have_one_curve_between_them():
    rng = np.random.default_rng(7)
    values = np.array([[1.0], [3.0]]) * rng.normal(size=(2, 20_000)) + 10 * rng.normal(size=20_000)
    found = separated(values, 10.0)
    assert not found.is_individual
    mean = np.sqrt((1 + 9) / 2)
    one, other = found.own
    assert one.deviation[0] * np.sqrt(found.tau[0] * 10.0) == pytest.approx(mean, rel=0.1)
    assert one.deviation[0] == other.deviation[0]


def test_intervals_do_not_depend_on_the_unit():
    rng = np.random.default_rng(11)
    values = rng.normal(size=(3, 20_000)) + 10 * rng.normal(size=20_000)
    large, small = separated(values, 10.0).own[0], separated(1e-6 * values, 10.0).own[0]
    assert 1e6 * small.lower == pytest.approx(large.lower, rel=1e-4, nan_ok=True)
    assert 1e6 * small.upper == pytest.approx(large.upper, rel=1e-4, nan_ok=True)


def test_one_board_is_not_separated():
    with pytest.raises(ValueError, match="two boards"):
        separated(np.zeros((1, 1000)), 10.0)


def written(folder, boards, hz=None):
    """Write records as tables of times and dps; return their paths."""
    records, rates, starts = bench(3, boards)
    paths = []
    for k, (record, rate) in enumerate(zip(records, rates, strict=True)):
        time_s = np.arange(len(record)) / rate
        values = 0.02 * record[:, 0]
        if hz is not None:
            values = values + 0.1 * np.sin(2 * np.pi * hz * (time_s + starts[k]))
        path = folder / f"board-{k}.csv"
        table = np.column_stack([time_s, values])
        np.savetxt(path, table, "%.6f", ",", header="t[s],gx[dps]", comments="")
        paths.append(str(path))
    return paths


def test_the_command_shows_what_is_common_and_what_is_own(tmp_path, capsys):
    paths = written(tmp_path, 3)
    out = tmp_path / "together.json"
    assert main(["together", *paths, "--quiet", "--json", str(out)]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert "gx, Allan deviation in mdps [95 %]" in shown
    head = shown[shown.index("gx, Allan deviation in mdps [95 %]") + 1]
    row = shown[shown.index(head) + 1]
    assert all(row[head.index(f"own {k}") - 1] == " " for k in (1, 2, 3))
    assert all(row[head.index(f"own {k}")].isdigit() for k in (1, 2, 3))
    told = json.loads(out.read_text())
    gx = told["axes"]["gx"]
    assert gx["individual"]
    tau = gx["tau"][0]
    for own in gx["own"].values():
        assert own["lower"][0] < 0.02 / np.sqrt(tau * RATE) < 1.05 * own["upper"][0]
        assert own["measured"][0] > 10 * own["deviation"][0]


def test_the_command_says_what_two_recordings_cannot_tell_and_traces_their_lines(tmp_path, capsys):
    paths = written(tmp_path, 2, hz=150.0)
    assert main(["together", *paths, "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "the individual noise is the mean of both" in shown
    assert "external, alias of 150" in shown


def test_records_of_the_same_noise_are_said_to_have_none_of_their_own(tmp_path, capsys):
    (path,) = written(tmp_path, 1)
    other = tmp_path / "other.csv"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    np.savetxt(other, table, "%.5f", ",", header="t[s],gx[dps]", comments="")
    assert main(["together", path, str(other), "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "no noise of its own on gx: board-0.csv, other.csv" in shown
    assert re.search(r"s +[\d.]+   none$", shown, re.M)


def test_copies_of_one_recording_are_refused(tmp_path, capsys):
    (path,) = written(tmp_path, 1)
    copy = tmp_path / "copy.csv"
    copy.write_bytes(Path(path).read_bytes())
    assert main(["together", path, str(copy)]) == 3
    assert "board-0.csv and copy.csv hold the same samples" in capsys.readouterr().err


def test_one_recording_is_refused(tmp_path, capsys):
    assert main(["together", str(tmp_path / "a.csv")]) == 2
    assert "give 2 to 12 recordings" in capsys.readouterr().err
