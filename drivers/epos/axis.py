"""One drive in the loop: its set value and feedback as bytes, one step of its state machine an exchange."""

import math
import struct

import can

from drivers.epos import states
from drivers.epos.objects import FEEDBACK_COB, PER_MINUTE, SETPOINT_COB, position_limits
from drivers.epos.options import NodeOptions
from drivers.epos.states import STATE_OF, UPWARD, State

ENABLED, IN_QUICK_STOP, FAULT = State.ENABLED, State.QUICK_STOP, State.FAULT  # the tick has no time to look up enums
FEEDBACK = struct.Struct("<Hi")
SHORT, LONG = struct.Struct("<Hh"), struct.Struct("<Hi")
HIGHEST_16 = 2**15 - 1
JUMP_MARGIN, JUMP_COUNTS = 2.0, 2.0
"""A step of the encoder beyond this multiple of what the greatest speed gives, and so many counts, is no motion."""


class Axis:
    """Process data of one drive.

    A command is a current in the current modes and a speed in all others; the position modes integrate it, from where the
    drive stood when it was enabled, between its software limits.

    Attributes:
        angle_rad: accumulated since the first feedback, in the axis's own sense. samples: feedbacks received.
        sampled_tick: when the drive sampled the latest. unanswered: SYNCs since. owed: feedbacks missing since `forgive`.
        silent: its position is too old to be used.
        state: of the drive. enabled: it was seen enabled since power was asked for.
        jump_counts: size of an impossible step of the encoder, 0 for none. disobeyed: feedbacks in a row without bit 12.
        sum_v: commands since the last exchange, added up by whoever asks for one [V].
        message: what goes out, its data filled in by :meth:`demand`.
    """

    def __init__(self, options: NodeOptions, divisor: int, period_s: float) -> None:
        self.options, self.number, self._divisor = options, options.axis, divisor
        self.setpoint_cob, self.feedback_cob = SETPOINT_COB + options.node, FEEDBACK_COB + options.node
        codes = SHORT if options.by_current else LONG
        self.message = can.Message(arbitration_id=self.setpoint_cob, is_extended_id=False, data=bytes(codes.size))
        self._put, self._data = codes.pack_into, self.message.data
        self._rad_per_count = options.direction / options.counts_per_rad
        self._low, self._high = position_limits(options)
        self._jump_per_tick = JUMP_MARGIN * options.max_speed_rad_per_s * period_s * options.counts_per_rad
        self._tells_that_it_follows = options.mode in ("csp", "cst")
        self._is_ppm = options.mode == "ppm"
        self._integrates = options.mode in ("csp", "ppm", "position")
        self._per_v = options.direction * self._gain(divisor * period_s)
        self._largest = self._limit()
        self.forget()

    def _gain(self, exchange_s: float) -> float:
        """Drive's units of one volt: per mille or mA, rpm, or counts an exchange."""
        o = self.options
        if o.by_current:
            return 1e3 * (o.gain_a_per_v or 0.0) / (o.rated_current_a if o.mode == "cst" else 1.0)
        return (o.gain_rad_per_s_per_v or 0.0) * (PER_MINUTE if o.mode == "velocity" else exchange_s * o.counts_per_rad)

    def _limit(self) -> float:
        """Largest set value in the same units; a position has limits of its own, and its step that of the speed."""
        o = self.options
        if o.by_current:
            full = 1e3 * o.current_limit_a / (o.rated_current_a if o.mode == "cst" else 1.0)
            return min(full, float(HIGHEST_16))
        return o.max_speed_rad_per_s / (o.gain_rad_per_s_per_v or math.inf) * abs(self._per_v)

    def forget(self) -> None:
        """As before the first feedback."""
        self.samples, self.sampled_tick, self.unanswered, self.owed = 0, 0, 0, 0
        self.silent = False
        self.state, self.enabled, self.status = State.UNKNOWN, False, 0
        self.sum_v = 0.0
        self.angle_rad, self.jump_counts, self.disobeyed = 0.0, 0, 0
        self._counts, self._travel, self._set = 0, 0, 0.0

    def feed(self, data: bytes | bytearray, sync_tick: int) -> None:
        """A feedback frame of 6 bytes, the answer to the SYNC at `sync_tick`."""
        self.status, counts = FEEDBACK.unpack_from(data)
        self.state = STATE_OF[self.status & 0x7F]
        if self.samples:
            step = ((counts - self._counts + 0x80000000) & 0xFFFFFFFF) - 0x80000000
            ticks = max(sync_tick - self.sampled_tick, self._divisor)
            if abs(step) > self._jump_per_tick * ticks + JUMP_COUNTS:
                self.jump_counts = step
            self._travel += step
        self._counts = counts
        self.angle_rad = self._travel * self._rad_per_count
        self.samples += 1
        self.owed -= 1
        self.sampled_tick, self.unanswered = sync_tick, 0
        if self._tells_that_it_follows and self.state is ENABLED and not self.status & states.FOLLOWS:
            self.disobeyed += 1
        else:
            self.disobeyed = 0

    def demand(self, command_v: float, arm: bool, coast: bool, reset: bool) -> None:
        """Fill in what goes out next.

        arm: lead the drive towards ENABLED. Else it stops along its ramp; coast: the ramp's time is over. reset: clear
        its fault, which leads to switch-on disabled and no further.
        """
        state = self.state
        if arm:
            word = UPWARD[state]
            self.enabled = self.enabled or state is ENABLED
        else:
            self.enabled = False
            word = states.DISABLE
            if (state is ENABLED or state is IN_QUICK_STOP) and not coast:
                word = states.QUICK_STOP
            elif state is FAULT and reset:
                word = states.FAULT_RESET
        if not (arm and state is ENABLED):
            value = self._set = float(self._counts) if self._integrates else 0.0
        else:
            value = min(max(self._per_v * command_v, -self._largest), self._largest)
            if self._integrates:
                value = self._set = self._move(value)
            if self._is_ppm:
                word |= self._handshake()
        self._put(self._data, 0, word, int(value + 0.5 if value >= 0.0 else value - 0.5))

    def _move(self, step: float) -> float:
        """The set position moved by `step`. It is never moved further beyond a limit, nor pulled back from beyond one."""
        if step >= 0.0:
            return min(self._set + step, max(self._high, self._set))
        return max(self._set + step, min(self._low, self._set))

    def _handshake(self) -> int:
        """A set point is taken at a rising bit 4, which must fall again before the next one."""
        return states.AT_ONCE if self.status & states.ACKNOWLEDGES else states.AT_ONCE | states.NEW_SETPOINT
