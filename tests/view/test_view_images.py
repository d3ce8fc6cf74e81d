"""The pictures of the documentation: one of every tab and of the report, small, and not blank."""

import importlib.util
from pathlib import Path

import pytest
from PIL import Image

from allanscope.view.rerun_blueprint import TABS
from support.headless_viewer import why_no_viewer

DOCS = Path(__file__).parents[2] / "docs"
SMALL, ALL_SMALL = 300_000, 3_000_000


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("screenshots", DOCS / "screenshots.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def colours(path):
    """Return how many colours a picture has, and the share of its commonest one."""
    with Image.open(path) as image:
        counts = [count for count, _ in image.convert("RGB").getcolors(1 << 24)]
    return len(counts), max(counts) / sum(counts)


def test_there_is_a_picture_of_every_tab_and_of_the_report(script):
    assert len(script.VIEWS) == len(TABS)
    wanted = {f"view-{name}.png" for name in script.VIEWS} | {f"{n}.png" for n in script.REPORTS}
    assert wanted == {path.name for path in (DOCS / "images").glob("*.png")}


def test_they_are_small_and_show_something():
    pictures = sorted((DOCS / "images").glob("*.png"))
    assert sum(path.stat().st_size for path in pictures) < ALL_SMALL
    for path in pictures:
        assert path.stat().st_size < SMALL, path.name
        number, commonest = colours(path)
        assert number > 30, path.name
        assert commonest < 0.97, path.name


@pytest.mark.skipif(bool(why_no_viewer()), reason=why_no_viewer() or "-")
def test_the_script_takes_the_picture_of_a_tab(script, tmp_path, monkeypatch):
    arguments = ["screenshots.py", "allan", "--out", str(tmp_path), "--seconds", "8"]
    monkeypatch.setattr("sys.argv", [*arguments, "--size", "1200x800"])
    assert script.main() == 0
    number, commonest = colours(tmp_path / "view-allan.png")
    assert number > 30
    assert commonest < 0.97
