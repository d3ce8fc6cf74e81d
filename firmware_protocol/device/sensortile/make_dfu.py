"""Wrap a flash image into a DfuSe file: what ST's bootloader takes from `dfu-util -D`.

Layout from ST's UM0391: a prefix, one target with one element, and the suffix of USB DFU 1.1a.
"""

import struct
import sys
import zlib
from pathlib import Path

FLASH = 0x08000000
VENDOR, BOOTLOADER = 0x0483, 0xDF11


def dfu(image):
    """Return the file that holds an image for the start of the flash."""
    element = struct.pack("<II", FLASH, len(image)) + image
    name = b"SensorTile flash".ljust(255, b"\0")
    target = struct.pack("<6sBI255sII", b"Target", 0, 1, name, len(element), 1) + element
    prefix = struct.pack("<5sBIB", b"DfuSe", 1, 11 + len(target), 1)
    body = prefix + target
    suffix = struct.pack("<HHHH3sB", 0xFFFF, BOOTLOADER, VENDOR, 0x011A, b"UFD", 16)
    # The CRC of zlib without its final inversion.
    crc = zlib.crc32(body + suffix) ^ 0xFFFFFFFF
    return body + suffix + struct.pack("<I", crc)


if __name__ == "__main__":
    Path(sys.argv[2]).write_bytes(dfu(Path(sys.argv[1]).read_bytes()))
