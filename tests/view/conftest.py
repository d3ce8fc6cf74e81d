"""The demo's result, and a viewer that logs nothing."""

from __future__ import annotations

import os

import pytest

from support.demo_analysis import demo_analysis

os.environ.setdefault("RUST_LOG", "off")


@pytest.fixture(scope="session")
def analysis():
    """Return a result of two hours with effects on three axes."""
    return demo_analysis(7300.0)
