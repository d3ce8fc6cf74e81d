"""The made-up session, and its page."""

import pytest

from allanscope.report import render
from support.report_session import two_axes


@pytest.fixture(scope="session")
def analysis():
    return two_axes()


@pytest.fixture(scope="session")
def page(analysis):
    return render(analysis)
