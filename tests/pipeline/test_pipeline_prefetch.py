"""What is loaded before the port is opened, and the thread that reads ahead."""

import pytest

from allanscope.errors import DeviceError
from allanscope.pipeline import DeviceSettings, SessionSettings, SimulatedSettings, run
from allanscope.pipeline.replaying import prefetch


def test_all_that_takes_long_is_loaded_before_the_port_is_opened(monkeypatch):
    """A board does not wait: what its buffer cannot hold until it is read is lost."""
    done = []

    def opened(*_):
        done.append("port")
        raise DeviceError("there is none")

    monkeypatch.setattr(run, "load_rerun", lambda: done.append("rerun"))
    monkeypatch.setattr(run, "device_source", opened)
    quiet = SessionSettings(quiet=True, view="none")
    with pytest.raises(DeviceError):
        run.run_live("nowhere", DeviceSettings(), quiet, SimulatedSettings())
    assert done == ["rerun", "port"]


def test_what_computes_the_result_loads_before_the_run_is_over_and_is_ended(monkeypatch, tmp_path):
    done, started = [], []

    def processes(analyser, preload):
        done.append("processes")
        started.extend(search_processes(analyser, preload))
        return started

    def end(*given):
        done.append("end")
        end_input(*given)

    search_processes, end_input = run.search_processes, run._end_input
    monkeypatch.setattr(run, "usable_processes", lambda: 2)
    monkeypatch.setattr(run, "search_processes", processes)
    monkeypatch.setattr(run, "_end_input", end)
    quiet = SessionSettings(quiet=True, view="none", out=tmp_path / "s", duration_s=4.0)
    run.run_live("sim", DeviceSettings(), quiet, SimulatedSettings())
    assert done == ["processes", "end"]
    assert len(started) == 1
    assert started[0]._process.poll() is not None
    assert (tmp_path / "s/report.html").exists()


def test_a_port_that_is_not_there_is_told_before_anything_is_loaded(monkeypatch):
    monkeypatch.setattr(run, "load_rerun", lambda: pytest.fail("loaded in vain"))
    quiet = SessionSettings(quiet=True, view="none")
    with pytest.raises(DeviceError, match="no such port /dev/nowhere"):
        run.run_live("/dev/nowhere", DeviceSettings(), quiet, SimulatedSettings())


def test_what_reads_ahead_gives_everything_in_order_and_errors_in_their_place():
    def items():
        yield from range(10)
        raise ValueError("torn")

    few = prefetch(items(), depth=3)
    assert [next(few) for _ in range(10)] == list(range(10))
    with pytest.raises(ValueError, match="torn"):
        next(few)


def test_what_reads_ahead_stays_no_more_than_its_depth_ahead_and_ends_when_nobody_asks():
    made = []

    def items():
        for number in range(1000):
            made.append(number)
            yield number

    few = prefetch(items(), depth=2)
    assert next(few) == 0
    few.close()
    assert len(made) <= 5
