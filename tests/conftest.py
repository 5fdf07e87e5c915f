"""Fixtures that several test files share."""

from pathlib import Path

import pytest

INPUTS = Path(__file__).parents[1].parent / "shared" / "inputs"


@pytest.fixture(scope="session")
def inputs() -> Path:
    """Folder of public stages and photometric files that nobody here made."""
    if not INPUTS.is_dir():
        pytest.skip("the folder of public test inputs is not beside the checkout")
    return INPUTS
