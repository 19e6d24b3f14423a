"""What can be known of a file before it is written."""

import os
import socket
import sys

import pytest

from obscurance_addon.core.files import TargetError, check_folder_target, check_target, identities, is_stream

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="special files are those of Unix")


def pipe(folder):
    os.mkfifo(folder / "x")


def bound_socket(folder):
    here = os.getcwd()
    os.chdir(folder)  # names of sockets are short
    try:
        socket.socket(socket.AF_UNIX).bind("x")
    finally:
        os.chdir(here)


def device(folder):
    (folder / "x").symlink_to("/dev/null")


def protected(folder):
    (folder / "x").touch(mode=0o444)


def loop(folder):
    (folder / "x").symlink_to("y")
    (folder / "y").symlink_to("x")


def dangling(folder):
    (folder / "x").symlink_to("missing/file")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (pipe, "is a pipe, which must not be replaced"),
        (bound_socket, "is a socket, which must not be replaced"),
        (device, "is a device, which must not be replaced"),
        (protected, "is write-protected: change its permissions"),
        (loop, "links lead in a circle"),
        (dangling, r"the link '.*x' leads nowhere: the folder '.*missing' does not exist: create it"),
        (lambda folder: (folder / "x").mkdir(), "is a folder: name a file"),
    ],
)
def test_what_must_not_be_replaced_is_told(tmp_path, make, words):
    make(tmp_path)
    with pytest.raises(TargetError, match=words):
        check_target(tmp_path / "x")


def test_names_and_folders_that_cannot_be(tmp_path):
    with pytest.raises(TargetError, match="too long for the disk"):
        check_target(tmp_path / ("x" * 300))
    with pytest.raises(TargetError, match="too long for Blender"):
        check_target(tmp_path / ("x/" * 600))
    with pytest.raises(TargetError, match="missing' does not exist: create it first"):
        check_target(tmp_path / "missing" / "x")
    with pytest.raises(TargetError, match="is a device"):
        check_folder_target("/dev/null")


def test_links_to_new_and_old_files_can_be_written_to(tmp_path):
    (tmp_path / "link").symlink_to("new")
    check_target(tmp_path / "link")
    (tmp_path / "new").touch()
    check_target(tmp_path / "link")
    check_folder_target(tmp_path)
    check_folder_target(tmp_path / "another")


def test_paths_of_one_file_share_an_identity(tmp_path):
    file, link, hard, other = (tmp_path / name for name in ("file", "link", "hard", "other"))
    link.symlink_to("file")
    assert identities(file) & identities(link)  # before there is a file, too
    file.touch()
    other.touch()
    os.link(file, hard)
    assert identities(file) & identities(link) & identities(hard)
    assert not identities(file) & identities(other)


def test_pipes_and_devices_are_written_into(tmp_path):
    pipe(tmp_path)
    assert is_stream(tmp_path / "x")
    assert is_stream("/dev/null")
    (tmp_path / "file").touch()
    assert not is_stream(tmp_path / "file")
    assert not is_stream(tmp_path / "missing")
    assert not is_stream("/dev")
