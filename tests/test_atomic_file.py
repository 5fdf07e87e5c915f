"""A file appears whole or not at all."""

import os
import stat

import pytest

from isolux.atomic_file import replace_atomically
from isolux.errors import SceneError


def test_a_file_is_replaced_when_its_block_ends(tmp_path):
    path = tmp_path / "picture.exr"
    path.write_text("old")
    with replace_atomically(path) as temporary:
        assert temporary.suffix == ".exr"
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_file_has_the_permissions_of_any_other(tmp_path):
    with replace_atomically(tmp_path / "a.json") as temporary:
        temporary.write_text("{}")
    (tmp_path / "b.json").write_text("{}")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("a.json", "b.json")]
    assert modes[0] == modes[1]


@pytest.mark.parametrize("interruption", [ValueError, KeyboardInterrupt])
def test_what_ends_the_block_early_leaves_the_old_file_alone(tmp_path, interruption):
    path = tmp_path / "report.json"
    path.write_text("old")
    with pytest.raises(interruption), replace_atomically(path) as temporary:
        temporary.write_text("half")
        raise interruption
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write")
def test_a_folder_without_permission_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with (
        pytest.raises(SceneError, match=r"report\.json: found Permission denied"),
        replace_atomically(tmp_path / "report.json"),
    ):
        pass


def test_a_missing_folder_is_named(tmp_path):
    with (
        pytest.raises(SceneError, match=r"no/report\.json: found No such file or directory"),
        replace_atomically(tmp_path / "no" / "report.json"),
    ):
        pass
