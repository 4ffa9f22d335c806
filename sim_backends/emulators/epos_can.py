"""A CAN bus in memory that charges bit time, in lockstep: what does not fit into a tick is left over for the next.

No time passes in `send`. It passes in :meth:`LockstepBus.let_pass`, which the bench calls once a tick, and while somebody
waits in `recv`, so that SDO transfers work between two ticks.
"""

from collections import deque
from typing import Protocol

import can

QUEUE = 128
"""Frames that the controller's transmit queue holds."""
BUS_OFF, CONTROLLER = 0x40, 0x04
PASSIVE, ACTIVE = 0x30, 0x40
Frame = tuple[int, bytes]


def stuffed_bits(data_bytes: int) -> int:
    """Of a data frame with an 11-bit identifier and its space to the next, with as many stuff bits as there can be."""
    stuffable = 34 + 8 * data_bytes  # from the start bit to the end of the checksum
    return 47 + 8 * data_bytes + (stuffable - 1) // 4


STUFFED = tuple(stuffed_bits(n) for n in range(9))


class Received(can.Message):
    """A data frame for the master. python-can's own constructor takes longer than a driver's whole look at the frame."""

    __slots__ = ()

    def __init__(self, identifier: int, data: bytes) -> None:
        self.timestamp, self.channel = 0.0, None
        self.arbitration_id, self.data, self.dlc = identifier, bytearray(data), len(data)
        self.is_extended_id = self.is_remote_frame = self.is_error_frame = self.is_fd = False
        self.bitrate_switch = self.error_state_indicator = False
        self.is_rx = True


class Participant(Protocol):
    """A device on the bus."""

    outgoing: deque[Frame]
    """frames it wants to send, in order; always the same queue"""
    hears: set[int]
    """identifiers that its filter lets through"""

    def hear(self, identifier: int, data: bytes) -> None:
        """A frame of the master has arrived."""


class LockstepBus(can.BusABC):
    """The master's end. Not for threads.

    Everybody sends in the order of their own queue; between the heads of the queues the lowest identifier wins.

    Attributes:
        busy: share of the bus that others take, 0 .. 1.
        left_over: frames that did not fit in when time passed last.
    """

    def __init__(self, channel: str, bitrate: int) -> None:
        super().__init__(channel=channel)
        self._is_shutdown = True  # nothing to release
        self.channel_info = f"lockstep {channel}"
        self.bitrate = bitrate
        self.participants: list[Participant] = []
        self.busy, self.left_over = 0.0, 0
        self.off = self.full = False
        self._outgoing: deque[Frame] = deque()
        self._queues = [self._outgoing]
        self._incoming: deque[can.Message] = deque()
        self._bits = 0.0

    def join(self, participant: Participant) -> None:
        """Connect a device."""
        self.participants.append(participant)
        self._queues.append(participant.outgoing)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        """Queue a frame. Raises CanOperationError when the queue is full or the controller off."""
        if self.off:
            raise can.CanOperationError("Network is down")
        if self.full or len(self._outgoing) >= QUEUE:
            raise can.CanOperationError("Transmit buffer full")
        if msg.is_extended_id or msg.is_remote_frame or msg.is_error_frame or len(msg.data) > 8:
            raise ValueError(f"no drive understands this frame: {msg}")
        self._outgoing.append((msg.arbitration_id, bytes(msg.data)))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The oldest frame for the master. Filters are not known here, so nothing is left of what python-can does in recv."""
        if not self._incoming and timeout != 0.0:
            self.let_pass(1.0 if timeout is None else timeout)
        return self._incoming.popleft() if self._incoming else None

    def let_pass(self, seconds: float) -> None:
        """Carry what fits into so much time; a bus that idles saves nothing up."""
        if self.off:
            for queue in self._queues:
                queue.clear()
            return
        self._bits += seconds * self.bitrate * (1.0 - self.busy)
        queues = self._queues
        while True:
            winner = None
            for queue in queues:
                if queue and (winner is None or queue[0] < winner[0]):
                    winner = queue
            if winner is None:
                self._bits, self.left_over = 0.0, 0
                return
            cost = STUFFED[len(winner[0][1])]
            if cost > self._bits:
                self.left_over = sum(map(len, queues))
                return
            self._bits -= cost
            identifier, data = winner.popleft()
            if winner is self._outgoing:
                for participant in self.participants:
                    if identifier in participant.hears:
                        participant.hear(identifier, data)
            else:
                self._incoming.append(Received(identifier, data))

    def raise_error(self, error_class: int, controller: int = 0) -> None:
        """The controller tells of an error, in a frame as socketcan makes it."""
        data = bytes((0, controller, 0, 0, 0, 0, 0, 0))
        self._incoming.append(can.Message(arbitration_id=error_class, is_extended_id=False, is_error_frame=True, data=data))  # fmt: skip

    def shutdown(self) -> None:
        """The master lets go: what waits for it is lost. It may come back."""
        self._incoming.clear()
        self._outgoing.clear()
