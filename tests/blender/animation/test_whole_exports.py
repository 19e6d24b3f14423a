"""Files of animations are read back: whole ones pass, and none that ends early."""

import bpy
import pytest

from obscurance_addon.core.files import NotWholeError, check_whole
from tests.blender.helpers import floor

MANY = 60


@pytest.fixture(params=[".usdc", ".usda", ".usd", ".abc"])
def exported(request, empty_scene, tmp_path):
    """A scene of Blender's own exporter."""
    for number in range(MANY):
        floor(f"Floor {number}", n=2)
    path = tmp_path / f"x{request.param}"
    if path.suffix == ".abc":
        bpy.ops.wm.alembic_export(filepath=str(path), start=1, end=2, as_background_job=False)
    else:
        bpy.ops.wm.usd_export(filepath=str(path))
    return path


def test_whole_files_pass_and_those_that_end_early_do_not(exported):
    check_whole(exported)
    data = exported.read_bytes()
    lengths = {0, 4, 8, 20, *(len(data) * part // 23 for part in range(1, 23)), *(len(data) - n for n in range(3, 60))}
    for length in sorted(lengths):
        exported.write_bytes(data[:length])
        with pytest.raises(NotWholeError):
            check_whole(exported)


def test_what_points_outside_of_the_file_is_refused(exported):
    """Each 8 bytes of what the file says about itself, made huge."""
    data = exported.read_bytes()
    places = [16] if data.startswith(b"PXR") else [8, int.from_bytes(data[8:16], "little")]
    for place in () if data.startswith(b"#usda") else places:
        for wrong in (b"\xff" * 8, b"\0" * 8, (1 << 62).to_bytes(8, "little"), len(data).to_bytes(8, "little")):
            exported.write_bytes(data[:place] + wrong + data[place + 8 :])
            with pytest.raises(NotWholeError):
                check_whole(exported)
