"""Blind benchmark of the closed loop: undeclared effects in records the loop has never seen.

    python benchmarks/blind.py --records 40 --seed 1 [--json FILE] [--hours 2] [--rate 104]
                               [--keep FOLDER]

With ``--keep`` the outcome of every record is kept in a file of its own: a run can be interrupted,
continued and extended, and another process can work on it with ``--first``.

Every record has six axes with noise of its own; zero, one or two effects are hidden in it (see
``blind_generator.py``, which shares nothing with the simulator). Scored are: the kind; parameters
within their 95 % intervals; effects claimed on axes that have none; processes that no word of the
vocabulary names (the right answer is ``unexplained``, of a tone that moves also ``drifting_line``);
and the error that is left, on other runs of the same device, against that of an oracle who is told
what was hidden (``blind_oracle.py``).
"""

from __future__ import annotations

import argparse
import json
import pickle
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import blind_generator as generator
import numpy as np
from blind_effects import MOVING, OUTSIDE, Truth
from blind_oracle import Errors, errors_of

from allanscope.explain import Effect, explain

Cell = tuple[str, str]
_SKIPPED = ("intervals",)
"""Parameters whose truth is a matter of definition."""


@dataclass(frozen=True)
class Outcome:
    """What was hidden in one record, what was found, and at which cost."""

    truths: tuple[Truth, ...]
    axes: tuple[str, ...]
    found: dict[str, tuple[Effect, ...]]
    errors: dict[str, Errors]
    seconds: float


@dataclass
class Score:
    """Counts over all records."""

    right: Counter[Cell] = field(default_factory=Counter)
    equivalent: Counter[Cell] = field(default_factory=Counter)
    asked: Counter[Cell] = field(default_factory=Counter)
    answers: dict[Cell, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    inside: Counter[str] = field(default_factory=Counter)
    parameters: Counter[str] = field(default_factory=Counter)
    clean_axes: int = 0
    false: list[str] = field(default_factory=list)
    extra: list[str] = field(default_factory=list)
    both_ways: int = 0
    errors: dict[Cell, list[Errors]] = field(default_factory=lambda: defaultdict(list))
    seconds: list[float] = field(default_factory=list)


def judge(outcome: Outcome, score: Score, tag: str) -> None:
    """Compare what was found with what was hidden."""
    found = outcome.found
    touched = {truth.axis for truth in outcome.truths}
    everywhere = {truth.kind for truth in outcome.truths if not truth.axis}
    for truth in outcome.truths:
        axis = truth.axis or outcome.axes[0]
        cell = (truth.kind, truth.level)
        score.asked[cell] += 1
        kinds = [e.kind for e in found[axis]]
        score.answers[cell]["+".join(sorted(kinds)) or "nothing"] += 1
        if truth.kind in OUTSIDE:
            names = {"unexplained"} | ({"drifting_line"} if truth.kind in MOVING else set())
            wrong = [k for k in kinds if k not in names and k not in everywhere]
            score.right[cell] += bool(names & set(kinds)) and not wrong
            continue
        match = [e for e in found[axis] if e.kind == truth.kind]
        score.right[cell] += bool(match)
        score.equivalent[cell] += bool(match) or any(
            truth.kind in e.equivalent for e in found[axis]
        )
        extras = [k for k in kinds if k != truth.kind and k not in everywhere]
        if extras and truth.axis and match:
            score.extra.append(f"{tag} {axis} {truth.kind}/{truth.level}: also {extras}")
        if match:
            _parameters(truth, match[0], score)
    coupled = {str(truth.parameters.get("source", "")): truth.axis for truth in outcome.truths}
    for axis, effects in found.items():
        if axis in touched:
            continue
        own = [e for e in effects if e.kind not in everywhere]
        back = [e for e in own if _is_other_way_round(e, coupled.get(axis, ""))]
        score.both_ways += len(back)
        score.clean_axes += not back
        score.false += [f"{tag} {axis} {e.kind}" for e in own if e not in back]


def _is_other_way_round(effect: Effect, coupled: str) -> bool:
    """Tell whether an effect is a coupling that was hidden, read from its source."""
    return (
        effect.kind == "cross_coupling"
        and effect.parameters["source"].value == coupled
        and len(effect.axes) == 2
    )


def _parameters(truth: Truth, effect: Effect, score: Score) -> None:
    for name, value in truth.parameters.items():
        if name in _SKIPPED or name not in effect.parameters:
            continue
        parameter = effect.parameters[name]
        key = f"{truth.kind}.{name}"
        score.parameters[key] += 1
        if isinstance(value, str):
            score.inside[key] += parameter.value == value
        elif parameter.lower is not None and parameter.upper is not None:
            score.inside[key] += bool(parameter.lower <= value <= parameter.upper)


def run(arguments: argparse.Namespace) -> Score:
    """Make and explain the records, or take what was kept of them."""
    score = Score()
    for index in range(arguments.first, arguments.first + arguments.records):
        name = f"{arguments.seed}-{index}-{arguments.hours:g}h-{arguments.rate:g}Hz.pickle"
        kept = arguments.keep / name if arguments.keep else None
        if kept and kept.exists():
            outcome = pickle.loads(kept.read_bytes())
        else:
            outcome = measure(arguments.seed, index, arguments.hours, arguments.rate)
            if kept:
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_bytes(pickle.dumps(outcome))
        score.seconds.append(outcome.seconds)
        for truth in outcome.truths:
            if truth.kind in outcome.errors:
                score.errors[truth.kind, truth.level].append(outcome.errors[truth.kind])
        judge(outcome, score, f"#{index}")
        if not arguments.quiet:
            named = {a: [e.kind for e in es] for a, es in outcome.found.items() if es}
            hidden = [(t.kind, t.level, t.axis) for t in outcome.truths]
            ratios = {kind: round(e.loop / e.oracle, 3) for kind, e in outcome.errors.items()}
            print(
                f"#{index} {outcome.seconds:.1f} s hidden {hidden} found {named} "
                f"error over oracle {ratios}",
                flush=True,
            )
    return score


def measure(seed: int, index: int, hours: float, rate: float) -> Outcome:
    """Make one record and explain it."""
    kinds = generator.draw_kinds(np.random.default_rng([seed, index]), index)
    blind = generator.make_blind(1000 * seed + index, kinds, hours, rate)
    began = time.process_time()
    result = explain(blind.record, nominal_hz=blind.nominal_hz, rate_fit=blind.rate_fit)
    seconds = time.process_time() - began
    errors = {
        truth.kind: errors_of(blind, result, truth, seed=1000 * seed + index)
        for truth in blind.truths
    }
    return Outcome(
        truths=tuple(replace(t, signal=None, again=None) for t in blind.truths),
        axes=blind.record.axes,
        found={axis: e.effects for axis, e in result.axes.items()},
        errors={kind: own for kind, own in errors.items() if own is not None},
        seconds=seconds,
    )


def table(score: Score) -> str:
    """Return the result for people."""
    lines = ["kind                 level   n  right  or equivalent  error/oracle  answers"]
    for cell in sorted(score.asked):
        n = score.asked[cell]
        answers = ", ".join(f"{k} {v}" for k, v in score.answers[cell].most_common(4))
        own = [e.loop / e.oracle for e in score.errors[cell]]
        errors = f"{np.median(own):.2f} to {max(own):.2f}" if own else ""
        lines.append(
            f"{cell[0]:20s} {cell[1]:6s} {n:3d} {100 * score.right[cell] / n:5.0f}% "
            f"{100 * max(score.equivalent[cell], score.right[cell]) / n:8.0f}%       "
            f"{errors:13s}  {answers}"
        )
    lines.append("\nparameter within its 95 % interval")
    for key in sorted(score.parameters):
        lines.append(f"  {key:32s} {score.inside[key]:3d} of {score.parameters[key]}")
    summary = totals(score)
    lines.append("")
    lines += [f"{key}: {value}" for key, value in summary.items()]
    lines += [f"  false: {text}" for text in score.false]
    lines += [f"  extra: {text}" for text in score.extra]
    return "\n".join(lines)


def totals(score: Score) -> dict[str, Any]:
    """Return the figures against the goals."""
    out: dict[str, Any] = {}
    for level in ("near", "above"):
        cells = [c for c in score.asked if c[1] == level and c[0] not in OUTSIDE]
        asked = sum(score.asked[c] for c in cells)
        if asked:
            out[f"right_{level}_percent"] = round(
                100 * sum(score.right[c] for c in cells) / asked, 1
            )
            out[f"right_or_equivalent_{level}_percent"] = round(
                100 * sum(score.equivalent[c] for c in cells) / asked, 1
            )
    cells = [c for c in score.asked if c[0] in OUTSIDE]
    if cells:
        asked = sum(score.asked[c] for c in cells)
        out["outside_right_percent"] = round(100 * sum(score.right[c] for c in cells) / asked, 1)
    total = sum(score.parameters.values())
    if total:
        out["parameters_inside_percent"] = round(100 * sum(score.inside.values()) / total, 1)
    out["clean_axes"] = score.clean_axes
    out["false_effects"] = len(score.false)
    out["couplings_named_both_ways"] = score.both_ways
    if score.seconds:
        out["cpu_seconds_a_record"] = round(float(np.mean(score.seconds)), 1)
    for level in ("near", "above"):
        errors = [e for cell, own in score.errors.items() if cell[1] == level for e in own]
        for whom in ("oracle", "omniscient"):
            ratios = np.array([e.loop / getattr(e, whom) for e in errors])
            if len(ratios):
                out[f"error_over_{whom}_{level}_median"] = round(float(np.median(ratios)), 3)
                out[f"error_within_5_percent_of_{whom}_{level}_percent"] = round(
                    100 * float(np.mean(ratios < 1.05)), 1
                )
    return out


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--records", type=int, default=18)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--rate", type=float, default=104.0)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", type=argparse.FileType("w"))
    parser.add_argument("--quiet", action="store_true")
    arguments = parser.parse_args()
    score = run(arguments)
    print(table(score))
    if arguments.json:
        json.dump(totals(score), arguments.json, indent=1)


if __name__ == "__main__":
    main()
