"""Write docs/reference/commands.md from the parser itself: ``python docs/commands.py``.

A test compares the page with the parser, so a command or an option cannot change without it.
"""

from __future__ import annotations

from argparse import Action, ArgumentParser, _ArgumentGroup, _HelpAction, _SubParsersAction
from pathlib import Path

from allanscope.cli import parser
from allanscope.simulator import effect_help, fault_help

PAGE = Path(__file__).resolve().parent / "reference" / "commands.md"

HEAD = """\
# Commands

Written by `python docs/commands.py`. Every command takes `--quiet` (print only results and errors)
and `--debug` (show a traceback); `allanscope --version` prints all versions that matter.

`allanscope --show-settings` prints the settings file with everything it may contain: defaults of
`live` (part, rate, full scales, wire format, folder of new sessions, view, port) and of `replay`
and `open` (view, port). It is `~/.config/allanscope/settings.toml`, on Windows
`%APPDATA%/allanscope/settings.toml`, or the file named by `ALLANSCOPE_SETTINGS`.

| exit code | meaning |
|---|---|
| 0 | done; also after Ctrl-C, with files closed and the report written |
| 1 | internal error: please report it with `--debug`; the other axes are complete |
| 2 | wrong usage |
| 3 | input cannot be read |
| 4 | device lost or not found |
| 5 | `check` or `verify` failed |
| 6 | incomplete: standard error and `failures` in the result say what is missing |
| 130 | stopped by Ctrl-C before it was done |

An error is one line on standard error: what, where, what to do.
"""

COMMON = {"--quiet", "--debug"}
PIPE = "\\|"
HEADS = ["| argument | meaning |", "|---|---|"]


def page() -> str:
    """Return the whole page."""
    commands = _commands(parser())
    shared = {str(g.title): g for one in commands.values() for g in _groups(one)}
    return "\n".join(
        [
            HEAD,
            *(_section(name, one) for name, one in commands.items()),
            *(_group(one) for one in shared.values()),
            _kinds("Effects", effect_help()),
            _kinds("Faults", fault_help()),
        ]
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


def _groups(one: ArgumentParser) -> list[_ArgumentGroup]:
    """Return the named groups of options, which several commands share."""
    own = ("positional arguments", "options")
    return [g for g in one._action_groups if g.title not in own]  # noqa: SLF001 - as above


def _section(name: str, one: ArgumentParser) -> str:
    groups = _groups(one)
    grouped = {id(action) for group in groups for action in group._group_actions}  # noqa: SLF001
    rows = [
        _row(action)
        for action in _actions(one)
        if not isinstance(action, _HelpAction) and id(action) not in grouped
        if not COMMON & set(action.option_strings)
    ]
    lines = [f"## allanscope {name}", "", one.description or "", ""]
    if rows:
        lines += [*HEADS, *rows, ""]
    if groups:
        links = [f"[{g.title}](#{_heading(g).lower().replace(' ', '-')})" for g in groups]
        lines += [f"Options of {', '.join(links)}.", ""]
    example = (one.epilog or "").removeprefix("Example: ")
    return "\n".join([*lines, f"    {example}", ""])


def _heading(group: _ArgumentGroup) -> str:
    return f"Options of {group.title}"


def _group(group: _ArgumentGroup) -> str:
    rows = map(_row, group._group_actions)  # noqa: SLF001
    return "\n".join([f"## {_heading(group)}", "", *HEADS, *rows, ""])


def _row(action: Action) -> str:
    shown = ", ".join(action.option_strings) or str(action.metavar or action.dest).upper()
    if action.option_strings and action.nargs != 0:
        value = PIPE.join(map(str, action.choices)) if action.choices else ""
        shown += f" {value or str(action.metavar or action.dest.upper()).replace('|', PIPE)}"
    words = (action.help or "").replace("|", PIPE)
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
