"""One Blender with the extension installed, for all cases."""

import pytest

from tests.window.debian_blender import DebianBlender


@pytest.fixture(scope="session")
def blender(tmp_path_factory) -> DebianBlender:
    """Installed from the zip by Blender's own command."""
    made = DebianBlender(tmp_path_factory.mktemp("blender"))
    done = made.install()
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Installed" in done.stdout, done.stdout + done.stderr
    return made
