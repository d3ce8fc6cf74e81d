"""What packages offer is what type checkers read, lives where it is said, and is found by name."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import allanscope

ROOT = Path(allanscope.__file__).parent
PACKAGES = [
    ".".join(("allanscope", *path.parent.relative_to(ROOT).parts))
    for path in sorted(ROOT.rglob("__init__.py"))
    if "lazily(" in path.read_text("utf-8")
]


def promised(package):
    """Return the names that are imported for type checkers only, with the module of each."""
    tree = ast.parse(Path(import_module(package).__file__).read_text("utf-8"))
    guarded = [node for node in tree.body if isinstance(node, ast.If)]
    imports = [one for node in guarded for one in node.body if isinstance(one, ast.ImportFrom)]
    return {alias.name: one.module for one in imports for alias in one.names}


def test_packages_are_lazy():
    assert len(PACKAGES) >= 10


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_offers_what_type_checkers_read_from_where_they_read_it(package):
    module = import_module(package)
    for name, home in promised(package).items():
        assert getattr(module, name) is getattr(import_module(home), name)
    assert set(promised(package)) <= set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        getattr(module, name)


@pytest.mark.parametrize("package", PACKAGES)
def test_an_unknown_name_is_an_error_with_both_names(package):
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'avar'"):
        _ = import_module(package).avar


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_is_found_whichever_module_was_imported_before(package):
    """A module under the name of what it holds would hide it from the moment of its import."""
    names, homes = zip(*promised(package).items(), strict=True)
    code = (
        f"import {', '.join(sorted(set(homes)))}\n"
        f"from {package} import {', '.join(names)}\n"
        f"print([n for n in {names!r} if type(globals()[n]).__name__ == 'module'])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "[]\n"
