"""Makes the demo session and the viewer without a window known to the tests of this room."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
os.environ.setdefault("RUST_LOG", "off")

from demo_analysis import demo_analysis


@pytest.fixture(scope="session")
def analysis():
    """Return a result of two hours with effects on three axes."""
    return demo_analysis(7300.0)
