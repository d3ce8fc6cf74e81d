"""The session: wiring, threads, shutdown, and what a run leaves behind."""
