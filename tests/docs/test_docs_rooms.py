"""Each room explains itself: whoever opens its folder finds every module named in `__init__.py`."""

import ast
import re
from pathlib import Path

import pytest

import allanscope

PACKAGE = Path(allanscope.__file__).parent
ROOMS = [
    "analysis",
    "clock",
    "fleet",
    "pipeline",
    "recording",
    "simulator",
    "sources",
    "verify",
    "wire",
]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_names_its_modules(room):
    about = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text("utf-8")))
    modules = [
        path.stem
        for path in (PACKAGE / room).iterdir()
        if path.stem[0].isalpha() and (path.suffix == ".py" or (path / "__init__.py").exists())
    ]
    assert modules
    assert [name for name in modules if not re.search(rf"\b{name}\b", about or "")] == []
