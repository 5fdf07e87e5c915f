"""Fixtures that several test files share, and the report of what is validated."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from no_division import no_division
from validation.recorder import Recorder
from validation.rows import Validation

sys.path.append(str(Path(__file__).parents[1] / "tools"))  # where the tools import each other
INPUTS = Path(__file__).parents[1].parent / "shared" / "inputs"
REPORT = "--validation-report"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(REPORT, type=Path, metavar="FOLDER", help="write the validation report there")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "validation(section): the test is in this section of the validation report"
    )
    folder = config.getoption(REPORT)
    if folder is not None:
        config.pluginmanager.register(Recorder(folder))


@pytest.fixture
def validation(request: pytest.FixtureRequest) -> Validation:
    """Checks whose figures stand in the validation report; see tests/validation/rows.py."""
    assert request.node.get_closest_marker("validation"), "no section of the report is named"
    told = Validation()
    request.node.validation_rows = told.rows
    return told


@pytest.fixture
def undivided() -> Iterator[None]:
    """Meshes are solved on as authored; see tests/no_division.py."""
    with no_division():
        yield


@pytest.fixture(scope="session")
def inputs() -> Path:
    """Folder of public stages and photometric files that nobody here made."""
    if not INPUTS.is_dir():
        pytest.skip("the folder of public test inputs is not beside the checkout")
    return INPUTS
