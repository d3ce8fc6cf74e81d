"""Makes the made-up session, and the view's result that it is made of, known to these tests."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "view"))
sys.path.insert(0, str(Path(__file__).parent))

from report_session import two_axes

from allanscope.report.page import render


@pytest.fixture(scope="session")
def analysis():
    return two_axes()


@pytest.fixture(scope="session")
def page(analysis):
    return render(analysis)
