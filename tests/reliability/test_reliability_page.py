"""The page of promises names tests that exist, and every row has one."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
NAMED = re.compile(r"\[`(test_\w+)`\]\(([^)]+)\)|`(test_\w+)`")
"""A test with the file that it and those after it stand in, or one of those after it."""


def rows() -> list[str]:
    """Return what stands in the column of tests, row by row."""
    promises, _, _ = PAGE.read_text("utf-8").partition("## Measured")
    lines = [line for line in promises.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    return [row[-1] for row in cells if row[0] != "fault"]


def test_every_promise_names_a_test_and_every_test_exists() -> None:
    found = rows()
    assert len(found) > 25
    for row in found:
        source, named = "", 0
        for first, link, test in NAMED.findall(row):
            if link:
                source = (PAGE.parent / link).read_text("utf-8")
            assert f"def {first or test}(" in source, first or test
            named += 1
        assert named, row
