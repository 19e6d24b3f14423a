"""What the add-on shows of itself: preferences, presets, a missing library, coming and going."""

import sys

import bpy

ADDON = "bl_ext.user_default.obscurance_addon"


def preferences(window):
    """Its page in the preferences, with the state of the libraries."""
    area = window.area()
    area.type = "PREFERENCES"
    bpy.context.preferences.active_section = "ADDONS"
    bpy.context.window_manager.addon_search = "Obscurances"
    yield 1.0
    with bpy.context.temp_override(area=area):
        bpy.ops.preferences.addon_expand(module=ADDON)
    yield from window.picture("preferences")


def presets(window):
    """The list behind the button in the panel's header; choosing one changes the settings."""
    yield from window.sidebar()
    header = window.region()
    yield from window.click(header.x + header.width - 58, header.y + header.height - 20)
    yield 1.0
    yield from window.picture("presets")
    (folder,) = bpy.utils.preset_paths("obscurance_addon/bake")
    bpy.ops.script.execute_preset(filepath=f"{folder}/Final.py", menu_idname="OBSCURANCE_PT_presets")
    assert bpy.context.scene.obscurance.rays == 1024


def adjust_last_operation(window):
    """A bake that is adjusted is baked again from where it began."""
    yield from window.open("cornell_box.blend")
    yield from window.look_from_camera()
    yield from window.sidebar()
    yield from window.select_all()
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(lambda: _last_operator().bl_idname == "OBSCURANCE_OT_bake", "the bake")
    assert _last_operator().rays == 64
    colours = _colours()
    view = window.region("WINDOW")
    window.point(view.x + 300, view.y + 300)
    yield 0.3
    yield from window.key("F9")
    yield from window.picture("adjust_last_operation")
    hud = window.region("HUD")
    yield from window.click(hud.x + 12, hud.y + hud.height - 12)
    yield 1.0
    yield from window.click(hud.x + 121, hud.y + hud.height - 66)  # the check box of Color Bleeding
    yield from window.until(lambda: _colours() != colours, "another bake")
    assert all(r == g == b for r, g, b, _a in _colours())
    assert bpy.context.scene.obscurance.use_bleeding


def _last_operator():
    return bpy.context.window_manager.operators[-1]


def _colours():
    return [tuple(d.color) for d in bpy.data.objects["Room"].data.attributes["Obscurance"].data]


def missing_library(window):
    """The panel says what is missing and what helps, and the button is off."""
    module = sys.modules[f"{ADDON}.core.native_library"]
    for name in ("embreex.rtcore_scene", "embreex.mesh_construction", "embreex"):
        sys.modules[name] = None
    module.why_missing.cache_clear()
    yield from window.sidebar()
    yield from window.select_all()
    assert not bpy.ops.obscurance.bake.poll()
    yield from window.picture("missing_library")


def comes_and_goes(window):
    """Disabled, enabled and reloaded in the window, the panel and its handler are there once."""
    yield from window.sidebar()
    for _ in range(2):
        bpy.ops.preferences.addon_disable(module=ADDON)
        yield 0.5
        assert not hasattr(bpy.types.Scene, "obscurance")
        bpy.ops.preferences.addon_enable(module=ADDON)
        yield 0.5
    bpy.ops.script.reload()
    yield 1.0
    assert len([f for f in bpy.app.handlers.load_post if f.__module__.startswith(ADDON)]) == 1
    assert len([f for f in bpy.types.VIEW3D_MT_object.draw._draw_funcs if f.__module__.startswith(ADDON)]) == 1
    yield from window.sidebar()
    yield from window.find('bpy.data.scenes["Scene"].obscurance.use_bleeding')
