"""The one error tree: what happened, the value, the bound, and what to do about it."""


class RtctlError(Exception):
    """Base of every error rtctl raises on purpose.

    Args:
        what: what happened, in a short sentence without a final stop.
        value: the offending value, if there is one.
        bound: the bound it broke, in words ("0.1 .. 50 mm/s").
        remedy: what the user should do next.
    """

    exit_code = 1

    def __init__(self, what: str, *, value: object = None, bound: str = "", remedy: str = "") -> None:
        self.what, self.value, self.bound, self.remedy = what, value, bound, remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        text = self.what
        if self.value is not None:
            text += f": got {self.value!r}"
        if self.bound:
            text += f" (allowed: {self.bound})"
        if self.remedy:
            text += f"; {self.remedy}"
        return text


class OptionError(RtctlError):
    """A setting is unknown, missing, of the wrong type or out of bounds."""

    exit_code = 2


class BackendError(RtctlError):
    """A backend cannot be found, opened or trusted."""

    exit_code = 3
