"""The recording that a session leaves: read back, it holds the values of the result."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import rerun as rr

from allanscope.noise import Coefficient
from allanscope.quantities import COEFFICIENTS, TWO_SIDED_95
from allanscope.samples import Gap, Notice
from allanscope.view import RerunView
from allanscope.view.chart_builder import SharedScales
from allanscope.view.rerun_recording import Canvas
from allanscope.watch import Event, Occurrence
from support.demo_analysis import demo_analysis
from support.demo_session import INFO, LEVELS, blocks, perform
from support.readback import read_back

SECONDS = 12.0


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Rows of a short session, by entity, and how many bytes they take."""
    folder = tmp_path_factory.mktemp("session")
    view = RerunView(folder, "none", {"name": "demo", "started_unix_s": 1.79e9, "bench": "B12"})
    view.start()
    assert view.address == ""
    perform(view, SECONDS)
    view.gap(Gap("link", 4000))
    view.notice(Notice("error", "the sensor\x1b[2J overran"))
    view.notice("a line of the program", "warn")
    view.health({"queue": 3, "name": "text", "odd name.": 1.5, "bad": float("nan")})
    assert view.settle(20.0)
    assert (view.dropped, view._worker.failed) == (0, 0)
    once = Occurrence(7.0, 6.0, 8.0, 9.0, None, 0.1, 728, 936)
    event = Event("step", ("gx",), "dps", (once,), 1, 30.0)
    view.close(replace(demo_analysis(SECONDS, seed=9), events=(event,)))
    return read_back(folder / "session.rrd")


def test_the_last_curve_is_that_of_the_final_result(session):
    final = demo_analysis(SECONDS, seed=9)
    scales = SharedScales()
    due = 1.0
    for second in range(1, int(SECONDS) + 1):
        if second >= due:
            scales.fit(demo_analysis(float(second)))
            due *= 1.06
    scales.fit(final)
    for axis, unit, factor in (("gx", "dps", 1e3), ("az", "g", 1e6)):
        row = session[f"/{axis}/allan/oadev/points"][-1]
        curve = final.axes[axis].curves["oadev"]
        drawn = scales.allan(unit).values(row.dots())
        order = np.argsort(drawn[:, 0])
        n = int(curve.trusted.sum())
        np.testing.assert_allclose(drawn[order][:n, 0], curve.tau[:n], rtol=1e-4)
        np.testing.assert_allclose(drawn[order][:n, 1], factor * curve.deviation[:n], rtol=1e-4)
        assert row.elapsed_s == SECONDS


@pytest.mark.parametrize(
    "plot",
    [
        *("samples/gyro", "samples/accel", "samples/temperature", "rate"),
        *("link/throughput", "link/lost", "link/errors", "coefficients/gyro/N"),
    ],
)
def test_an_event_is_marked_on_every_axis_of_time(session, plot):
    assert [row.elapsed_s for row in session[f"/{plot}/events"] if row.elapsed_s] == [7.0]


def test_history_can_be_scrubbed(session):
    times = [row.elapsed_s for row in session["/gx/allan/oadev"]]
    assert len(times) == len(set(times)) + 1, "the final result replaces the last snapshot"
    assert times[0] == 1.0
    assert len(times) > 8
    rare = [row.elapsed_s for row in session["/gx/allan/mdev"]]
    assert len(rare) < len(times)
    assert rare[-1] == SECONDS


def test_the_time_series_starts_at_zero_and_keeps_mean_and_extremes(session):
    rows = [row for row in session["/samples/gyro"] if row.elapsed_s is not None]
    times = np.array([row.elapsed_s for row in rows])
    assert times[0] == pytest.approx(0.05, abs=1e-3)
    np.testing.assert_allclose(np.diff(times), 0.1, atol=2e-3)
    assert times[-1] > SECONDS - 0.3
    values = np.array([row.values["Scalars:scalars"] for row in rows])
    mean, low, high = values[:, :3], values[:, 3:6], values[:, 6:]
    np.testing.assert_array_equal(mean[0], 0.0)
    assert (low < mean).all()
    assert (high > mean).all()
    first = next(iter(blocks(1))).counts[:666, 0] * 8.75
    assert high[0, 0] == pytest.approx(first.max() - first.mean(), rel=1e-6)
    assert low[0, 0] == pytest.approx(first.min() - first.mean(), rel=1e-6)
    assert first.mean() == pytest.approx(1e3 * LEVELS[0], rel=0.1)


def test_everything_also_lies_on_the_clock_on_the_wall(session):
    for path in ("/samples/gyro", "/gx/allan/oadev", "/log"):
        row = session[path][-1]
        assert row.clock_s == pytest.approx(1.79e9 + row.elapsed_s, abs=1e-3)


def test_a_result_that_adds_nothing_is_not_drawn(tmp_path):
    result = demo_analysis(1000.0)
    view = RerunView(tmp_path, "none")
    view.start()
    for second in range(1000, 1031):
        view.snapshot(replace(result, duration_s=float(second)))
        assert view.settle(60.0)
    view.close()
    times = [row.elapsed_s for row in read_back(tmp_path / "session.rrd")["/log"]]
    assert times == [1000.0] * len(times)
    rows = read_back(tmp_path / "session.rrd")["/coefficients/gyro/N"]
    assert [row.elapsed_s for row in rows] == [1000.0, 1020.0, 1030.0]


def test_what_never_changes_is_logged_again_now_and_then_for_late_viewers(tmp_path):
    result = demo_analysis(10.0)
    view = RerunView(tmp_path, "none")
    view.start()
    for second in (10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0):
        view.snapshot(replace(result, duration_s=second))
        assert view.settle(60.0)
    view.close()
    rows = read_back(tmp_path / "session.rrd")
    for path in ("/gx/allan/grid", "/gx/allan/oadev", "/gx/spectrum/effects/words"):
        assert [row.elapsed_s for row in rows[path]] == [10.0, 15.0, 16.0], path


def test_the_layout_of_a_file_is_written_once_with_the_estimators_of_the_end(tmp_path, monkeypatch):
    sent = []
    send = rr.RecordingStream.send_blueprint
    monkeypatch.setattr(
        rr.RecordingStream, "send_blueprint", lambda *given: sent.append(1) or send(*given)
    )
    final = demo_analysis(60.0)
    first = {
        name: replace(one, curves={"oadev": one.curves["oadev"]})
        for name, one in final.axes.items()
    }
    view = RerunView(tmp_path, "none")
    view.start()
    view.info(INFO)
    view.snapshot(replace(final, axes=first, duration_s=10.0))
    assert view.settle(60.0)
    view.close(final)
    assert len(final.axes["gx"].curves) > 3
    assert len(sent) == 1


def test_a_coefficient_is_plotted_once_it_is_detected_and_known_well_enough():
    from allanscope.view.rerun_series import _value_if_precise

    known = Coefficient(2.0, 1.9, 2.1, "dps", detected=True)
    assert _value_if_precise(known) == (2.0, pytest.approx(0.2 / (2 * TWO_SIDED_95)))
    assert np.isnan(_value_if_precise(replace(known, detected=False))).all()
    assert np.isnan(_value_if_precise(replace(known, lower=0.0, upper=4.0))).all()


def test_coefficients_are_plotted_with_their_standard_error(session):
    n = session["/coefficients/gyro/N"][-1].values
    known = demo_analysis(SECONDS, seed=9).axes["gx"].coefficients["N"]
    assert n["Measurements:values"][0] == pytest.approx(1e3 * known.value)
    sigma = np.sqrt(n["Measurements:variances"][0])
    assert sigma == pytest.approx(1e3 * (known.upper - known.lower) / (2 * TWO_SIDED_95))
    k = session["/coefficients/gyro/K"][-1].values["Measurements:values"]
    assert np.isnan(k).all(), "not detected, not plotted"


def test_what_was_not_detected_is_plotted_by_its_upper_limit(tmp_path):
    """As marks from the first minute on: a plot of nothing would run from -1 to 1."""
    view = RerunView(tmp_path, "none")
    view.start()
    for seconds in (30.0, 61.0, 62.0, 300.0):
        view.snapshot(demo_analysis(seconds))
        assert view.settle(60.0)
    view.close()
    rows = read_back(tmp_path / "session.rrd")
    marks = [row for row in rows["/coefficients/gyro/K/limit"] if row.elapsed_s is not None]
    assert [row.elapsed_s for row in marks] == [61.0, 300.0]
    known = demo_analysis(300.0).axes
    reading = COEFFICIENTS["dps", "K"][0]
    limits = [known[name].coefficients["K"].upper * reading.factor for name in ("gx", "gy", "gz")]
    assert marks[-1].values["Scalars:scalars"] == pytest.approx(limits)
    of_n = [row for row in rows["/coefficients/gyro/N/limit"] if row.elapsed_s is not None]
    assert not of_n, "N is plotted itself"


def test_the_rate_is_plotted_in_ppm_of_the_nominal_one(session):
    row = session["/rate"][-1].values
    assert row["Measurements:values"][0] == pytest.approx(1e6 * (6664.2 / 6660.0 - 1.0))
    assert row["Measurements:variances"][0] == pytest.approx((800.0 / SECONDS) ** 2)


def test_the_log_tells_of_gaps_remarks_and_findings_in_printable_text(session):
    lines = [row.values["TextLog:text"][0] for row in session["/log"]]
    assert "gap (link): 4 000 samples lost" in lines
    assert "device error: the sensor\ufffd[2J overran" in lines
    assert "a line of the program" in lines
    assert any(line.startswith("found on gx gy: line") for line in lines)
    levels = {
        row.values["TextLog:text"][0]: row.values["TextLog:level"][0] for row in session["/log"]
    }
    assert levels["a line of the program"] == "WARN"
    assert levels["device error: the sensor\ufffd[2J overran"] == "ERROR"


def test_the_link_is_plotted_and_its_state_told(session):
    states = [
        r.values["StateChange:state"][0] for r in session["/link/state"] if r.elapsed_s is not None
    ]
    assert states == ["streaming", "gap"]
    assert session["/link/health/queue"][-1].values["Scalars:scalars"] == [3.0]
    assert "/link/health/odd_name_" in session
    assert "/link/health/name" not in session
    assert "/link/health/bad" not in session
    assert "/link/health/produced" not in session
    assert session["/link/throughput"][-1].values["Scalars:scalars"][0] == pytest.approx(
        89.0, rel=0.01
    )


def test_the_session_is_told_in_the_table_of_the_run(session):
    text = session["/tables/run"][-1].values["TextDocument:text"][0]
    assert "| bench | B12 |" in text
    assert "started_unix_s" not in text


def test_viewers_that_join_late_get_grids_and_styles_again(session):
    assert len(session["/gx/allan/grid"]) > 1
    assert session["/samples/gyro"][0].elapsed_s is None, "styles are static"


def test_the_file_opens_at_once_because_it_was_rewritten_in_few_chunks(tmp_path):
    from rerun.chunk import RrdReader

    view = RerunView(tmp_path, "none")
    view.start()
    perform(view, 3.0)
    view.close()
    path = tmp_path / "session.rrd"
    assert RrdReader(str(path)).store().schema() is not None, "it has an index"
    assert [file.name for file in tmp_path.iterdir()] == ["session.rrd"]


def test_a_file_is_not_ended_because_the_process_was_stopped_while_it_was_written():
    class Slept:
        """A recording of which the first flush times out."""

        flushes = 0

        def flush(self, timeout_sec):
            self.flushes += 1
            if self.flushes == 1:
                raise RuntimeError("Flush timed out")

    recording = Slept()
    Canvas(recording, {}).flush()
    assert recording.flushes == 2


def test_a_file_that_was_never_finished_can_be_read(tmp_path):
    script = (
        "import sys, os, signal; sys.path.insert(0, sys.argv[1]); os.environ['RUST_LOG'] = 'off'\n"
        "from pathlib import Path\n"
        "from support.demo_session import perform\n"
        "from allanscope.view.rerun_view import RerunView\n"
        "view = RerunView(Path(sys.argv[2]), 'none'); view.start(); perform(view, 3.0)\n"
        "view.flush(); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    here = str(__import__("pathlib").Path(__file__).parents[1])
    subprocess.run([sys.executable, "-c", script, here, str(tmp_path)], check=False, timeout=60)
    rows = read_back(tmp_path / "session.rrd")
    assert rows["/gx/allan/oadev"][-1].elapsed_s >= 2.0


def test_nothing_is_imported_or_opened_when_nothing_is_to_be_shown():
    script = (
        "import sys\n"
        "import allanscope.view\n"
        "from allanscope.view.rerun_view import RerunView\n"
        "view = RerunView(None, 'none'); view.start()\n"
        "view.notice('x'); view.health({'a': 1}); view.close()\n"
        "assert not {'rerun', 'pyarrow', 'rich'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_an_unknown_mode_is_refused():
    with pytest.raises(ValueError, match="no view 'screen'; choose one of auto window web none"):
        RerunView(None, "screen")


def test_a_view_that_was_closed_takes_no_more(tmp_path):
    view = RerunView(tmp_path, "none")
    view.start()
    view.info(INFO)
    view.close()
    for block in blocks(2):
        view.samples(INFO, block)
    view.snapshot(demo_analysis(2.0))
    view.close()
