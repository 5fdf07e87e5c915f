"""Ctrl-C and SIGTERM as a request to stop: what was computed so far is worth keeping."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """Which signal asked the run to stop; None: none did."""

    signal: signal.Signals | None = None


@contextmanager
def stop_on_signal() -> Iterator[StopRequest]:
    """Turn the first SIGINT or SIGTERM within the block into a request.

    yields : the request, still open; a second signal raises KeyboardInterrupt
    """
    request = StopRequest()

    def handle(number: int, frame: FrameType | None) -> None:
        if request.signal is not None:
            raise KeyboardInterrupt
        request.signal = signal.Signals(number)

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def signals_held() -> Iterator[None]:
    """The first SIGINT or SIGTERM within the block comes after it.

    For code of USD that runs Python, and prints the traceback of an interruption there.
    """
    with stop_on_signal() as stop:
        yield
    if stop.signal is not None:
        signal.raise_signal(stop.signal)
