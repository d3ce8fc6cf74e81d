"""Record the terminal of a live run as images/live.gif: ``python docs/animation.py``.

`allanscope live sim` runs in a terminal emulator (pyte, of `.[docs]`) for a minute; its screen is
drawn with Pillow every three seconds and played back ten times as fast. Linux and macOS.
"""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import sys
import tempfile
import termios
import time
from pathlib import Path

import pyte
from matplotlib import font_manager
from PIL import Image, ImageColor, ImageDraw, ImageFont

HERE = Path(__file__).resolve().parent
COMMAND = (
    "-m", "allanscope", "live", "sim", "--for", "60s", "--view", "none", "--seed", "3",
    "--out", "first",
    "--effect", "sinusoid:frequency=12.5,amplitude=0.02,axis=gy",
)  # fmt: skip
COLUMNS, ROWS = 100, 34
EVERY_S, FRAME_MS, LAST_MS = 3.0, 300, 4000
SIZE = 13
BACKGROUND, TEXT = "#101418", "#d8dee4"
COLOURS = {
    "black": "#5c6670", "red": "#ff7b72", "green": "#7ee787", "brown": "#e3b341",
    "blue": "#79c0ff", "magenta": "#d2a8ff", "cyan": "#76e3ea", "white": TEXT,
}  # fmt: skip
DOTS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))
"""Column and row of the dots of a braille pattern, in the order of its bits."""


def main() -> None:
    """Run the session and write the animation."""
    path = HERE / "images" / "live.gif"
    frames = recorded()
    used = {colour_of(cell) for frame in frames for line in frame for cell in line}
    colours = palette(used | {TEXT})
    pictures = [
        picture_of(frame).quantize(palette=colours, dither=Image.Dither.NONE) for frame in frames
    ]
    duration = [FRAME_MS] * (len(pictures) - 1) + [LAST_MS]
    pictures[0].save(
        path, save_all=True, append_images=pictures[1:], duration=duration, loop=0, optimize=True
    )
    print(f"{path.name}: {len(pictures)} frames, {path.stat().st_size / 1e3:.0f} kB")


def palette(used: set[str]) -> Image.Image:
    """Return the colours of the screen, in steps towards the background for smooth letters."""
    dark = ImageColor.getrgb(BACKGROUND)
    entries = [
        round(low + (high - low) * step / 8)
        for name in sorted(used)
        for step in range(9)
        for low, high in zip(dark, ImageColor.getrgb(name), strict=True)
    ]
    picture = Image.new("P", (1, 1))
    picture.putpalette(entries)
    return picture


def recorded() -> list[list[list[pyte.screens.Char]]]:
    """Return the screen every few seconds, and as the run left it."""
    with tempfile.TemporaryDirectory() as folder:
        child, terminal = pty.fork()
        if child == 0:
            os.environ.update(TERM="xterm-256color", COLORTERM="")
            os.chdir(folder)
            os.execv(sys.executable, (sys.executable, *COMMAND))
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        screen = pyte.Screen(COLUMNS, ROWS)
        stream, frames, due = pyte.ByteStream(screen), [], time.monotonic() + EVERY_S
        while True:
            if select.select([terminal], [], [], 0.2)[0]:
                try:
                    data = os.read(terminal, 1 << 16)
                except OSError:  # Linux says so at the end
                    break
                if not data:
                    break
                stream.feed(data)
            if time.monotonic() >= due:
                due += EVERY_S
                frames.append(cells_of(screen))
        os.waitpid(child, 0)
        return [*frames, cells_of(screen)]


def cells_of(screen: pyte.Screen) -> list[list[pyte.screens.Char]]:
    """Return a copy of what the screen shows."""
    return [[screen.buffer[row][column] for column in range(COLUMNS)] for row in range(ROWS)]


def colour_of(cell: pyte.screens.Char) -> str:
    """Return the colour of a letter: one of the sixteen by its name, or six hexadecimal digits."""
    named = COLOURS.get(cell.fg.removeprefix("bright"), TEXT)
    return f"#{cell.fg}" if len(cell.fg) == 6 and cell.fg not in COLOURS else named


def picture_of(cells: list[list[pyte.screens.Char]]) -> Image.Image:
    """Draw a screen; braille dots are drawn by hand, which few fonts have."""
    fonts = {
        bold: ImageFont.truetype(
            font_manager.findfont(
                font_manager.FontProperties(
                    family="DejaVu Sans Mono", weight="bold" if bold else "normal"
                )
            ),
            SIZE,
        )
        for bold in (False, True)
    }
    wide, high = round(fonts[False].getlength("0")), SIZE + 4
    picture = Image.new("RGB", (COLUMNS * wide + 16, ROWS * high + 16), BACKGROUND)
    draw = ImageDraw.Draw(picture)
    for row, line in enumerate(cells):
        for column, cell in enumerate(line):
            x, y = 8 + column * wide, 8 + row * high
            colour = colour_of(cell)
            pattern = ord(cell.data[:1] or " ") - 0x2800
            if 0 <= pattern < 256:
                for bit, (right, down) in enumerate(DOTS):
                    if pattern >> bit & 1:
                        left, top = x + 1 + right * wide // 2, y + 1 + down * high // 4
                        draw.rectangle((left, top, left + 1, top + 1), fill=colour)
            elif cell.data.strip():
                draw.text((x, y), cell.data, fill=colour, font=fonts[cell.bold])
    return picture


if __name__ == "__main__":
    main()
