"""What `import allanscope` gives, and what it costs."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import allanscope
from allanscope.__main__ import main
from allanscope.errors import ExitCode

HEAVY = {"numpy", "scipy", "rerun", "matplotlib", "mcap", "serial", "rich", "jinja2"}


@pytest.mark.parametrize("name", allanscope.__all__)
def test_every_public_name_exists_and_says_what_it_is(name):
    public = getattr(allanscope, name)
    assert name in dir(allanscope)
    if inspect.isclass(public) or inspect.isfunction(public):
        assert len(inspect.getdoc(public)) > 30


def test_names_are_sorted_and_typed_and_found_at_home():
    assert sorted(allanscope.__all__, key=str.lower) == sorted(allanscope._HOMES, key=str.lower)
    for name, home in allanscope._HOMES.items():
        value = getattr(allanscope, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert f"{value.__module__}.".startswith(f"allanscope.{home}.")
    assert (Path(allanscope.__file__).parent / "py.typed").exists()
    assert allanscope.__version__.count(".") == 2


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'avar'"):
        _ = allanscope.avar


def test_importing_it_imports_nothing_heavy():
    code = "import sys, allanscope; print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in ran.stdout.split()}
    assert not HEAVY & loaded
    own = [name for name in ran.stdout.split() if name.startswith("allanscope")]
    assert sorted(own) == ["allanscope", "allanscope.lazy"]


@pytest.mark.parametrize(
    ("name", "contract"),
    [
        ("AllanBank", ["rate", "axes=6", "per_octave=4"]),
        (
            "deviation",
            ["data", "rate", "kind='oadev'", "taus='octave'", "data_kind='rate'", "exact=True"],
        ),
        ("analyse", ["recording_or_arrays"]),
        ("open_stream", ["port='auto'"]),
    ],
)
def test_arguments_come_in_the_promised_order_with_the_promised_defaults(name, contract):
    parameters = inspect.signature(getattr(allanscope, name)).parameters.values()
    written = [
        p.name if p.default is p.empty else f"{p.name}={p.default!r}"
        for p in parameters
        if p.kind is p.POSITIONAL_OR_KEYWORD
    ]
    assert written[: len(contract)] == contract


def test_every_error_is_an_allanscope_error_and_a_wrong_argument_a_value_error():
    for name in ("CheckFailed", "DeviceError", "InputError", "UsageError"):
        assert issubclass(getattr(allanscope, name), allanscope.AllanscopeError)
    assert issubclass(allanscope.UsageError, ValueError)
    assert not issubclass(allanscope.InputError, ValueError)


@pytest.mark.parametrize("module", ["analyse_file", "check", "run"])
def test_what_measures_loads_nothing_that_takes_half_a_second_for_one_function(module):
    heavy = {"scipy.stats", "scipy.signal", "scipy.interpolate", "matplotlib", "rerun", "pyarrow"}
    code = f"import sys, allanscope.pipeline.{module}; print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not heavy & set(ran.stdout.split())


ABSENT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rerun", "pyarrow", "matplotlib", "PIL", "jinja2"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from allanscope.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_file_is_analysed_without_what_only_viewer_and_report_need(tmp_path):
    made, result = tmp_path / "a.mcap", tmp_path / "a.json"
    for command in (
        ["simulate", str(made), "--hours", "0.003", "--quiet"],
        ["analyse", str(made), "--json", str(result), "--quiet"],
    ):
        subprocess.run([sys.executable, "-c", ABSENT, *command], capture_output=True, check=True)
    assert '"oadev"' in result.read_text()


@pytest.mark.parametrize(
    ("command", "package"),
    [
        (["live", "sim", "--for", "1s", "--view", "none", "--out", "OUT"], "rerun-sdk"),
        (["replay", "MADE", "--view", "none", "--out", "OUT"], "rerun-sdk"),
        (["analyse", "MADE", "--quiet", "--report", "OUT"], "jinja2"),
    ],
)
def test_a_package_that_is_missing_is_named_with_the_command_that_installs_it(
    tmp_path, command, package
):
    out, made = tmp_path / "out", tmp_path / "a.mcap"
    assert main(["simulate", str(made), "--hours", "0.003", "--quiet"]) == ExitCode.DONE
    words = [{"OUT": str(out), "MADE": str(made)}.get(word, word) for word in command]
    ran = subprocess.run(
        [sys.executable, "-c", ABSENT, *words], capture_output=True, encoding="utf-8", check=False
    )
    assert ran.returncode == ExitCode.USAGE
    line = ran.stderr.strip().rpartition("\n")[2]
    assert line.startswith(
        f"allanscope: {command[0]} needs the package {package}, which is not installed: "
        f"python -m pip install '{package}"
    )
    assert not out.exists()
