"""Write docs/reference/commands.md from the parser itself: ``python docs/commands.py``.

A test compares the page with the parser, so a command or an option cannot change without it.
"""

from __future__ import annotations

from argparse import Action, ArgumentParser, _HelpAction, _SubParsersAction
from pathlib import Path

from allanscope.cli import parser
from allanscope.simulator import effect_help, fault_help

PAGE = Path(__file__).resolve().parent / "reference" / "commands.md"

HEAD = """\
# Commands

This page is written by `python docs/commands.py` from the parser.

Every command takes `--quiet` (print only results and errors) and `--debug` (show a traceback on an
error). `allanscope --version` prints the versions that matter, `allanscope COMMAND --help` what
stands here.

`allanscope --show-settings` prints the settings file, with everything that can stand in it:
defaults of `live` (part, rate, full scales, wire format, folder of new sessions, view, port; of
`replay` and `open` the last two). It is `~/.config/allanscope/settings.toml`, on Windows
`%APPDATA%/allanscope/settings.toml`, or what the variable `ALLANSCOPE_SETTINGS` names.

| exit code | meaning |
|---|---|
| 0 | done; also a run that Ctrl-C ended cleanly: files closed, report written |
| 1 | internal error: please report it, `--debug` shows where; other axes are written all the same |
| 2 | usage: something in the call does not exist |
| 3 | input that cannot be read |
| 4 | device lost or not found |
| 5 | `check` or `verify` failed |
| 6 | done, but not all of it: standard error and `failures` in the result say what |
| 130 | stopped by Ctrl-C before it was done |

An error is one line on standard error: what, where, what to do.
"""

COMMON = {"--quiet", "--debug"}


def page() -> str:
    """Return the whole page."""
    sections = [_section(name, one) for name, one in _commands(parser()).items()]
    return "\n".join(
        [HEAD, *sections, _kinds("Effects", effect_help()), _kinds("Faults", fault_help())]
    )


def _kinds(title: str, lines: str) -> str:
    rows = []
    for line in lines.splitlines():
        name, _, meaning = line.partition(": ")
        words, _, parameters = meaning.rpartition(" (")
        rows.append(f"| `{name}` | {words} | {parameters.rstrip(')')} |")
    return "\n".join([f"## {title}", "", "| kind | | parameters |", "|---|---|---|", *rows, ""])


def _commands(top: ArgumentParser) -> dict[str, ArgumentParser]:
    (commands,) = (a for a in _actions(top) if isinstance(a, _SubParsersAction))
    return dict(commands.choices)


def _actions(one: ArgumentParser) -> list[Action]:
    return one._actions  # noqa: SLF001 - argparse has no public list of them


def _section(name: str, one: ArgumentParser) -> str:
    lines = [f"## allanscope {name}", "", one.description or "", ""]
    actions = [a for a in _actions(one) if not isinstance(a, _HelpAction)]
    rows = [_row(action) for action in actions if not COMMON & set(action.option_strings)]
    if rows:
        lines += ["| argument | meaning |", "|---|---|", *rows, ""]
    example = (one.epilog or "").removeprefix("Example: ")
    return "\n".join([*lines, f"    {example}", ""])


def _row(action: Action) -> str:
    shown = ", ".join(action.option_strings) or str(action.metavar or action.dest).upper()
    if action.option_strings and action.nargs != 0:
        value = "\\|".join(map(str, action.choices)) if action.choices else ""
        shown += f" {value or action.metavar or action.dest.upper()}"
    words = (action.help or "").replace("|", "\\|")
    default = action.default
    if default not in (None, "", False, [], "auto") and "default" not in words:
        words = f"{words} (default {default:g})" if isinstance(default, float) else words
        if isinstance(default, str | int) and not isinstance(default, bool):
            words = f"{words} (default {default})"
    return f"| `{shown}` | {words.strip()} |"


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
