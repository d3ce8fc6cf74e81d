"""The documentation as a program: its code runs, its links lead somewhere, its words exist.

``python`` blocks are executed, those with prompts as doctests; ``sh`` blocks that call nothing but
``allanscope`` are run line by line, all blocks of a page in order, in one folder of its own. To be
quick, a live run takes 2 s and no viewer, a simulation 36 s of device time, and the figures of a
report, which have tests of their own, are not drawn. A block after ``<!-- not run: why -->`` is
left out.
"""

import doctest
import importlib.util
import json
import re
import shlex
from pathlib import Path

import allantools
import pytest

from allanscope.__main__ import main
from allanscope.allan.estimators import REGISTRY
from allanscope.cli import parser
from allanscope.explain.effects import VOCABULARY
from allanscope.wire import formats

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("firmware_protocol/**/*.md")]
)
BLOCK = re.compile(r"(?P<before>[^\n]*)\n```(?P<kind>\w+)\n(?P<code>.*?)^```$", re.M | re.S)
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)\s#]*)(#[^)\s]*)?\)")
DOCTEST = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
SECONDS, HOURS = "2s", "0.01"


def named(page):
    return str(page.relative_to(ROOT))


def blocks(page):
    """Return kind and code of the blocks of a page that are to be run."""
    found = BLOCK.finditer("\n" + page.read_text("utf-8"))
    return [
        (one["kind"], one["code"])
        for one in found
        if one["kind"] == "python" or (one["kind"] == "sh" and is_ours(one["code"]))
        if not one["before"].startswith("<!-- not run")
    ]


def is_ours(code):
    lines = [line for line in code.splitlines() if line and not line.startswith("#")]
    return all(line.startswith("allanscope ") for line in lines)


def quick(arguments):
    """Shorten what would take minutes."""
    short = list(arguments)
    for option, value in (("--for", SECONDS), ("--hours", HOURS)):
        if option in short:
            short[short.index(option) + 1] = value
    if short[0] in ("live", "replay"):
        if "--view" in short:
            short[short.index("--view") + 1] = "none"
        else:
            short += ["--view", "none"]
        if short[0] == "live" and "--for" not in short:
            short += ["--for", SECONDS]
    return short


def run_shell(code):
    for line in code.splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        expected = re.search(r"# exit (\d)", line)
        try:
            code = main(quick(words[1:]))
        except SystemExit as stop:
            code = stop.code or 0
        assert code == int(expected[1] if expected else 0), line


def run_python(code, names, page):
    if ">>>" not in code:
        exec(compile(code, named(page), "exec"), names)
        return
    runner = doctest.DocTestRunner(optionflags=DOCTEST)
    failures = []
    test = doctest.DocTestParser().get_doctest(code, names, named(page), named(page), 0)
    runner.run(test, out=failures.append, clear_globs=False)
    names.update(test.globs)
    assert not runner.failures, "".join(failures)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=named)
def test_code_on_the_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "page"}
    for kind, code in blocks(page):
        if kind == "sh":
            with monkeypatch.context() as undrawn:
                undrawn.setattr("allanscope.report.page.pictures", lambda _: {})
                undrawn.setattr("allanscope.report.page.render", lambda *_, **__: "<html>")
                run_shell(code)
        else:
            run_python(code, names, page)


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_to_files_and_headings(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.M | re.S)
    for target, heading in LINK.findall(text):
        path = page if not target else (page.parent / target).resolve()
        assert path.exists(), f"{named(page)} links to {target}"
        if heading and path.suffix == ".md":
            assert heading[1:] in anchors(path), f"{named(page)} links to {target}{heading}"


def anchors(page):
    titles = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), flags=re.M)
    plain = [re.sub(r"[^\w\- ]", "", title.lower()) for title in titles]
    return {title.replace(" ", "-") for title in plain}


@pytest.mark.parametrize("page", sorted(ROOT.glob("docs/**/*.md")), ids=named)
def test_a_page_begins_with_a_sentence(page):
    """What a reader gets from a page stands first, before any heading, table, list or code."""
    title, first = [line for line in page.read_text("utf-8").splitlines() if line][:2]
    assert title.startswith("# ")
    assert not first.startswith(("#", "|", "-", "```", "    ", "!", "1.")), first


def test_files_and_constants_that_contributors_are_sent_to_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8").replace("`utils.py`", "")
    sources = [path for room in ("src", "tests") for path in (ROOT / room).rglob("*.[pjtc]*")]
    files = [path.as_posix() for path in sources]
    for name in re.findall(r"`([\w/]+\.(?:py|json|toml|c))`", text):
        assert "NAME" in name or any(f"/{file}".endswith(f"/{name}") for file in files), name
    code = "".join(path.read_text("utf-8") for path in sources if path.suffix == ".py")
    for name in re.findall(r"`([A-Z][A-Z_]+)`", text):
        assert re.search(rf"\b{name}\b", code), name


def test_every_page_is_reached_from_the_readme():
    reached, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page in reached:
            continue
        reached.add(page)
        links = (page.parent / target for target, _ in LINK.findall(page.read_text("utf-8")))
        waiting += [link.resolve() for link in links if link.suffix == ".md" and link.exists()]
    assert set(PAGES) <= reached, sorted(map(named, set(PAGES) - reached))


@pytest.fixture(scope="module")
def commands():
    """Return docs/commands.py, which writes the page of commands."""
    spec = importlib.util.spec_from_file_location("commands", ROOT / "docs" / "commands.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_of_commands_has_every_command(commands):
    written = commands.PAGE.read_text("utf-8")
    assert written == commands.page(), "run: python docs/commands.py"
    assert all(f"\n| `allanscope {name}" in written for name in commands.commands())


def test_the_site_and_the_help_have_every_option_with_its_meaning(commands):
    lines = commands.options().splitlines()
    for name, one in commands.commands().items():
        for action in one._actions:
            option = [*action.option_strings, str(action.metavar or action.dest).upper()][0]
            if option not in ("-h", *commands.COMMON):
                assert action.help, f"{name} {option}"
                row = f"| `{option}", action.help.replace("|", commands.PIPE)
                assert any(line.startswith(row[0]) and row[1] in line for line in lines), row


def test_the_readme_names_every_command():
    (commands,) = (a for a in parser()._actions if hasattr(a, "choices") and a.choices)
    text = (ROOT / "README.md").read_text("utf-8") + (ROOT / "docs/tutorial.md").read_text("utf-8")
    for name in commands.choices:
        assert f"allanscope {name}" in text, name


def test_the_help_names_every_wire_format(capsys):
    with pytest.raises(SystemExit):
        main(["device", "--help"])
    text = capsys.readouterr().out
    for name in formats():
        assert re.search(rf"[ \n]{name}[, \n]", text), name


def test_the_table_of_effects_has_every_kind():
    page = (ROOT / "docs" / "reference" / "json.md").read_text("utf-8")
    table = page[page.index("## Effects") :]
    assert sorted(re.findall(r"^\| `(\w+)` \|", table, re.M)) == sorted(VOCABULARY)


def test_the_pages_name_every_estimator():
    reference = (ROOT / "docs" / "python.md").read_text("utf-8")
    explained = (ROOT / "docs" / "explanation" / "estimators.md").read_text("utf-8")
    for name in REGISTRY:
        assert re.search(rf"\b{name}\b", reference), name
        assert f"`{name}`" in explained, name


def test_decisions_are_all_listed():
    folder = ROOT / "docs" / "decisions"
    index = (folder / "README.md").read_text("utf-8")
    for page in folder.glob("0*.md"):
        assert f"({page.name})" in index


def test_code_that_is_wrong_is_noticed(tmp_path):
    page = ROOT / "README.md"
    with pytest.raises(AssertionError):
        run_python(">>> 1 + 1\n3\n", {}, page)
    with pytest.raises(ZeroDivisionError):
        run_python("1 / 0", {}, page)
    with pytest.raises(AssertionError):
        run_shell(f"allanscope analyse {tmp_path / 'missing.csv'}")


@pytest.mark.parametrize("notebook", sorted(ROOT.glob("docs/notebooks/*.ipynb")), ids=named)
def test_the_cells_of_a_notebook_run(notebook, tmp_path, monkeypatch):
    """The cells are run in order, without a kernel; what a cell ends with is shown as HTML."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    monkeypatch.chdir(tmp_path)
    names = {"__name__": "notebook"}
    shown = []
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    for cell in cells:
        if cell["cell_type"] == "code":
            run_python("".join(cell["source"]), names, notebook)
            last = cell["source"][-1].strip()
            if last.isidentifier():
                shown.append(names[last]._repr_html_())
    assert shown
    assert all("<table>" in text for text in shown)
    assert pyplot.get_fignums()
    pyplot.close("all")
    assert not any(cell.get("outputs") for cell in cells), "notebooks are kept without output"


def test_every_function_of_allantools_is_beside_ours():
    page = (ROOT / "docs/how-to/coming-from.md").read_text(encoding="utf-8")
    names = {name for name in dir(allantools) if not name.startswith("_")}
    functions = {name for name in names if callable(getattr(allantools, name))}
    assert functions - set(re.findall(r"\w+", page)) == set()
