"""What a calibration refuses to do."""

from hal.errors import RtctlError


class CalibrationError(RtctlError):
    """The measurements, or the way they were made, do not determine what is asked for."""


class CalibrationFileError(CalibrationError):
    """A file of measurements cannot be read, or the file of a result cannot be written."""

    exit_code = 2
