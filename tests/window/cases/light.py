"""Ambient light baked by the button and shown in materials, as an artist does it."""

import bpy

SAMPLE = "room_1423.blend"
SHADERS_S = 60.0  # for EEVEE to compile them in software


def _meshes():
    return [ob for ob in bpy.context.scene.objects if ob.type == "MESH"]


def _groups():
    """Nodes that add ambient light in all materials."""
    return [
        node.name
        for material in bpy.data.materials
        for node in material.node_tree.nodes
        if node.bl_idname == "ShaderNodeGroup"
    ]


def _trees():
    return {
        material.name: sorted(
            (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
            for link in material.node_tree.links
        )
        for material in bpy.data.materials
    }


def apply_in_materials(window):
    """Bake ambient light, add it to the materials, undo, redo, look at it in EEVEE, remove it without a trace."""
    yield from window.open(SAMPLE)
    yield from window.look_from_camera()
    yield from window.sidebar()
    yield from window.select_all()
    scene = bpy.context.scene
    scene.obscurance.quantity = "AMBIENT"
    yield 0.5
    before = _trees()
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(lambda: all("Obscurance" in ob.data.attributes for ob in _meshes()), "the result")
    yield from window.picture("light_1_ambient_baked")

    yield from window.press("bpy.ops.obscurance.apply_in_materials(action='ADD')")
    yield from window.until(_groups, "the groups")
    assert len(_groups()) == len(bpy.data.materials)
    yield from window.key("Z", ctrl=True)
    yield from window.until(lambda: not _groups(), "undo")
    yield from window.key("Z", ctrl=True, shift=True)
    yield from window.until(_groups, "redo")

    shading = window.area().spaces.active.shading
    scene.render.engine = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0, 0) else "BLENDER_EEVEE"
    shading.type = "RENDERED"
    yield SHADERS_S
    yield from window.picture("light_2_with_ambient")
    yield from window.press("bpy.ops.obscurance.apply_in_materials(action='REMOVE')")
    yield from window.until(lambda: not _groups(), "the groups to go")
    yield 20.0
    yield from window.picture("light_3_direct_only")
    assert _trees() == before
    assert not bpy.data.node_groups
    shading.type = "SOLID"
