"""`allanscope.live`: a session in the background, as a notebook uses it."""

import pytest

import allanscope
from allanscope.pipeline.stream import DeviceError


def test_the_result_grows_and_the_end_leaves_the_files_of_a_session(tmp_path):
    with allanscope.live("sim", rate=208.0, out=tmp_path / "S") as session:
        assert "no result yet" in session._repr_html_() or "running" in session._repr_html_()
        early = session.wait(1.0)
        assert early.samples > 0
        assert "running" in session._repr_html_()
        assert repr(session).startswith("<LiveSession sim: running, ")
        session.mark("door")
    final = session.result
    assert final.samples > early.samples
    assert final.lost_samples == 0
    assert [text for _, text in final.marks] == ["door"]
    assert "<table>" in session._repr_html_()
    kept = {path.name for path in (tmp_path / "S").iterdir()}
    assert kept == {"session.mcap", "result.json", "report.html"}
    again = allanscope.analyse(tmp_path / "S")
    assert again.samples == final.samples
    assert again.origin == "synthetic"


def test_a_session_ends_by_itself(tmp_path):
    with allanscope.live("sim", rate=208.0, duration_s=0.5, out=tmp_path / "S") as session:
        session.wait(60.0)
        assert "ended" in session._repr_html_()
    assert 0 < session.result.samples < 208 * 5
    assert session.close() is session.result


def test_an_error_in_the_block_is_the_one_that_is_told(tmp_path):
    def block():
        with allanscope.live("sim", out=tmp_path / "S") as session:
            session.wait(0.5)
            _ = 1 / 0

    with pytest.raises(ZeroDivisionError):
        block()
    assert (tmp_path / "S" / "result.json").exists()


def test_a_silent_port_is_one_error(tmp_path):
    session = allanscope.live("loop://", duration_s=0.5, wire="native", out=tmp_path / "S")
    with pytest.raises(DeviceError, match="no samples received"):
        session.wait(30.0)
    with pytest.raises(DeviceError, match="no samples received"):
        session.close()
