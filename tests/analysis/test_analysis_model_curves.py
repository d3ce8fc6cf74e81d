"""The model that is drawn lies on what was measured, whatever rows the loop worked on."""

import numpy as np
import pytest

from allanscope import analyse
from allanscope.analysis import Analyser, AnalyserSettings, summarise
from allanscope.samples import Block, StreamInfo, Ticks
from allanscope.wire import LinkStats

RATE_HZ = 100.0
SAMPLES = 1 << 16
LSB = 1e-3


def disturbed():
    """White noise with a line that rows of four samples still show, and a step."""
    time_s = np.arange(SAMPLES) / RATE_HZ
    noise = 0.04 * np.random.default_rng(5).standard_normal(SAMPLES)
    line = 0.02 * np.sin(2 * np.pi * 3.0 * time_s)
    step = np.where(time_s > 300.0, 0.05, 0.0)
    return np.rint((noise + line + step) / LSB).astype(np.int16)[:, np.newaxis]


@pytest.fixture(scope="module", params=[SAMPLES, SAMPLES // 4], ids=["samples", "rows of four"])
def axis(request):
    """Return the result of the disturbed axis, with all samples kept or only means of four."""
    analyser = Analyser(AnalyserSettings(history_rows=request.param))
    analyser.feed(StreamInfo(("gx",), (LSB,), RATE_HZ))
    analyser.feed(Block(0, disturbed(), Ticks.none()))
    return summarise(analyser, LinkStats(), "full", {}).axes["gx"]


def test_the_loop_finds_what_was_put_in(axis):
    assert {effect.kind for effect in axis.explanation.effects} == {"sinusoid", "step"}
    assert {"sinusoid", "step"} <= set(axis.model.components)


def test_the_final_model_lies_on_the_measured_curve(axis):
    curve = axis.curves["oadev"]
    reliable = curve.edf > 400
    ratio = curve.deviation[reliable] / axis.model.total[reliable]
    assert np.abs(ratio - 1.0).max() < 0.05


def test_the_textbook_model_starts_where_the_samples_do(axis):
    curve = axis.curves["oadev"]
    assert axis.model_before.total[0] == pytest.approx(curve.deviation[0], rel=0.25)
    assert axis.model_before.x[0] == curve.tau[0]


def test_the_density_is_that_of_the_samples(axis):
    quiet = np.abs(np.log(axis.density.frequency / 3.0)) > 1.0
    quiet &= axis.density.averages > 200
    ratio = axis.density.density[quiet] / axis.density_model.total[quiet]
    assert np.abs(ratio - 1.0).max() < 0.35


def test_only_what_was_detected_is_drawn():
    """White noise has no flicker and no walk, and the lines of their likeliest values mislead."""
    counts = np.rint(0.04 * np.random.default_rng(8).standard_normal(SAMPLES) / LSB)
    analyser = Analyser(AnalyserSettings())
    analyser.feed(StreamInfo(("gx",), (LSB,), RATE_HZ))
    analyser.feed(Block(0, counts.astype(np.int16)[:, np.newaxis], Ticks.none()))
    found = summarise(analyser, LinkStats(), "full", {}).axes["gx"]
    detected = {name for name, known in found.coefficients.items() if known.detected}
    assert detected == {"N"}
    for model in (found.model, found.model_before):
        assert set(model.components) <= {"N", "rounding"}
        parts = np.sqrt(sum(part**2 for part in model.components.values()))
        np.testing.assert_allclose(model.total, parts)
    one_sided = 2.0 * found.coefficients["N"].value ** 2
    np.testing.assert_allclose(found.density_model.total, one_sided, rtol=0.01)


def test_a_line_that_drifts_is_drawn_once():
    """It is a part of the final model already; by its power it is most of the first points."""
    time_s = np.arange(SAMPLES // 2) / RATE_HZ
    rng = np.random.default_rng(9)
    envelope = 1 + 0.9 * np.sin(2 * np.pi * 3 * time_s / time_s[-1])
    tone = 0.1 * envelope * np.sin(2 * np.pi * 31.0 * time_s)
    values = tone + rng.normal(0.0, 0.04, len(time_s))
    axis = analyse({"gx": values}, RATE_HZ).axes["gx"]
    assert [effect.kind for effect in axis.explanation.effects] == ["drifting_line"]
    ratio = axis.curves["oadev"].deviation[:8] / axis.model.total[:8]
    assert np.abs(ratio - 1.0).max() < 0.05
