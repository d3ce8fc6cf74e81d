"""Text: whatever prints the numbers, they come out in dps and g."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.errors import UsageError
from allanscope.samples import AXES, Block, Event, Gap, Notice, StreamInfo
from allanscope.wire import WireSettings, format_named, sniff
from allanscope.wire.text import TextDecoder
from allanscope.wire.text.columns import cells_of, column_of, columns_of
from allanscope.wire.text.labelled import read_labelled
from allanscope.wire.text.refusal import why_no_rows
from allanscope.wire.text.units import gyro_unit, unit_of_text

GYRO, ACCEL = ("gx", "gy", "gz"), ("ax", "ay", "az")
BOTH = GYRO + ACCEL
RAD = math.pi / 180.0
HALF = [0.5, -0.25, 0.125]
ONE_G = [0.0, -0.5, 1.0]


class Case(NamedTuple):
    """What a text shows, its settings, and what each of its samples is in dps and g."""

    shows: str
    text: str
    said: dict[str, Any]
    axes: tuple[str, ...]
    sample: list[float]


CASES = [
    Case(
        "the contract's own header",
        "t[s],gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g],temp[degC]\n"
        + "0.01,0.5,-0.25,0.125,0,-0.5,1,25.5\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "any order, milli-units, semicolons",
        "az[mg];gy[mdps];gx[mdps];gz[mdps];ax[mg];ay[mg]\r\n" + "1000;-250;500;125;0;-500\r\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "decimal commas between semicolons",
        "gx[dps];gy[dps];gz[dps]\n" + "0,5;-0,25;0,125\n" * 3,
        {},
        GYRO,
        HALF,
    ),
    Case(
        "SI units, tabs",
        "gx[rad/s]\tgy[rad/s]\tgz[rad/s]\tax[m/s^2]\tay[m/s²]\taz[m/s2]\n"
        + f"{0.5 * RAD}\t{-0.25 * RAD}\t{0.125 * RAD}\t0\t-4.903325\t9.80665\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "degrees per hour, as of navigation grade",
        "gx[deg/h],gy[deg/hr],gz[°/h]\n" + "1800,-900,450\n" * 3,
        {},
        GYRO,
        HALF,
    ),
    Case(
        "a header with spaces, rows with tabs, as a vehicle log has it",
        "A_X [mg] A_Y [mg] A_Z [mg] G_X [dps] G_Y [dps] G_Z [dps] \n"
        + "0\t-500.0\t1000\t0.5\t-0.25\t0.125\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "a banner, an empty line, spaces around tabs, a separator at the end",
        "STEVAL-MKI251A (LSM6DSV320X)\n\nG_X [dps] \t G_Y [dps] \t G_Z [dps] \t\n"
        + "0.5 \t -0.25 \t 0.125 \t\n" * 3,
        {},
        GYRO,
        HALF,
    ),
    Case(
        "a version line and empty cells of sensors that are off",
        "#Format version: 1.0\ntime[us],accX[mg],accY[mg],accZ[mg],gyroX[mdps],gyroY[mdps],"
        "gyroZ[mdps],press[hPa],temp[\ufffdC],newData\n"
        + "10339391213,0,-500,1000,,,,,,0x07f,,,\n"
        * 3,
        {},
        ACCEL,
        ONE_G,
    ),
    Case(
        "low-g and high-g columns: the low-g ones count",
        "acc_l_x[mg],acc_l_y[mg],acc_l_z[mg],acc_h_x[mg],acc_h_y[mg],acc_h_z[mg]\n"
        + "0.0,-500.0,1000.0,62.464,-343.552,882.304\n" * 3,
        {},
        ACCEL,
        ONE_G,
    ),
    Case(
        "the SensorTile's SD card, with its degree sign in Latin-1",
        "T [ms],AccX [mg],AccY [mg],AccZ [mg],GyroX [mdps],GyroY [mdps],GyroZ [mdps],"
        "MagX [mgauss],MagY [mgauss],MagZ [mgauss],P [mB],T [\xb0C],H [%]\r\n"
        + "20, 0, -500, 1000, 500, -250, 125, 1, 2, 3,  987.54,  24.50, 40.1\r\n"
        * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "counts, with the full scales from the user",
        "gx[lsb],gy[lsb],gz[lsb],ax[lsb],ay[lsb],az[lsb]\n" + "4,-2,1,0,-4096,8192\n" * 3,
        {"gyro_fs": 125.0, "accel_fs": 4.0},
        BOTH,
        [4 * 4.375e-3, -2 * 4.375e-3, 4.375e-3, 0.0, -4096 * 0.122e-3, 8192 * 0.122e-3],
    ),
    Case(
        "units in the names",
        "time_us,gx_dps,gy_dps,gz_dps\n" + "10,0.5,-0.25,0.125\n" * 3,
        {},
        GYRO,
        HALF,
    ),
    Case(
        "units from the user where the header has none",
        "gyro_x gyro_y gyro_z\n" + "500 -250 125\n" * 3,
        {"units": {"gyro": "mdps"}},
        GYRO,
        HALF,
    ),
    Case(
        "the user's units before the header's",
        "gx[dps],gy[dps],gz[dps]\n" + "500,-250,125\n" * 3,
        {"units": {"gyro": "mdps"}},
        GYRO,
        HALF,
    ),
    Case("no header, six numbers", "0.5,-0.25,0.125,0.0,-0.5,1.0\n" * 4, {}, BOTH, HALF + ONE_G),
    Case(
        "six numbers and another library's remarks",
        "Configuring FIFO with no error checking...\n"
        + "0.5,-0.25,0.125,0.0,-0.5,1.0\n\nFifo Status 1 and 2 (16 bits): 0x1000\n" * 5,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case("no header, tabs, three numbers", "X\tY\tZ\n" + "0.5\t-0.25\t0.125\n" * 4, {}, GYRO, HALF),
    Case(
        "three numbers of an accelerometer",
        "x,y,z\n" + "0.0,-4.903325,9.80665\n" * 4,
        {"units": {"accel": "m/s^2"}},
        ACCEL,
        ONE_G,
    ),
    Case(
        "labels and bars",
        "Acc[mg]: 0 -500 1000 | Gyr[mdps]: 500 -250 125\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "a line a sensor, as ST's polling example prints them",
        "Acceleration [mg]:0.00\t-500.00\t1000.00\r\n"
        "Angular rate [mdps]:500.00\t-250.00\t125.00\r\n"
        "Temperature [degC]: 24.50\r\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "a discovery board's",
        "Accel [G] : 0.000 -0.500 1.000 | Gyro [dps] : 0.500 -0.250 0.125\n\r" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "names and equals signs, a unit behind",
        "Sample: ax=+0.0 ay=-0.500 az=+1.0 g | gx=+0.50 gy=-0.25 gz=+0.125 dps | t=28.67 C\n" * 3,
        {},
        BOTH,
        HALF + ONE_G,
    ),
    Case(
        "a serial plotter's",
        "gx:0.5,gy:-0.25,gz:0.125\n" * 3,
        {},
        GYRO,
        HALF,
    ),
    Case(
        "counts on a console, among prompts, echoes and colours",
        "\x1b[36m[I]\x1b[0m === CLI ===\r\n> \r\n>>> raw\r\n\r\r\n"
        "Raw: ax=77 ay=-301 az=16679 | gx=14 gy=-182 gz=-122 | t=1162\r\n> \r\n"
        "Accel: x=0.005 y=-0.019 z=1.015 g (raw: 82 -305 16647)\r\n" * 3,
        {"gyro_fs": 250.0, "accel_fs": 2.0, "part": "LSM6DSL"},
        BOTH,
        [14 * 8.75e-3, -182 * 8.75e-3, -122 * 8.75e-3, 77 * 61e-6, -301 * 61e-6, 16679 * 61e-6],
    ),
]


@pytest.mark.parametrize("way", ["whole", "byte by byte", "with trailing garbage"])
@pytest.mark.parametrize("case", CASES, ids=[case.shows for case in CASES])
def test_a_text_is_understood(
    case: Case,
    way: str,
    fed: Callable[..., list[Event]],
    joined: Callable[[list[Event]], list[Event]],
) -> None:
    data = case.text.encode("latin-1") if "\xb0" in case.text else case.text.encode()
    cuts = range(len(data)) if way == "byte by byte" else []
    data += b"\x07\x80 garb" if way == "with trailing garbage" else b""
    decoder = format_named("text").decoder(WireSettings(**case.said))
    events = joined(fed(decoder, data, cuts))
    info = next(event for event in events if isinstance(event, StreamInfo))
    blocks = [event for event in events if isinstance(event, Block)]
    assert info.axes == case.axes
    counts = np.concatenate([block.counts for block in blocks])
    assert len(counts) in (3, 4, 5)
    for row in counts * np.asarray(info.scale):
        np.testing.assert_allclose(row, case.sample, atol=1e-12)
    assert (counts.dtype == np.int16) == ("[lsb]" in case.text or "Raw" in case.text)


def _decode(text: str, host_s: float = 0.0, **said: Any) -> list[Event]:
    decoder = format_named("text").decoder(WireSettings(**said))
    return decoder.feed(text.encode(), host_s) + decoder.finish()


def _remarks(events: list[Event]) -> list[str]:
    return [event.text for event in events if isinstance(event, Notice)]


def test_what_was_assumed_is_said() -> None:
    remarks = _remarks(_decode("1,2,3\n" * 5))
    assert remarks == [
        "no header: 3 columns, assumed to be gx gy gz",
        "the text gives no unit of gyro: counts (lsb) assumed",
        "counts of gyro without a full scale: 250 dps assumed",
    ]
    assert not _remarks(_decode("gx[dps],gy[dps],gz[dps]\n" + "1,2,3\n" * 5))


@pytest.mark.parametrize("numbers", [False, True], ids=["header", "all"])
def test_quotation_marks_are_no_part_of_a_cell(numbers: bool) -> None:
    """As spreadsheets and pandas write them; and an order that must not be taken for the usual."""
    row = ["-0.5", "1.25", ""]
    cells = [f'"{cell}"' for cell in row] if numbers else row
    info, *rest = _decode('"az[g]","gx[dps]","comment"\n' + f"{','.join(cells)}\n" * 30)
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    assert info.axes == ("gx", "az")
    assert block.counts[0].tolist() == [1.25, -0.5]
    assert _remarks(rest) == ["columns left out: comment"]


def test_a_column_in_a_unit_that_nobody_knows_is_left_out_and_said() -> None:
    info, *events = _decode("gx[furlong],ay[g],mx[mG]\n" + "1,0.5,7\n" * 5)
    assert isinstance(info, StreamInfo)
    assert info.axes == ("ay",)
    assert _remarks(events) == [
        "the unit of gx[furlong] is not known: that column is left out",
        "columns left out: mx[mG]",
    ]


def test_names_of_many_columns_that_are_left_out_are_cut_visibly() -> None:
    magnetometer = ",".join(f"Magnetometer {axis} (uT)" for axis in "XYZ")
    _, *events = _decode(f"gx[dps],{magnetometer}\n" + "1,2,3,4\n" * 5)
    (told,) = _remarks(events)
    assert told.startswith("columns left out: Magnetometer X (uT), ")
    assert told.endswith("…")


def test_a_row_that_no_sensor_can_have_measured_is_left_out() -> None:
    """Its square would spoil every sum; the stamps say that a sample is missing there."""
    rows = [f"{0.01 * i:.2f},{'1e30' if i == 60 else '0.5'}\n" for i in range(100)]
    events = _decode("t[s],gx[dps]\n" + "".join(rows))
    blocks = [event for event in events if isinstance(event, Block)]
    assert np.concatenate([block.counts for block in blocks]).max() == 0.5
    assert sum(len(block) for block in blocks) == 99
    assert [event.lost for event in events if isinstance(event, Gap)] == [1]


@pytest.mark.parametrize(
    ("step", "unit", "seconds"), [(10, "ms", 0.01), (9600, "us", 0.0096), (0.0096, "s", 0.0096)]
)
def test_a_time_without_a_unit_goes_by_its_steps(step: float, unit: str, seconds: float) -> None:
    rows = "".join(f"{step * i},0.5,0.5,0.5\n" for i in range(40))
    events = _decode("t,gx[dps],gy[dps],gz[dps]\n" + rows)
    assert _remarks(events) == [f"the text gives no unit of time: {unit} assumed"]
    block = next(event for event in events if isinstance(event, Block))
    assert np.diff(block.ticks.device_s) == pytest.approx(np.full(39, seconds))


@pytest.mark.parametrize(
    ("first", "step", "unit"),
    [
        (1746835168, 0.25, "s"),
        (1746835168000, 12, "ms"),
        (1746835168, 9600, "us"),
    ],
)
def test_a_time_that_is_a_date_has_the_unit_of_the_date(first: int, step: float, unit: str) -> None:
    """Whole seconds stand still for some rows; a clock of half an hour in us is no date."""
    rows = "".join(f"{first + int(step * i)},0.5,0.5,0.5\n" for i in range(80))
    events = _decode("t,gx[dps],gy[dps],gz[dps]\n" + rows)
    assert f"the text gives no unit of time: {unit} assumed" in _remarks(events)


def test_times_temperatures_and_rate_come_along() -> None:
    rows = "".join(f"{0.02 * i:.2f},0.5,0.5,0.5,{25 + i}\n" for i in range(40))
    info, block = _decode("t[s],gx[dps],gy[dps],gz[dps],temp[degC]\n" + rows)
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert info.nominal_hz == 50.0
    assert info.device_clock
    assert block.ticks.device_s == pytest.approx(0.02 * np.arange(40))
    assert block.ticks.temperature_c.tolist() == [25.0 + i for i in range(40)]


def test_rows_without_some_cells_wait_for_the_axes_that_come_more_rarely() -> None:
    rows = "".join(f"{i},{i},{i},{i},{'1,1,1' if i % 3 == 0 else ',,'}\n" for i in range(90))
    header = "t[ms],gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g]\n"
    info, block = _decode(header + rows)
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert info.axes == BOTH
    assert block.counts[:, 0].tolist() == list(range(0, 90, 3))


def test_a_second_header_starts_a_new_configuration() -> None:
    first = "gx[dps],gy[dps],gz[dps]\n" + "1,2,3\n" * 30
    events = _decode(first + first.replace("dps", "mdps"))
    kinds = [type(event) for event in events]
    assert kinds == [StreamInfo, Block, StreamInfo, Gap, Block]
    assert [type(e) for e in _decode(first + first)] == [StreamInfo, Block]


HEADER = "t[us],gx[dps],gy[dps],gz[dps]\n"


def _rows(first: int, count: int, end: str = "") -> str:
    return "".join(f"{10_000 * i},1,2,3{end}\n" for i in range(first, first + count))


@pytest.mark.parametrize(
    "damaged",
    [
        "t[us],gx[dpr],gy[dps],gz[dps]",
        "t[s],gx[dps],gy[dps],gz[dps]",
        "t[us],gx[dps]gy[dps],gz[dps]",
        "t[us],gx[dps],gy[dps],,gz[dps]",
    ],
)
def test_a_header_that_is_repeated_and_damaged_costs_no_row(damaged: str) -> None:
    text = HEADER + _rows(0, 40) + damaged + "\n" + _rows(40, 40) + HEADER + _rows(80, 40)
    events = _decode(text)
    assert [type(event) for event in events] == [StreamInfo, Block]
    assert len(events[1]) == 120


def test_a_header_with_another_number_of_columns_is_believed_with_its_first_row() -> None:
    wider = HEADER.strip() + ",temp[degC]\n"
    events = _decode(HEADER + _rows(0, 40) + wider + _rows(40, 40, ",25"))
    assert [type(event) for event in events] == [StreamInfo, Block, StreamInfo, Gap, Block]
    assert len(events[-1]) == 40


def test_a_header_that_differs_in_one_column_is_believed_when_it_is_said_again() -> None:
    slower = HEADER.replace("us", "ms") + _rows(40, 40)
    events = _decode(HEADER + _rows(0, 40) + slower)
    assert sum(isinstance(event, StreamInfo) for event in events) == 1
    events = _decode(HEADER + _rows(0, 40) + slower + slower)
    assert sum(isinstance(event, StreamInfo) for event in events) == 2


def test_a_table_of_other_things_is_not_taken_for_rates() -> None:
    assert _decode("pressure,humidity,co2\n" + "1013,40,400\n" * 40) == []


def test_a_damaged_row_without_times_is_a_hole_of_unknown_length() -> None:
    rows = "0.5,0.25,1\n" * 30
    text = "gx[dps],gy[dps],gz[dps]\n" + rows + "0.5,0.2\n" + rows
    events = _decode(text)
    assert [type(event) for event in events] == [StreamInfo, Block, Gap, Block]
    assert events[2] == Gap("link", None)


@pytest.mark.parametrize(
    "bad", ["0.5,0.25", "0.5,0.25,1,7", "0.5,,x1", "0.5,0.2\x071,1", "0x1,2,3"]
)
def test_a_row_that_is_no_row_is_dropped(bad: str) -> None:
    rows = "0.5,0.25,1\n" * 3
    decoder = format_named("text").decoder(WireSettings())
    decoder.feed(("gx[dps],gy[dps],gz[dps]\n" + rows + bad + "\n" + rows).encode(), 0.0)
    decoder.finish()
    assert decoder.stats.samples == 6
    assert decoder.stats.resyncs == 1


@pytest.mark.parametrize("number", ["inf", "1e400", "nan", "-inf"])
def test_numbers_that_are_none_make_no_sample(number: str) -> None:
    row = "0.5,0.25,1\n"
    events = _decode(f"gx[dps],gy[dps],gz[dps]\n{row}{row}{number},0,0\n{row}")
    blocks = [event for event in events if isinstance(event, Block)]
    assert np.isfinite(np.concatenate([block.counts for block in blocks])).all()


@pytest.mark.parametrize("time", ["1e300", "inf", "-inf"])
def test_a_time_that_no_clock_has_makes_no_sample(time: str) -> None:
    rows = "".join(f"{0.01 * i},1,2,3\n" for i in range(40))
    decoder = format_named("text").decoder(WireSettings())
    header = "t[s],gx[dps],gy[dps],gz[dps]\n"
    decoder.feed((header + rows + f"{time},1,2,3\n" + "0.41,1,2,3\n0.42,1,2,3\n").encode(), 0.0)
    decoder.finish()
    assert decoder.stats.samples == 42
    assert decoder.stats.lost_samples == 1


def test_damage_is_remembered_over_rows_that_are_left_out() -> None:
    rows = "1,2,3,1,1,1\n" * 30
    text = "gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g]\n" + rows + "1,2\n1,2,3,,,\n" + rows
    assert [e for e in _decode(text) if isinstance(e, Gap)] == [Gap("link", None)]
    whole = text.replace("1,2\n1,2,3", "1,2,3")
    assert [e for e in _decode(whole) if isinstance(e, Gap)] == [Gap("device", 1)]


def test_the_tail_of_a_row_at_the_start_is_no_row() -> None:
    decoder = format_named("text").decoder(WireSettings())
    rows = b"17.25,0.5,0.5\n" * 30
    events = decoder.feed(rows[3:], 0.0)
    events += decoder.interrupt("disconnected")
    events += decoder.feed(rows[4:], 0.0) + decoder.finish()
    counts = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    assert counts.shape == (58, 3)
    assert np.unique(counts[:, 0]).tolist() == [17.25]


def test_a_file_without_a_header_keeps_its_first_row() -> None:
    decoder = format_named("text").decoder(WireSettings())
    events = decoder.feed(b"17.25,0.5,0.5\n" * 30, float("nan")) + decoder.finish()
    assert sum(len(event) for event in events if isinstance(event, Block)) == 30


def test_counts_are_taken_before_units_even_if_they_are_rarer() -> None:
    raw = "Raw: ax=1 ay=2 az=16000 | gx=3 gy=4 gz=5\n"
    read = "Sample: ax=1.0 ay=2.0 az=3.0 g | gx=1.0 gy=2.0 gz=3.0 dps\n"
    events = _decode((raw + 3 * read) * 10)
    counts = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    assert counts.tolist() == [[3, 4, 5, 1, 2, 16000]] * 10


def test_a_remark_in_parentheses_is_left_out() -> None:
    said = read_labelled("Accel: x=5 y=-19 z=1015 mg (raw: 82 -305 16647)")
    assert said is not None
    assert (said.accel, said.accel_unit) == ((5.0, -19.0, 1015.0), "mg")


def test_axes_of_one_sensor_in_different_units_say_nothing() -> None:
    assert read_labelled("ax[g]=1.0 ay[mg]=2.0 az[g]=3.0") is None


@pytest.mark.parametrize("level", [32_768, 260_000, -40_000])
def test_counts_of_more_than_16_bits_are_not_cut(level: int) -> None:
    """20-bit converters, and codes without a sign that are 32768 at rest."""
    rows = "".join(f"{level + i % 7},5,{i % 3}\n" for i in range(60))
    info, *rest = _decode("gx[lsb],gy[lsb],gz[lsb]\n" + rows)
    counts = np.concatenate([e.counts for e in rest if isinstance(e, Block)])
    assert isinstance(info, StreamInfo)
    assert len(counts) == 60
    assert set(counts[:, 0]) == set(range(level, level + 7))
    assert any("beyond 16 bits" in remark for remark in _remarks(rest))


def test_counts_beyond_int16_stay_within_it() -> None:
    rows = "32000,-32000,1\n" * 400 + "32768,-32769,1\n" * 2
    events = _decode("gx[lsb],gy[lsb],gz[lsb]\n" + rows)
    counts = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    assert counts.dtype == np.int16
    assert counts[-1].tolist() == [32767, -32768, 1]


@pytest.mark.parametrize("header", ["# t[s],gx[dps]", '"t[s]","gx[dps]"', "%t[s], gx[dps]"])
def test_a_header_in_quotes_or_behind_a_mark_of_comments_keeps_its_first_name(header: str) -> None:
    events = _decode(header + "\n" + "".join(f"{i / 100},{i % 7}.5\n" for i in range(40)))
    info = next(event for event in events if isinstance(event, StreamInfo))
    assert (info.axes, info.nominal_hz) == (("gx",), 100.0)


def test_a_number_that_no_sensor_gives_makes_no_sample() -> None:
    rows = ["0.5", "1e300", "0.25", "-1e200", "0.75"]
    events = _decode("gx[rad/s]\n" + "\n".join(rows) + "\n")
    counts = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    assert (counts[:, 0] * RAD).round(3).tolist() == [0.5, 0.25, 0.75]


def test_means_of_counts_are_not_rounded() -> None:
    events = _decode("gx[lsb]\n" + "12.25\n-3.5\n0.75\n")
    block = next(event for event in events if isinstance(event, Block))
    assert block.counts[:, 0].tolist() == [12.25, -3.5, 0.75]


def test_a_32_bit_counter_of_microseconds_may_wrap() -> None:
    rows = "".join(f"{(2**32 - 50_000 + 10_000 * i) % 2**32},1,2,3\n" for i in range(40))
    events = _decode("t[us],gx[dps],gy[dps],gz[dps]\n" + rows)
    assert [type(event) for event in events] == [StreamInfo, Block]


def test_a_kind_of_line_once_chosen_stays() -> None:
    both = "Acc[mg]: 0 -500 1000 | Gyr[mdps]: 500 -250 125\n"
    other = "Sample: ax=9 ay=9 az=9 g | gx=9 gy=9 gz=9 dps\n"
    events = _decode(both * 12 + other * 40 + both * 3)
    counts = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    assert len(counts) == 15
    assert np.unique(counts[:, 5]).tolist() == [1.0]


@pytest.mark.parametrize(
    "line",
    [
        "  STATUS_REG = 0x07 (XLDA=1 GDA=1 TDA=1)",
        "  User offset: x=0 y=0 z=0",
        "  Accel FS: +/-2g",
        "Temp C:   min=29.50 avg=29.54 max=29.57",
        "Sample: ax=+0.005 ay=-0",
        "Accel: x=0.005 y=-0.019",
        "Acc[mdps]: 1 2 3",
        "TimeStamp: 12:34:56.78",
        "http://example.org/?ax=1",
        "",
        ":" * 400,
    ],
)
def test_a_line_without_three_axes_of_a_sensor_says_nothing(line: str) -> None:
    assert read_labelled(line) is None


@pytest.mark.parametrize(
    ("header", "quantity", "unit", "axis"),
    [
        ("gx", "gyro", "", 0),
        ("GyroZ [mdps]", "gyro", "mdps", 2),
        ("gyr_y(dps)", "gyro", "dps", 1),
        ("A_X [mg]", "accel", "mg", 3),
        ("accelerometer_z", "accel", "", 5),
        ("t", "time", "", -1),
        ("T [degC]", "temperature", "degc", -1),
        ("Timestamp[ms]", "time", "ms", -1),
        ("temperature", "temperature", "", -1),
        ("gtemp", "temperature", "", -1),
        ("IMU_Temp [degC]", "temperature", "degc", -1),
    ],
)
def test_a_column_is_known_by_many_names(header: str, quantity: str, unit: str, axis: int) -> None:
    column = column_of(header)
    assert column is not None
    assert (column.quantity, column.unit, column.axis) == (quantity, unit, axis)


@pytest.mark.parametrize(
    "header",
    ["P [mB]", "MagX [mgauss]", "acc_h_x[mg]", "gx[mg]", "hum[%RH]", "", "[dps]", "x" * 999],
)
def test_other_columns_are_left_alone(header: str) -> None:
    assert column_of(header) is None


def test_of_two_columns_of_one_axis_the_first_counts() -> None:
    columns = columns_of(cells_of("gx[dps],gx[mdps],gy[dps]"))
    assert columns is not None
    assert [column is not None for column in columns] == [True, False, True]


@pytest.mark.parametrize("units", [{"gyro": "furlong"}, {"barometer": "hPa"}, {"accel": "dps"}])
def test_a_unit_that_does_not_exist_is_refused(units: dict[str, str]) -> None:
    with pytest.raises(UsageError, match="choose one of"):
        format_named("text").decoder(WireSettings(units=units))


@settings(max_examples=150, deadline=None)
@given(st.text(max_size=300))
def test_no_line_is_too_strange(line: str) -> None:
    read_labelled(line)
    columns_of(cells_of(line))
    unit_of_text(line)
    _decode("gx[dps],gy[dps],gz[dps]\n" + line)
    _decode(line + "\nAcc[mg]: 1 2 3\n" + line)


@pytest.mark.parametrize(
    "line", ["a" * 4000, "[" * 4000, "a=" * 2000, "1," * 2000, "a " * 2000, "(" * 4000]
)
def test_a_long_line_costs_no_more_than_its_length(line: str) -> None:
    decoder = format_named("text").decoder(WireSettings())
    for _ in range(30):
        decoder.feed(line.encode() + b"\n", 0.0)
    assert decoder.stats.samples == 0


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        *(("rad s^-1", "rad/s"), ("rad*s^-1", "rad/s"), ("rad·s⁻¹", "rad/s"), ("rad/sec", "rad/s")),
        *(("m s^-2", "m/s2"), ("m/s/s", "m/s2"), ("ns", "ns"), ("counts", "lsb"), ("mg", "mg")),
    ],
)
def test_a_unit_is_known_however_it_is_written(written: str, meant: str) -> None:
    assert unit_of_text(written) == meant


EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)


def test_a_table_of_euroc_is_read_with_its_nanoseconds() -> None:
    """As float64 the stamps would be 256 ns apart; the steps are kept to the last digit."""
    stamps = [1403636579758555392 + 5_000_001 * i for i in range(60)]
    row = ",".join(["0.1", "0", "0", "0", "0", "9.80665"])
    info, block = _decode(EUROC + "".join(f"{stamp},{row}\n" for stamp in stamps))
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert info.axes == BOTH
    assert block.counts[0] == pytest.approx([0.1 / RAD, 0, 0, 0, 0, 1.0])
    assert np.diff(block.ticks.device_s) == pytest.approx(np.full(59, 5.000001e-3), abs=1e-12)


@pytest.mark.parametrize(
    ("first", "step", "head"),
    [
        (672_705_976_809_250, 2_000_000, "timestamp_ns,ax,ay,az\n"),
        (672_705_976_809_250, 2_000_000, "t,ax,ay,az\n"),  # since a phone was switched on
        (1_714_000_000_123, 2, "t,ax,ay,az\n"),  # ms since 1970
    ],
)
def test_whole_numbers_later_than_any_time_in_seconds_are_times(first, step, head) -> None:
    """They were no rows of a table, and no format fitted the file."""
    events = _decode(head + "".join(f"{first + step * i},0,0,{i}e-3\n" for i in range(60)))
    (block,) = (event for event in events if isinstance(event, Block))
    steps = np.diff(block.ticks.device_s)
    assert len(steps) == 59
    assert steps == pytest.approx(np.full(59, steps[0]), rel=1e-6)


@pytest.mark.parametrize(
    "stamp",
    [
        lambda i: f"23:59:{59 + 0.02 * i:05.2f}" if i < 50 else f"00:00:{0.02 * i - 1:05.2f}",
        lambda i: (
            f"2024-02-{28 + (i >= 50)}T"
            + (f"23:59:{59 + 0.02 * i:06.3f}Z" if i < 50 else f"00:00:{0.02 * i - 1:06.3f}Z")
        ),
        lambda i: (
            f"2024-02-{28 + (i >= 50)} "
            + (f"23:59:{59 + 0.02 * i:06.3f}" if i < 50 else f"00:00:{0.02 * i - 1:06.3f}")
        ),
        lambda i: f"11:59:{59 + 0.02 * i:05.2f} PM" if i < 50 else f"12:00:{0.02 * i - 1:05.2f} AM",
        lambda i: (
            f"11:59:{59 + 0.02 * i:05.2f} a.m." if i < 50 else f"12:00:{0.02 * i - 1:05.2f} p.m."
        ),
    ],
    ids=["time of day", "ISO", "ISO with a blank", "midnight by AM", "noon by p.m."],
)
@pytest.mark.parametrize("separator", [",", " ", "\t"])
@pytest.mark.parametrize("header", [True, False], ids=["header", "no header"])
def test_times_that_people_read_go_on_over_midnight(
    stamp: Callable[[int], str], separator: str, header: bool
) -> None:
    names = separator.join(["time", "gx[dps]", "gy[dps]", "gz[dps]"]) + "\n"
    rows = [separator.join([stamp(i), "0.5", "0.1", "0.25"]) + "\n" for i in range(100)]
    info, *rest = _decode(names * header + "".join(rows), math.nan)
    (block,) = [event for event in rest if isinstance(event, Block)]
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == 50.0
    assert block.counts[0].tolist() == [0.5, 0.1, 0.25]
    assert np.diff(block.ticks.device_s) == pytest.approx(np.full(99, 0.02), abs=1e-6)
    assert "unit of its time" not in " ".join(_remarks(rest))


G3 = "0.5,-0.25,0.125"


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        ("gx[dps],gy[dps],gz[dps]", "{n}," + G3, "assumed to be a row number"),
        ("gx[dps],gy[dps],gz[dps]", "{t:.2f}," + G3, "assumed to be the time"),
        ("t[s],gx[dps],gy[dps],gz[dps]", "{t:.2f}," + G3 + ",7", "the last cell of each row"),
        ("t[s],gx[dps],gy[dps],gz[dps],temp", "{t:.2f}," + G3, "the last name is left out"),
        ("index,t[s],gx[dps],gy[dps],gz[dps]", "{t:.2f}," + G3, "the first name is left out"),
    ],
)
def test_a_header_with_one_name_more_or_fewer_is_set_right(
    header: str, row: str, said: str
) -> None:
    rows = "".join(row.format(n=i, t=0.02 * i) + "\n" for i in range(40))
    info, *rest = _decode(f"{header}\n{rows}", math.nan)
    blocks = [event for event in rest if isinstance(event, Block)]
    assert isinstance(info, StreamInfo)
    assert info.axes == GYRO
    assert sum(len(block) for block in blocks) == 40, "no row is lost over it"
    assert blocks[0].counts[0].tolist() == HALF
    assert any(said in remark for remark in _remarks(rest))
    assert info.nominal_hz == (50.0 if "{t" in row else 0.0)


def test_damaged_rows_behind_a_header_do_not_turn_the_columns() -> None:
    text = "gx[dps],gy[dps],gz[dps]\n1,2\n" + f"{G3}\n" * 40 + "1,2,3,4\n" * 5
    events = _decode(text, math.nan)
    (info,) = (event for event in events if isinstance(event, StreamInfo))
    assert info.axes == GYRO
    assert _remarks(events) == [
        "line 2 is not a row of the table: '1,2' (2 cells where the header names 3 columns); "
        "such lines are skipped",
        *(
            f"line {line} is not a row of the table: '1,2,3,4' "
            "(4 cells where the header names 3 columns); such lines are skipped"
            for line in (43, 44)
        ),
    ]


A3 = {"m/s^2": [0.1, -0.2, 9.79], "g": [0.01, -0.02, 1.001], "mg": [12.0, -21.0, 1003.5]}


@pytest.mark.parametrize("unit", A3)
@pytest.mark.parametrize("names", ["ax,ay,az,gx,gy,gz", "", "az"])
def test_an_accelerometer_is_known_by_gravity(unit: str, names: str) -> None:
    """Also where it comes first without a name; and the guess is said."""
    values = A3[unit][2:] if names == "az" else [*A3[unit], 0.3, 0.02, -0.1]
    line = ",".join(map(repr, values))
    info, *rest = _decode((names + "\n") * bool(names) + f"{line}\n" * 40)
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    assert block.counts[0][info.axes.index("az")] == pytest.approx(1.0, rel=0.01)
    if names != "az":
        dps = 1.0 / RAD if unit == "m/s^2" else 1.0
        assert block.counts[0][:3] == pytest.approx(np.multiply([0.3, 0.02, -0.1], dps))
    assert any(f"no unit of accel: {unit} assumed" in remark for remark in _remarks(rest))
    if not names:
        assert any("assumed to be ax ay az gx gy gz" in remark for remark in _remarks(rest))


@pytest.mark.parametrize(
    ("header", "axes"),
    [
        ("Time[s];LSM6DSM_ACC_X[mg];LSM6DSM_ACC_Y[mg];LSM6DSM_ACC_Z[mg]", "t ax ay az"),
        ("IMU_Time,IMU_GyrX,IMU_GyrY,IMU_GyrZ,IMU_AccX,IMU_AccY,IMU_AccZ", "t gx gy gz ax ay az"),
        ("loopIteration,time (us),gyroADC[0],gyroADC[1],gyroADC[2]", "- t gx gy gz"),
        ("acc[0],acc[1],acc[2],gyro[0],gyro[1],gyro[2]", "ax ay az gx gy gz"),
        ("ts,lin_acc_x,lin_acc_y,lin_acc_z,ang_vel_x,ang_vel_y,ang_vel_z", "t ax ay az gx gy gz"),
        ("hh:mm:ss.ms,X_Acc,Y_Acc,Z_Acc", "t ax ay az"),
        ("sys_time,p,q,r,fx,fy,fz", "t gx gy gz ax ay az"),
        ("TimeUS,GyrX,GyrY,GyrZ", "t gx gy gz"),
        ("PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Mag_X", "- t ax ay az -"),
        ("elapsedRealtimeNanos,rotationRateX,rotationRateY,rotationRateZ", "t gx gy gz"),
        ("gyroRotationX(rad/s),gyroRotationY(rad/s),gyroRotationZ(rad/s)", "gx gy gz"),
        ("a_acc_x,acc_x,a_acc_y,acc_y,a_acc_z,acc_z", "- ax - ay - az"),
        ("b_acc_x,b_acc_y,b_acc_z,c_acc_x,c_acc_y,c_acc_z", "ax ay az - - -"),
        ("gx,gy,gz,bias_acc_x,bias_acc_y,bias_acc_z", "gx gy gz - - -"),
        ("gx,gy,gz,lin_acc_x,lin_acc_y", "gx gy gz - -"),
        (
            "epoc (ms),timestamp (-0700),elapsed (s),x-axis (deg/s),y-axis (deg/s),z-axis (deg/s)",
            "t - - gx gy gz",
        ),
    ],
)
def test_names_with_more_to_them_are_read_where_no_plain_ones_are(header: str, axes: str) -> None:
    """Of three axes at least, and the first of each."""
    columns = columns_of(cells_of(header))
    assert columns is not None
    names = ["-" if c is None else AXES[c.axis] if c.axis >= 0 else "t" for c in columns]
    assert names == axes.split()


@pytest.mark.parametrize(
    "header", ["t,fx,fy,fz", "t,p,q,fx,fy,fz", "t,rotationX,rotationY,rotationZ"]
)
def test_forces_without_rates_and_angles_are_no_sensor(header: str) -> None:
    assert columns_of(cells_of(header)) is None


@pytest.mark.parametrize("unit", ["[m/s^2]", "[g]", ""])
def test_a_gyroscope_beside_si_units_is_in_rad_s(unit: str) -> None:
    """Unless it says otherwise; and the guess is said."""
    header = ",".join(f"a{axis}{unit}" for axis in "xyz") + ",gx,gy,gz\n"
    line = "0.1,9.79,-0.2" if unit != "[g]" else "0.01,1.001,-0.02"
    events = _decode(header + f"{line},0.3,0.02,-0.1\n" * 40)
    block = next(event for event in events if isinstance(event, Block))
    said = "rad/s assumed, as accel is in m/s^2" if unit != "[g]" else "dps assumed"
    assert f"the text gives no unit of gyro: {said}" in _remarks(events)
    assert block.counts[0][0] == pytest.approx(0.3 if unit == "[g]" else 0.3 / RAD)
    stated = _decode(header.replace("gx", "gx[dps]") + f"{line},0.3,0.02,-0.1\n" * 40)
    assert next(one for one in stated if isinstance(one, Block)).counts[0][0] == 0.3


@pytest.mark.parametrize(
    ("step", "beside", "said"),
    [
        (math.radians(2000.0 / 2**15), 1.0, "rad/s assumed, as its step is that of 2000 dps in"),
        (math.radians(0.0175), 1.0, "rad/s assumed, as its step is that of 500 dps in 16 bits"),
        (1.0 / 131.0, 9.81, "dps assumed, as its step is that of 250 dps in 16 bits"),
        (8.75, 9.81, "mdps assumed, as its step is that of 250 dps in 16 bits"),
        (0.01, 1.0, "dps assumed"),
        (0.001, 9.81, "rad/s assumed, as accel is in m/s^2"),
        (math.radians(2.0 * 2000.0 / 2**15), 1.0, "rad/s assumed, as its step is that of 4000 dps"),
        (math.radians(3.0 * 2000.0 / 2**15), 1.0, "dps assumed"),
    ],
)
def test_the_step_of_a_gyroscope_tells_its_unit(step: float, beside: float, said: str) -> None:
    """Bias taken off, digits cut, and a bump; a decimal step tells nothing."""
    counts = np.random.default_rng(1).normal(0.0, 2.5, (40, 3)).round()
    counts[5:8, 1] += [2000.0, -3001.0, 700.0]
    rows = (counts - counts.mean(axis=0)) * step
    lines = "".join(f"0,0,{beside},{','.join(f'{v:.6g}' for v in row)}\n" for row in rows)
    assert any(
        f"no unit of gyro: {said}" in remark
        for remark in _remarks(_decode("ax,ay,az,gx,gy,gz\n" + lines))
    )


def test_noise_without_a_step_tells_no_unit_of_a_gyroscope() -> None:
    """2000 sets of 25 rows, continuous or on decimal steps: none is taken for counts."""
    rng = np.random.default_rng(2)
    for number in range(2000):
        rows = rng.normal(0.0, 10.0 ** rng.uniform(-1.0, 1.5), (25, 3))
        step = float(rng.choice([1.0, 2.0, 5.0])) * 10.0 ** rng.integers(-6, 1)
        values = rows * step if number % 2 else np.rint(rows) * step
        assert "step" not in gyro_unit(values, "")[1]
        cut = np.rint(rows / 10.0).round() * 500.0 / 2**15  # no counts of 250 dps in rad/s
        assert gyro_unit(cut.round(4), "")[0] == "dps"


@pytest.mark.parametrize("digits", [3, 9], ids=["a rounded one", "a fine one"])
@pytest.mark.parametrize(("deviation", "unit"), [(0.0012, "rad/s"), (0.02, "dps"), (1e-9, "dps")])
def test_the_noise_of_a_gyroscope_tells_rad_from_degrees(
    deviation: float, unit: str, digits: int
) -> None:
    """A phone's 0.07 dps in rad/s, 20 mdps, as of a quiet part at 25 Hz, and what is neither."""
    rows = np.random.default_rng(4).normal(0.1, deviation, (25, 3)).round(digits)
    assert gyro_unit(rows, "mg")[0] == unit


def test_a_coarse_gyroscope_that_hardly_moves_stays_in_degrees() -> None:
    rows = np.zeros((400, 3))
    rows[::50, 1] = 0.07  # one code in fifty rows: its mean step is 3 mdps
    assert gyro_unit(rows, "") == ("dps", "")


GROUPED = (
    "Time (s);Vicon Orientation;;;;IMU Acceleration;;;IMU Gyroscope (mdps);;;IMU Magnetometer;;;\n"
    ";W;X;Y;Z;X;Y;Z;X;Y;Z;X;Y;Z;\n"
)


def test_a_header_of_two_lines_has_sensors_above_axes() -> None:
    """As spreadsheets write it, with a unit of the group; orientation and field are left out."""
    rows = "".join(
        f"{i * 0.01:.2f};0;5;6;7;0.01;-0.02;1.001;500;-250;125;1;2;3\n" for i in range(40)
    )
    info, *rest = _decode(GROUPED + rows)
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    assert (info.axes, info.nominal_hz) == (BOTH, pytest.approx(100.0))
    assert block.counts[0] == pytest.approx([0.5, -0.25, 0.125, 0.01, -0.02, 1.001])


@pytest.mark.parametrize(
    ("groups", "axes", "named"),
    [
        ("Accelerometer,,,Gyroscope,,", ACCEL + GYRO, True),
        ("Angular velocity,,,Acceleration", GYRO + ACCEL, True),
        ("Accelerometer and gyroscope", GYRO + ACCEL, False),
        ("Accelerometer log", GYRO + ACCEL, False),
        ("a title", GYRO + ACCEL, False),
    ],
)
def test_sensors_above_x_y_and_z_are_believed_and_titles_are_not(
    groups: str, axes: tuple[str, ...], named: bool
) -> None:
    """Below a title the sensors go by their place."""
    info, *rest = _decode(f"{groups}\nx,y,z,x,y,z\n" + "1.5,2.5,3.5,4.5,5.5,26.5\n" * 40)
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    by_place = dict(zip(axes, (1.5, 2.5, 3.5, 4.5, 5.5, 26.5), strict=True))
    assert block.counts[0].tolist() == [by_place[axis] for axis in info.axes]
    assert named != any("no sensor is named" in one for one in _remarks(rest))


@pytest.mark.parametrize(
    ("line", "hz"),
    [
        *(("Fs,100", 100.0), ("# fs = 416 Hz", 416.0), ("// Update Rate: 40.0Hz", 40.0)),
        ("# Config: data_rate = 2000.0 Hz, filter = 488 Hz, acc_range = 4 g", 2000.0),
        *(("Sampling frequency [Hz]: 208", 208.0), ("sample rate = 1.66 kHz", 1660.0)),
        *(("Baud rate: 115200", 0.0), ("FS,2000", 0.0), ("Gyro fs: 250", 0.0)),
        *(("Accel ODR: 104 Hz", 0.0), ("Sample rate: 104 Hz" + 30 * "\nready", 0.0)),
        *(("sample rate: fast", 0.0), ("sample rate: 100.5.1", 0.0)),
    ],
)
def test_a_line_above_the_rows_may_state_the_rate(line: str, hz: float) -> None:
    """It counts where there are neither times nor a rate from the user, and is said."""
    text = f"{line}\ngx,gy,gz\n" + "0.5,-0.25,0.125\n" * 40
    events = _decode(text)
    info = next(event for event in events if isinstance(event, StreamInfo))
    assert info.nominal_hz == pytest.approx(hz)
    assert any("above the rows" in one for one in _remarks(events)) == bool(hz)
    given = next(one for one in _decode(text, rate_hz=52.0) if isinstance(one, StreamInfo))
    assert given.nominal_hz == 52.0
    timed = f"{line}\nt[s],gx\n" + "".join(f"{i * 0.02:.2f},0.5\n" for i in range(40))
    info = next(event for event in _decode(timed) if isinstance(event, StreamInfo))
    assert info.nominal_hz == pytest.approx(50.0)


@pytest.mark.parametrize("names", [",x,y,z", ",gx,gy,gz"])
@pytest.mark.parametrize("step", ["time", "number", "blank"])
def test_a_first_column_without_a_name_is_a_time_or_a_row_number(names: str, step: str) -> None:
    """As a table of pandas has its index."""
    first = {"time": "{:.2f}", "number": "{}", "blank": ""}[step]
    rows = "".join(
        first.format(i * 0.01 if step == "time" else i) + ",0.5,-0.25,0.125\n" for i in range(40)
    )
    info, *rest = _decode(f"{names}\n{rows}")
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    assert info.axes == GYRO
    assert info.nominal_hz == (pytest.approx(100.0) if step == "time" else 0.0)
    assert block.counts[0].tolist() == HALF


def test_three_columns_of_one_g_are_an_accelerometer() -> None:
    info, *rest = _decode("x,y,z\n" + "0.02,-0.01,0.999\n" * 40)
    assert isinstance(info, StreamInfo)
    assert info.axes == ACCEL
    assert any("because gravity is in the first three" in remark for remark in _remarks(rest))


@pytest.mark.parametrize(
    "names", ["x,y,z,x,y,z", "X1,Y1,Z1,X2,Y2,Z2", "t[s],x_1,y_1,z_1,x_2,y_2,z_2"]
)
@pytest.mark.parametrize("first", ["gyro", "accel"])
def test_sensors_that_a_header_does_not_name_are_known_by_gravity(names: str, first: str) -> None:
    gyro, accel = [0.3, 0.02, -0.1], [0.01, -0.02, 1.001]
    values = ",".join(map(repr, gyro + accel if first == "gyro" else accel + gyro))
    time = "{:.2f}," if names.startswith("t") else ""
    rows = "".join(time.format(i * 0.01) + values + "\n" for i in range(40))
    info, *rest = _decode(f"{names}\n{rows}")
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    assert info.axes == BOTH
    assert block.counts[0].tolist() == gyro + accel
    order = "gx gy gz ax ay az" if first == "gyro" else "ax ay az gx gy gz"
    assert any(
        f"columns, assumed to be {'t ' * bool(time)}{order}" in one for one in _remarks(rest)
    )


@pytest.mark.parametrize("header", ["x,y,z,x,y", "x,z,y", "x,y,z,mx,my,mz", "t,id,x,y,z"])
def test_letters_that_are_no_three_axes_say_nothing(header: str) -> None:
    assert columns_of(header.split(",")) is None


@pytest.mark.parametrize(
    ("header", "axes"),
    [
        ("Time (s),X (m/s^2),Y (m/s^2),Z (m/s^2)", ACCEL),
        ("Time (s),X (rad/s),Y (rad/s),Z (rad/s)", GYRO),
        ("Time (s),x [g],y [g],z [g],Absolute [g]", ACCEL),
        ("time,x [g],y [g],z [g],x [dps],y [dps],z [dps]", ACCEL + GYRO),
        ("time,seconds_elapsed,z,y,x", GYRO[::-1]),
    ],
)
def test_axes_without_a_sensor_have_that_of_their_unit(header: str, axes: tuple[str, ...]) -> None:
    columns = columns_of(header.split(","))
    assert columns is not None
    assert tuple(AXES[one.axis] for one in columns if one and one.axis >= 0) == axes


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_log_of_one_sensor_has_that_of_the_name_of_its_file(sensor: str) -> None:
    """Sensor Logger's acceleration is without gravity: nothing else tells it from a rate."""
    lines = "".join(
        f"{1664206376914869000 + i * 10**7},{i * 0.01},0.02,0.01,0.03\n" for i in range(40)
    )
    info, *rest = _decode("time,seconds_elapsed,z,y,x\n" + lines, sensor=sensor)
    block = next(event for event in rest if isinstance(event, Block))
    assert isinstance(info, StreamInfo)
    assert info.axes == (GYRO if sensor == "gyro" else ACCEL)
    unit = 180 / math.pi if sensor == "gyro" else 1 / 9.80665  # rad/s and m/s^2, as the app writes
    assert block.counts[0].tolist() == pytest.approx([0.03 * unit, 0.01 * unit, 0.02 * unit])
    letter = info.axes[0][0]
    assert _remarks(rest) == [
        "columns left out: seconds_elapsed",
        "only the name of the file tells the sensor: 5 columns, assumed to be "
        f"t {letter}z {letter}y {letter}x",
        "the text gives no unit of time: ns assumed",
    ]


def test_gravity_and_units_are_above_the_name_of_a_file() -> None:
    (turned, *_) = _decode("t,x,y,z\n" + "0,0.1,0.2,9.81\n" * 40, rate_hz=52.0, sensor="gyro")
    assert isinstance(turned, StreamInfo)
    assert turned.axes == ACCEL
    (said, *_) = _decode(
        "t,x [dps],y [dps],z [dps]\n" + "0,1,2,3\n" * 40, rate_hz=52.0, sensor="accel"
    )
    assert isinstance(said, StreamInfo)
    assert said.axes == GYRO


@pytest.mark.parametrize(
    "header",
    [
        *("Time (s),X (µT),Y (µT),Z (µT)", "x [g],y [g],z [dps]", "w,x,y,z", "frame,joint,x,y,z"),
        *("x [g],y [g],z [g],x [g],y [g],z [g]", "a,b,x [g],y [g],z [g]"),
    ],
)
def test_axes_in_units_of_no_sensor_say_nothing(header: str) -> None:
    assert columns_of(header.split(",")) is None


def test_a_unit_beside_x_y_and_z_leaves_nothing_to_assume() -> None:
    info, *rest = _decode('"Time (s)","X (m/s^2)","Y (m/s^2)","Z (m/s^2)"\n' + "0,1,2,9\n" * 40)
    assert isinstance(info, StreamInfo)
    assert info.axes == ACCEL
    assert not any("assumed to be" in remark for remark in _remarks(rest))


def test_what_the_user_or_the_header_says_of_units_is_above_gravity() -> None:
    (said, *_) = _decode("ax[g],ay[g],az[g]\n" + "0,0.1,9.81\n" * 40)[1:]
    assert isinstance(said, Block)
    assert said.counts[0, 2] == 9.81
    (given, *_) = _decode("ax,ay,az\n" + "0,0.1,9.81\n" * 40, units={"accel": "g"})[1:]
    assert isinstance(given, Block)
    assert given.counts[0, 2] == 9.81


def _bursts(rows: int, burst: int, seed: int) -> list[float]:
    """Return stamps of rows that are 10 ms apart and passed on some at a time."""
    jitter = np.random.default_rng(seed).uniform(0, 2e-4, rows)
    return [0.01 * burst * (i // burst) + 0.002 * (i % burst) + jitter[i] for i in range(rows)]


@pytest.mark.parametrize("burst", [3, 5, 18, 40])
def test_bursts_are_no_losses_and_the_rate_is_rows_over_time(burst: int) -> None:
    text = "t[s],gx[dps],gy[dps],gz[dps]\n"
    text += "".join(f"{t:.6f},{G3}\n" for t in _bursts(3000, burst, burst))
    info, *rest = _decode(text, math.nan)
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == pytest.approx(100.0, rel=0.002)
    assert not [event for event in rest if isinstance(event, Gap)]
    assert any("in bursts" in remark for remark in _remarks(rest))


def test_a_hole_among_bursts_is_one() -> None:
    times = [t + (5.0 if i >= 1500 else 0.0) for i, t in enumerate(_bursts(3000, 5, 1))]
    rows = "".join(f"{t:.6f},{G3}\n" for t in times)
    events = _decode("t[s],gx[dps],gy[dps],gz[dps]\n" + rows, math.nan)
    assert [event.lost for event in events if isinstance(event, Gap)] == [None]


@pytest.mark.parametrize("rate", [100.0, None])
def test_uneven_bursts_are_no_losses(rate: float | None) -> None:
    times = np.repeat(np.cumsum(np.random.default_rng(6).uniform(0.02, 0.28, 400)), 15)
    times = times + np.tile(0.002 * np.arange(15), 400)
    times = np.maximum.accumulate(times) + 1e-6 * np.arange(len(times))
    rows = "".join(f"{t:.6f},{G3}\n" for t in times)
    info, *rest = _decode("t[s],gx[dps],gy[dps],gz[dps]\n" + rows, math.nan, rate_hz=rate)
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == pytest.approx(100.0, rel=0 if rate else 0.1)
    assert not [event for event in rest if isinstance(event, Gap)]
    assert any("in bursts" in remark for remark in _remarks(rest))


def test_stamps_of_a_busy_host_are_no_losses() -> None:
    """Rows at 101.3 Hz, stamped up to a period late: a long step is made up for by the next."""
    late = np.random.default_rng(8).gamma(1.5, 0.002, 3000)
    times = np.maximum.accumulate(np.arange(3000) / 101.3 + late)
    rows = "".join(f"{t:.3f},{G3}\n" for t in times)
    info, *rest = _decode("t[s],gx[dps],gy[dps],gz[dps]\n" + rows, math.nan)
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == pytest.approx(101.3, rel=0.002)
    assert not [event for event in rest if isinstance(event, Gap)]


def test_losses_are_no_bursts() -> None:
    keep = np.random.default_rng(3).random(3000) > 0.05
    rows = "".join(f"{0.01 * i:.2f},{G3}\n" for i in np.flatnonzero(keep))
    events = _decode("t[s],gx[dps],gy[dps],gz[dps]\n" + rows, math.nan)
    lost = sum(event.lost or 0 for event in events if isinstance(event, Gap))
    assert lost == pytest.approx(np.count_nonzero(~keep), rel=0.1)


@pytest.mark.parametrize(("times", "used"), [("bursts", False), ("others", False), ("same", True)])
def test_a_given_rate_is_above_times_that_disagree(times: str, used: bool) -> None:
    stamps = {
        "bursts": _bursts(400, 5, 2),
        "others": [0.002 * i for i in range(400)],
        "same": [0.00985 * i for i in range(400)],
    }[times]
    rows = "".join(f"{t:.6f},{G3}\n" for t in stamps)
    info, *rest = _decode("t[s],gx[dps],gy[dps],gz[dps]\n" + rows, math.nan, rate_hz=100.0)
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == 100.0
    assert info.device_clock is used
    assert any("ignored" in remark for remark in _remarks(rest)) is not used
    (block,) = [event for event in rest if isinstance(event, Block)]
    assert bool(len(block.ticks.offset)) is used


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            "gx[dps],gy[dps]\n0.1,abc\n0.1,2,3,4\n",
            "line 2, column 2: 'abc' is not a number; line 3: 4 cells",
        ),
        ("p,q\n1,2\n", "line 1: no axis among 'p', 'q'; names are t gx gy gz ax ay az temp"),
        ("gx[furlong],q\n1,2\n", "line 1: the unit of 'gx[furlong]' is not known"),
        ("1,2\n3,4\n", "line 1: 2 columns without names; write names above, e.g. 'gx gy' (al"),
        ("1\n2\n", "line 1: 1 column without a name; write a name above, e.g. 'gx' (also t"),
        ("1 " * 40 + "\n", "line 1: 40 columns without names; write names above, e.g. 'gx gy gz "),
        ("\x00\x01\xff\xfe" * 50, ""),
    ],
)
def test_why_a_text_is_no_table_names_line_and_column(text: str, why: str) -> None:
    said = why_no_rows(text.encode("latin-1"))
    assert said.startswith(why)
    assert bool(said) is bool(why)


YMR = (
    "$VNYMR,+164.618,+022.062,-003.757,-00.3611,-00.0797,+00.2916,"
    "+03.553,+00.595,-08.826,+00.004000,-00.000843,+00.000141*64\r\n"
)
"""As a VN-100 sends it; the checksum is its own."""


@pytest.mark.parametrize("host_s", [math.nan, 5.0])
def test_sentences_of_a_vectornav_are_rows(host_s: float) -> None:
    info, *rest = _decode(YMR * 40, host_s)
    assert isinstance(info, StreamInfo)
    assert info.axes == AXES
    (block,) = (event for event in rest if isinstance(event, Block))
    assert len(block) == 40
    rates = np.degrees([0.004, -0.000843, 0.000141])
    forces = np.array([3.553, 0.595, -8.826]) / 9.80665
    assert block.counts[7] == pytest.approx(np.concatenate([rates, forces]))
    assert not _remarks(rest)
    assert sniff((YMR * 5).encode()).name == "text"


def test_a_sentence_with_a_wrong_checksum_or_of_another_name_is_left_out() -> None:
    decoder = TextDecoder(WireSettings())
    damaged = YMR.replace("+03.553", "+03.653")
    other = "$VNRRG,07,40*5C\r\n"
    events = decoder.feed((YMR * 30 + damaged + other + YMR * 30).encode(), math.nan)
    events += decoder.finish()
    blocks = [event for event in events if isinstance(event, Block)]
    assert sum(len(block) for block in blocks) == 60
    assert decoder.stats.crc_errors == 1
    assert decoder.stats.unknown == 1
    assert [event.lost for event in events if isinstance(event, Gap)] == [None]


def test_sentences_of_an_unknown_name_are_rows_without_a_header() -> None:
    info, *rest = _decode("$IMU,0.1,0.2,0.3,0.01,-0.02,1.0\n" * 40, math.nan)
    assert isinstance(info, StreamInfo)
    assert info.axes == AXES
    assert "no header" in _remarks(rest)[0]


@pytest.mark.parametrize("units", ["ms,mdps,mg", "[ms],[mdps],[mg]", "(ms),(mdps),(mg)"])
def test_units_in_a_second_line_of_the_header(units: str) -> None:
    rows = "".join(f"{20 * i},{500 + i % 3},{1000 + i % 2}\n" for i in range(40))
    info, *rest = _decode(f"Time,Gyro_X,Acc_Z\n{units}\n{rows}", math.nan)
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == pytest.approx(50.0)
    (block,) = (event for event in rest if isinstance(event, Block))
    assert block.counts[1].tolist() == pytest.approx([0.501, 1.001])
    assert not _remarks(rest)


def test_words_below_a_header_are_no_units() -> None:
    events = _decode("gx[dps],gy,temp\nleft,right,warm\n" + "1.5,2.5,20\n" * 40, math.nan)
    (info,) = (event for event in events if isinstance(event, StreamInfo))
    assert info.axes == ("gx", "gy")


def test_the_first_three_rows_that_are_none_are_told_with_their_column() -> None:
    bad = ["1,oops,3", "1,2,n/a", "1;2;3", "x,y,z"]
    text = "gx[dps],gy[dps],gz[dps]\n" + "1.5,2.5,3.5\n" * 30 + "\n".join(bad) + "\n"
    told = [event.text for event in _decode(text, math.nan) if isinstance(event, Notice)]
    assert [one.partition(" (")[2].partition(")")[0] for one in told] == [
        "column 2: 'oops' is not a number",
        "column 3: 'n/a' is not a number",
        "",  # another separator
    ]


@pytest.mark.parametrize(("columns", "first"), [(6, 0.3), (3, 0.1)])
def test_a_unit_that_is_given_does_not_hide_gravity(columns: int, first: float) -> None:
    """Six columns are told apart as before; three are what the unit was given of."""
    line = ",".join(map(repr, [*A3["m/s^2"], 0.3, 0.02, -0.1][:columns]))
    info, *rest = _decode(f"{line}\n" * 40, units={"gyro": "dps"})
    assert isinstance(info, StreamInfo)
    block = next(event for event in rest if isinstance(event, Block))
    assert block.counts[0][info.axes.index("gx")] == first


@pytest.mark.parametrize(
    ("header", "row", "rate"),
    [
        ("gz[rad/s]", "1e308", 104.0),  # infinite in dps
        ("t[s],gx[dps]", "{n}e-320,0.1", None),  # stamps that are next to nothing
        ("t[ms],gx[dps]", "{n}e-300,0.1", 104.0),
    ],
)
def test_numbers_at_the_ends_of_float64_overflow_nowhere(
    header: str, row: str, rate: float | None
) -> None:
    text = header + "\n" + "".join(row.format(n=i // 3) + "\n" for i in range(300))
    decoder = TextDecoder(WireSettings(rate_hz=rate))
    events = [*decoder.feed(text.encode(), math.nan), *decoder.finish()]
    infos = [event for event in events if isinstance(event, StreamInfo)]
    assert all(math.isfinite(info.nominal_hz) for info in infos)
