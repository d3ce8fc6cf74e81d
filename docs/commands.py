"""Write docs/reference/commands.md from the parser itself: ``python docs/commands.py``.

The page has the commands; every option stands once, in the parser, and is printed by ``--help``.
The site appends them all (`options`, called by conf.py), so that its search finds them. A test
compares the page with the parser, and the options with those of every command.
"""

from __future__ import annotations

from argparse import Action, ArgumentParser, _ArgumentGroup, _HelpAction, _SubParsersAction
from pathlib import Path

from allanscope.cli import parser
from allanscope.simulator import effect_help, fault_help

PAGE = Path(__file__).resolve().parent / "reference" / "commands.md"

HEAD = """\
# Commands

What each command does, with an example, and what its exit code means. `allanscope COMMAND --help`
explains every option, and `--effect help` of `simulate`, `device` and `live sim` the effects that
can be simulated; the [site](../../CONTRIBUTING.md#tests) lists all below this table. Every command
takes `--quiet` (only results and errors) and `--debug` (a traceback). `allanscope --version` prints
all versions that matter.

`allanscope --show-settings` prints the settings file with the defaults of `live`, `replay` and
`open`: `~/.config/allanscope/settings.toml`, on Windows `%APPDATA%/allanscope/settings.toml`, or
the file named by `ALLANSCOPE_SETTINGS`.

| example | does |
|---|---|"""

TAIL = """
An error is one line on standard error: what, where, what to do.

| exit code | meaning |
|---|---|
| 0 | done; also after Ctrl-C, with files closed and the report written |
| 1 | internal error: please report it with `--debug`; the other axes are complete |
| 2 | wrong usage |
| 3 | input cannot be read |
| 4 | device lost or not found |
| 5 | `check`, `verify`, `doctor`, `fleet --against` or `--compare` failed |
| 6 | incomplete: standard error and `failures` in the result say what is missing |
| 130 | stopped by Ctrl-C before it was done |
"""

COMMON = {"--quiet", "--debug"}
PIPE = "\\|"
HEADS = ["| argument | meaning |", "|---|---|"]


def page() -> str:
    """Return the page: a row for each command."""
    return "\n".join([HEAD, *map(_command, commands().values()), TAIL])


def options() -> str:
    """Return every option of every command, and the effects and faults that can be simulated."""
    groups = list({str(g.title): g for one in commands().values() for g in _groups(one)}.values())
    return "\n".join(
        [
            *(_section(name, one) for name, one in commands().items()),
            *(_group(one, groups[:number]) for number, one in enumerate(groups)),
            _kinds("Effects", effect_help(), ("axis", "time")),
            _kinds("Faults", fault_help(), ("rate", "at")),
        ]
    )


def _kinds(title: str, lines: str, common: tuple[str, ...]) -> str:
    """Return a table of kinds; parameters that they have in common are named once."""
    rows, without = [], []
    for line in lines.splitlines():
        name, _, meaning = line.partition(": ")
        words, _, parameters = meaning.rpartition(" (")
        names = parameters.rstrip(")").split(", ")
        if not set(common) <= set(names):
            without.append(name)
        own = ", ".join(one for one in names if one not in common)
        rows.append(f"| `{name}` | {words} | {own} |")
    but = f", except {', '.join(without)}" if without else ""
    text = f"Every kind takes {' and '.join(f'`{one}`' for one in common)} too{but}."
    heads = ["| kind | | parameters |", "|---|---|---|"]
    return "\n".join([f"## {title}", "", text, "", *heads, *rows, ""])


def commands() -> dict[str, ArgumentParser]:
    """Return the commands by name."""
    (found,) = (a for a in _actions(parser()) if isinstance(a, _SubParsersAction))
    return dict(found.choices)


def _command(one: ArgumentParser) -> str:
    return (
        f"| `{_example(one).partition('  ')[0]}` | {(one.description or '').replace('|', PIPE)} |"
    )


def _example(one: ArgumentParser) -> str:
    return (one.epilog or "").removeprefix("Example: ")


def _actions(one: ArgumentParser) -> list[Action]:
    return one._actions  # noqa: SLF001 - argparse has no public list of them


def _groups(one: ArgumentParser) -> list[_ArgumentGroup]:
    """Return the named groups of options, which several commands share."""
    own = ("positional arguments", "options")
    return [g for g in one._action_groups if g.title not in own]  # noqa: SLF001 - as above


def _options(group: _ArgumentGroup) -> list[Action]:
    return group._group_actions  # noqa: SLF001 - as above


def _section(name: str, one: ArgumentParser) -> str:
    groups = _groups(one)
    grouped = {id(action) for group in groups for action in _options(group)}
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
        lines += [f"Options of {', '.join(map(_link, groups))}.", ""]
    return "\n".join([*lines, f"    {_example(one)}", ""])


def _heading(group: _ArgumentGroup) -> str:
    return f"Options of {group.title}"


def _link(group: _ArgumentGroup) -> str:
    return f"[{group.title}](#{_heading(group).lower().replace(' ', '-')})"


def _group(group: _ArgumentGroup, before: list[_ArgumentGroup]) -> str:
    """Return a table of options; those that an earlier group explains are named in one line."""
    rows, lines = _rows(group), [f"## {_heading(group)}", ""]
    for other in before:
        explained = _rows(other)
        same = [option for option, row in rows.items() if explained.get(option) == row]
        if len(same) > 1:
            names = ", ".join(f"`{option}`" for option in same)
            lines += [f"{names} as for {_link(other)}.", ""]
            rows = {option: row for option, row in rows.items() if option not in same}
            break
    return "\n".join([*lines, *HEADS, *rows.values(), ""])


def _rows(group: _ArgumentGroup) -> dict[str, str]:
    return {one.option_strings[0]: _row(one) for one in _options(group)}


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
