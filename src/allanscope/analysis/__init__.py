"""The analysis: running sums of a stream, and the result that is made of them at any moment.

::

    StreamInfo ──▶ Analyser ─▶ StreamState ─┬▶ AllanBank, SpectrumBank   every sample
    Block, Gap     one for each             ├▶ History                   means of rows
    Notice         configuration            └▶ Clock, temperature

    Analyser ──▶ summarise ─┬▶ curves, noise, datasheet, effects ──▶ Analysis ─┬▶ to_dict: the JSON
                            └─ look: what the closed loop is given             └▶ verdict, wording

Taking samples is cheap and never ends; `summarise` reads the sums without changing them, coarsely
at each refresh (``live``) or with every estimator and the closed loop (``full``). `Analysis` is the
result for all who show it: terminal, viewer, report and JSON. `verdict` and `wording` put it into
the words that they share.
"""
