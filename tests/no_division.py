"""Solvers whose meshes stay as authored, however large their elements."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from isolux import _core
from isolux.core_scene import build_core_scene


@contextmanager
def no_division() -> Iterator[None]:
    """Solvers made meanwhile divide no elements: what their vertices tell is all they solve."""

    def build(*arguments: Any, **others: Any) -> _core.Scene:
        return build_core_scene(*arguments, **others | {"divide": False})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("isolux.solver.build_core_scene", build)
        yield
