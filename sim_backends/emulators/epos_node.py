"""An emulated CANopen node: NMT, heartbeat, SYNC, process data, emergencies (CiA 301, 07 section 2.3)."""

import struct
from collections import deque

from sim_backends.emulators import epos_objects
from sim_backends.emulators.epos_can import Frame
from sim_backends.emulators.epos_drive import Drive
from sim_backends.emulators.epos_objects import key
from sim_backends.emulators.epos_pdo import Pdo, ProcessData
from sim_backends.emulators.epos_sdo import SdoServer

BOOT_S = 0.005
"""From a reset to the boot-up frame; of a drive that starts anew with its electronics still warm [U]."""
BOOT, STOPPED, OPERATIONAL, PREOPERATIONAL = 0x00, 0x04, 0x05, 0x7F
NMT, SYNC, SDO_ABORT = 0x000, 0x080, 0x80
HEARTBEAT_LOST, HEARTBEAT_REGISTER = 0x8130, 0x11


class Node:
    """A drive on the bus.

    Attributes:
        mute, heartbeat_dead: says nothing any more; sends no heartbeat any more.
        deaf_to_sync: SYNCs that it will miss.
    """

    def __init__(self, node: int, generation: str) -> None:
        self.node, self.generation = node, generation
        self.outgoing: deque[Frame] = deque()
        self.hears: set[int] = set()
        self.mute = self.heartbeat_dead = False
        self.deaf_to_sync = 0
        self.drive = Drive(generation)
        self.sdo = SdoServer(self._check, self._written)
        self._start()
        self.state = PREOPERATIONAL  # it was switched on long ago

    def _start(self) -> None:
        self.state, self._boot_s = BOOT, 0.0
        self.outgoing.clear()
        self._objects = epos_objects.make(self.node, self.generation)
        self.sdo.objects = self._objects
        self.drive.start(self._objects, self._emergency)
        self.pdo = ProcessData(self._objects, self._listen)
        self._since_beat_s, self._since_master_s, self._syncs = 0.0, -1.0, 0

    def restart(self) -> None:
        """As after a dip of its supply: position, settings and mappings are lost."""
        self.drive.power_stage = False
        self._start()

    def _listen(self) -> None:
        master = self._objects[key(0x1016, 1)].value >> 16 & 0x7F
        self._beat_of_master = 0x700 + master
        self._receives = {pdo.identifier: pdo for pdo in self.pdo.received} if hasattr(self, "pdo") else {}
        self.hears = {NMT, SYNC, 0x600 + self.node, self._beat_of_master, *self._receives}

    def _send(self, identifier: int, data: bytes) -> None:
        if not self.mute:
            self.outgoing.append((identifier, data))

    def _emergency(self, code: int, register: int) -> None:
        if self.state in (OPERATIONAL, PREOPERATIONAL):
            self._send(0x80 + self.node, struct.pack("<HB5x", code, register))

    def hear(self, identifier: int, data: bytes) -> None:
        """See :class:`sim_backends.emulators.epos_can.Participant`."""
        if self.state == BOOT:
            return
        if identifier == SYNC:
            if self.state == OPERATIONAL:
                self._sync()
        elif (pdo := self._receives.get(identifier)) is not None:
            if self.state == OPERATIONAL and len(data) >= pdo.codes.size:
                self._receive(pdo, data)
        elif identifier == NMT:
            if len(data) == 2 and data[1] in (0, self.node):
                self._command(data[0])
        elif identifier == 0x600 + self.node:
            if self.state != STOPPED and len(data) == 8 and data[0] != SDO_ABORT:
                self._send(0x580 + self.node, self.sdo.answer(data))
        elif identifier == self._beat_of_master:
            self._since_master_s = 0.0

    def _receive(self, pdo: Pdo, data: bytes) -> None:
        if pdo.synchronous:
            pdo.waiting = data
            return
        pdo.put(data)
        self.drive.obey(pdo.has_controlword)

    def _sync(self) -> None:
        """Sample first, then take over what was received since the last SYNC."""
        if self.deaf_to_sync:
            self.deaf_to_sync -= 1
            return
        self._syncs += 1
        for pdo in self.pdo.sent:
            if pdo.synchronous and (pdo.kind < 2 or self._syncs % pdo.kind == 0):
                self._send(pdo.identifier, pdo.take())
        for pdo in self.pdo.received:
            if pdo.waiting is not None:
                pdo.put(pdo.waiting)
                pdo.waiting = None
                self.drive.obey(pdo.has_controlword)

    def _command(self, command: int) -> None:
        if command == 0x81:
            self.restart()
        elif command == 0x82:
            self._start()
        elif command in (0x01, 0x02, 0x80):
            wanted = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PREOPERATIONAL}[command]
            if self.state == OPERATIONAL != wanted:
                self.drive.lose_master(self._objects[key(0x6007)].value)
            self.state = wanted

    def advance(self, dt_s: float) -> None:
        """Let the node's own time pass."""
        if self.state == BOOT:
            self._boot_s += dt_s
            if self._boot_s >= BOOT_S:
                self.state = PREOPERATIONAL
                self._send(0x700 + self.node, bytes((BOOT,)))
            return
        self._watch_master(dt_s)
        self.drive.advance(dt_s)
        self._beat(dt_s)
        if self.state == OPERATIONAL:
            for pdo in self.pdo.sent:
                if not pdo.synchronous and (data := pdo.take()) != pdo.last:
                    pdo.last = data
                    self._send(pdo.identifier, data)

    def _beat(self, dt_s: float) -> None:
        period_ms = self._objects[key(0x1017)].value
        self._since_beat_s += dt_s
        if period_ms and self._since_beat_s > (period_ms - 0.5) / 1e3:
            self._since_beat_s = 0.0
            if not self.heartbeat_dead:
                self._send(0x700 + self.node, bytes((self.state,)))

    def _watch_master(self, dt_s: float) -> None:
        """A master that was heard once must go on being heard."""
        limit_ms = self._objects[key(0x1016, 1)].value & 0xFFFF
        if not limit_ms or self._since_master_s < 0.0:
            return
        self._since_master_s += dt_s
        if self._since_master_s * 1e3 > limit_ms:
            self._since_master_s = -1.0
            self._emergency(HEARTBEAT_LOST, HEARTBEAT_REGISTER)
            self.drive.lose_master(self._objects[key(0x6007)].value)

    def _written(self, index: int) -> None:
        """An object was written by SDO."""
        if 0x1400 <= index < 0x1C00:
            self.pdo.compile()
        elif index == 0x1016:
            self._listen()
        self.drive.obey(index == 0x6040)

    def _check(self, index: int, sub: int, value: int) -> None:
        """Whether it may be. Raises Abort."""
        if 0x1400 <= index < 0x1C00:
            self.pdo.check(index, sub, value, self.state == PREOPERATIONAL)
        self.drive.check(index, value)
