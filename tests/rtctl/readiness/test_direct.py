"""Runs without a gateway: how they end, told from a daemon that is made of nothing."""

import signal
import time

import numpy as np
import pytest

from rtctl.exchange.control import Word, put
from rtctl.readiness import direct
from rtctl.readiness.direct import RunError, run_daemon


class Double:
    """A daemon whose loop ticks at once; `code` is how it ends, `killed` whether somebody else ends it."""

    code, killed = 0, False

    def __init__(self, *_, **__):
        self.control = np.zeros(64, np.int64)
        self.stopping_since = self.real_time = None
        self.handler = signal.getsignal(signal.SIGINT)

    def run(self):
        signal.signal(signal.SIGINT, lambda *_: self.stop())
        put(self.control, Word.TICK, 1)
        if self.killed:
            signal.raise_signal(signal.SIGINT)
        while self.stopping_since is None:
            time.sleep(0.001)
        return self.code

    def stop(self):
        self.stopping_since = self.stopping_since or time.monotonic()


@pytest.fixture
def double(monkeypatch):
    made = type("Made", (Double,), {})
    monkeypatch.setattr(direct, "Daemon", made)
    return made


def wait_until_stopped(daemon):
    end_s = time.monotonic() + 10.0
    while daemon.stopping_since is None and time.monotonic() < end_s:
        time.sleep(0.001)
    raise RunError("the loop ended while it was operated")


def test_a_run_ends_when_it_was_operated_and_gives_the_signals_back(double):
    seen, before = [], signal.getsignal(signal.SIGINT)
    run_daemon(None, seen.append, gateway=False)
    assert len(seen) == 1
    assert signal.getsignal(signal.SIGINT) is before
    double.code = 5
    with pytest.raises(RunError, match="daemon failed"):
        run_daemon(None, seen.append, gateway=False)


@pytest.mark.parametrize("code", [0, 5])
def test_ctrl_c_is_an_interruption_whatever_it_breaks(double, code):
    double.killed, double.code = True, code
    with pytest.raises(KeyboardInterrupt):
        run_daemon(None, wait_until_stopped, gateway=False)


@pytest.mark.usefixtures("double")
def test_what_goes_wrong_while_it_is_operated_comes_out():
    def fail(_daemon):
        raise RunError("it broke")

    with pytest.raises(RunError, match="it broke"):
        run_daemon(None, fail, gateway=False)
