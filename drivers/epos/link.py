"""Frames in and out, every tick: nothing here waits or raises (07 section 2.5)."""

from collections.abc import Sequence
from typing import Any

import can

from drivers.epos.axis import Axis
from drivers.epos.objects import EMERGENCY_COB, HEARTBEAT_COB, NMT_COB, SYNC_COB
from drivers.epos.service import PREOPERATIONAL

MOST_FRAMES = 500
"""Taken in a tick; what is left waits for the next."""
BUS_OFF_CLASS, CONTROLLER_CLASS = 0x40, 0x04
PASSIVE_BITS, STATE_BITS = 0x30, 0x7C
"""Of data[1] in a controller error: error-passive; all that tell a state and not an overflow."""
FEEDBACK_BYTES, EMERGENCY_BYTES = 6, 8
OPERATIONAL = 0x05
WINDOW = 50
"""Exchanges after which frames that got lost are no longer counted as owed."""


class Link:
    """A bus in operation.

    Attributes:
        off: the controller is bus-off, or the interface is down. passive: it is error-passive.
        unsent: frames of the latest exchange that the transmit queue did not take; all_unsent: of all.
        sync_tick: of the latest exchange; exchanges: how many there were.
        rebooted, emergency, beat_tick: by place in `axes`: started anew; code of the last emergency; latest heartbeat.
        malformed, error_frames, emergencies, sync_late: counters.
    """

    def __init__(self, bus: Any, axes: Sequence[Axis], master: int) -> None:
        self.bus, self.axes = bus, tuple(axes)
        self.off = self.passive = False
        self.unsent = self.all_unsent = self.exchanges = self.sync_tick = 0
        n = len(self.axes)
        self.rebooted, self.emergency, self.beat_tick = [False] * n, [0] * n, [0] * n
        self.malformed = self.error_frames = self.emergencies = self.sync_late = 0
        self._by_feedback = {axis.feedback_cob: axis for axis in self.axes}
        self._by_beat = {HEARTBEAT_COB + axis.options.node: i for i, axis in enumerate(self.axes)}
        self._by_emergency = {EMERGENCY_COB + axis.options.node: i for i, axis in enumerate(self.axes)}
        self._sync = can.Message(arbitration_id=SYNC_COB, is_extended_id=False)
        self._beat = can.Message(arbitration_id=HEARTBEAT_COB + master, is_extended_id=False, data=bytes((OPERATIONAL,)))  # fmt: skip

    def receive(self, tick: int) -> None:
        """Take what has come."""
        receive = self.bus.recv
        try:
            for _ in range(MOST_FRAMES):
                message = receive(0.0)
                if message is None:
                    return
                self._take(message, tick)
        except (can.CanError, OSError):
            self.off = True

    def settle(self, wait_s: float) -> None:
        """Give the bus some time, then take what has come: not for the loop."""
        try:
            message = None if self.off else self.bus.recv(wait_s)
        except (can.CanError, OSError):
            self.off = True
            return
        if message is not None:
            self._take(message, self.sync_tick)
            self.receive(self.sync_tick)

    def _take(self, message: can.Message, tick: int) -> None:
        axis = self._by_feedback.get(message.arbitration_id)
        if axis is not None and len(message.data) == FEEDBACK_BYTES and _is_plain(message):
            axis.feed(message.data, self.sync_tick)
        else:
            self._receive_other(message, tick)

    def _receive_other(self, message: can.Message, tick: int) -> None:
        identifier, data = message.arbitration_id, message.data
        if message.is_error_frame:
            self._receive_error(identifier, data)
        elif not _is_plain(message):
            self.malformed += 1
        elif identifier in self._by_beat and len(data) == 1:
            place = self._by_beat[identifier]
            self.beat_tick[place] = tick
            if data[0] == 0x00:
                self.rebooted[place] = True
        elif identifier in self._by_emergency and len(data) == EMERGENCY_BYTES:
            self.emergencies += 1
            self.emergency[self._by_emergency[identifier]] = data[0] | data[1] << 8
        elif identifier in self._by_feedback or identifier in self._by_beat or identifier in self._by_emergency:
            self.malformed += 1

    def _receive_error(self, error_class: int, data: bytearray) -> None:
        self.error_frames += 1
        if error_class & BUS_OFF_CLASS:
            self.off = True
        if error_class & CONTROLLER_CLASS and len(data) > 1 and data[1] & STATE_BITS:
            self.passive = bool(data[1] & PASSIVE_BITS)

    def exchange(self, tick: int) -> None:
        """Send every set value, then the SYNC at which the drives take them over and sample."""
        if self.exchanges == 0:
            self.sync_tick = tick
            self.beat_tick = [tick] * len(self.axes)
        self.unsent = 0
        if self.exchanges % WINDOW == 0:
            self.forgive()
        for axis in self.axes:
            self._send(axis.message)
            if self.exchanges == 0:
                axis.sampled_tick = tick
            axis.unanswered += 1
            axis.owed += 1
        self._send(self._sync)
        self.exchanges += 1
        self.sync_tick = tick

    def beat(self) -> None:
        """Tell the drives that somebody is in charge: without it they stop by themselves."""
        self._send(self._beat)

    def release(self, node: int) -> None:
        """Take a node out of operation."""
        self._send(can.Message(arbitration_id=NMT_COB, is_extended_id=False, data=bytes((PREOPERATIONAL, node))))

    def forgive(self) -> None:
        """Nothing is owed from now on."""
        for axis in self.axes:
            axis.owed = 0

    def _send(self, message: can.Message) -> None:
        if self.off:
            return
        try:
            self.bus.send(message)
        except (can.CanError, OSError):
            self.unsent += 1
            self.all_unsent += 1


def _is_plain(message: can.Message) -> bool:
    return not (message.is_error_frame or message.is_extended_id or message.is_remote_frame)
