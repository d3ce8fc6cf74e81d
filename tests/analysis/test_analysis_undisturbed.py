"""The longest stretch without an event, its coefficients, and where they are shown."""

from __future__ import annotations

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from allanscope.analysis import Undisturbed
from allanscope.analysis.findings import event_times
from allanscope.analysis.undisturbed import longest_stretch, undisturbed
from allanscope.explain import Effect, Parameter, explain
from allanscope.history import Record
from allanscope.noise import Coefficient, NoiseModel
from allanscope.noise.components import Flicker, RandomWalk, White
from allanscope.report import render
from allanscope.view import summary_lines
from allanscope.view.change_log import Trends
from allanscope.view.tables import coefficients_table
from allanscope.view.terminal_screen import Screen
from allanscope.watch import Event, Occurrence
from support.demo_analysis import demo_analysis


def event(kind: str, begin_s: float, end_s: float | None, size: float = 2.0) -> Event:
    once = Occurrence(begin_s, begin_s - 1.0, begin_s + 1.0, begin_s + 5.0, end_s, size, 1, 2)
    return Event(kind, ("gx",), "", (once,), 1, 30.0)


@pytest.mark.parametrize(
    ("events", "wanted"),
    [
        ([], (0.0, 1000.0)),
        ([event("sinusoid", 300.0, None)], (0.0, 299.0)),
        ([event("step", 300.0, None)], (301.0, 1000.0)),
        ([event("step", 300.0, 600.0)], (600.0, 1000.0)),
        ([event("lost_samples", 300.0, 600.0)], (0.0, 1000.0)),
        ([event("variance_change", 300.0, None, 3.0)], (0.0, 299.0)),
        ([event("variance_change", 300.0, None, 0.5)], (301.0, 1000.0)),
        ([event("outliers", 600.0, 620.0), event("sinusoid", 100.0, 950.0)], (0.0, 99.0)),
    ],
)
def test_what_lasts_disturbs_all_the_while_and_a_shift_only_its_moment(
    events: list[Event], wanted: tuple[float, float]
) -> None:
    assert longest_stretch(events, 1000.0) == wanted


def record(loud: slice) -> Record:
    """Return 2000 s of white noise, N = 1 mdps/sqrt(Hz), three times as loud in a part of it."""
    rate_hz, n = 10.0, 20_000
    values = np.random.default_rng(5).normal(0.0, 1e-3 * np.sqrt(rate_hz), (n, 1))
    values[loud] *= 3.0
    starts = np.arange(n) / rate_hz
    temperature, whole = np.full(n, np.nan), np.array([[0, n]])
    return Record(rate_hz, 1, ("gx",), values, (1e-6,), temperature, starts, whole)


def test_the_coefficients_are_those_of_the_quiet_part() -> None:
    loud = event("variance_change", 200.0, 800.0, 3.0)
    found = undisturbed([loud], record(slice(2000, 8000)))
    assert found is not None
    assert (found.begin_s, round(found.end_s)) == (800.0, 2000)
    white = found.axes["gx"]["N"]
    assert white.lower < 1e-3 < white.upper
    assert white.value == pytest.approx(1e-3, rel=0.05)


def test_a_floor_that_the_quiet_part_does_not_show_is_a_limit(monkeypatch) -> None:
    """Fitted to what was found beside lines that are not there: the curve of the part is lower."""
    model = NoiseModel((White(1e-3), Flicker(0.05), RandomWalk(1e-9)), 0.1)
    sized = {k: Coefficient(v, 0.9 * v, 1.1 * v, "", True) for k, v in
             (("N", 1e-3), ("B", 0.05), ("K", 1e-9))}  # fmt: skip
    monkeypatch.setattr("allanscope.noise.fit_noise", lambda *_, **__: SimpleNamespace(model=model))
    published = "allanscope.analysis.coefficients.published_coefficients"
    monkeypatch.setattr(published, lambda *_: sized)
    loud = event("variance_change", 200.0, 800.0, 3.0)
    found = undisturbed([loud], record(slice(2000, 8000))).axes["gx"]
    assert not found["B"].detected
    assert found["B"].upper < 1e-3
    assert found["N"] == sized["N"]


def test_what_is_there_all_along_is_no_noise_of_the_quiet_part() -> None:
    """A line ten times as strong as the noise within a hertz, and samples far beside it."""
    plain = record(slice(2000, 8000))
    t = plain.start_s
    values = plain.values[:, 0] + 0.01 * np.sin(2 * np.pi * 1.3 * t)
    values[9000::1500] += 0.3
    disturbed = replace(plain, values=values[:, np.newaxis])
    loud = event("variance_change", 200.0, 800.0, 3.0)
    found = undisturbed([loud], disturbed, loop=explain(disturbed))
    assert found is not None
    assert found.begin_s == 800.0
    assert found.axes["gx"]["N"].value == pytest.approx(1e-3, rel=0.05)


def test_a_run_without_events_or_without_quiet_has_none() -> None:
    assert undisturbed([], record(slice(0))) is None
    busy = [event("outliers", float(second), second + 19.0) for second in range(1, 2000, 20)]
    assert undisturbed(busy, record(slice(0))) is None


def test_terminal_tables_report_and_json_show_it_beside_the_whole() -> None:
    analysis = demo_analysis()
    quiet = {name: {"N": axis.coefficients["N"]} for name, axis in analysis.axes.items()}
    analysis = replace(analysis, undisturbed=Undisturbed(600.0, 3600.0, quiet))
    lines = summary_lines(analysis)
    assert sum(line.startswith("undisturbed ") for line in lines) == 6
    assert any(line.startswith("Undisturbed: 10 min to 1 h") for line in lines)
    narrow = Console(file=io.StringIO(), width=80, height=60)
    narrow.print(Screen(analysis, Trends(), is_final=True))
    rows = [row for row in narrow.file.getvalue().splitlines() if row.startswith("undisturbed ")]
    assert len(rows) == 6
    assert all("±" in row and "[" not in row for row in rows), "errors, as of the whole run"
    assert "gx undisturbed, 10 min to 1 h" in coefficients_table(analysis)
    page = render(analysis)
    assert page.count('<tr class="quiet"><td>undisturbed</td>') == 6
    assert "10 min to 1 h, the longest stretch" in page
    stated = analysis.to_dict()["undisturbed"]
    assert (stated["begin_s"], stated["end_s"]) == (600.0, 3600.0)
    assert stated["axes"]["gz"]["N"]["value"] == analysis.axes["gz"].coefficients["N"].value


def test_what_the_search_found_at_a_time_disturbs_as_well() -> None:
    known = {
        "shock": {"time": 20.0, "duration": 5.0},
        "step": {"time": 60.0},
        "variance_change": {"start": 70.0, "stop": 80.0},
        "sinusoid": {"frequency": 3.0},
    }
    effects = [
        SimpleNamespace(parameters={k: Parameter(v, v, v, "s") for k, v in values.items()})
        for values in known.values()
    ]
    times = [found for effect in effects if (found := event_times(effect))]
    assert times == [(20.0, 25.0), (60.0,), (70.0, 80.0)]
    assert longest_stretch([], 100.0, [(one[0], one[-1]) for one in times]) == (25.0, 60.0)


def test_noise_below_half_a_step_has_no_quiet_part() -> None:
    """Where the level lies in its code makes the noise; 12 stood beside 45 ug/sqrt(Hz)."""
    one = record(slice(0, 2000))
    loop = explain(one)
    axis = one.axes[0]
    coarse = Effect("quantization", {})
    searched = replace(loop.axes[axis], effects=(*loop.axes[axis].effects, coarse))
    found = undisturbed([event("variance_change", 0.0, 20.0, 3.0)], one, None, loop)
    assert found is not None
    assert axis in found.axes
    loop = replace(loop, axes={**loop.axes, axis: searched})
    found = undisturbed([event("variance_change", 0.0, 20.0, 3.0)], one, None, loop)
    assert found is None or axis not in found.axes
