"""At home in the shell: completion, the settings file, the versions and the doctor."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from allanscope.__main__ import main
from allanscope.allan import CurveChoices
from allanscope.allan.noise_type import NAMES
from allanscope.arguments import SUGGESTIONS
from allanscope.cli import parser
from allanscope.errors import UsageError
from allanscope.parts import PARTS
from allanscope.pipeline import doctor
from allanscope.shell import SHELLS, apply_settings, completion, settings_lines
from allanscope.simulator.effects import effect_kinds
from allanscope.simulator.faults import FAULT_KINDS
from allanscope.wire import formats
from support.terminal import Terminal


@pytest.fixture
def settings(tmp_path, monkeypatch):
    """Return the settings file, which does not exist yet."""
    path = tmp_path / "settings.toml"
    monkeypatch.setenv("ALLANSCOPE_SETTINGS", str(path))
    return path


def completed(words, tmp_path):
    script = tmp_path / "allanscope.bash"
    script.write_text(completion(parser(), "bash"))
    line = " ".join(f"'{word}'" for word in words)
    code = f"""source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}
_allanscope; echo "${{COMPREPLY[@]}}" """
    ran = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
    return ran.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_and_choices(tmp_path):
    assert completed(["allanscope", "re"], tmp_path) == ["replay", "recover", "report"]
    assert completed(["allanscope", "live", "--view", "w"], tmp_path) == ["window", "web"]
    assert completed(["allanscope", "export", "--la"], tmp_path) == ["--layout"]
    assert completed(["allanscope", "completion", ""], tmp_path) == ["bash", "zsh", "fish"]
    assert completed(["allanscope", "analyse", ""], tmp_path) == [], "files, by the shell itself"


COMPLETIONS = {
    "allanscope re": {"replay", "recover", "report"},
    "allanscope live --vi": {"--view"},
    "allanscope live --view w": {"window", "web"},
    "allanscope live --view=w": {"window", "web"},
    "allanscope live --part LSM6DSV": {"LSM6DSV", "LSM6DSV16X"},
    "allanscope analyse --wire tm": {"tmsg", "tmsg-sensortile"},
    "allanscope stability t": {"tierms"},
    "allanscope live --effect step --eff": {"--effect"},
    "allanscope live --rate ": set(),
    "allanscope analyse here": {"here-1.csv", "here-2.csv"},
    "allanscope live --out here": {"here-1.csv", "here-2.csv"},
}
"""What stands on the line, and what a shell offers in a folder with two files."""


@pytest.fixture
def two_files(tmp_path, monkeypatch):
    """Move to a folder with two files; return another one, of the shell's own."""
    folder = tmp_path / "work"
    folder.mkdir()
    for name in ("here-1.csv", "here-2.csv"):
        (folder / name).touch()
    monkeypatch.chdir(folder)
    home = tmp_path / "home"
    home.mkdir()
    return home


@pytest.mark.skipif(shutil.which("fish") is None, reason="no fish")
def test_fish_completes_commands_options_values_and_files(two_files):
    script = two_files / "allanscope.fish"
    script.write_text(completion(parser(), "fish"))
    environment = {**os.environ, "HOME": str(two_files)}
    for line, offered in COMPLETIONS.items():
        asked = f"source {script}; complete -C '{line}'"
        ran = subprocess.run(
            ["fish", "-N", "-c", asked], capture_output=True, text=True, check=True, env=environment
        )
        words = {row.partition("\t")[0].removeprefix("--view=") for row in ran.stdout.splitlines()}
        assert (words, ran.stderr) == (offered, ""), line


ZSHRC = """
PS1="ready> "
autoload -Uz compinit; compinit -u -D
source "$HOME/allanscope.zsh"
compadd() {  # notes what is added, and adds it
  if [[ ${@[1,(i)(-|--)]} != *-(O|A|D)\\ * ]]; then
    local -a found
    builtin compadd -O found "$@"
    print -rl -- $found >>$HOME/offered
  fi
  builtin compadd "$@"
}
complete-and-tell() { zle expand-or-complete; print end >>$HOME/ended }
zle -N complete-and-tell
bindkey '^I' complete-and-tell
"""


@pytest.mark.skipif(shutil.which("zsh") is None, reason="no zsh")
def test_zsh_completes_commands_options_values_and_files(two_files):
    (two_files / "allanscope.zsh").write_text(completion(parser(), "zsh"))
    (two_files / ".zshrc").write_text(ZSHRC)
    offered, ended = two_files / "offered", two_files / "ended"
    ended.touch()
    start = "import os; os.execvp('zsh', ['zsh', '-i'])"
    with Terminal(start, 200, 60, HOME=str(two_files), ZDOTDIR=str(two_files)) as terminal:
        terminal.read_until("ready> ")
        for k, (line, words) in enumerate(COMPLETIONS.items()):
            offered.write_text("")
            terminal.type(f"{line}\t")
            terminal.wait_for(lambda _, k=k: len(ended.read_text().split()) > k)
            terminal.type("\x15")  # the line is thrown away
            assert set(offered.read_text().split()) == words, line


def test_the_values_that_a_shell_offers_are_those_there_are():
    assert sorted(SUGGESTIONS["part"]) == sorted(PARTS)
    assert SUGGESTIONS["wire"] == formats()
    assert SUGGESTIONS["noise_type"] == tuple(NAMES.values())
    for name in SUGGESTIONS["taus"]:
        CurveChoices(taus=name)


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_reads_its_script(shell, tmp_path):
    script = completion(parser(), shell)
    for name in ("live", "doctor", "--accel-fs" if shell != "fish" else "-l accel-fs"):
        assert name in script
    if shutil.which(shell) is None:
        return
    path = tmp_path / "script"
    path.write_text(script)
    assert subprocess.run([shell, "-n", str(path)], check=False).returncode == 0


def test_settings_are_the_defaults_of_a_live_run_alone(settings):
    settings.write_text('part = "LSM6DSL"\nrate = 208\nport = 9000\nview = "web"\n')
    top = parser()
    apply_settings(top)
    live = top.parse_args(["live"])
    assert (live.part, live.rate, live.view_port, live.view) == ("LSM6DSL", 208, 9000, "web")
    assert top.parse_args(["live", "--part", "LSM6DSM"]).part == "LSM6DSM"
    replay = top.parse_args(["replay", "night.mcap"])
    assert (replay.part, replay.view) == ("", "web"), "a recording knows its part"
    assert top.parse_args(["analyse", "night.mcap"]).part == ""


def test_no_view_is_a_setting_of_live_that_leaves_open_its_own(settings):
    settings.write_text('view = "none"\n')
    top = parser()
    apply_settings(top)
    assert top.parse_args(["live"]).view == top.parse_args(["replay", "x"]).view == "none"
    assert top.parse_args(["open", "x"]).view == "auto"


def test_the_settings_are_shown_as_a_file_that_can_be_read_again(settings, capsys):
    with pytest.raises(SystemExit):
        main(["--show-settings"])
    shown = capsys.readouterr().out
    assert "(does not exist yet)" in shown
    settings.write_text(shown.replace("# part =", "part =").replace("# rate =", "rate ="))
    assert 'part = "LSM6DSM"  # LSM6DS3H, LSM6DSL or LSM6DSM' in settings_lines()
    assert "rate = 104  # nominal sample rate, Hz" in settings_lines()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("part = 3", "part must be a quoted text"),
        ("rate = true", "rate must be a number"),
        ("ratte = 3", "unknown setting 'ratte'"),
        ('view = "fog"', "view is 'fog'; choose auto, window, web, none"),
        ('part = "LSM9"', "settings.toml: unknown part 'LSM9'"),
        ("part = ", "cannot read the settings"),
    ],
)
def test_a_wrong_setting_is_an_error_of_usage(settings, text, said, capsys):
    settings.write_text(text)
    with pytest.raises(UsageError, match=said):
        apply_settings(parser())
    assert main(["live", "sim"]) == 2
    assert said in capsys.readouterr().err


def test_the_versions_that_matter_are_printed(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("allanscope ")
    assert lines[1].startswith("Python 3.")
    assert any(line.startswith("rerun-sdk ") for line in lines)


def test_the_doctor_looks_at_everything(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(doctor, "find_ports", list)
    assert main(["doctor", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    for name in ("board", "viewer", "GPU", "compiled code", "disk"):
        assert f"  {name}: " in told
    assert "-> plug the board in; without one: allanscope live sim" in told
    assert not list(tmp_path.iterdir()), "nothing is left behind"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at Linux alone")
def test_the_doctor_tells_for_how_long_samples_can_wait(tmp_path, monkeypatch):
    """At 100 Hz, 1.41 kB/s: what a pty was seen to hold, 64 and 256 MiB.

    A busy system does not take the same number of bytes twice, so it is asked once.
    """
    held = doctor.buffers()
    monkeypatch.setattr(doctor, "buffers", lambda: held)
    one, other = doctor._reading(100.0)
    assert (one.grade, one.name) == ("ok", "buffers")
    held_ms = float(one.text.split("samples can wait ")[1].split(" ms")[0])
    assert held_ms == pytest.approx(1e3 * held["the system"] / 1410.0, rel=1e-3)
    assert held_ms >= 4096 / 1.41 - 1.0, "a tty holds a page"
    assert "13 h 13 min in the reader, 2 d 4 h in the measuring process" in one.text
    assert other.name == "reader"
    monkeypatch.setattr(doctor, "may_run_in_real_time", lambda: False)
    assert doctor._reading(1e6).__next__().grade == "note", "a millisecond is too little"
    remedy = list(doctor._reading(100.0))[1].remedy
    assert "rtprio" in remedy
    assert main(["doctor", str(tmp_path), "--rate", "0"]) == 2


def test_the_doctor_names_the_command_that_mends_it(tmp_path, monkeypatch, capsys):
    port = doctor.find_ports.__globals__["PortDescription"]("/dev/null", 0x0483, 0x5740)
    monkeypatch.setattr(doctor, "find_ports", lambda: [port])
    monkeypatch.setattr(doctor.os, "access", lambda *_: False)
    monkeypatch.setattr(doctor, "_group", lambda _: "dialout")
    monkeypatch.setattr(doctor, "has_display", lambda: False)
    assert main(["doctor", str(tmp_path)]) == 5
    assert "-> sudo usermod -aG dialout $USER, then log in again" in capsys.readouterr().out
    process = tmp_path / "1"
    process.mkdir()
    (process / "comm").write_text("ModemManager\n")
    assert "systemctl disable --now ModemManager" in doctor._modem_manager(tmp_path).remedy
    assert "mesa-vulkan-drivers" in doctor._graphics(tmp_path, tmp_path).remedy
    assert doctor._disk(Path("/proc")).grade == "bad"
    assert doctor._disk(tmp_path / "none").text.endswith("none: No such file or directory")


@pytest.mark.parametrize(
    ("words", "kinds"),
    [
        (["simulate", "x.mcap", "--effect", "help"], effect_kinds()),
        (["live", "sim", "--effect", "help"], effect_kinds()),
        (["device", "--fault", "help"], FAULT_KINDS),
    ],
)
def test_kinds_of_effects_and_faults_are_listed_on_request(words, kinds, capsys):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert not end.value.code
    listed = [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()]
    assert sorted(listed) == sorted(kinds)


def test_specifications_are_collected_and_commands_do_not_share_them():
    arguments = ["simulate", "x.mcap", "--effect", "step:size=1", "--effect", "outliers"]
    assert parser().parse_args(arguments).effect == ["step:size=1", "outliers"]
    assert parser().parse_args(arguments[:2]).effect == []


@pytest.mark.parametrize("words", [["--show-settings"], ["simulate", "x", "--effect", "help"]])
def test_a_reader_that_closes_the_pipe_gets_no_traceback(words):
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "allanscope", *words]
    ran = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (ran.returncode, ran.stderr) == (0, "")
