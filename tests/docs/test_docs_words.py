"""One name for one thing: words that people read stand once, and replaced phrases stay away."""

import ast
import re
from pathlib import Path

import pytest

from allanscope import labels

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "src" / "allanscope"
READ = [
    *SOURCES.rglob("*.py"),
    *SOURCES.rglob("*.j2"),
    *SOURCES.rglob("*.json"),
    *ROOT.glob("docs/**/*.md"),
    *ROOT.glob("*.md"),
]

REPLACED = {
    "as the datasheet says": "Noise matches the datasheet",
    "more than noise was found": "Additional effects found",
    "not all of it explained": "Partly unexplained",
    "to know them to": "Keep recording: B to ±20 % in about 10 min",
    "in 1 stretches": "37 026, no gaps",
    "measuring has ended": "Recording stopped; running the final analysis",
    "is worked out in full": "running the final analysis",
    "kept in first": "Saved: first/report.html",
    "nats above the noise": "log-likelihood gain 797",
    "is what sampling error leaves": "The residual is consistent with sampling error",
    "cannot show it twice": "Seen once; confirm with a second recording",
    "nobody thought of": "internal error",
    "let go of what rests": "trim memory",
    "nothing was heard": "no samples received",
    "lost none": "Lost samples: none",
    "no samples lost": "Lost samples: none",
    "arrivals ±": "arrival jitter 0.31 ms",
    "taken as lsb": "counts (lsb) assumed",
    "searched, see below": "not searched, with the reason once",
    "was taken there": "the upper limit is given instead",
    "only limited from above": "only an upper limit is known",
    "carries no noise": "constant: no noise to measure",
    "less than its search costs": "the log-likelihood gain is below the penalty",
    "corrected for having been detected": "size corrected for selection bias",
    "would have been found": "detection limits: line ..., step ...",
    "% without a name": "% in unnamed effects",
    "single runs have against": "remarks on single runs",
    "as if the computer read late": "perhaps because the computer reads late",
    "what rest cannot tell": "not in this bound, as a record at rest does not show them",
    "takes another:": "selects another:",
    "never said what": "no descriptor of its counts",
    "are no longer kept": "charts are no longer saved",
}
"""Phrases that readers stumbled over, and what is said instead."""

LABELS = {
    *labels.KIND_NAMES.values(),
    *labels.MODEL_ERRORS.values(),
    labels.HELD_OUT,
    labels.EXCESS,
    labels.MINIMUM,
    labels.OTHER_UNITS,
    labels.WAIT,
}


@pytest.mark.parametrize("phrase", REPLACED)
def test_a_replaced_phrase_is_nowhere(phrase):
    pattern = re.compile(r"\s+".join(map(re.escape, phrase.split())), re.IGNORECASE)
    found = [
        str(path.relative_to(ROOT)) for path in READ if pattern.search(path.read_text("utf-8"))
    ]
    assert not found, f"say: {REPLACED[phrase]}"


def literals(text):
    """Return the strings of a module that are no docstrings."""
    tree = ast.parse(text)
    plain = {id(one.value) for one in ast.walk(tree) if isinstance(one, ast.Expr)}
    return [
        one.value
        for one in ast.walk(tree)
        if isinstance(one, ast.Constant) and isinstance(one.value, str) and id(one) not in plain
    ]


def test_a_label_is_written_once():
    simulated = SOURCES / "simulator"  # another program, which shares no words on purpose
    twice = [
        (str(path.relative_to(SOURCES)), text)
        for path in SOURCES.rglob("*.py")
        if path.name != "labels.py" and simulated not in path.parents
        for text in literals(path.read_text("utf-8"))
        if text in LABELS
    ]
    assert not twice, "take it from labels.py"


def test_a_label_that_is_repeated_would_be_seen():
    assert literals('"""minimum deviation"""\nHEAD = "minimum deviation"') == ["minimum deviation"]
