"""The datagrams of a Net F/T: requests, records, and whether a record is new (07 section 3.4). Big-endian."""

import struct

MAGIC, STOP, START = 0x1234, 0, 2
RECORD = struct.Struct(">III6i")
"""rdt_sequence, ft_sequence, status, six counts."""
MODULUS = 2**32
LATE_RECORDS = 64
"""A record that is behind by more is no late one: the counters started anew."""
LATE_TICKS = 10
"""Nor does a late record come after a pause."""
MOST_SAMPLES_PER_S = 10_000
"""The sensor samples at up to 7 kHz [U]; ft_sequence cannot go on faster."""
SATURATED_BIT = 17
HARMLESS = 1 << 31 | 1 << 16
"""The summary of all bits, and a threshold that was passed."""
STATUS = {
    30: "processor or memory", 29: "digital board", 28: "analog board", 27: "serial link", 26: "program memory",
    25: "halted for its configuration", 24: "settings", 23: "configuration does not fit the calibration", 22: "network",
    21: "CAN", 20: "RDT", 19: "EtherNet/IP", 18: "DeviceNet", 17: "transducer saturated or A/D error", 14: "watchdog",
    12: "EEPROM", 9: "excitation current high", 8: "excitation current low", 7: "analog ground", 6: "supply high",
    5: "supply low", 4: "link data unavailable", 3: "reference", 2: "temperature",
}  # fmt: skip
"""What a bit of the status says."""


def request(command: int) -> bytes:
    """A request for endlessly many records, or for their end. The device's magic number is 1234 hexadecimal."""
    return struct.pack(">HHI", MAGIC, command, 0)


def difference(later: int, earlier: int) -> int:
    """How far a 32-bit counter went from `earlier` to `later`, if that is less than half its range."""
    return (later - earlier + MODULUS // 2) % MODULUS - MODULUS // 2


def worst_bit(status: int) -> int:
    """The highest bit of an error in a status word; that of saturation counts first. -1 for a healthy one."""
    if status >> SATURATED_BIT & 1:
        return SATURATED_BIT
    return (status & ~HARMLESS).bit_length() - 1


class Stream:
    """Tells new records from late ones, and a sensor that started anew from a record that is nonsense.

    A record that does not continue the stream is believed if the next one continues it: one datagram of nonsense
    changes nothing. Then either only rdt_sequence began anew, as with every request, or the sensor itself did.

    Attributes:
        lost, late: records so far that never came, that came twice or too late.
        advance: how far ft_sequence went with the last new record; 0 if the sensor repeats a sample.
        rebooted: with the last new record ft_sequence began anew.
    """

    def __init__(self, period_s: float) -> None:
        self._samples_per_tick = MOST_SAMPLES_PER_S * period_s
        self._started = self._doubted = False
        self._rdt = self._ft = self._tick = self._other_rdt = self._other_ft = 0
        self.lost = self.late = self.advance = 0
        self.rebooted = False

    def take(self, rdt: int, ft: int, tick: int) -> bool:
        """True if the record is a new one."""
        most = int((tick - self._tick + LATE_RECORDS) * self._samples_per_tick) + LATE_RECORDS
        step, advance = difference(rdt, self._rdt), difference(ft, self._ft)
        if self._started and 0 < step <= most and 0 <= advance <= most:
            self.lost += step - 1
            self._accept(rdt, ft, tick, advance, rebooted=False)
            return True
        recent = self._started and tick - self._tick <= LATE_TICKS
        if recent and -LATE_RECORDS <= step <= 0 and -most <= advance <= 0:
            self.late += 1
            return False
        if self._doubted and difference(rdt, self._other_rdt) == 1 and 0 <= difference(ft, self._other_ft) <= most:
            reboot = self._started and not 0 <= advance <= most
            self._accept(rdt, ft, tick, advance, rebooted=reboot)
            return True
        self._doubted, self._other_rdt, self._other_ft = True, rdt, ft
        return False

    def _accept(self, rdt: int, ft: int, tick: int, advance: int, *, rebooted: bool) -> None:
        self._started, self._doubted = True, False
        self._rdt, self._ft, self._tick = rdt, ft, tick
        self.advance, self.rebooted = advance, rebooted
