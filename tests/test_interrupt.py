"""Signals while a run is under way."""

import os
import signal

import pytest

from isolux.interrupt import signals_held, stop_on_signal


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


def test_a_signal_that_is_held_comes_after_the_block():
    finished = []
    with pytest.raises(KeyboardInterrupt), signals_held():
        os.kill(os.getpid(), signal.SIGINT)
        finished.append(True)
    assert finished
