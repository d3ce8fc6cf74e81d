"""The pages of this folder as a site: ``sphinx-build -W docs build/site``, with ``.[docs]``.

The table in README.md is the navigation, and the reference of the code is made from the docstrings
of what `allanscope` exports, that of the options from the parser. Links to files outside this
folder lead to a copy of the file.
"""

from __future__ import annotations

import re
from importlib.metadata import version as version_of
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent

project = "allanscope"
release = version_of("allanscope")
root_doc = "README"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
exclude_patterns = ["notebooks", "**/.ipynb_checkpoints"]
html_theme = "furo"
html_title = f"allanscope {release}"
html_show_sourcelink = False
html_copy_source = False
html_show_copyright = False

myst_heading_anchors = 4

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_ivar = True
default_role = "code"

COLUMNS = {
    "to learn": "Learn",
    "to do": "Do",
    "to look up": "Look up",
    "to understand": "Understand",
}
TABLE = re.compile(r"<!-- table: (\S+\.csv) -->")
TABLE_HERE = r"```{csv-table}\n:file: \1\n:header-rows: 1\n```"
LINK = re.compile(r"\[([^\]]+)\]\(([^)#\s]+\.md)\)")


def contents(text: str) -> str:
    """Return the navigation: the links of each column of the table of README.md."""
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    heads, columns = rows[0], zip(*rows[2:], strict=True)
    found = []
    for head, column in zip(heads, columns, strict=True):
        pages = [page for _, page in LINK.findall(" ".join(column)) if not page.startswith("..")]
        if head.strip() == "to look up":
            pages.append("reference/api")
        found.append(_tree(pages, f":caption: {COLUMNS[head.strip()]}\n"))
    return "\n".join(found)


def _tree(pages: list[str], options: str = "") -> str:
    return "\n".join(["", "```{toctree}", f":hidden:\n{options}", *pages, "```", ""])


def _downloads(page: str, text: str) -> str:
    """Turn links to Markdown outside this folder, which is no page of the site, into downloads."""

    def turned(link: re.Match[str]) -> str:
        outside = not (HERE / page).parent.joinpath(link[2]).resolve().is_relative_to(HERE)
        return f"{{download}}`{link[1]} <{link[2]}>`" if outside else link[0]

    return re.sub(r"\[([^\]]+)\]\(([^)#\s]+\.md)(?:#[^)]*)?\)", turned, text)


def _commands() -> Any:
    spec = spec_from_file_location("commands", HERE / "commands.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _add_contents(app: Any, page: str, source: list[str]) -> None:
    source[0] = TABLE.sub(TABLE_HERE, _downloads(page, source[0]))
    if page == root_doc:
        source[0] += contents(source[0])
    elif page == "reference/commands":
        source[0] += _commands().options()
    elif page == "decisions/README":
        source[0] += _tree(sorted(f.name for f in HERE.glob("decisions/0*.md")))


def setup(app: Any) -> None:
    """Put the navigation behind the pages that list others."""
    app.connect("source-read", _add_contents)
