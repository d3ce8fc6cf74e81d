"""Print the deepest stack of the firmware, from GCC's call graphs (-fcallgraph-info=su).

What the pointers of each file can reach is named here. On top come an interrupt and the one above
it: their own stack and the frames that the core saves, FPU included. Recursion has no depth and is
an error, and so is a call through a pointer in a file that is not named.
"""

import re
import sys
from pathlib import Path

EXCEPTION_FRAME = 108  # 26 words and one to align
BELOW = ("exti2_handler", "systick_handler")
ABOVE = "dma1_channel4_handler"
BUS = ("sensor_spi_read", "sensor_spi_write", "sensortile/sensortile.c:wait_ms")
SENSOR = ("lsm6dsm.c:configure", "lsm6dsm.c:read", "lsm6dsm.c:registers")
POINTERS = {
    "lsm6dsm": BUS,
    "lsm6dsm_self_test": BUS,
    "device": SENSOR,
    "descriptor": SENSOR,
    "usb_cdc": ("board_wait_ms",),
}


def load(folder):
    """Return stack bytes and callees of each function."""
    stack, calls = {}, {}
    for path in folder.glob("*.ci"):
        text = path.read_text()
        for title, label in re.findall(r'node: \{ title: "([^"]+)" label: "([^"]+)"', text):
            if found := re.search(r"\\n(\d+) bytes \((\w+)", label):
                if found[2] != "static":
                    raise SystemExit(f"{title}: its stack is {found[2]}, not static")
                stack[title] = int(found[1])
        for source, target in re.findall(
            r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text
        ):
            reached = POINTERS[path.stem] if target == "__indirect_call" else (target,)
            calls.setdefault(source, set()).update(reached)
    return stack, calls


def deepest(stack, calls, name, above=()):
    """Return the bytes of the deepest chain from a function on, and the chain."""
    if name in above:
        raise SystemExit(f"recursion: {' > '.join((*above, name))}")
    below = [deepest(stack, calls, target, (*above, name)) for target in calls.get(name, ())]
    size, chain = max(below, default=(0, ()))
    return size + stack.get(name, 0), (name.rpartition(":")[2], *chain)


if __name__ == "__main__":
    stack, calls = load(Path(sys.argv[1]))
    missing = {one for every in POINTERS.values() for one in every} - set(stack)
    if missing:
        raise SystemExit(f"not in the call graph: {', '.join(sorted(missing))}")
    size, chain = deepest(stack, calls, "main")
    handlers = max(deepest(stack, calls, name)[0] for name in BELOW)
    handlers += deepest(stack, calls, ABOVE)[0] + 2 * EXCEPTION_FRAME
    print(f"worst stack: {size + handlers} bytes, two interrupts included")
    print("deepest chain:", " > ".join(chain))
