"""Files that appear whole or not at all: written beside their place, then moved into it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import SceneError


@contextmanager
def replace_atomically(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to; when the block ends well, it takes the place of `path`.

    path : the file to make or replace; its folder must exist
    yields : an empty file in the same folder, with the same suffix (writers choose formats by it)
    raises : SceneError naming `path` where the system refuses (no permission, disk full)

    Whatever ends the block early leaves `path` as it was and no temporary file behind.
    """
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        # Some systems report a full disk only when the bytes reach it.
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise SceneError(str(path), error.strerror or str(error), "a file to write") from error
    finally:
        with suppress(OSError):  # gone into place, or never made
            temporary.unlink()
