"""What tests of several modules share: made-up data, doubles of devices and screens, processes.

The folder ``tests`` is on the path of pytest (``pythonpath`` in pyproject.toml), so that a test
writes ``from support.serving import serving``, whichever folder it is in.
"""
