"""The sensor that the firmware makes up on a board without one, as synthetic.c defines it."""

import numpy as np

F = np.float32


def count(index, axis):
    """Return the synthetic sensor's count, as synthetic.c defines it."""
    x = (index * 2654435761 + axis * 40503 + 1) & 0xFFFFFFFF
    for _ in range(3):
        x = (x ^ x << 13) & 0xFFFFFFFF
        x ^= x >> 17
        x = (x ^ x << 5) & 0xFFFFFFFF
    total = int((x & 255) + (x >> 8 & 255) + (x >> 16 & 255) + (x >> 24)) - 510
    noise = total // 16 if total >= 0 else -(-total // 16)
    return noise + (int(F(1) / F(0.061e-3)) if axis == 5 else 0)


def check_values(blocks):
    """Assert that every 13th sample is what the synthetic sensor defines."""
    for block in blocks:
        for row in range(0, len(block), 13):
            expected = [count(block.index + row, axis) for axis in range(6)]
            assert block.counts[row].tolist() == expected
