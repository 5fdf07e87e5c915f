"""Signals while a run is under way."""

import os
import signal

import pytest

from isolux.interrupt import stop_on_signal


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_insists(sent):
    before = signal.getsignal(sent)
    with stop_on_signal() as stop:
        assert stop.signal is None
        os.kill(os.getpid(), sent)
        assert stop.signal == sent
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(sent) == before
