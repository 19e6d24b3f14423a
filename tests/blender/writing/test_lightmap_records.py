"""What a lightmap remembers of who made its UV map, and what it says of lamps."""

import pytest

from obscurance_addon.blender.writing.layers import AttributeNameError
from tests.blender.helpers import FACE_LAYER, bake, cube, floor
from tests.blender.jobs.test_lightmap_bake import bake_map, uv_of
from tests.blender.reading.light_helpers import lamp

pytestmark = pytest.mark.usefixtures("empty_scene")


def with_own_map():
    """A floor with a UV map of the user's, which has the name of results."""
    ob = floor()
    ob.data.uv_layers.new(name=FACE_LAYER)
    return ob


def test_a_map_of_the_users_that_was_kept_stays_the_users():
    """Keeping it does not make it one that a later bake may replace."""
    ob = with_own_map()
    bake_map(ob, uv_mode="KEEP", uv_map=FACE_LAYER)
    before = uv_of(ob).copy()
    for again in (lambda: bake_map(ob), lambda: bake(ob)):
        with pytest.raises(AttributeNameError, match="has a UV map named 'Obscurance', which a bake must not replace"):
            again()
    assert (uv_of(ob) == before).all()


def test_a_map_of_a_bake_that_was_kept_stays_the_bakes():
    """Unwrap, keep, unwrap: the last one may replace what the first one made."""
    ob = floor()
    bake_map(ob)
    bake_map(ob, uv_mode="KEEP", uv_map=FACE_LAYER)
    assert FACE_LAYER in ob.data.uv_layers
    bake_map(ob, size=512)
    assert [layer.name for layer in ob.data.uv_layers] == [FACE_LAYER]


@pytest.mark.parametrize("quantity", ["DIRECT", "COMBINED", "RADIOSITY"])
def test_lamps_that_reach_nothing_are_named(quantity):
    """As a bake of faces does: one lamp is buried in a solid, the other is not."""
    ob = floor()
    cube("Wall", half=0.2).location = (0.0, 0.0, 0.5)
    lamp("POINT", (0.0, 0.0, 0.5), name="Buried")
    lamp("POINT", (0.9, 0.0, 2.0), name="Free")
    warnings = bake_map(ob, quantity=quantity).warnings
    (told,) = [text for text in warnings if "reach no surface" in text]
    assert "'Buried'" in told
    assert "'Free'" not in told
