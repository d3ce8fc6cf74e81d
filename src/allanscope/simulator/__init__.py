"""The simulated SensorTile: a sensor with known truth, firmware, and a port to plug a cable into.

::

    Truth ──▶ AxisSignal x 6 ──▶ Simulator ──▶ Firmware ──▶ Device ──▶ a pty, for anyone's reader
    N B K Q R   noise, effects     counts,       encoder,     thread,
    effects     (all streams)      clocks,       commands,    pacing,
                                   temperature   ring, faults  port

Two halves meet in the Block. The sensor half (`Truth`, `Simulator`) makes samples of which every
coefficient is known, so that whatever is estimated from them can be checked. The device half
(`Firmware`, `Device`) puts them on a wire as real firmware does: it obeys commands, drops samples
when the host does not read, damages bytes when told to, and keeps a `Ledger` of every sample that
did not arrive, so that what a reader reports as lost can be checked too.

Everything is reproducible from one seed, and independent of the sizes in which it is read.

===================================== ==============================================================
``truth`` ``noise`` ``effects``       coefficients, their noise, and what else is in a signal
``effect_spec`` ``parameters``        effects and faults as they are written on the command line
``signals`` ``simulator``             the signal of each axis; the sensor as a stream of Blocks
``firmware`` ``transmitter``          the program of the board; its ring, and what was lost
``faults``                            what damages bytes, or stops the device
``device`` ``virtual_port``           the board on a cable, and the port that a host opens
``pty_port``                          that port where the system has pseudo-terminals
``record``                            the same as a recording, without waiting for it
===================================== ==============================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.simulator.device import EMULATED_WIRE, Device, run_device, run_emulated
    from allanscope.simulator.effect_spec import EffectSpec, effect_help, parse_effect
    from allanscope.simulator.faults import FaultSpec, fault_help, parse_fault
    from allanscope.simulator.firmware import Firmware
    from allanscope.simulator.record import simulate_blocks, start_messages
    from allanscope.simulator.simulator import Simulator
    from allanscope.simulator.transmitter import Ledger, Loss
    from allanscope.simulator.truth import AxisTruth, TemperatureTruth, Truth

__all__ = [
    "EMULATED_WIRE",
    "AxisTruth",
    "Device",
    "EffectSpec",
    "FaultSpec",
    "Firmware",
    "Ledger",
    "Loss",
    "Simulator",
    "TemperatureTruth",
    "Truth",
    "effect_help",
    "fault_help",
    "parse_effect",
    "parse_fault",
    "run_device",
    "run_emulated",
    "simulate_blocks",
    "start_messages",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "AxisTruth": "truth",
        "Device": "device",
        "EMULATED_WIRE": "device",
        "EffectSpec": "effect_spec",
        "FaultSpec": "faults",
        "Firmware": "firmware",
        "Ledger": "transmitter",
        "Loss": "transmitter",
        "Simulator": "simulator",
        "TemperatureTruth": "truth",
        "Truth": "truth",
        "effect_help": "effect_spec",
        "fault_help": "faults",
        "start_messages": "record",
        "parse_effect": "effect_spec",
        "parse_fault": "faults",
        "run_device": "device",
        "run_emulated": "device",
        "simulate_blocks": "record",
    },
)
