"""A browser without a window, to see pages as a user would."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["browser_command", "drawn", "pdf_of", "picture_of", "why_no_browser"]

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_GRAPHICS = (
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--remote-debugging-port=0",
)
_DARK = "--blink-settings=preferredColorScheme=0"


def why_no_browser() -> str:
    """Return why no page can be looked at here, or an empty text."""
    return "" if _program() else "no browser is installed (on Debian: chromium)"


def browser_command(profile: Path, *options: str) -> list[str]:
    """Return the command that runs the browser without a window, a sandbox, or any habit."""
    return [
        _program(),
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--disable-extensions",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-first-run",
        "--hide-scrollbars",
        f"--user-data-dir={profile}",
        *options,
    ]


@contextmanager
def drawn(address: str, folder: Path, *options: str) -> Iterator[None]:
    """Keep a page open that is drawn without a graphics card."""
    browser = subprocess.Popen(
        browser_command(folder / "profile", *_GRAPHICS, *options, address),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "HOME": str(folder)},
    )
    try:
        yield
    finally:
        browser.terminate()
        browser.wait(20)


def picture_of(page: Path, folder: Path, size: str, dark: bool = False) -> NDArray[np.uint8]:
    """Return a page as it is shown, shape (height, width, 3)."""
    out = folder / "page.png"
    options = ["--disable-gpu", f"--window-size={size}", f"--screenshot={out}"]
    _run(folder, *options, *([_DARK] if dark else []), page.as_uri())
    with Image.open(out) as image:
        return np.asarray(image.convert("RGB"))


def pdf_of(page: Path, folder: Path) -> bytes:
    """Return a page as it is printed."""
    out = folder / "page.pdf"
    _run(folder, "--disable-gpu", "--no-pdf-header-footer", f"--print-to-pdf={out}", page.as_uri())
    return out.read_bytes()


def _run(folder: Path, *options: str) -> None:
    subprocess.run(
        browser_command(folder / "profile", *options),
        env={**os.environ, "HOME": str(folder)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=90,
        check=True,
    )


def _program() -> str:
    return next((path for name in _NAMES if (path := shutil.which(name))), "")
