"""What is computed here and now, against what is certified; and the record of it."""

from __future__ import annotations

import hashlib
import json
import math
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan import AllanBank, deviation
from allanscope.allan.cascade import lags_of_level
from allanscope.allan.kernels import COLUMNS
from allanscope.pipeline import analyse
from allanscope.quantities import TWO_SIDED_95
from allanscope.recording import Chunk, Recording, SessionWriter, recover
from allanscope.samples import AXES, Block, Gap, StreamInfo, Ticks
from allanscope.sanitize import sanitize
from allanscope.spectrum import SEGMENT, SpectrumBank
from allanscope.verify import certified

__all__ = ["CHECKS", "Check", "Value", "table_lines", "to_json", "verify"]

ALL_BITS = 17.0
"""Digits of a double that is the same to the last bit."""


EXACT = 12.0
_WHOLE = 2**51
"""Below it a double holds quarters of whole numbers."""

_WIDE = 3.5
"""Standard uncertainties from the truth that are allowed: by chance, one value in two thousand."""


@dataclass(frozen=True, slots=True)
class Value:
    """One number against its certified value.

    Attributes
    ----------
    what : str
        What the number is.
    expected, found : float
        Certified, and computed here.
    digits : float
        Digits to which they agree, 17 for all bits; or 0 and 1, where a number has to lie within
        limits.
    """

    what: str
    expected: float
    found: float
    digits: float


@dataclass(frozen=True, slots=True)
class Check:
    """What was compared in one go.

    Attributes
    ----------
    name, reference : str
        What is checked, and where the certified values come from.
    required : float
        Digits to which each value has to agree; 1 for limits.
    values : tuple of Value
    """

    name: str
    reference: str
    required: float
    values: tuple[Value, ...]

    @property
    def digits(self) -> float:
        """Digits of the worst value; 0 where there is none."""
        return min((value.digits for value in self.values), default=0.0)

    @property
    def passed(self) -> bool:
        """Whether every value agrees."""
        return self.digits >= self.required

    @property
    def worst(self) -> Value | None:
        """The value that agrees least."""
        return min(self.values, key=lambda value: value.digits, default=None)


def verify(advance: Callable[[str], None] = lambda _: None) -> list[Check]:
    """Return the outcome of every check.

    Parameters
    ----------
    advance : callable, optional
        Told the name of each check before it runs.
    """
    done = []
    for name, (reference, required, run) in CHECKS.items():
        advance(name)
        try:
            values = tuple(run())
        except Exception as error:  # a check that cannot run has failed; the others still count
            values = (Value(f"stopped by {type(error).__name__}: {error}", 0.0, 0.0, -1.0),)
        done.append(Check(name, reference, required, values))
    return done


# --- estimators ---------------------------------------------------------------------------------


def _nbs14() -> Iterator[Value]:
    ten, thousand = np.array(certified.TEN_POINTS), certified.thousand_points()
    yield from _curves("10 points", ten, [1, 2], certified.TEN, True)
    yield from _curves("1000 points", thousand, [1, 10, 100], certified.THOUSAND, True)


def _stable32() -> Iterator[Value]:
    ten, thousand = np.array(certified.TEN_POINTS), certified.thousand_points()
    theo1 = {"theo1": certified.THEO1}
    yield from _curves("10 points", ten, [1, 2], certified.TEN_RAW, False)
    yield from _curves("1000 points", thousand, [1, 10, 100], certified.THOUSAND_RAW, False)
    yield from _curves("1000 points", thousand, [10, 100, 1000], theo1, False)


def _curves(
    points: str,
    data: NDArray[np.float64],
    taus: list[int],
    table: Mapping[str, Sequence[float]],
    corrected: bool,
) -> Iterator[Value]:
    for kind, expected in table.items():
        # The noise type is given: it is published with the values.
        curve = deviation(data, 1.0, kind, taus, bias_corrected=corrected, noise="WFM")
        yield from _values(f"{kind} of {points}", curve.m, expected, curve.deviation)


def _pdev() -> Iterator[Value]:
    curve = deviation(certified.thousand_points(), 1.0, "pdev")
    yield from _values("pdev of 1000 points", curve.m, certified.PDEV, curve.deviation)


def _rational() -> Iterator[Value]:
    """Compare every estimator, of an array and of a stream, with its equation in fractions."""
    rates = certified.integer_record(128)
    phase = [Fraction(value) for value in (0, *np.cumsum(rates).tolist())]
    bank = AllanBank(1.0, axes=1, per_octave=2)
    bank.update(rates.astype(np.int16))
    for kind, definition in certified.DEFINITIONS.items():
        of_array = deviation(rates, 1.0, kind, "decade", bias_corrected=False)
        of_stream = bank.deviation(kind, bias_corrected=False).axis(0)
        short = (of_stream.m < 64) & np.isfinite(of_stream.deviation)
        for where, m, found, terms in (
            ("", of_array.m, of_array.deviation, of_array.terms),
            (" streamed", of_stream.m[short], of_stream.deviation[short], of_stream.terms[short]),
        ):
            answers = [definition(phase, one) for one in m.tolist()]
            expected = [math.sqrt(variance) for variance, _ in answers]
            yield from _values(f"{kind}{where}", m, expected, found)
            counts = [count for _, count in answers]
            yield from _values(f"terms of {kind}{where}", m, counts, terms)


def _running_sums() -> Iterator[Value]:
    """Compare the sums through which every sample of a stream goes, on every rung of the ladder."""
    rates = certified.integer_record(20_000)
    bank = AllanBank(1.0, axes=1, per_octave=2)
    for part in np.split(rates.astype(np.int16), [1, 7, 1000, 1255, 1256, 9999]):
        bank.update(part)
    bank.gap()
    state = bank.state()
    ladder = [
        (k << level, 1 << level)
        for level in range(state["rungs"].shape[1])
        for k in lags_of_level(level, bank.per_octave).tolist()
    ]
    for sums, (m, stride) in zip(state["sums"][0], ladder, strict=True):
        for kind, exact in certified.squares_of_sums(rates, m, stride).items():
            found = float(sums[COLUMNS.index(kind)])
            if exact < _WHOLE:
                yield _value(f"sum of squares of {kind} at m = {m}", float(exact), found)


# --- fit and loop -------------------------------------------------------------------------------


def _spectrum() -> Iterator[Value]:
    """Density of white counts near the Nyquist frequency, Welch's average by its definition."""
    rate, segments = 100.0, 20
    counts = np.random.default_rng(6).integers(-3000, 3000, (segments * SEGMENT, 1))
    bank = SpectrumBank(rate, 1)
    bank.update(counts.astype(np.int16))
    found = bank.density(0, per_decade=None)
    window = 1.0 - np.cos(2.0 * np.pi * np.arange(SEGMENT) / SEGMENT)
    pieces = np.lib.stride_tricks.sliding_window_view(counts[:, 0] - counts[0, 0], SEGMENT)
    power = np.abs(np.fft.rfft(pieces[:: SEGMENT // 2] * window, axis=1)) ** 2
    density = 2.0 / rate * power.mean(axis=0) / np.sum(window**2)
    near = found.frequency > 0.3 * rate
    at = np.rint(found.frequency[near] * SEGMENT / rate).astype(int)
    for k, one in zip(at.tolist(), found.density[near].tolist(), strict=True):
        yield _value(f"density of bin {k}", float(density[k]), one)


def _fit_and_loop() -> Iterator[Value]:
    """Compare coefficients and effects with a truth that the analysis is not told."""
    counts = certified.record_with_effects()
    columns = {f"{name}[lsb]": column for name, column in zip(AXES, counts.T, strict=False)}
    result = analyse(columns, certified.RATE, part="LSM6DSM", gyro_fs=125.0, accel_fs=2.0)
    for name, truth in certified.EFFECTS.items():
        axis, scale = result.axes[name], 125.0 * 35e-6 if name[0] == "g" else 61e-6
        for letter, expected in (("N", truth.N), ("K", truth.K)):
            found = axis.coefficients[letter]
            yield _within(f"{letter} of {name}", expected * scale, found)
        effects = axis.explanation.effects if axis.explanation else ()
        wrong = [effect.kind for effect in effects if effect.kind != truth.kind]
        words = f"false effects of {name}" + f" ({', '.join(wrong)})" * bool(wrong)
        yield Value(words, 0, len(wrong), float(not wrong))
        for parameter, number in truth.parameters.items():
            right = [e for e in effects if e.kind == truth.kind]
            what = f"{parameter} of the {truth.kind} of {name}"
            expected = number * (scale if parameter in ("amplitude", "size") else 1.0)
            if right:
                yield _within(what, expected, right[0].parameters[parameter])
            else:
                yield Value(f"{what}: not found", expected, math.nan, 0.0)


def _within(what: str, expected: float, found: Any) -> Value:
    """Return whether the truth is within 95 % limits, made wide for all values together."""
    value, lower, upper = (float(x) for x in (found.value, found.lower, found.upper))
    more = _WIDE / TWO_SIDED_95
    inside = value - more * (value - lower) <= expected <= value + more * (upper - value)
    if not getattr(found, "detected", True):
        inside = expected <= upper * more
    return Value(what, expected, value, float(inside))


# --- wire and recording -------------------------------------------------------------------------


def _stream(rows: int) -> tuple[StreamInfo, Block]:
    noise = (certified.lehmer(12 * rows) >> 19).reshape(2, -1)[0] % 61 - 30
    counts = noise.reshape(rows, 6).astype(np.int16)
    counts[:, 5] += 16_393
    offset, unknown = np.arange(rows), np.full(rows, np.nan)
    ticks = Ticks(offset, 10.0 + offset / certified.RATE, unknown, np.full(rows, 26.5))
    scale = (70e-3,) * 3 + (0.061e-3,) * 3
    info = StreamInfo(AXES, scale, certified.RATE, "LSM6DSM", "", 1e-6, True, epoch=3)
    return info, Block(0, counts, ticks)


def _wire() -> Iterator[Value]:
    """Send samples over every format, and over a native stream with damaged bytes."""
    from allanscope.simulator import start_messages
    from allanscope.wire import WireSettings, format_named, formats

    info, block = _stream(1200)
    settings = WireSettings(part="LSM6DSM")
    for name in formats():
        encoder, decoder = format_named(name).encoder(), format_named(name).decoder(settings)
        data = start_messages(format_named(name), encoder, info) + encoder.encode(block)
        seen, rows = _received(decoder.feed(data, 1.0) + decoder.finish())
        yield _value(f"samples over {name}", len(block), len(rows))
        expected = np.round(block.counts * np.array(info.scale) / 1e-3, 6)
        if seen is None or rows.shape != expected.shape:
            continue
        found = np.round(rows * np.array(seen.scale) / 1e-3, 6)
        cut = np.array(seen.truncated or (False,) * 6)
        expected[:, cut] = np.trunc(expected[:, cut])
        different = np.abs(found - expected) > 1e-5
        yield _value(f"values that differ over {name}", 0, int(different.sum()))
    encoder = format_named("native").encoder()
    descriptor, damaged = encoder.describe(info), bytearray(encoder.encode(block))
    for where in (certified.lehmer(20, 7) % len(damaged)).tolist():
        damaged[where] ^= 0x10
    decoder = format_named("native").decoder(settings)
    first, end, delivered, lost, wrong = None, 0, 0, 0, 0
    for event in decoder.feed(descriptor + bytes(damaged), 1.0) + decoder.finish():
        if isinstance(event, Gap):
            lost += event.lost or 0
        elif isinstance(event, Block):
            delivered += len(event)
            first = event.index if first is None else first
            sent = block.counts[event.index : event.index + len(event)]
            wrong += int((event.counts != sent).any(axis=1).sum())
            end = event.index + len(event)
    # The loss before the first sample that arrives is unknown.
    known = end - (first or 0)
    yield _value("samples of a damaged stream, delivered or counted", known, delivered + lost)
    yield _value("wrong samples of a damaged stream", 0, wrong)
    yield Value("samples lost to damage", 0, lost, ALL_BITS if lost else 0.0)


def _received(events: Sequence[Any]) -> tuple[StreamInfo | None, NDArray[Any]]:
    infos = [event for event in events if isinstance(event, StreamInfo)]
    blocks = [event.counts for event in events if isinstance(event, Block)]
    return infos[0] if infos else None, np.concatenate(blocks) if blocks else np.empty((0, 6))


def _damaged_recording() -> Iterator[Value]:
    """Recover a recording that is cut off, and one with a flipped bit: the rest is there."""
    second = 10
    data = certified.lehmer(20 * second * 32, 99).astype(np.uint32).tobytes()
    size = len(data) // (20 * second)
    reads = [
        Chunk(5_000_000_000 + i * 100_000_000, data[i * size : (i + 1) * size])
        for i in range(20 * second)
    ]
    with tempfile.TemporaryDirectory(prefix="allanscope-verify-") as folder:
        path = Path(folder) / "whole.mcap"
        writer, ends = SessionWriter(path, {"part": "LSM6DSM"}), []
        for number, read in enumerate(reads, 1):
            writer.chunk(read)
            if number % second == 0:
                writer.commit()
                ends.append(path.stat().st_size)
        writer.close()
        whole = path.read_bytes()
        at = (ends[11] + ends[12]) // 2
        flipped = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
        for words, bad, kept in (
            ("whole", whole, reads),
            ("truncated", whole[:at], reads[: 12 * second]),
            ("with a flipped bit", flipped, reads[: 12 * second] + reads[13 * second :]),
        ):
            damaged, saved = Path(folder) / "damaged.mcap", Path(folder) / f"saved {words}.mcap"
            damaged.write_bytes(bad)
            recover(damaged, saved)
            found = b"".join(chunk.data for chunk in Recording(saved).chunks())
            expected = b"".join(chunk.data for chunk in kept)
            same = float(found == expected) * ALL_BITS
            yield Value(f"bytes of a recording {words}", len(expected), len(found), same)


CHECKS: dict[str, tuple[str, float, Callable[[], Iterator[Value]]]] = {
    "NBS14, published": ("NIST SP 1065, section 12.4", 6.0, _nbs14),  # seven digits, rounded
    "raw totals, Theo1": ("Stable32 1.60", 4.0, _stable32),  # five digits
    "parabolic deviation": ("SigmaTheta 3.0", 11.0, _pdev),
    "sixteen estimators": ("rational answers", EXACT, _rational),
    "running sums": ("exact integers", ALL_BITS, _running_sums),
    "spectrum": ("transforms in double precision", 6.0, _spectrum),  # segments are float32
    "fit and closed loop": ("record with known truth", 1.0, _fit_and_loop),
    "wire formats": ("what was sent", ALL_BITS, _wire),
    "damaged recording": ("what was recorded", ALL_BITS, _damaged_recording),
}
"""Every check: where its values come from, the digits that are required, and what computes it."""


def _values(what: str, m: ArrayLike, expected: ArrayLike, found: ArrayLike) -> Iterator[Value]:
    for at, one, other in zip(np.array(m), np.array(expected), np.array(found), strict=True):
        yield _value(f"{what} at m = {at}", float(one), float(other))


def _value(what: str, expected: float, found: float) -> Value:
    if found == expected:
        return Value(what, expected, found, ALL_BITS)
    error = abs(found - expected) / abs(expected) if expected else math.inf
    digits = -math.log10(error) if math.isfinite(error) else 0.0
    return Value(what, expected, found, min(max(digits, 0.0), 16.0))


# --- what is printed and filed ------------------------------------------------------------------


def table_lines(checks: Sequence[Check]) -> list[str]:
    """Return the table, and below it the worst value of each check that failed."""
    head = ("check", "values", "agreement", "required", "verdict", "reference")
    rows = [
        (
            check.name,
            str(len(check.values)),
            _agreement(check),
            _digits(check.required),
            "PASS" if check.passed else "FAIL",
            check.reference,
        )
        for check in checks
    ]
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (head, *rows)
    ]
    for check in checks:
        worst = check.worst
        if not check.passed and worst is not None:
            lines.append(
                sanitize(
                    f"{check.name}: {worst.what}: {worst.found!r} instead of {worst.expected!r}"
                )
            )
    return lines


def _agreement(check: Check) -> str:
    if check.required == 1.0:
        inside = sum(value.digits >= 1.0 for value in check.values)
        return f"{inside} of {len(check.values)}"
    return _digits(check.digits)


def _digits(digits: float) -> str:
    if digits >= ALL_BITS:
        return "all bits"
    return "in limits" if digits == 1.0 else f"{max(digits, 0.0):.1f} digits"


def to_json(checks: Sequence[Check]) -> str:
    """Return the record of a verification as JSON, schema ``allanscope-verify/1``."""
    values = [
        [check.name, value.what, float(value.expected).hex(), float(value.found).hex()]
        for check in checks
        for value in check.values
    ]
    document = {
        "schema": "allanscope-verify/1",
        "allanscope": version("allanscope"),
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "passed": all(check.passed for check in checks),
        "processor_s": round(time.process_time(), 1),
        "versions": {"python": platform.python_version(), **_versions()},
        "machine": {
            "processor": _processor(),
            "architecture": platform.machine(),
            "system": platform.platform(),
        },
        "sha256": {
            "package": _of_package(),
            "integers": _sha256(certified.integer_record(20_000).astype("<i8").tobytes()),
            "record": _sha256(certified.record_with_effects().astype("<i2").tobytes()),
            "values": _sha256(json.dumps(values).encode()),
        },
        "checks": [
            {
                "name": check.name,
                "reference": check.reference,
                "required_digits": check.required,
                "digits": round(check.digits, 2),
                "passed": check.passed,
                "values": [
                    {
                        "what": value.what,
                        "expected": value.expected,
                        "found": value.found if math.isfinite(value.found) else None,
                        "digits": round(value.digits, 2),
                    }
                    for value in check.values
                ],
            }
            for check in checks
        ],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _versions() -> dict[str, str]:
    found = {}
    for name in ("numpy", "scipy", "numba", "mcap", "zstandard"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # not every one is needed for ever
            continue
    return found


def _processor() -> str:
    """Return the model of the processor, as the system calls it."""
    try:
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _of_package() -> str:
    """Return the checksum of the program: of the names and bytes of all files of the package."""
    root = Path(__file__).resolve().parent.parent
    total = hashlib.sha256()
    for path in sorted(root.rglob("*"), key=lambda path: path.relative_to(root).as_posix()):
        if path.is_file() and "__pycache__" not in path.parts:
            total.update(f"{path.relative_to(root).as_posix()}\n".encode())
            total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
