"""A host at the serial port of an emulated board."""

import time

import serial

from allanscope.samples import Block, Gap, Notice
from allanscope.wire import WireSettings, format_named
from allanscope.wire.native.framing import pack_frame

START, STOP, DESCRIBE, SET, PING = 0x81, 0x82, 0x83, 0x84, 0x85


class Host:
    """A host at the board's port: decodes what comes, sends commands, keeps everything."""

    def __init__(self, board):
        self._board = board
        self._port = serial.Serial(str(board.port), timeout=0.02)
        self._decoder = format_named("native").decoder(WireSettings())
        self.events = []
        self.sent = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._port.close()

    def send(self, kind, body=b""):
        self.sent += 1
        self._port.write(b"\0" + pack_frame(kind, self.sent, 0, body))
        return self.sent

    def until(self, condition, what):
        """Read until something is there."""
        patience = self._board.patience()
        while not condition():
            assert not patience.ended(), f"no {what} from the board"
            data = self._port.read(self._port.in_waiting or 1)
            self.events += self._decoder.feed(data, time.monotonic())

    def acknowledged(self, seq):
        replies = [e for e in self.events if isinstance(e, Notice) and e.kind == "reply"]
        return [reply.fields["result"] for reply in replies if reply.fields["sequence"] == seq]

    def answered(self):
        """Return the commands that the board has replied to."""
        return {
            e.fields["sequence"] for e in self.events if isinstance(e, Notice) and e.kind == "reply"
        }

    def ask(self, kind, body=b""):
        """Send a command, again while no reply comes as the norm says, and return its result.

        What the board sends before QEMU has noticed that its port was opened is lost.
        """
        sent = [self.send(kind, body)]
        next_try = time.monotonic() + 2.0

        def answered():
            nonlocal next_try
            if time.monotonic() > next_try:
                sent.append(self.send(kind, body))
                next_try += 2.0
            return any(self.acknowledged(seq) for seq in sent)

        self.until(answered, f"reply to {kind:#x}")
        return next(result for seq in sent for result in self.acknowledged(seq))

    @property
    def blocks(self):
        return [event for event in self.events if isinstance(event, Block)]

    def samples(self):
        return sum(map(len, self.blocks))

    def lost(self):
        return sum(e.lost for e in self.events if isinstance(e, Gap) and e.lost is not None)

    def last_status(self):
        found = [e for e in self.events if isinstance(e, Notice) and e.kind == "status"]
        return found[-1].fields if found else {}
