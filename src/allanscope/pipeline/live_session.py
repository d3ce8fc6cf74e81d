"""`live` for Python: a session in the background, whose result can be looked at while it grows."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import replace
from html import escape
from pathlib import Path
from types import TracebackType
from typing import Self

from allanscope.analysis import Analysis
from allanscope.pipeline.outputs import write_results
from allanscope.pipeline.refreshing import IN_VIEWER
from allanscope.pipeline.run import OpenSession, close_recorder, open_session
from allanscope.pipeline.settings import DeviceSettings, SessionSettings, SimulatedSettings
from allanscope.pipeline.stream import no_samples_error
from allanscope.quantities import duration
from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.sources import require_port

__all__ = ["LiveSession", "live"]


class LiveSession:
    """A device that is measured and recorded in the background; made by `live`.

    The device is stopped, the final result computed, and the report written when the ``with`` block
    ends. A notebook shows the session as its newest result.

    Parameters
    ----------
    opened : OpenSession
        Device and recording, ready to run.
    """

    def __init__(self, opened: OpenSession) -> None:
        self._session, self._recorder, self.folder, _ = opened
        self._newest = _NewestResult()
        self._session.listeners = (self._newest,)
        self._error: BaseException | None = None
        self._ended = threading.Event()
        self._final: Analysis | None = None
        self._thread = threading.Thread(target=self._run, name="session", daemon=True)
        self._thread.start()

    @property
    def result(self) -> Analysis:
        """The newest result; waits for the first one, a second or two after the first sample.

        Raises
        ------
        DeviceError
            When no sample came, or the device was lost for good.
        InputError
            When what comes is in no known format.
        """
        if self._final is not None:
            return self._final
        while not self._newest.has_result.wait(0.1):
            if self._ended.is_set():
                break
        if self._error is not None:
            raise self._error
        if self._newest.newest is None:
            raise no_samples_error(self._session.source)
        return self._newest.newest

    @property
    def notices(self) -> tuple[str, ...]:
        """What was reported so far: events, remarks of the device, failures."""
        return tuple(self._newest.notices)

    def wait(self, seconds: float) -> Analysis:
        """Measure for so long, or until the session ends; return the newest result."""
        self._ended.wait(seconds)
        return self.result

    def mark(self, text: str) -> None:
        """Set a mark at the present moment, as the key ``m`` does in a terminal."""
        self._session.mark(text)

    def close(self) -> Analysis:
        """Stop the device, compute the final result, and write what is kept.

        Raises
        ------
        DeviceError, InputError
            As `result`.
        """
        if self._final is None:
            self._session.stop()
            self._thread.join()
            close_recorder(self._recorder, self._session)
            self._session.emit_notices(time.monotonic_ns())
            if self._error is not None:
                raise self._error
            final = self._session.result("full")
            if not final.samples:
                raise no_samples_error(self._session.source)
            written = write_results(final, self.folder)
            self._final = replace(final, failures=(*final.failures, *written.failures))
        return self._final

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
            return
        with suppress(Exception):  # the error of the block is the one to be told
            self.close()

    def __repr__(self) -> str:
        """Return what is measured, and for how long it has been."""
        newest = self._final or self._newest.newest
        state = "ended" if self._ended.is_set() else "running"
        length = duration(newest.duration_s) if newest is not None else "no result yet"
        return f"<LiveSession {self._session.source.name}: {state}, {length}>"

    def _repr_html_(self) -> str:
        newest = self._final or self._newest.newest
        if newest is None:
            return f"<p>{escape(self._session.source.name)}: no result yet</p>"
        state = "ended" if self._ended.is_set() else "running"
        head = f"{self._session.source.name}: {state}, {duration(newest.duration_s)}"
        return f"<p>{escape(head)}</p>{newest._repr_html_()}"

    def _run(self) -> None:
        try:
            self._session.run()
        except BaseException as error:
            self._error = error
        self._ended.set()


class _NewestResult:
    """Keeps the newest result of a session, and what was reported."""

    def __init__(self) -> None:
        self.newest: Analysis | None = None
        self.has_result = threading.Event()
        self.notices: list[str] = []

    def info(self, info: StreamInfo) -> None:
        """Nothing is shown of it: the result says what the samples mean."""

    def samples(self, info: StreamInfo, block: Block) -> None:
        """Nothing is shown of them."""

    def gap(self, gap: Gap) -> None:
        """Nothing is shown of it: the result counts the losses."""

    def notice(self, notice: Notice) -> None:
        """Keep what is meant to be read."""
        if notice.kind != "status":
            self.notices.append(notice.text)

    def snapshot(self, analysis: Analysis) -> None:
        """Keep the result."""
        self.newest = analysis
        self.has_result.set()


def live(
    port: str = "auto",
    *,
    part: str = "",
    rate: float | None = None,
    gyro_fs: float | None = None,
    accel_fs: float | None = None,
    wire: str = "",
    duration_s: float | None = None,
    out: Path | str | None = None,
) -> LiveSession:
    """Measure a device in the background, as ``allanscope live`` does without a viewer.

    Parameters
    ----------
    port : str
        A device path, a pyserial URL, ``auto`` (the board that is plugged in) or ``sim``.
    part : str
        LSM6DS3H, LSM6DSL or LSM6DSM, where the stream does not say.
    rate, gyro_fs, accel_fs : float, optional
        Nominal rate in Hz, full scales in dps and g.
    wire : str
        Wire format; detected if not given.
    duration_s : float, optional
        Stop this long after the first byte; otherwise at the end of the ``with`` block.
    out : str or Path, optional
        Folder for recording, result and report; by default a new one, named after time and device.

    Returns
    -------
    LiveSession
        A context manager with the newest `result`.

    Raises
    ------
    DeviceError
        When the port cannot be opened.
    UsageError
        For a part, a full scale or a wire format that does not exist.

    Examples
    --------
    ::

        with allanscope.live("auto", part="LSM6DSM") as session:
            session.wait(60.0).plot()
        session.result  # the final one
    """
    device = DeviceSettings(part=part, rate_hz=rate, gyro_fs=gyro_fs, accel_fs=accel_fs, wire=wire)
    require_port(port)
    settings = SessionSettings(
        out=None if out is None else Path(out), view="none", quiet=True, duration_s=duration_s
    )
    return LiveSession(open_session(port, device, settings, SimulatedSettings(), IN_VIEWER))
