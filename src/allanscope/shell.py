"""At home in the shell: the settings file, and completion for bash, zsh and fish."""

from __future__ import annotations

import os
import re
import shlex
import sys
import tomllib
from argparse import SUPPRESS, Action, ArgumentParser, _SubParsersAction
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from allanscope.arguments import SUGGESTIONS
from allanscope.errors import UsageError
from allanscope.parts import part_named
from allanscope.sanitize import sanitize

__all__ = ["SHELLS", "apply_settings", "completion", "settings_file", "settings_lines"]

SHELLS = ("bash", "zsh", "fish")

_KEYS: Mapping[str, tuple[str, str | float, str]] = {
    "part": ("part", "LSM6DSM", "LSM6DS3H, LSM6DSL or LSM6DSM"),
    "rate": ("rate", 104.0, "nominal sample rate, Hz"),
    "gyro_fs": ("gyro_fs", 250.0, "gyro full scale, dps"),
    "accel_fs": ("accel_fs", 2.0, "accelerometer full scale, g"),
    "wire": ("wire", "native", "wire format"),
    "folder": ("folder", "~/sessions", "where new sessions are made"),
    "view": ("view", "web", "auto, window, web or none"),
    "port": ("view_port", 9876, "network port of the web viewer"),
}
"""Key to the name of the option, an example, whose type a value must have, and what it is."""

_OF_COMMAND = {
    "live": tuple(_KEYS),
    "replay": ("view", "port"),
    "open": ("view", "port"),
}
"""What each command takes from the file.

A recording knows its part and its rate: a setting must not overrule them.
"""


def settings_file() -> Path:
    """Return where the settings are: ``ALLANSCOPE_SETTINGS``, or the user's configuration."""
    named = os.environ.get("ALLANSCOPE_SETTINGS")
    if named:
        return Path(named)
    if sys.platform == "win32":
        base = os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming"
    else:
        base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "allanscope" / "settings.toml"


def apply_settings(top: ArgumentParser) -> None:
    """Make what the settings file says the default of the options of live, replay and open.

    Raises
    ------
    UsageError
        For a file that cannot be read, a key that does not exist, or a value of a wrong type.
    """
    known = _read(settings_file())
    for name, keys in _OF_COMMAND.items():
        one = _commands(top)[name]
        chosen = {_KEYS[key][0]: known[key] for key in keys if key in known}
        for action in _options(one):
            value = chosen.get(action.dest)
            if value is not None and action.choices and value not in action.choices:
                if name != "live":  # which takes every setting: `open` must show charts
                    del chosen[action.dest]
                    continue
                raise UsageError(
                    f"{settings_file()}: {action.dest} is {value!r}; choose "
                    f"{', '.join(map(str, action.choices))}"
                )
        one.set_defaults(**chosen)


def settings_lines() -> list[str]:
    """Return the settings as they are, and those that there could be."""
    path = settings_file()
    known = _read(path)
    lines = [f"# {path}" + ("" if path.exists() else " (does not exist yet)")]
    lines.append("# Defaults of allanscope live; view and port also of replay and open.")
    for key, (_, example, meaning) in _KEYS.items():
        value = known.get(key, example)
        shown = f'"{value}"' if isinstance(value, str) else f"{value:g}"
        lines.append(f"{'' if key in known else '# '}{key} = {shown}  # {meaning}")
    return lines


def _read(path: Path) -> dict[str, Any]:
    try:
        known = tomllib.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read the settings {path}: {error}") from None
    for key, value in known.items():
        if key not in _KEYS:
            raise UsageError(f"{path}: unknown setting {key!r}; there are {', '.join(_KEYS)}")
        example = _KEYS[key][1]
        types = (int, float) if isinstance(example, float) else type(example)
        if not isinstance(value, types) or isinstance(value, bool):
            wanted = "a quoted text" if isinstance(example, str) else "a number"
            raise UsageError(f"{path}: {key} must be {wanted}, e.g. {example!r}")
    if "part" in known:
        try:
            part_named(known["part"])
        except UsageError as error:
            raise UsageError(f"{path}: {error}") from None
    if "folder" in known:
        known["folder"] = str(Path(known["folder"]).expanduser())
    return known


def completion(top: ArgumentParser, shell: str) -> str:
    """Return a script that completes commands, options and values; files where they are taken."""
    commands = {name: _options(one) for name, one in _commands(top).items()}
    summaries = {name: one.description or "" for name, one in _commands(top).items()}
    match shell:
        case "bash":
            return _bash(commands)
        case "zsh":
            return _zsh(commands, summaries)
        case _:
            return _fish(commands, summaries)


def _values(one: Action) -> str:
    """Return the values that an argument takes, or the usual ones, separated by spaces."""
    return " ".join(map(str, one.choices or SUGGESTIONS.get(one.dest, ())))


def _takes_files(one: Action) -> bool:
    """Whether files and folders are values: of arguments without a flag they nearly always are."""
    return not one.choices and (not one.option_strings or bool(_FILES.match(str(one.metavar))))


_FILES = re.compile(r"FILE|DIR|PATH|RESULT|SPEC|COMMAND")
"""Beginnings of the metavars of options that take a file, a folder or a program."""


def _bash(commands: Mapping[str, list[Action]]) -> str:
    choices, options = [], []
    for name, actions in commands.items():
        flags = " ".join(flag for one in actions for flag in one.option_strings)
        options.append(f'    {name}) words="{flags}" ;;')
        for one in actions:
            if values := _values(one):
                wanted = "|".join(f'"{name} {flag}"' for flag in one.option_strings)
                wanted = wanted or f'"{name} {name}"'
                is_closed = "" if _takes_files(one) else " wanted=1"
                choices.append(f'    {wanted}) words="{values}"{is_closed} ;;')
    return f"""# bash completion of allanscope; add to ~/.bashrc:
#   eval "$(allanscope completion bash)"
_allanscope() {{
  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD-1]}} words="" wanted=""
  # --view=web is three words.
  if [[ $cur == = ]]; then cur=""
  elif [[ $prev == = ]]; then prev=${{COMP_WORDS[COMP_CWORD-2]}}
  fi
  case "${{COMP_WORDS[1]}} $prev" in
{chr(10).join(choices)}
  esac
  if [[ -z $wanted && $COMP_CWORD -eq 1 ]]; then
    words="{" ".join(commands)} --help --version --show-settings"
  elif [[ -z $wanted && $cur == -* ]]; then
    case "${{COMP_WORDS[1]}}" in
{chr(10).join(options)}
    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$cur"))
}}
complete -o default -F _allanscope allanscope
"""


def _zsh(commands: Mapping[str, list[Action]], summaries: Mapping[str, str]) -> str:
    named = " ".join(shlex.quote(f"{name}:{_plain(text)}") for name, text in summaries.items())
    cases = []
    for name, actions in commands.items():
        rows = [shlex.quote(row) for one in actions for row in _zsh_rows(one)]
        cases.append(f"    {name}) _arguments {' '.join(rows)} ;;")
    return f"""#compdef allanscope
# zsh completion of allanscope; add to ~/.zshrc, after compinit:
#   eval "$(allanscope completion zsh)"
_allanscope() {{
  if (( CURRENT == 2 )); then
    local -a commands=({named})
    _describe command commands
    return
  fi
  shift words
  (( CURRENT-- ))
  case $words[1] in
{chr(10).join(cases)}
  esac
}}
compdef _allanscope allanscope
"""


def _zsh_rows(one: Action) -> Iterable[str]:
    """Yield the specifications of `_arguments` for one argument."""
    words = f"({_values(one)})" if _values(one) else ""
    values = "_files" if _takes_files(one) else words
    if words and _takes_files(one):
        values = f"{{_files; compadd -- {_values(one)}}}"
    what = _zsh_escaped(str(one.metavar or one.dest))
    if not one.option_strings:
        yield f"{'*' if one.nargs in ('*', '+') else ''}:{what}:{values}"
        return
    again = "*" if isinstance(one.default, list) else ""  # may be given more than once
    value = "" if one.nargs == 0 else f":{what}:{values}"
    for flag in one.option_strings:
        joined = "=" if value and flag.startswith("--") else ""
        yield f"{again}{flag}{joined}[{_zsh_escaped(_plain(one.help or ''))}]{value}"


def _zsh_escaped(text: str) -> str:
    return re.sub(r"[\[\]:]", r"\\\g<0>", text)


def _fish(commands: Mapping[str, list[Action]], summaries: Mapping[str, str]) -> str:
    lines = [
        "# fish completion of allanscope:",
        "#   allanscope completion fish > ~/.config/fish/completions/allanscope.fish",
    ]
    for name, actions in commands.items():
        told = shlex.quote(_plain(summaries[name]))
        lines.append(f"complete -c allanscope -n __fish_use_subcommand -f -a {name} -d {told}")
        here = f"__fish_seen_subcommand_from {name}"
        for one in actions:
            words = f" -a '{_values(one)}'" if _values(one) else ""
            values = "" if one.nargs == 0 else " -r" if _takes_files(one) else " -x"
            told = shlex.quote(_plain(one.help or ""))
            for flag in one.option_strings:
                if flag.startswith("--"):
                    option = f"-l {flag[2:]}{values}{words}"
                    lines.append(f"complete -c allanscope -n '{here}' {option} -d {told}")
            if words and not one.option_strings:
                first = f"{here}; and test (count (commandline -opc)) -eq 2"
                files = "" if _takes_files(one) else " -f"
                lines.append(f"complete -c allanscope -n '{first}'{files}{words}")
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Return a text without what means something to a shell within quotes."""
    marks = str.maketrans({"'": "’", **dict.fromkeys('`$\\"', " ")})
    return " ".join(sanitize(text.replace("%%", "%")).translate(marks).split())


def _commands(top: ArgumentParser) -> dict[str, ArgumentParser]:
    actions = top._actions  # noqa: SLF001 - argparse has no public list of them
    (commands,) = (one for one in actions if isinstance(one, _SubParsersAction))
    return dict(commands.choices)


def _options(one: ArgumentParser) -> list[Action]:
    actions = one._actions  # noqa: SLF001
    return [action for action in actions if action.help != SUPPRESS]
