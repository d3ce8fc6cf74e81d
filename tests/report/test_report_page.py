"""The page of one session: what comes first, what is explained, and that nothing gets in or out."""

import base64
import gc
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from allanscope import analyse
from allanscope.allan import transfer
from allanscope.explain import ResidualError
from allanscope.quantities import count
from allanscope.report import Picture, render
from allanscope.report import page as module
from allanscope.report.page import pictures

HOSTILE = '<script>alert("1")</script><img src=x onerror=alert(1)> & \' $x^2$ {{ 7 * 7 }}'
NAMESPACES = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


class Tags(HTMLParser):
    """Collects every tag with its attributes, and all text."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.words = [], []
        self.feed(page)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def tags(page):
    return Tags(page)


def test_the_verdict_comes_first_and_the_convention_beside_it(tags):
    order = [
        tags.text.index(words)
        for words in (
            "Noise matches the datasheet",
            "A datasheet's noise density is one-sided",
            "Noise of each axis",
            "Effects and residual",
            "Time series",
            "Data quality",
            "Provenance",
        )
    ]
    assert order == sorted(order)


def test_coefficients_are_given_in_the_units_people_use(tags):
    for unit in ("mdps/√Hz", "°/√h", "°/h", "°/h/√h", "µg/√Hz", "m/s²/√Hz", "µg"):
        assert unit in tags.text
    assert "2.900 [2.874, 2.926] mdps/√Hz 0.174 °/√h" in tags.text


def test_the_angle_error_is_worked_out_in_both_readings(tags):
    # N = 2.9 mdps/sqrt(Hz) makes 60 x 0.0029 = 0.174 deg/sqrt(h), and sqrt(8) times that in 8 h.
    assert "is 0.174 °/√h" in tags.text
    assert "0.0225° after 1 min, 0.174° after 1 h, 0.492° after 8 h" in tags.text
    # The datasheet's 3.8 mdps/sqrt(Hz) as DT0064 reads it, and as one-sided.
    assert "0.228° after an hour; read as one-sided, 0.161°" in tags.text


def test_every_figure_has_a_caption_that_explains_its_marks(page):
    figures = re.findall(r"<figure.*?</figure>", page, re.DOTALL)
    assert len(figures) == 2 + 2 * 4 + 2 + 3
    captions = [re.search(r"<figcaption>(.*?)</figcaption>", one, re.DOTALL)[1] for one in figures]
    assert min(map(len, captions)) > 60
    overlay, _, deviation, residual, density, lag = captions[:6]
    assert "Point at the chart" in overlay
    for word in ("95 % band", "hollow", "model", "letter", "datasheet"):
        assert word in deviation
    for word in ("noise model alone", "with effects", "shade"):
        assert word in residual
    assert "effects" in density
    assert "DT0064" in lag
    assert "DT0064" in captions[-2]
    assert "density of the rate" in captions[-1]


def test_marks_of_the_user_are_listed_and_numbered_in_the_series(page, tags):
    assert [words for words in ("5.0 s: fan off", "12 s: door") if words in tags.text]
    series = page[page.index("<h2>Time series") :]
    svg = series[: series.index("</svg>")]
    assert [number for number in "12" if f">{number}</text>" in svg] == ["1", "2"]


def test_effects_come_with_parameters_and_evidence(tags):
    assert "sinusoid" not in tags.text  # it is a line wherever people read
    assert "frequency 49.980 [49.969, 49.991] Hz, amplitude 20.00 [19.80, 20.20] mdps" in (
        tags.text
    )


def test_the_page_says_where_it_comes_from_and_how_to_make_it_again(tags):
    assert "ab" * 32 in tags.text
    assert "to reproduce allanscope analyse '/data/my session'" in tags.text
    assert re.search(r"computed with Python 3\.\d+\.\d+, numpy \d.*, scipy \d", tags.text)
    assert "intervals 95.0 %" in tags.text


def test_nothing_is_fetched_when_the_page_is_opened(page, tags):
    assert set(re.findall(r"https?://[^\s\"'<)]+", page)) <= NAMESPACES
    assert not {tag for tag, _ in tags.tags} & {"script", "link", "iframe", "object", "embed"}
    sources = [
        value
        for _, attributes in tags.tags
        for name, value in attributes.items()
        if name in ("src", "href", "xlink:href", "action", "poster")
    ]
    assert sources
    inside = ("#", "data:image/png;base64,", "data:text/csv;base64,")
    assert all(value.startswith(inside) for value in sources)
    assert "url(" not in page.replace("url(#", "")
    policy = [a["content"] for tag, a in tags.tags if a.get("http-equiv")]
    assert policy[0].startswith("default-src 'none'")


def test_text_from_devices_and_files_is_escaped(analysis):
    loop = analysis.axes["gx"].explanation
    effect = replace(loop.effects[0], evidence={"words": HOSTILE})
    axis = replace(
        analysis.axes["gx"],
        remarks=(HOSTILE,),
        explanation=replace(loop, effects=(effect,), remarks=(HOSTILE,)),
    )
    hostile = replace(
        analysis,
        axes={"gx": axis},
        part=HOSTILE,
        input=dict.fromkeys(("name", "path", "serial", HOSTILE), HOSTILE),
        marks=((1.0, HOSTILE),),
        remarks=(HOSTILE,),
        record=None,
    )
    page = render(hostile)
    seen = Tags(page)
    assert not [tag for tag, _ in seen.tags if tag in ("script", "img")]
    assert not [a for _, a in seen.tags if any(name.startswith("on") for name in a)]
    assert "{{ 7 * 7 }}" in seen.text
    assert seen.text.count('<script>alert("1")</script>') >= 8


def test_an_axis_that_could_not_be_searched_says_how_much_longer(analysis):
    unknown = ResidualError(*[float("nan")] * 5)
    words = "6 s are too short to look for effects: run at least 54 s longer"
    loop = replace(
        analysis.axes["gx"].explanation,
        effects=(),
        before=unknown,
        after=unknown,
        explained=False,
        remarks=(words,),
    )
    axis = replace(analysis.axes["gx"], explanation=loop)
    seen = Tags(render(replace(analysis, axes={"gx": axis}, record=None)))
    assert f"Not searched: {words}." in seen.text
    assert "no effect explains" not in seen.text
    assert " - " not in seen.text


def test_a_result_without_any_axis_makes_a_page(analysis):
    seen = Tags(render(replace(analysis, axes={}, record=None, marks=())))
    assert "Provenance" in seen.text


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-310])
def test_axes_without_noise_that_a_logarithm_can_show_make_a_page(size):
    rng = np.random.default_rng(3)
    values = {"gx": 0.25 + size * rng.normal(size=3000), "ax": size * rng.normal(size=3000)}
    text = Tags(render(analyse(values, 104.0))).text
    assert text.count("no noise: all values are the same") >= 3


def test_the_mouse_reads_the_values_that_the_result_has(analysis, page):
    curve = analysis.axes["gx"].curves["oadev"]
    axis = page[page.index('<section class="axis" id="gx">') :]
    svg = axis[: axis.index("</svg>")]
    told = re.findall(r'<g class="at">.*?<text [^>]*>(.*?)</text></g>', svg)
    assert 0.8 * len(curve.tau) < len(told) <= len(curve.tau)
    when, value, model = re.findall("<tspan [^>]*>(.*?)</tspan>", told[0])
    assert re.match(r"τ .*, mdps", when)
    number = re.match(r"gx ([\d.]+) \[", value)[1]
    assert float(number) == pytest.approx(1e3 * curve.deviation[0], rel=0.01)
    assert model.startswith("model ")


def test_what_the_mouse_reads_of_three_axes_fits_the_chart(page):
    lines = re.findall(r"<tspan [^>]*>(.*?)</tspan>", page)
    assert max(map(len, lines)) < 40, "9 points in a frame of 4.16 inches hold some 60"


def test_the_numbers_behind_a_figure_can_be_saved(analysis, page):
    link = re.search(r'download="gx-deviation.csv" href="data:text/csv;base64,([^"]+)"', page)[1]
    head, *rows = base64.b64decode(link).decode().splitlines()
    assert head == "tau_s,deviation,lower,upper,trusted,model"
    curve = analysis.axes["gx"].curves["oadev"]
    assert len(rows) == len(curve.tau)
    first = rows[0].split(",")
    assert float(first[1]) == pytest.approx(curve.deviation[0], rel=1e-5)
    assert first[4] == str(bool(curve.trusted[0]))


def test_axes_and_models_can_be_hidden_and_details_opened(analysis, page):
    assert page.count('class="series-gx"') >= 2, "line and band"
    assert 'class="show-gx" checked' in page
    assert 'class="series-before"' in page
    assert '<details class="more" open>' not in page
    assert '<details class="more" open>' in render(analysis, full=True)


def test_title_and_operator_stand_above_the_page(analysis):
    seen = Tags(render(analysis, title="Bench <3>", operator="A & B"))
    assert seen.text.count("Bench <3>") == 2
    assert "measured by A & B" in seen.text


def test_the_same_result_gives_the_same_page(analysis, page):
    assert render(analysis) == page


def test_the_chain_says_what_was_done_to_the_samples_of_this_run(analysis, page):
    """The transfer functions that stand there are those of `transfer`."""
    x = np.pi * 0.5 * 0.37 + np.pi * np.arange(4)
    formulas = {
        "ostdev": ("sin² x / x²", np.sin(x) ** 2 / x**2),
        "oadev": ("2 sin⁴ x / x²", 2 * np.sin(x) ** 4 / x**2),
        "mdev": ("2 sin⁶ x / x⁴", 2 * np.sin(x) ** 6 / x**4),
        "ohdev": ("8/3 sin⁶ x / x²", 8 / 3 * np.sin(x) ** 6 / x**2),
    }
    chain = page[page.index("Processing chain") : page.index("<h2>Provenance")]
    for kind, (formula, values) in formulas.items():
        assert formula in chain
        passed = transfer(kind, x / np.pi / 1000.0, 1000, 1.0)
        np.testing.assert_allclose(passed, values, rtol=1e-3)
    assert f"decimates to {analysis.rate.best_hz:g} samples/s" in chain
    assert f"{count(len(analysis.record.values))} samples" in chain


def test_nothing_of_ours_is_a_character_that_cannot_be_shown(page):
    assert "\ufffd" not in page
    assert '<td class="limit">&lt; ' in page


def test_the_verdict_is_followed_by_the_table_and_the_charts_of_all_axes(page):
    order = [
        page.index(text) for text in ('class="verdict', "<caption>", 'class="overlay"', "<dl>")
    ]
    assert order == sorted(order)


def test_garbage_is_collected_after_the_drawing(analysis):
    seen = []
    drawn = {name: Picture(lambda _: seen.append(gc.isenabled())) for name in pictures(analysis)}
    render(analysis, drawn)
    assert seen == [False] * len(drawn)
    assert gc.isenabled()


def test_what_is_drawn_ahead_is_not_drawn_again_with_the_result(analysis, monkeypatch):
    module._method.cache_clear()
    module._embedded_method.cache_clear()
    module.template.cache_clear()
    whole = render(analysis)
    module.draw_ahead()
    drawn = []
    svg = Picture.svg
    monkeypatch.setattr(Picture, "svg", lambda one: drawn.append(one) or svg(one))
    monkeypatch.setattr(module.jinja2, "Environment", None)
    assert render(analysis) == whole
    assert len(drawn) == len(pictures(analysis)) - 1
