"""The page in a browser: light, dark, and printed."""

import re
import shutil
import subprocess
from importlib.resources import files

import numpy as np
import pytest

from allanscope.colours import BLUE as MEASURED
from allanscope.report import render
from support.browser import pdf_of, picture_of, why_no_browser
from support.demo_analysis import demo_analysis

pytestmark = pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser() or "-")

GOOD = {False: (17, 99, 41), True: (87, 171, 90)}
PAPER = {False: (255, 255, 255), True: (13, 17, 23)}


@pytest.fixture(scope="module")
def file(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


def near(picture, colour, tolerance=6):
    """Return where the picture has this colour."""
    return (np.abs(picture.astype(int) - colour) <= tolerance).all(axis=2)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_the_verdict_is_on_the_first_screen_and_the_curve_below_it(file, tmp_path, dark):
    picture = picture_of(file, tmp_path, "1100,1500", dark)
    assert tuple(picture[2, 2]) == PAPER[dark]
    verdict = np.flatnonzero(near(picture, GOOD[dark]).any(axis=1))
    assert len(verdict) > 40
    assert verdict[0] < 300, "the first thing on the page"
    curve = np.flatnonzero(near(picture, MEASURED, 20).any(axis=1))
    assert curve[-1] > verdict[-1] + 200
    assert picture[:, -8:].reshape(-1, 3).std(axis=0).max() < 1.0, "nothing sticks out to the right"


def test_the_words_above_a_wide_table_fit_a_phone(tmp_path):
    """The table is scrolled to the side; what it is about must be read without that."""
    folder = files("allanscope.report") / "templates"
    row = "<td style='white-space: nowrap'>0.123 [0.101, 0.145]</td>" * 9
    caption = f"<caption style='color: rgb{MEASURED}'>{'what it is about ' * 20}</caption>"
    page = tmp_path / "wide.html"
    page.write_text(
        f"<!DOCTYPE html><style>{(folder / 'page.css').read_text('utf-8')}</style>"
        f"<div class='scroll'><table>{caption}<tr>{row}</tr></table></div>",
        encoding="utf-8",
    )
    picture = picture_of(page, tmp_path, "500,500")
    lines = np.flatnonzero(near(picture, MEASURED, 20).any(axis=1))
    assert np.ptp(lines) > 80, "320 letters take five lines; fewer are cut off"


def test_the_page_can_be_printed(file, tmp_path):
    pdf = pdf_of(file, tmp_path)
    assert pdf.startswith(b"%PDF")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    assert 2 <= pages <= 6, "two axes, and what is folded is not printed"


def test_six_axes_are_printed_on_eight_pages(tmp_path):
    axes = demo_analysis(7300.0)
    path = tmp_path / "six.html"
    path.write_text(render(axes), encoding="utf-8")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf_of(path, tmp_path)))
    assert 4 <= pages <= 8


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="needs pdftotext (poppler-utils)")
def test_open_sections_keep_their_headings_in_print_and_folded_ones_vanish(file, tmp_path):
    (tmp_path / "page.pdf").write_bytes(pdf_of(file, tmp_path))
    command = ["pdftotext", str(tmp_path / "page.pdf"), "-"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "Findings:" in text
    assert "Level, datasheet, residual" not in text


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="needs pdftotext (poppler-utils)")
def test_the_overlay_of_all_axes_is_printed_on_page_one(tmp_path):
    path = tmp_path / "six.html"
    path.write_text(render(demo_analysis(7300.0)), encoding="utf-8")
    (tmp_path / "six.pdf").write_bytes(pdf_of(path, tmp_path))
    command = ["pdftotext", "-l", "1", str(tmp_path / "six.pdf"), "-"]
    first = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "Accelerometer: overlapping Allan deviations" in " ".join(first.split())
    assert "averaging time" in first, "the charts themselves"
