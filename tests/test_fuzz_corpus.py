"""Files that fuzzing starts from, and those that it found: none gets past an IsoluxError."""

from pathlib import Path

import pytest
from tools.fuzz.targets import CORPUS, TARGETS

FILES = {
    f"{target}/{file.name}": file
    for target in TARGETS
    for file in sorted((CORPUS / target).iterdir())
}
# What whole files are for is lost where they can't be read.
UNREADABLE = ("decimal_commas.ies",)


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_the_corpus_is_read_or_refused(tmp_path: Path, name: str) -> None:
    target = name.split("/")[0]
    readable = TARGETS[target](FILES[name].read_bytes(), tmp_path)
    if FILES[name].suffix:  # those that fuzzing found have none
        assert readable == (FILES[name].name not in UNREADABLE)
