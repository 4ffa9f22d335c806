"""Why a request is not carried out."""

from typing import Any

from hal.errors import RtctlError
from rtctl.commands import Reason, explain


class Refusal(Exception):
    """Raised anywhere below a request; becomes the reply.

    Args:
        reason: one word for programs.
        text, remedy: for people.
        value, bound: the number that was wrong and what it may be.
    """

    def __init__(
        self, reason: str, text: str, remedy: str = "", value: float | None = None, bound: float | str | None = None
    ) -> None:
        super().__init__(text)
        self.reason, self.text, self.remedy, self.value, self.bound = reason, text, remedy, value, bound


def from_verdict(row: Any) -> Refusal:
    """The refusal the tick wrote into a controller record."""
    value, bound = float(row["reason_value"]), float(row["reason_bound"])
    reason = Reason(int(row["command_verdict"]))
    return Refusal(reason.name.lower(), *explain(reason, value, bound), value, bound)


def from_error(reason: str, error: RtctlError) -> Refusal:
    """The refusal that says what an error of ours says."""
    value = float(error.value) if isinstance(error.value, int | float) else None
    shown = error.what if value is not None or error.value is None else f"{error.what}: got {error.value!r}"
    return Refusal(reason, shown, error.remedy, value, error.bound or None)
