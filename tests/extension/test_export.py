"""The baked colours in glTF, USD and Alembic, each exported and imported again in a process of its own."""

import pytest

from tests.extension.conftest import ROOT

CORNELL = ROOT / "sample_blends" / "cornell_box.blend"

# One corner of the short block is made brighter than 1. Faces are told apart by their centres, because importers may
# order and split them anew.
SCRIPT = """
import numpy as np
warnings.simplefilter("default")  # of Blender's own exporters
enable()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
for ob in bpy.context.scene.objects:
    ob.select_set(True)
bpy.context.scene.obscurance.rays = 16
bpy.ops.obscurance.bake()
source = bpy.data.objects["Short Block"]
source.data.attributes["Obscurance"].data[0].color = (1.25, 0.5, 0.25, 1.0)

def faces(ob, name):
    layer = ob.data.attributes[name]
    colors = np.empty(len(layer.data) * 4, np.float32)
    layer.data.foreach_get("color", colors)
    colors = colors.reshape(-1, 4)[:, :3]
    if layer.domain == "CORNER":
        colors = np.array([colors[list(p.loop_indices)].mean(0) for p in ob.data.polygons])
    return np.array([ob.matrix_world @ p.center for p in ob.data.polygons]), colors

places, expected = faces(source, "Obscurance")
bpy.ops.obscurance.copy_for_export(format=FORMAT)
EXPORT
for ob in list(bpy.data.objects):
    bpy.data.objects.remove(ob)
for mesh in list(bpy.data.meshes):
    bpy.data.meshes.remove(mesh)
IMPORT
bpy.context.view_layer.update()
found_places, found = faces(next(ob for ob in bpy.data.objects if ob.type == "MESH" and "Short" in ob.name), NAME)
nearest = np.argmin(((places[None] - found_places[:, None]) ** 2).sum(2), axis=1)  # each triangle's or quad's own face
assert set(nearest) == set(range(len(places)))
if LIMITED:
    expected = np.minimum(expected, 1.0)
error = np.abs(found - expected[nearest]).max()
assert error < TOLERANCE, error
"""
EIGHT_BITS = 0.006  # half a step of 8 bits in sRGB near white is 0.0045; glTF's 16 bits come on top


@pytest.mark.parametrize(
    ("export_format", "name", "limited", "tolerance", "save", "load"),
    [
        (
            "GLTF",
            "Color",  # Blender's own name for what comes from COLOR_0, which it keeps with 8 bits
            True,
            EIGHT_BITS,
            "bpy.ops.export_scene.gltf(filepath=sys.argv[2] + '.glb', export_vertex_color='ACTIVE')",
            "bpy.ops.import_scene.gltf(filepath=sys.argv[2] + '.glb')",
        ),
        (
            "USD",
            "displayColor",
            False,
            1e-6,
            "bpy.ops.wm.usd_export(filepath=sys.argv[2] + '.usda')\n"
            "assert 'primvars:displayColor' in open(sys.argv[2] + '.usda').read()",
            "bpy.ops.wm.usd_import(filepath=sys.argv[2] + '.usda')",
        ),
        (
            "ALEMBIC",
            "Cd",
            True,
            EIGHT_BITS,
            "bpy.ops.wm.alembic_export(filepath=sys.argv[2] + '.abc', vcolors=True)",
            "bpy.ops.wm.alembic_import(filepath=sys.argv[2] + '.abc', as_background_job=False)",
        ),
    ],
)
def test_colors_come_back(installed, tmp_path, export_format, name, limited, tolerance, save, load):
    """With the switches that the README names; what is brighter than 1 stays so in USD and is 1 elsewhere."""
    code = SCRIPT.replace("FORMAT", repr(export_format)).replace("NAME", repr(name)).replace("LIMITED", repr(limited))
    code = code.replace("TOLERANCE", repr(tolerance)).replace("EXPORT", save).replace("IMPORT", load)
    installed.run(code, CORNELL, tmp_path / "out")


def test_an_animation_is_exported_by_the_installed_extension(installed, tmp_path):
    """In a process of its own, which has to find the extension."""
    out, exported = tmp_path / "moving.blend", tmp_path / "moving.usdc"
    installed.run(
        "enable()\nassert sys.modules[MODULE].command_line.main(['bake', *sys.argv[1:]]) == 0",
        *(CORNELL, "--output", out, "--rays", 1, "--frames", "1-2", "--export", exported),
    )
    assert exported.stat().st_size > 0
