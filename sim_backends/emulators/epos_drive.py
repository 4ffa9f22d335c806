"""State machine of an emulated drive and what its modes do (CiA 402, 07 section 2.3)."""

import enum
from collections.abc import Callable

from sim_backends.emulators.epos_loops import Loops
from sim_backends.emulators.epos_objects import ABORT_RANGE, MODES, Abort, Entry, key

POWER_STAGE_S = 0.004
"""Time that the power stage takes to come up [U]."""
FOLLOWING_ERROR, MOTION_REGISTER = 0x8611, 0x21


class State(enum.IntEnum):
    """Of the drive; the value is its statusword without the bits that say other things."""

    DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    REACTING = 0x0F
    FAULT = 0x08


class Drive:
    """A power stage with its state machine.

    Attributes:
        power_stage: the motor is energised.
        ignores: it does not follow its set values, as with a lost enable input.
        stuck_fault: the cause of the last fault is still there, so that no reset succeeds.
    """

    def __init__(self, generation: str) -> None:
        self.generation = generation
        self.power_stage = self.ignores = self.stuck_fault = False
        self.loops = Loops(generation)

    def start(self, objects: dict[int, Entry], emergency: Callable[[int, int], None]) -> None:
        """After a reset."""
        self._objects, self._emergency = objects, emergency
        self._controlword, self._statusword = objects[key(0x6040)], objects[key(0x6041)]
        self._mode, self._shown_mode = objects[key(0x6060)], objects[key(0x6061)]
        self.state, self._word, self._timer_s = State.DISABLED, 0, 0.0
        self.loops.start(objects)
        self._show()

    def check(self, index: int, value: int) -> None:
        """Whether a value may be written now. Raises Abort."""
        if index == 0x6060 and value not in MODES[self.generation]:
            raise Abort(ABORT_RANGE)
        if index == 0x60C2 and value == 0:
            raise Abort(ABORT_RANGE)

    def obey(self, has_controlword: bool) -> None:
        """Objects were written; a rising bit 7 of the controlword resets a fault."""
        if not has_controlword:
            return
        word = self._controlword.value
        if word & 0x80 and not self._word & 0x80 and self.state == State.FAULT and not self.stuck_fault:
            self.state = State.DISABLED
            self._objects[key(0x1001)].value = self._objects[key(0x603F)].value = 0
            self._emergency(0, 0)
            self._word = 0
        self._word = word

    def fail(self, code: int, register: int) -> None:
        """A fault: an emergency, then the reaction of 605E."""
        if self.state in (State.FAULT, State.REACTING):
            return
        self._objects[key(0x1001)].value, self._objects[key(0x603F)].value = register, code
        self._emergency(code, register)
        ramp = self.power_stage and self._objects[key(0x605E)].value == 2
        self._enter(State.REACTING if ramp else State.FAULT)

    def lose_master(self, option: int) -> None:
        """The reaction of 6007: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop."""
        if option == 1:
            self.fail(0x8130, 0x11)
        elif option == 2:
            self._enter(State.DISABLED)
        elif option == 3 and self.state == State.ENABLED:
            self._enter(State.QUICK_STOP)
        self._word = 0x02

    def _enter(self, state: State) -> None:
        if state in (State.QUICK_STOP, State.REACTING):
            self.loops.begin_stop()
        self.state, self._timer_s = state, 0.0
        if state not in (State.ENABLED, State.QUICK_STOP, State.REACTING):
            self.power_stage = False

    def _step(self, dt_s: float) -> None:
        """One transition of the state machine."""
        word, state = self._word, self.state
        self._timer_s += dt_s
        if state in (State.REACTING, State.QUICK_STOP) and self.loops.stopped:
            if state == State.REACTING:
                self._enter(State.FAULT)
            elif self._objects[key(0x605A)].value in (1, 2):
                self._enter(State.DISABLED)
        elif state in (State.FAULT, State.REACTING):
            return
        elif not word & 0x02:
            if state != State.DISABLED:
                self._enter(State.DISABLED)
        elif not word & 0x04:
            if state == State.ENABLED:
                self._enter(State.QUICK_STOP)
            elif state in (State.READY, State.SWITCHED_ON):
                self._enter(State.DISABLED)
        elif state == State.QUICK_STOP:
            return
        elif word & 0x07 == 0x06:
            if state != State.READY:
                self._enter(State.READY)
        elif state == State.READY:
            self._enter(State.SWITCHED_ON)
        elif not word & 0x08:
            if state == State.ENABLED:
                self._enter(State.SWITCHED_ON)
        elif state == State.SWITCHED_ON:
            self.power_stage = True
            if self._timer_s >= POWER_STAGE_S:
                self.loops.begin()
                self._enter(State.ENABLED)

    def advance(self, dt_s: float) -> None:
        """State machine, then loops, then what they show."""
        self._step(dt_s)
        if self.loops.advance(dt_s, self.state == State.ENABLED and not self.ignores, self._ramping, self.power_stage, self._word):  # fmt: skip
            self.fail(FOLLOWING_ERROR, MOTION_REGISTER)
        self._show()

    @property
    def _ramping(self) -> bool:
        return self.state in (State.QUICK_STOP, State.REACTING)

    def _show(self) -> None:
        """Bring the objects that tell of the drive up to date."""
        word = int(self.state) | 0x0200
        if self.power_stage or self.state in (State.READY, State.SWITCHED_ON):
            word |= 0x10  # voltage enabled
        word |= self.loops.flags(self.state == State.ENABLED and not self.ignores)
        self._statusword.value = word
        self._shown_mode.value = self._mode.value
        self.loops.show()
