"""What USD says of its own errors."""

from __future__ import annotations

from pxr import Tf

NO_TEXT = "text that is not UTF-8"


def usd_message(said: Tf.ErrorException | Tf.DiagnosticBase) -> str:
    """On one line; USD quotes a file's bytes, whatever they are."""
    if isinstance(said, Tf.ErrorException):
        if not said.args:
            return "no reason given"
        said = said.args[0]
    try:
        return " ".join(said.commentary.split())
    except UnicodeDecodeError:
        return NO_TEXT
