"""The JSON result against its schema, which is part of the contract."""

import copy
import json
import math
from importlib.resources import files

import jsonschema
import numpy as np
import pytest

from allanscope import AXES, SCHEMA, analyse
from allanscope.__main__ import main
from allanscope.allan.choices import KINDS
from allanscope.allan.estimators import REGISTRY
from allanscope.analysis import Analyser, summarise
from allanscope.explain.effects import VOCABULARY
from allanscope.samples import Block, StreamInfo, Ticks
from allanscope.wire import LinkStats


def closed(schema):
    """Return a schema that refuses keys it does not describe: every key is to be documented."""
    if isinstance(schema, dict):
        schema = {key: closed(value) for key, value in schema.items()}
        if "properties" in schema and isinstance(schema["properties"], dict):
            schema.setdefault("additionalProperties", False)
    return [closed(one) for one in schema] if isinstance(schema, list) else schema


SCHEMA_FILE = files("allanscope.analysis").joinpath("result.schema.json")
PUBLISHED = json.loads(SCHEMA_FILE.read_text("utf-8"))
CLOSED = closed(PUBLISHED)
CLOSED["$defs"]["effect"]["properties"]["kind"]["enum"] = sorted(VOCABULARY)
STRICT = jsonschema.Draft202012Validator(CLOSED)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("schema")


@pytest.fixture(scope="module")
def live(folder):
    """Return the result of a live session with a lossy link."""
    out = folder / "live"
    fault = "byte_loss:rate=0.002,length=8"
    options = ["--for", "4s", "--view", "none", "--fault", fault, "--quiet"]
    assert main(["live", "sim", "--out", str(out), *options]) == 0
    return read(out / "result.json")


def read(path):
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


def test_the_schema_itself_is_sound():
    jsonschema.Draft202012Validator.check_schema(PUBLISHED)
    assert PUBLISHED["properties"]["schema"]["const"] == SCHEMA


def test_the_words_of_the_schema_are_those_of_the_program():
    axis = PUBLISHED["$defs"]["axis"]["properties"]
    assert set(axis["curves"]["propertyNames"]["enum"]) == set(REGISTRY) == set(KINDS)
    assert set(PUBLISHED["properties"]["axes"]["propertyNames"]["enum"]) == set(AXES)


def test_a_live_lossy_session(live):
    STRICT.validate(live)
    assert live["lost_samples"] > 0
    assert live["segments"] > 1
    assert set(live["link"]) >= {
        "bytes",
        "frames",
        "crc_errors",
        "resyncs",
        "suspect",
        "reconnects",
    }


def test_a_replay_of_it(live, folder):
    out = folder / "replay"
    arguments = ["replay", str(folder / "live"), "--view", "none", "--quiet", "--out", str(out)]
    assert main(arguments) == 0
    result = read(out / "result.json")
    STRICT.validate(result)
    assert result["samples"] == live["samples"]


def test_an_analysis_of_it(live, folder):
    out = folder / "analysis.json"
    assert main(["analyse", str(folder / "live"), "--json", str(out), "--quiet"]) == 0
    result = read(out)
    STRICT.validate(result)
    assert result["lost_samples"] == live["lost_samples"]


def test_a_clean_minute_and_one_with_a_line():
    clean, tone = 0.05 * np.random.default_rng(8).standard_normal((2, 7000))
    tone += 0.05 * np.sin(0.31 * np.arange(7000))
    result = analyse({"gx": clean, "gy": tone}, 104.0).to_dict()
    STRICT.validate(plain(result))
    assert result["axes"]["gx"]["effects"] == []
    assert result["axes"]["gy"]["effects"][0]["kind"] == "sinusoid"


@pytest.mark.parametrize("rows", [1, 2, 3, 63, 64, 200])
def test_the_shortest_records_have_every_key(rows):
    result = analyse({"gx": np.arange(rows) % 7, "az": np.zeros(rows)}, 104.0).to_dict()
    STRICT.validate(plain(result))
    axis = result["axes"]["gx"]
    assert set(axis["coefficients"]) == set("NBKQR")
    assert axis["datasheet"]["density"]["verdict"] == "not compared"
    assert axis["residual"]["before"]["chi2_per_dof"] is None


def test_a_constant_axis_is_no_special_case():
    result = analyse(np.ones((8000, 2)), 104.0, axes=("ax", "az")).to_dict()
    STRICT.validate(plain(result))


def test_a_step_that_hides_the_noise():
    counts = np.rint(np.random.default_rng(9).normal(0.3, 0.25, 8000)).astype(np.int16)
    result = analyse({"gx": counts}, 104.0, part="LSM6DSM", gyro_fs=2000.0).to_dict()
    STRICT.validate(plain(result))
    assert result["axes"]["gx"]["datasheet"]["density"]["verdict"] == "hidden by the step"


def test_a_part_of_another_name():
    info = StreamInfo(("gx",), (8.75e-3,), 104.0, part="LSM6DSO", wire="native")
    analyser = Analyser()
    analyser.feed(info)
    analyser.feed(Block(0, np.arange(200, dtype=np.int16)[:, np.newaxis] % 7, Ticks.none()))
    result = summarise(analyser, LinkStats(), "full", {"name": "arrays", "wire": "native"})
    STRICT.validate(plain(result.to_dict()))
    assert result.part == "LSM6DSO"


def test_what_the_schema_would_catch(live):
    for damage in (
        lambda r: r.pop("rate"),
        lambda r: r["axes"]["gx"].pop("residual"),
        lambda r: r["axes"]["gx"]["coefficients"]["N"].pop("lower"),
        lambda r: r["axes"]["gx"]["coefficients"].update(N=0.1),
        lambda r: r["axes"]["gx"]["curves"]["oadev"].update(tau=["1"]),
        lambda r: r["axes"]["gx"].update(surprise=1),
        lambda r: r["axes"].update(mx=r["axes"]["gx"]),
        lambda r: r.update(samples=1.5),
        lambda r: r.update(schema="allanscope/2"),
    ):
        result = copy.deepcopy(live)
        damage(result)
        with pytest.raises(jsonschema.ValidationError):
            STRICT.validate(result)


def test_later_versions_may_add_keys(live):
    jsonschema.Draft202012Validator(PUBLISHED).validate({**live, "tomorrow": 1})


def plain(result):
    """Return the result as a reader of the file gets it, after a look for what JSON cannot hold."""
    stack = [result]
    while stack:
        one = stack.pop()
        assert not (isinstance(one, float) and not math.isfinite(one))
        assert type(one).__module__ == "builtins"
        stack += one.values() if isinstance(one, dict) else one if isinstance(one, list) else []
    return json.loads(json.dumps(result, allow_nan=False))
