"""What can be wrong with a device, as one table: how grave, the operator's text, and what to do (07 section 7).

A device reports a trouble as long as it lasts, with a number that goes into its text. The lifecycle reacts by the
grade alone and latches faults; that values are not to be used is told by their validity, beside this.
"""

import enum
from dataclasses import dataclass


class Grade(enum.IntEnum):
    """What a trouble asks of the controller; the larger wins."""

    NONE = 0
    WARNING = 1
    """the operator should know"""
    PAUSE = 2
    """nothing moves on until somebody resumes; the way out stays open"""
    FAULT = 3
    """no power, until it is acknowledged"""


class Trouble(enum.IntEnum):
    """Every trouble by its code in the record; 0 is none."""

    NONE = 0
    # card
    CARD_LOST = 1
    ADC_NOT_DONE = 2
    ADC_STOPPED = 3
    ADC_REFERENCE = 4
    DAC_MISMATCH = 5
    # encoder
    ENCODER_JUMP = 10
    ENCODER_ERROR = 11
    ENCODER_STALLED = 12
    INDEX_DRIFT = 13
    INDEX_LOST = 14
    WRONG_WAY = 15
    INDEX_MISSING = 16
    # amplifier
    AMPLIFIER_NOT_READY = 20
    MOTOR_HOT = 21
    # force sensor
    GAUGE_SATURATED = 30
    GAUGE_FROZEN = 31
    GAUGE_CABLE = 32
    GAUGE_NOISE = 33
    LOAD_HIGH = 35
    LOAD_OVER_RATED = 36
    SENSOR_STATUS = 37
    SENSOR_REBOOTED = 38
    SENSOR_SILENT = 39
    SENSOR_FROZEN = 50
    # drives on a bus
    BUS_OFF = 40
    BUS_PASSIVE = 41
    BUS_OVERLOAD = 42
    NODE_LATE = 43
    NODE_SILENT = 44
    NODE_REBOOTED = 45
    DRIVE_FAULT = 46
    DRIVE_IGNORES = 47
    DRIVE_CONFIGURATION = 48
    # telemetry
    TELEMETRY_GAP = 60
    TELEMETRY_SILENT = 61
    TELEMETRY_NEW_RUN = 62
    TELEMETRY_FROZEN = 63
    TELEMETRY_CORRUPT = 64
    # serial and datagrams in general
    LINE_DESYNC = 70
    DATAGRAM_GAP = 71
    DATAGRAM_CORRUPT = 72


@dataclass(frozen=True)
class Row:
    """One line: `{value:...}` in the text is the number the device reports with it."""

    grade: Grade
    text: str
    remedy: str


W, P, F = Grade.WARNING, Grade.PAUSE, Grade.FAULT

TABLE: dict[Trouble, Row] = {
    Trouble.CARD_LOST: Row(F, "the card does not answer: its signature reads {value:.0f}", "switch off, check its seat and its base address, start again"),
    Trouble.ADC_NOT_DONE: Row(W, "a conversion was not done in time ({value:.0f} in a row)", "if it comes back, check the card"),
    Trouble.ADC_STOPPED: Row(F, "the converter does not finish any more ({value:.0f} ticks in a row)", "switch the card off and on; replace it if it stays"),
    Trouble.ADC_REFERENCE: Row(P, "the converter's reference is off by {value:.3g} %", "let the card warm up; have it calibrated if it stays"),
    Trouble.DAC_MISMATCH: Row(F, "an output is {value:.3g} V away from what was written", "check the output's wiring and the card's calibration"),
    Trouble.ENCODER_JUMP: Row(F, "an encoder jumped by {value:.0f} counts in a tick, more than its motor can turn", "check its cable and shield, then home again"),
    Trouble.ENCODER_ERROR: Row(F, "the counter of axis {value:.0f} saw a step no encoder makes", "check cable and shield, then home again"),
    Trouble.ENCODER_STALLED: Row(F, "axis {value:.0f} is driven and does not count", "look for a cut encoder wire or a jam, then home again"),
    Trouble.INDEX_DRIFT: Row(W, "an encoder is {value:.0f} counts off its index", "finish; then check its cable and home again"),
    Trouble.INDEX_LOST: Row(F, "an encoder is {value:.0f} counts off its index: its position is lost", "check its cable and shield, then home again"),
    Trouble.INDEX_MISSING: Row(W, "the encoder of axis {value:.0f} turned by more than a turn without an index pulse", "finish; then check the wires of its index: until they are mended lost counts go unnoticed"),
    Trouble.WRONG_WAY: Row(F, "axis {value:.0f} turns against its command", "compare the motor's and the encoder's wires with the settings"),
    Trouble.AMPLIFIER_NOT_READY: Row(F, "the amplifier of axis {value:.0f} is not ready", "check its supply, its temperature and its Ready line, then acknowledge"),
    Trouble.MOTOR_HOT: Row(P, "the motor of axis {value:.0f} has reached its thermal limit", "let it cool down; look for a jam"),
    Trouble.GAUGE_SATURATED: Row(W, "gauge {value:.0f} is at its rail: no force can be trusted", "unload the sensor; check its cable if it stays"),
    Trouble.GAUGE_FROZEN: Row(W, "gauge {value:.0f} does not change any more", "check the card's converter and the sensor's cable"),
    Trouble.GAUGE_CABLE: Row(W, "all gauges are at their rails: the sensor's cable is off", "connect the cable, then unbias again"),
    Trouble.GAUGE_NOISE: Row(W, "a gauge is noisy: {value:.3g} V rms", "check shield and ground of the sensor's cable"),
    Trouble.LOAD_HIGH: Row(P, "the sensor bears {value:.0f} % of what it is made for", "take the load off; look what presses"),
    Trouble.LOAD_OVER_RATED: Row(F, "the sensor bears {value:.0f} % of what it is made for", "take the load off, and calibrate the sensor before you trust it again"),
    Trouble.SENSOR_STATUS: Row(W, "the force sensor reports status bit {value:.0f}", "look the bit up in the sensor's manual"),
    Trouble.SENSOR_REBOOTED: Row(P, "the force sensor started anew: its bias is lost", "unbias again with the sensor unloaded"),
    Trouble.SENSOR_SILENT: Row(W, "the force sensor is silent for {value:.0f} ticks", "check its cable and its power"),
    Trouble.SENSOR_FROZEN: Row(W, "the force sensor repeats the same sample for {value:.0f} records", "switch it off and on, then unbias again"),
    Trouble.BUS_OFF: Row(F, "the CAN controller is bus-off", "check termination and wiring; it is never restarted by itself"),
    Trouble.BUS_PASSIVE: Row(W, "the CAN controller is error-passive", "check termination and wiring"),
    Trouble.BUS_OVERLOAD: Row(F, "the bus cannot carry its frames: {value:.0f} were left over", "raise the divisor, or use a second bus"),
    Trouble.NODE_LATE: Row(W, "the drive of axis {value:.0f} is late", "look at the load of its bus"),
    Trouble.NODE_SILENT: Row(F, "the drive of axis {value:.0f} is silent", "check its supply and its bus"),
    Trouble.NODE_REBOOTED: Row(F, "the drive of axis {value:.0f} started anew: its position is lost", "check its supply, then home again"),
    Trouble.DRIVE_FAULT: Row(F, "the drive reports error code {value:.0f}", "look the code up in its manual, clear the cause, then acknowledge"),
    Trouble.DRIVE_IGNORES: Row(F, "the drive of axis {value:.0f} does not follow its set value", "check its mode and its limits, then acknowledge"),
    Trouble.DRIVE_CONFIGURATION: Row(F, "the drive of axis {value:.0f} does not hold its safety settings", "write them anew (`rtctl devices probe`), and check its firmware"),
    Trouble.TELEMETRY_GAP: Row(W, "{value:.0f} samples of the telemetry were lost", "check the link to the implant's computer"),
    Trouble.TELEMETRY_SILENT: Row(W, "the telemetry is silent for {value:.0f} ticks", "check the link to the implant's computer"),
    Trouble.TELEMETRY_NEW_RUN: Row(W, "the telemetry's sender started anew", "check that it measures the same array"),
    Trouble.TELEMETRY_FROZEN: Row(W, "the telemetry repeats the same numbers for {value:.0f} sweeps", "restart its sender"),
    Trouble.TELEMETRY_CORRUPT: Row(W, "{value:.0f} telemetry packets were refused", "check who sends to this address, and with which layout"),
    Trouble.LINE_DESYNC: Row(W, "a serial line lost its rhythm {value:.0f} times", "check cable and baud rate"),
    Trouble.DATAGRAM_GAP: Row(W, "{value:.0f} datagrams were lost", "connect the device directly, without a switch"),
    Trouble.DATAGRAM_CORRUPT: Row(W, "{value:.0f} datagrams were refused", "check who sends to this address"),
}  # fmt: skip


def say(code: int, value: float) -> tuple[str, str]:
    """Text and remedy of a trouble; a code that is not known says so."""
    if code not in Trouble._value2member_map_ or code == Trouble.NONE:
        return f"trouble number {code}", "update rtctl: this log is of a newer one"
    row = TABLE[Trouble(code)]
    return row.text.format(value=value), row.remedy
