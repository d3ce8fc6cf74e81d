"""From samples to a result: the streaming analyser and what it returns."""
