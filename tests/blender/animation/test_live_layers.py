"""Live Preview changes no layer of the user's."""

import bpy
import numpy as np
import pytest

from obscurance_addon.blender.animation.live_preview import PREVIEW
from tests.blender.animation.preview_helpers import SETTINGS, assert_as_baked_anew, at
from tests.blender.helpers import CORNER_LAYER, FACE_LAYER, bake, file_state, put, read


@pytest.mark.parametrize("quantity", ["OBSCURANCE", "DIRECT"])
@pytest.mark.parametrize(("name", "domain"), [(FACE_LAYER, "FACE"), (CORNER_LAYER, "CORNER")])
def test_it_does_not_begin_where_a_layer_is_the_users(room, empty_scene, quantity, name, domain):
    """The status names object and layer, and no object gets values."""
    put(room["Block"].data, name, "FLOAT_COLOR", domain)
    empty_scene.obscurance.quantity = quantity
    empty_scene.obscurance.live_preview = True
    before = file_state()
    at(1)
    assert f"'Block' has a color attribute named '{name}'" in PREVIEW.status
    assert file_state() == before | {"frame": 1}


def test_objects_that_have_one_are_not_followed_where_others_are_baked(room, empty_scene):
    """They occlude."""
    put(room["Wall"].data, FACE_LAYER, "FLOAT_COLOR", "FACE")
    before = read(room["Wall"].data, FACE_LAYER)
    bake(room["Floor"], **SETTINGS)
    empty_scene.obscurance.live_preview = True
    room["Mover"].location.x += 0.2
    at(2)
    assert_as_baked_anew([room["Floor"]])
    assert np.array_equal(read(room["Wall"].data, FACE_LAYER), before)


@pytest.mark.parametrize("data_type", ["FLOAT_COLOR", "BYTE_COLOR"])
def test_a_layer_that_takes_the_results_place_later(preview, data_type):
    """The preview stops with a word on it, and writes on no object; once it is gone, the other results are followed."""
    mesh = preview["Floor"].data
    mesh.attributes.remove(mesh.attributes[FACE_LAYER])
    bpy.context.view_layer.update()
    put(mesh, FACE_LAYER, data_type, "FACE")
    before = {name: read(ob.data, FACE_LAYER) for name, ob in preview.items()}
    preview["Mover"].location.x += 0.3
    at(2)
    assert "'Floor' has a color attribute named 'Obscurance'" in PREVIEW.status
    for name, values in before.items():
        assert np.array_equal(read(preview[name].data, FACE_LAYER), values), name
    mesh.attributes.remove(mesh.attributes[FACE_LAYER])
    at(3)
    assert_as_baked_anew([preview[name] for name in ("Wall", "Mover", "Block")])
