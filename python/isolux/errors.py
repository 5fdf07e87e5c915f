"""What goes wrong, said so that the reader of the message can mend it.

Each error names its subject (a prim path or a file), what was found there and what was wanted.
"""

from __future__ import annotations


class IsoluxError(Exception):
    """Base of all errors that a user of Isolux can cause and mend."""

    def __init__(self, subject: str, found: str, wanted: str) -> None:
        super().__init__(f"{subject}: found {found}; wanted {wanted}")
        self.subject = subject
        self.found = found
        self.wanted = wanted


class SceneError(IsoluxError):
    """A stage, a prim or an output that can't be used."""


class SettingsError(IsoluxError):
    """A setting out of its range, or settings that exclude each other."""


class PhotometryError(IsoluxError):
    """A photometric file or an inline goniometric diagram that can't be used."""


class DarkDiagramError(PhotometryError):
    """Candela that are all zero; a stage can do without that luminaire."""
