"""Finding the board, with every port injected: a test machine has none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from allanscope.errors import DeviceError
from allanscope.sources import PortDescription, auto_port, describe_ports, find_ports


def port(device: str, usb: str = "", serial: str = "", location: str = "") -> Any:
    vendor, product = (int(part, 16) for part in usb.split(":")) if usb else (None, None)
    return SimpleNamespace(
        device=device,
        vid=vendor,
        pid=product,
        serial_number=serial or None,
        manufacturer="STMicroelectronics" if usb.startswith("0483") else None,
        product=None,
        location=location or None,
    )


SENSORTILE = port("/dev/ttyACM1", "0483:5740", "205A37")
ST_LINK = port("/dev/ttyACM0", "0483:374b", "0669FF")
FTDI = port("/dev/ttyUSB0", "0403:6001", "A1")
BUILT_IN = port("/dev/ttyS0")


def test_the_sensortile_comes_before_an_st_link_and_both_before_strangers() -> None:
    ports = find_ports(lambda: [BUILT_IN, FTDI, ST_LINK, SENSORTILE])
    assert [one.device for one in ports][:2] == ["/dev/ttyACM1", "/dev/ttyACM0"]
    assert [bool(one.kind) for one in ports] == [True, True, False, False]
    assert auto_port(lambda: [ST_LINK, SENSORTILE]).usb_id == "0483:5740"


@pytest.mark.parametrize("product", ["374a", "374b", "374e", "374f", "3752", "3753"])
def test_every_st_link_is_a_board(product: str) -> None:
    assert auto_port(lambda: [FTDI, port("/dev/ttyACM0", f"0483:{product}")]).kind.startswith("ST-")


def test_the_choice_between_two_boards_does_not_depend_on_their_order() -> None:
    one, two = port("/dev/ttyACM9", "0483:5740", "AA"), port("/dev/ttyACM1", "0483:5740", "BB")
    assert auto_port(lambda: [one, two]) == auto_port(lambda: [two, one])
    assert auto_port(lambda: [one, two]).serial_number == "AA"


def test_ports_are_ordered_as_people_count() -> None:
    names = [f"/dev/ttyS{number}" for number in (10, 9, 1)]
    found = find_ports(lambda: [port(name) for name in names])
    assert [one.device for one in found] == ["/dev/ttyS1", "/dev/ttyS9", "/dev/ttyS10"]


def test_a_stranger_with_the_same_product_number_is_no_board() -> None:
    with pytest.raises(DeviceError):
        auto_port(lambda: [port("/dev/ttyACM0", "1234:5740")])


def test_without_a_board_it_says_what_it_looked_for_and_what_is_there() -> None:
    with pytest.raises(DeviceError) as caught:
        auto_port(lambda: [BUILT_IN, FTDI])
    line = str(caught.value)
    for words in ("0483:5740", "374b", "/dev/ttyS0", "/dev/ttyUSB0", "allanscope live sim"):
        assert words in line
    assert "\n" not in line
    with pytest.raises(DeviceError, match="no serial port was found"):
        auto_port(list)


def test_macos_ports_are_listed_by_their_calling_name() -> None:
    twins = [port("/dev/tty.usbmodem1", "0483:5740"), port("/dev/cu.usbmodem1", "0483:5740")]
    assert [one.device for one in find_ports(lambda: twins)] == ["/dev/cu.usbmodem1"]
    assert [one.device for one in find_ports(lambda: twins[:1])] == ["/dev/tty.usbmodem1"]


def test_the_list_says_which_one_auto_takes() -> None:
    lines = describe_ports(lambda: [BUILT_IN, SENSORTILE])
    assert "SensorTile" in lines[0]
    assert "serial 205A37" in lines[0]
    assert lines[-1] == "auto takes /dev/ttyACM1"
    assert "no board found" in describe_ports(lambda: [BUILT_IN])[-1]


def test_a_device_is_known_by_its_serial_number_and_else_by_its_socket() -> None:
    def described(device: str, serial: str = "", location: str = "") -> PortDescription:
        return find_ports(lambda: [port(device, "0483:5740", serial, location)])[0]

    board = described("/dev/ttyACM0", "AA", "1-1")
    assert board.is_same_device(described("/dev/ttyACM3", "AA", "1-2"))
    assert not board.is_same_device(described("/dev/ttyACM0", "BB", "1-1"))
    assert not board.is_same_device(described("/dev/ttyACM0", "", "1-1"))
    nameless = described("/dev/ttyACM0", "", "1-1")
    assert nameless.is_same_device(described("/dev/ttyACM1", "", "1-1"))
    assert not nameless.is_same_device(described("/dev/ttyACM0", "", "1-2"))
    assert not find_ports(lambda: [BUILT_IN])[0].is_same_device(find_ports(lambda: [BUILT_IN])[0])


def test_what_a_device_calls_itself_cannot_write_to_the_terminal() -> None:
    hostile = port("/dev/ttyACM0", "0483:5740", "A\x1b[2J")
    hostile.manufacturer, hostile.product = "evil\n\x07corp", "\x1b]0;owned\x07"
    lines = describe_ports(lambda: [hostile])
    assert all(line.isprintable() for line in lines)
    assert all(text.isprintable() for text in find_ports(lambda: [hostile])[0].facts().values())
