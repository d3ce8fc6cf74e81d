"""The pipeline: the other rooms wired together, with the threads, the shutdown and the files.

::

    live, replay   source ─▶ Session ─┬▶ Recorder                 session, inbox, signals
                                      ├▶ Decoding ─▶ Analyser     decoding
                                      └▶ refresh ─▶ audience      refreshing, looking (a child)

    analyse        file ─▶ ahead: decode ─▶ Analyser ─▶ Analysis  analyse, replaying, ahead
    Python         arrays ─▶ events ──────▶ Analyser ─▶ Analysis  analysing, columns, arrays
                   port ───▶ open_stream ─▶ Block, Gap            stream

A function here is what a command of the same name calls: `live` (with replays and `resuming`),
`analyse`, `check`, `convert` (import and export), `simulate`. `outputs` writes what a run leaves
behind. Whichever way samples come, they pass the same decoder and the same sums, so that no two
ways can disagree.
"""
