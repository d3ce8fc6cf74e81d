"""The C driver of the real part, called by ctypes on a bus of Python functions."""

import ctypes as c

import numpy as np

from support.lsm6dsm_model import Lsm6dsm

READ = c.CFUNCTYPE(c.c_bool, c.c_void_p, c.c_uint8, c.POINTER(c.c_uint8), c.c_uint16)
WRITE = c.CFUNCTYPE(c.c_bool, c.c_void_p, c.c_uint8, c.c_uint8)
WAIT = c.CFUNCTYPE(None, c.c_void_p, c.c_uint32)
WELL, SILENT, RESET = range(3)


class Bus(c.Structure):
    _fields_ = (
        ("context", c.c_void_p),
        ("read", READ),
        ("write", WRITE),
        ("wait_ms", WAIT),
        ("one_data_line", c.c_bool),
        ("interrupt", c.c_uint8),
    )


class Config(c.Structure):
    _fields_ = (("rate", c.c_float), ("gyro_fs", c.c_float), ("accel_fs", c.c_float))


class Batch(c.Structure):
    _fields_ = (
        ("n", c.c_uint8),
        ("lost_before", c.c_uint32),
        ("behind", c.c_uint32),
        ("sensor_time", c.c_uint32),
        ("doubts", c.c_uint8),
        ("temperature", c.c_int16),
        ("samples", c.c_int16 * 6 * 18),
    )


class Imu(c.Structure):
    """The head of struct imu: its functions, called with the object itself."""

    _fields_ = (
        ("configure", c.CFUNCTYPE(c.c_bool, c.c_void_p, c.POINTER(Config))),
        ("read", c.CFUNCTYPE(c.c_int, c.c_void_p, c.c_uint8, c.POINTER(Batch))),
        ("registers", c.CFUNCTYPE(c.c_uint8, c.c_void_p, c.POINTER(c.c_uint8), c.c_uint8)),
        ("part", c.c_char_p),
        ("who_am_i", c.c_uint8),
        ("source", c.c_uint8),
        ("watermark", c.c_uint8),
        ("counts_per_degc", c.c_float),
        ("rest", c.c_uint8 * 1024),
    )


class Driver:
    """The C driver on a bus of Python functions."""

    def __init__(self, library, part, name="dsm"):
        self.part = part
        self._library = library
        functions = READ(self._read), WRITE(self._write), WAIT(self._wait)
        self._bus = Bus(None, *functions, part.one_data_line, part.interrupt)
        self.imu = Imu()
        kind = c.c_char.in_dll(library, f"lsm6_{name}")
        library.lsm6dsm_init(c.byref(self.imu), c.byref(kind), c.byref(self._bus))

    def _read(self, _, register, to, n):
        data = self.part.read(register, n)
        if data is None:
            return False
        c.memmove(to, data, n)
        return True

    def _write(self, _, register, value):
        return self.part.write(register, value)

    def _wait(self, _, ms):
        self.part.advance(ms / 1000.0)

    def self_test(self):
        return self._library.lsm6dsm_self_test(c.byref(self.imu))

    def configure(self, rate=104.0, gyro_fs=250.0, accel_fs=2.0):
        self.config = Config(rate, gyro_fs, accel_fs)
        return self.imu.configure(c.addressof(self.imu), c.byref(self.config))

    def read(self, most=16):
        batch = Batch()
        health = self.imu.read(c.addressof(self.imu), most, c.byref(batch))
        return health == WELL, batch

    def registers(self):
        pairs = (c.c_uint8 * 64)()
        n = self.imu.registers(c.addressof(self.imu), pairs, 64)
        return dict(zip(pairs[0:n:2], pairs[1:n:2], strict=True))


def numbers(batch):
    """Return which samples of the model a batch holds, from the counts of all six axes."""
    counts = np.array([list(row) for row in batch.samples[: batch.n]], np.int64).reshape(-1, 6)
    k = (counts[:, 0] + 32768) * pow(7, -1, 65536) % 65536
    for row, index in zip(counts, k, strict=True):
        assert row.tolist() == Lsm6dsm.counts(int(index))
    return k.tolist()
