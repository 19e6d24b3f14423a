"""What a file links from libraries that are not there."""

from __future__ import annotations

import bpy

from ...core.notes import Notes

_CURE = "bring the library back, or relocate it (Outliner > Blender File > its context menu > Relocate)"


def note_missing(scene: bpy.types.Scene, notes: Notes) -> None:
    """Name the objects of a scene, and the materials, that Blender did not find in their libraries."""
    for collection in scene.collection.children_recursive:
        if collection.is_missing:
            notes.add(f"collections missing in {_library(collection)}, so left out", collection.name, cure=_CURE)
    for ob in scene.collection.all_objects:
        instanced = ob.instance_collection if ob.instance_type == "COLLECTION" else None
        for owner in (ob, ob.data, instanced):
            if owner is not None and owner.is_missing:
                notes.add(f"objects missing in {_library(owner)}, so left out", ob.name, cure=_CURE)
                break
        for slot in ob.material_slots:
            if slot.material is not None and slot.material.is_missing:
                what = f"materials missing in {_library(slot.material)}, so taken as grey"
                notes.add(what, slot.material.name, cure=_CURE)


def _library(owner: bpy.types.ID) -> str:
    return f"library '{owner.library.filepath}'" if owner.library is not None else "their library"
