"""Writes a scene description as a .blend file. The only file here that knows Blender."""

from __future__ import annotations

import gzip
import os
import tempfile
from pathlib import Path

import bpy
from mathutils import Vector
from scene_description import Camera, Material, PointLamp, Sample, SceneObject

PREVIEW_SAMPLES = 32
"""Enough for a quick look at the scene; bakes do not depend on it."""


def write_blend(sample: Sample, path: Path) -> None:
    """Write a sample whole: beside its target first, then renamed over it.

    Parameters
    ----------
    sample : Sample
        The scene.
    path : Path
        The .blend file, replaced if it exists.

    Raises
    ------
    ValueError
        If the counts of the sample, or of the meshes made from it, are not the expected ones.
    """
    sample.check()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = sample.name
    materials = {name: _new_material(name, material) for name, material in sample.materials.items()}
    for item in sample.objects:
        scene.collection.objects.link(_new_object(item, materials))
    for lamp in sample.lamps:
        scene.collection.objects.link(_new_lamp(lamp))
    scene.camera = _new_camera(sample.camera)
    scene.collection.objects.link(scene.camera)
    _set_up(scene, sample)
    faces = sum(len(item.data.polygons) for item in scene.objects if item.type == "MESH")
    if faces != sample.patch_count():
        raise ValueError(f"{sample.name}: {faces} faces instead of {sample.patch_count()} patches")
    _save(path)


def _new_material(name: str, material: Material) -> bpy.types.Material:
    """Make a Lambertian material; one that shines is a Principled BSDF without its specular layer."""
    new = bpy.data.materials.new(name)
    new.diffuse_color = (*material.reflectance, 1.0)
    if bpy.app.version < (5, 0):
        new.use_nodes = True
    nodes, links = new.node_tree.nodes, new.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    strength = max(material.emission)
    if strength > 0.0:
        shader = nodes.new("ShaderNodeBsdfPrincipled")
        shader.inputs["Base Color"].default_value = (*material.reflectance, 1.0)
        shader.inputs["Specular IOR Level"].default_value = 0.0
        shader.inputs["Roughness"].default_value = 1.0
        shader.inputs["Emission Color"].default_value = (*(c / strength for c in material.emission), 1.0)
        shader.inputs["Emission Strength"].default_value = strength
    else:
        shader = nodes.new("ShaderNodeBsdfDiffuse")
        shader.inputs["Color"].default_value = (*material.reflectance, 1.0)
    links.new(shader.outputs[0], output.inputs["Surface"])
    return new


def _new_object(item: SceneObject, materials: dict[str, bpy.types.Material]) -> bpy.types.Object:
    vertices, faces, paints = [], [], []
    for body in item.bodies:
        body_vertices, body_faces, body_paints = body.mesh()
        faces += [tuple(len(vertices) + v for v in face) for face in body_faces]
        vertices += body_vertices
        paints += body_paints
    mesh = bpy.data.meshes.new(item.name)
    mesh.from_pydata(vertices, [], faces)
    slots = list(dict.fromkeys(paints))
    for paint in slots:
        mesh.materials.append(materials[paint])
    mesh.polygons.foreach_set("material_index", [slots.index(paint) for paint in paints])
    if mesh.validate():
        raise ValueError(f"{item.name}: Blender had to correct the mesh")
    mesh.update()
    new = bpy.data.objects.new(item.name, mesh)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"  # curved paths could cut through furniture
    for frame, location in item.keys:
        new.location = location
        new.keyframe_insert("location", frame=frame)
    return new


def _new_lamp(lamp: PointLamp) -> bpy.types.Object:
    light = bpy.data.lights.new(lamp.name, "POINT")
    light.energy = lamp.power
    light.shadow_soft_size = lamp.radius
    new = bpy.data.objects.new(lamp.name, light)
    new.location = lamp.location
    return new


def _new_camera(camera: Camera) -> bpy.types.Object:
    data = bpy.data.cameras.new("Camera")
    data.lens = camera.focal_length
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = camera.sensor_width
    data.clip_start = 0.01
    new = bpy.data.objects.new("Camera", data)
    new.location = camera.location
    view = Vector(camera.target) - Vector(camera.location)
    new.rotation_euler = view.to_track_quat("-Z", "Y").to_euler()
    return new


def _set_up(scene: bpy.types.Scene, sample: Sample) -> None:
    world = bpy.data.worlds.new("Black")
    world.color = (0.0, 0.0, 0.0)
    scene.world = world
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 1.0
    scene.frame_start, scene.frame_end = 1, sample.last_frame
    scene.frame_set(1)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = sample.camera.resolution
    scene.render.resolution_percentage = 100
    scene.render.filepath = "//"
    scene.cycles.samples = PREVIEW_SAMPLES
    scene.cycles.use_denoising = False
    scene.view_settings.view_transform = "Standard"  # linear colours shown as they are, as in the paper's figures
    scene.view_settings.exposure = sample.camera.exposure


def _save(path: Path) -> None:
    """Save compressed, without the two paths of this machine that Blender notes in every file.

    These are where the file was saved and the folder its file browser starts in, the home folder. Both are overwritten
    by zero bytes in the uncompressed file; then it is packed by gzip, which Blender reads as well as its own packing.
    """
    path = path.resolve()
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        plain = Path(folder) / path.name
        bpy.ops.wm.save_as_mainfile(filepath=str(plain), compress=False, copy=True, check_existing=False)
        content = plain.read_bytes()
        for noted in (os.fsencode(plain), os.fsencode(Path.home()) + b"\0"):
            content = content.replace(noted, b"\0" * len(noted))
        packed = plain.with_suffix(".gz")
        packed.write_bytes(gzip.compress(content, compresslevel=9, mtime=0))
        packed.replace(path)
