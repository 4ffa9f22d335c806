"""One writer: the lease, its heartbeat, and what the tick is told about the operator."""

import secrets
import threading
from dataclasses import dataclass, field

from rtctl.exchange.control import OPERATOR_EXPECTED, OPERATOR_PRESENT
from rtctl.gateway.refusal import Refusal

ASK = "wait until it is released, or ask its holder; `stop` and everything that only reads need no lease"


@dataclass
class Lease:
    """Who may write. Times are of a clock that never jumps [s]; safe to call from several threads.

    A holder who is silent for `duration_s` loses the lease. If something moved at that moment, the operator
    counts as expected but absent until somebody acquires the lease again, so that the tick pauses the motion.
    """

    duration_s: float
    holder: str = ""
    _token: str = ""
    _renewed_s: float = 0.0
    _sequence: int = 0
    _abandoned: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def acquire(self, source: str, now_s: float) -> str:
        """Make `source` the writer and return its token.

        Raises:
            Refusal: somebody holds it.
        """
        with self._lock:
            left = self._renewed_s + self.duration_s - now_s
            if self.holder and left > 0:
                raise Refusal("lease_taken", f"{self.holder} holds the lease", ASK, left, self.duration_s)
            self.holder, self._token = source, secrets.token_hex(16)
            self._renewed_s, self._sequence, self._abandoned = now_s, 0, False
            return self._token

    def renew(self, token: str, now_s: float) -> None:
        """A sign of life. Raises Refusal without the lease."""
        with self._lock:
            self._check(token)
            self._renewed_s = now_s

    def authorise(self, token: str, sequence: int, now_s: float) -> None:
        """Admit one command of the holder; a sign of life, too.

        Raises:
            Refusal: no lease, or the command was overtaken by a later one of the same holder.
        """
        with self._lock:
            self._check(token)
            if sequence <= self._sequence:
                what = "the command was overtaken by a later one"
                raise Refusal("out_of_order", what, "count `sequence` up with every request", sequence, self._sequence)
            self._renewed_s, self._sequence = now_s, sequence

    def release(self, token: str) -> None:
        """Give it back; nobody is expected any more. Raises Refusal without the lease."""
        with self._lock:
            self._check(token)
            self.holder = self._token = ""

    def expire(self, busy: bool, now_s: float) -> str:
        """Take the lease from a silent holder and return its name, else ''. `busy`: something moves."""
        with self._lock:
            if not self.holder or now_s - self._renewed_s < self.duration_s:
                return ""
            lost, self.holder, self._token = self.holder, "", ""
            self._abandoned = busy
            return lost

    @property
    def health(self) -> int:
        """Bits OPERATOR_PRESENT and OPERATOR_EXPECTED of the gateway's health."""
        with self._lock:
            if self.holder:
                return OPERATOR_PRESENT | OPERATOR_EXPECTED
            return OPERATOR_EXPECTED if self._abandoned else 0

    def _check(self, token: str) -> None:
        if not self._token or not secrets.compare_digest(token.encode(), self._token.encode()):
            text = f"{self.holder} holds the lease" if self.holder else "this needs the lease, and nobody holds it"
            raise Refusal("no_lease", text, ASK if self.holder else "acquire the lease first")
