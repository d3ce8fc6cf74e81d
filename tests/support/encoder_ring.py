"""The ring of the C encoder, from which a device takes what goes out."""

import ctypes as c


class Ring(c.Structure):
    _fields_ = (
        ("bytes", c.POINTER(c.c_uint8)),
        ("size", c.c_uint32),
        ("reserve", c.c_uint32),
        ("put", c.c_uint32),
        ("taken", c.c_uint32),
    )
