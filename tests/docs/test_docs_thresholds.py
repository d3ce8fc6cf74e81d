"""Every number of the search and of the noise model says what it is."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2] / "src" / "allanscope"
FILES = sorted([*(ROOT / "explain").rglob("*.py"), *(ROOT / "noise").rglob("*.py")])


def unexplained(text):
    """Return the names of numbers of a module that no docstring follows, alone or in a group."""
    body, found = ast.parse(text).body, []
    for at, node in enumerate(body):
        if not (isinstance(node, ast.Assign) and is_number(node.value)):
            continue
        after = next((one for one in body[at:] if not isinstance(one, ast.Assign)), None)
        if not (isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)):
            found += [ast.unparse(target) for target in node.targets]
    return found


def is_number(value):
    """Tell whether a value is a number, or several that were written out."""
    try:
        numbers = ast.literal_eval(value)
    except ValueError:
        return False
    numbers = numbers if isinstance(numbers, tuple) else (numbers,)
    return all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_number_says_what_it_is(path):
    assert unexplained(path.read_text()) == []


def test_a_number_without_a_docstring_is_seen():
    assert unexplained('_A = 3.0\n"""Nats."""\n_B, _C = 1, 2.0\n\ndef f(): ...') == ["(_B, _C)"]
