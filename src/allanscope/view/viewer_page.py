"""The page of the web viewer, served so that a browser fetches nothing from anywhere else.

Rerun serves the page itself, but its page asks other hosts for a font, for the latest release and
whether it may report its use. Here the page is fetched from Rerun's server and passed on without
the links to other hosts, with a policy by which the browser refuses every other request that leaves
the page and its data::

    browser ─▶ WebPage (PORT) ─▶ rerun --serve-web
       └─────▶ data (PORT + 1)
"""

from __future__ import annotations

import http.client
import re
import threading
import time
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from allanscope.view.viewer_process import LOOPBACK, port_in_use

__all__ = ["WebPage", "policy", "without_links"]

_PIECE = 1 << 16
_STARTS_WITHIN_S = 20.0
_LENGTHS = ("Content-Length", "rerun-final-length")
_PASSED_ON = ("Content-Type", "Content-Encoding", *_LENGTHS)
_LINK = re.compile(rb"<link\b[^>]*\bhref=\"https?://[^>]*>", re.IGNORECASE)


class WebPage:
    """Serves the page in threads of its own until it is closed.

    Parameters
    ----------
    port : int
        Where, on the loopback interface; 0 for any free port.
    original : int
        Port of Rerun's own server of the page.
    data : int
        Port from which the page may fetch the data.

    Attributes
    ----------
    port : int
        Where the page is served.

    Raises
    ------
    UsageError
        When the port is taken.
    """

    def __init__(self, port: int, original: int, data: int) -> None:
        class Handler(_Handler):
            rerun = original
            allowed = policy(data)

        try:
            self._server = ThreadingHTTPServer((LOOPBACK, port), Handler)
        except OSError as error:
            raise port_in_use(port, error) from None
        self.port = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name="web-page", daemon=True).start()

    def close(self) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()


def policy(data: int) -> str:
    """Return the Content-Security-Policy: this page, its data, and nothing else."""
    return "; ".join(
        (
            "default-src 'none'",
            "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'",
            "style-src 'self' 'unsafe-inline'",
            "img-src 'self' data: blob:",
            "font-src 'self' data:",
            f"connect-src 'self' http://{LOOPBACK}:{data}",
            "worker-src 'self' blob:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )


def without_links(page: bytes) -> bytes:
    """Return a page without its links to other hosts.

    The policy does not cover them all: a browser connects ahead to what ``preconnect`` names.

    Examples
    --------
    >>> without_links(b'<link rel="preconnect" href="https://fonts.gstatic.com" /><p>')
    b'<p>'
    """
    return _LINK.sub(b"", page)


class _Handler(BaseHTTPRequestHandler):
    """Passes on what Rerun's server of the page has."""

    rerun = 0
    allowed = ""

    def do_GET(self) -> None:
        """Answer with the page, or with a file that belongs to it."""
        try:
            self._forward()
        except (OSError, http.client.HTTPException):
            self.close_connection = True  # the browser has gone, or the viewer has ended

    def log_message(self, *_: object) -> None:
        """Say nothing: the terminal belongs to the measurement."""

    def _forward(self) -> None:
        is_page = self.path.partition("?")[0] in ("/", "/index.html")
        encodings = "identity" if is_page else self.headers.get("Accept-Encoding", "identity")
        with closing(self._asked(encodings)) as connection:
            answer = connection.getresponse()
            headers = {name: answer.headers[name] for name in _PASSED_ON if name in answer.headers}
            first = without_links(answer.read()) if is_page else b""
            if is_page:
                headers |= dict.fromkeys(_LENGTHS, str(len(first)))
            self.send_response(answer.status)
            self.send_header("Content-Security-Policy", self.allowed)
            self.send_header("Referrer-Policy", "no-referrer")
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(first)
            while piece := answer.read(_PIECE):
                self.wfile.write(piece)

    def _asked(self, encodings: str) -> http.client.HTTPConnection:
        """Return a connection to Rerun's server, which takes a moment to start, that was asked."""
        end = time.monotonic() + _STARTS_WITHIN_S
        while True:
            connection = http.client.HTTPConnection(LOOPBACK, self.rerun, timeout=_STARTS_WITHIN_S)
            try:
                connection.request("GET", self.path, headers={"Accept-Encoding": encodings})
            except ConnectionRefusedError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)
            else:
                return connection
