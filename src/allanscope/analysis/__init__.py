"""The analysis: running sums of a stream, and the result that is made of them at any moment.

::

    StreamInfo ──▶ Analyser ─▶ StreamState ─┬▶ AllanBank, SpectrumBank   every sample
    Block, Gap     one for each             ├▶ History                   means of rows
    Notice         configuration            └▶ Clock, temperature

    Analyser ──▶ summarise ─┬▶ curves, noise, datasheet, effects ──▶ Analysis ─┬▶ to_dict: the JSON
                            └─ LoopInput: what the closed loop is given        └▶ verdict, wording

Taking samples is cheap and never ends; `summarise` reads the sums without changing them, coarsely
at each refresh (``live``) or with every estimator and the closed loop (``full``). `Analysis` is the
result for all who show it: terminal, viewer, report and JSON.

================================================ ===================================================
``analyser`` ``row_buffer`` ``logger_padding``   rows on their way to the sums; the sums of a stream
``summary`` ``result``                           from the sums to the result; the result as JSON
``curves`` ``model_curves``                      curves measured and fitted
``coefficients`` ``readings`` ``undisturbed``    N, B, K: of the model, read off curves, where quiet
``curve_limits``                                 B and K that the measured curve refutes
``datasheet`` ``comparison``                     against the datasheet, and an earlier session
``findings`` ``line_families`` ``combs``         effects of all axes that are one disturbance
``tracing``                                      where each finding comes from, by the next three
``line_origin`` ``direction`` ``coherence``      source of a line, direction, what axes share
``experiments``                                  which measurement would settle what is open
``together`` ``shared_lines``                    boards on one bench
``verdict_lines`` ``finding_phrases``            verdict and findings in words
``disagreement``                                 where model and reading are not the same
``remarks`` ``motion``                           what else must be known, that the board was moved
``wording`` ``notebook``                         single numbers in words; a notebook
================================================ ===================================================
"""

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.analysis.analyser import (
        FEWEST_ROWS,
        Analyser,
        AnalyserSettings,
        LoopInput,
        StreamState,
        loop_input,
    )
    from allanscope.analysis.comparison import Comparison, ReferenceCurve, read_reference
    from allanscope.analysis.direction import Direction, Motion
    from allanscope.analysis.experiments import measurements
    from allanscope.analysis.finding_phrases import cause_phrase, finding_phrase, share_text
    from allanscope.analysis.findings import UNEXPLAINED, Finding, findings_of, line_of
    from allanscope.analysis.line_origin import KnownSource, LineOrigin
    from allanscope.analysis.result import (
        SCHEMA,
        Analysis,
        AsOf,
        AxisAnalysis,
        Level,
        ModelCurve,
        Rate,
        Reading,
        event_dict,
    )
    from allanscope.analysis.shared_lines import RecordedLines, SharedLine, lines_in_both
    from allanscope.analysis.summary import Depth, search_processes, summarise, with_comparison
    from allanscope.analysis.together import (
        AlignedRecords,
        IndividualNoise,
        Separation,
        aligned,
        separate_units,
        separated,
    )
    from allanscope.analysis.undisturbed import Undisturbed
    from allanscope.analysis.verdict_lines import (
        NOTICEABLE_LOSS,
        Grade,
        Verdict,
        VerdictLine,
        verdict,
        was_searched,
    )
    from allanscope.analysis.wording import (
        as_of_text,
        best_text,
        clock_text,
        coefficient_text,
        coefficient_unit,
        density_verdict,
        effect_brief,
        effect_text,
        gaps_text,
        losses_phrase,
        losses_text,
        parameter_text,
        rate_text,
        recorded_text,
        shares_text,
        simulation_notice,
        wait_text,
    )

__all__ = [
    "FEWEST_ROWS",
    "NOTICEABLE_LOSS",
    "SCHEMA",
    "UNEXPLAINED",
    "AlignedRecords",
    "Analyser",
    "AnalyserSettings",
    "Analysis",
    "AsOf",
    "AxisAnalysis",
    "Comparison",
    "Depth",
    "Direction",
    "Finding",
    "Grade",
    "IndividualNoise",
    "KnownSource",
    "Level",
    "LineOrigin",
    "LoopInput",
    "ModelCurve",
    "Motion",
    "Rate",
    "Reading",
    "RecordedLines",
    "ReferenceCurve",
    "Separation",
    "SharedLine",
    "StreamState",
    "Undisturbed",
    "Verdict",
    "VerdictLine",
    "aligned",
    "as_of_text",
    "best_text",
    "cause_phrase",
    "clock_text",
    "coefficient_text",
    "coefficient_unit",
    "density_verdict",
    "effect_brief",
    "effect_text",
    "event_dict",
    "finding_phrase",
    "findings_of",
    "gaps_text",
    "line_of",
    "lines_in_both",
    "loop_input",
    "losses_phrase",
    "losses_text",
    "measurements",
    "parameter_text",
    "rate_text",
    "read_reference",
    "recorded_text",
    "search_processes",
    "separate_units",
    "separated",
    "share_text",
    "shares_text",
    "simulation_notice",
    "summarise",
    "verdict",
    "wait_text",
    "was_searched",
    "with_comparison",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "line_of": "findings",
        "lines_in_both": "shared_lines",
        "SharedLine": "shared_lines",
        "RecordedLines": "shared_lines",
        "separated": "together",
        "separate_units": "together",
        "aligned": "together",
        "Separation": "together",
        "IndividualNoise": "together",
        "AlignedRecords": "together",
        "FEWEST_ROWS": "analyser",
        "Analyser": "analyser",
        "AnalyserSettings": "analyser",
        "Analysis": "result",
        "AsOf": "result",
        "AxisAnalysis": "result",
        "Comparison": "comparison",
        "Depth": "summary",
        "ReferenceCurve": "comparison",
        "with_comparison": "summary",
        "read_reference": "comparison",
        "Finding": "findings",
        "Grade": "verdict_lines",
        "NOTICEABLE_LOSS": "verdict_lines",
        "Level": "result",
        "LoopInput": "analyser",
        "ModelCurve": "result",
        "Direction": "direction",
        "Motion": "direction",
        "KnownSource": "line_origin",
        "LineOrigin": "line_origin",
        "cause_phrase": "finding_phrases",
        "UNEXPLAINED": "findings",
        "Rate": "result",
        "Reading": "result",
        "SCHEMA": "result",
        "StreamState": "analyser",
        "Verdict": "verdict_lines",
        "VerdictLine": "verdict_lines",
        "as_of_text": "wording",
        "best_text": "wording",
        "clock_text": "wording",
        "coefficient_text": "wording",
        "coefficient_unit": "wording",
        "density_verdict": "wording",
        "effect_brief": "wording",
        "effect_text": "wording",
        "event_dict": "result",
        "finding_phrase": "finding_phrases",
        "share_text": "finding_phrases",
        "findings_of": "findings",
        "gaps_text": "wording",
        "loop_input": "analyser",
        "losses_phrase": "wording",
        "losses_text": "wording",
        "measurements": "experiments",
        "simulation_notice": "wording",
        "parameter_text": "wording",
        "rate_text": "wording",
        "recorded_text": "wording",
        "shares_text": "wording",
        "Undisturbed": "undisturbed",
        "was_searched": "verdict_lines",
        "search_processes": "summary",
        "summarise": "summary",
        "verdict": "verdict_lines",
        "wait_text": "wording",
    },
)
