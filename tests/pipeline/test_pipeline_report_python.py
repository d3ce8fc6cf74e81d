"""The page on Python use: what it says can be run as it stands."""

import re
from doctest import script_from_examples
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def test_every_block_of_the_page_runs_and_finds_what_it_promises(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = PAGE.read_text(encoding="utf-8")
    found = re.findall(r"(<!-- not run.*?-->\n)?```python\n(.*?)```", page, re.DOTALL)
    blocks = [block for skipped, block in found if not skipped]
    assert len(blocks) == 10
    names = {}
    for block in blocks:
        code = script_from_examples(block) if block.startswith(">>>") else block
        exec(compile(code, str(PAGE), "exec"), names)
    said = capsys.readouterr().out
    assert "sinusoid" in said
    assert "mdps/√Hz" in said
    assert names["result"].axes["gx"].explanation.effects[0].kind == "sinusoid"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "compared.html",
        "figures",
        "report.html",
    ]
    assert len(list((tmp_path / "figures").iterdir())) == 2
