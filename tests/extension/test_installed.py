"""The installed zip: it bakes, comes and goes without leftovers, and says what it misses."""

import json
import shutil
import tomllib
import zipfile

import pytest

from tests.extension.conftest import HERE, ROOT
from tools import build_extension
from tools.build_extension import MANIFEST, build

CORNELL = ROOT / "sample_blends" / "cornell_box.blend"

# What an add-on can leave behind.
TRACES = """
def traces():
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if name[0] != "_"}
    handlers = [(name, f.__module__, f.__name__) for name, fs in lists.items() if isinstance(fs, list) for f in fs]
    menus = [f.__module__ for f in bpy.types.VIEW3D_MT_object._dyn_ui_initialize() if f.__module__.startswith(MODULE)]
    return (sorted(name for name in dir(bpy.types) if "obscurance" in name.lower()),
            sorted(name for name in dir(bpy.ops.obscurance)),
            [name for name in dir(bpy.types.Scene) + dir(bpy.types.WindowManager) if "obscurance" in name],
            handlers, menus, bpy.utils.preset_paths("obscurance_addon/bake"))
"""
BAKE = """
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
for ob in bpy.context.scene.objects:
    ob.select_set(True)
bpy.context.scene.obscurance.rays = 16
print(bpy.ops.obscurance.bake())
"""
VALUES = """
print([tuple(d.color) for d in bpy.data.objects["Room"].data.attributes["Obscurance"].data][:50])
"""


def without(zipped, library, folder):
    """A zip that lacks one library, as on a platform for which there is none."""
    wheels = folder / "wheels"
    wheels.mkdir()
    with zipfile.ZipFile(zipped) as archive:
        for name in archive.namelist():
            if name.endswith(".whl") and library not in name:
                (wheels / name.split("/")[-1]).write_bytes(archive.read(name))
    (made,) = build([HERE], folder / "out", wheels)
    return made


def test_it_bakes_in_a_new_process(installed, tmp_path):
    """By the operator and by the command, with equal results, tracing with the wheel that came in the zip."""
    by_operator = installed.run("enable()\n" + BAKE + "import embreex; print(embreex.__file__)" + VALUES, CORNELL)
    finished, place, values = by_operator.strip().splitlines()[-3:]
    assert finished == "{'FINISHED'}"
    assert place.startswith(str(installed.user_folder / "extensions" / ".local"))

    out, report = tmp_path / "baked.blend", tmp_path / "report.json"
    installed.run(
        "enable()\nassert sys.modules[MODULE].command_line.main(['bake', *sys.argv[1:]]) == 0",
        *(CORNELL, "--output", out, "--rays", 16, "--report", report),
    )
    version = tomllib.loads(MANIFEST.read_text())["version"]
    assert json.loads(report.read_text())["version"] == version
    assert installed.run("bpy.ops.wm.open_mainfile(filepath=sys.argv[1])" + VALUES, out).strip().endswith(values)


def test_it_leaves_nothing_behind(installed):
    """Disabled, Blender is as it was; enabled again and reloaded, everything is there once."""
    installed.run(
        TRACES
        + """
bpy.ops.preferences.addon_disable(module=MODULE)
never = traces()
enable()
first = traces()
assert first != never
for _ in range(3):
    bpy.ops.preferences.addon_disable(module=MODULE)
    assert traces() == never, traces()
    enable()
    assert traces() == first, traces()
bpy.ops.script.reload()
assert traces() == first, (traces(), first)
assert len([f for f in bpy.app.handlers.load_post if "obscurance" in f.__module__]) == 1
"""
    )


def test_a_changed_file_is_taken_up(installed):
    """Blender reloads the first file of a package only; all others must follow."""
    installed.run(
        """
package = enable()
path = package.core.order.output.__file__
text = open(path).read()
open(path, "w").write(text + "\\nADDED = 7\\n")
os.utime(package.__file__)
bpy.ops.preferences.addon_disable(module=MODULE)
enable()
assert sys.modules[MODULE].core.order.output.ADDED == 7
"""
    )


def test_an_upgrade_replaces_the_older_version(installed, zipped, tmp_path, monkeypatch):
    """In a running session: new code, settings kept, nothing twice."""
    newer = tmp_path / "blender_manifest.toml"
    version = tomllib.loads(MANIFEST.read_text())["version"]
    newer.write_text(MANIFEST.read_text().replace(f'version = "{version}"', 'version = "9.9.9"'))
    monkeypatch.setattr(build_extension, "MANIFEST", newer)
    (upgrade,) = build([HERE], tmp_path / "upgrade")
    installed.run(
        TRACES
        + """
from importlib import import_module
enable()
bpy.context.scene.obscurance.rays = 99
bpy.context.preferences.addons[MODULE].preferences.threads = 3
before = traces()
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
assert import_module(MODULE + ".version").version() == "9.9.9"
assert traces() == before, (traces(), before)
assert bpy.context.scene.obscurance.rays == 99
assert bpy.context.preferences.addons[MODULE].preferences.threads == 3
"""
        + BAKE.replace("sys.argv[1]", "sys.argv[2]"),
        upgrade,
        CORNELL,
    )


def test_without_the_ray_tracer_it_enables_and_says_so(blender, zipped, tmp_path):
    """The button is off, and the error tells what to install."""
    blender.install(without(zipped, "embreex", tmp_path))
    told = blender.run(
        """
enable()
bpy.data.objects["Cube"].select_set(True)
assert not bpy.ops.obscurance.bake.poll()
try:
    bpy.ops.obscurance.bake()
except RuntimeError as error:
    print(error)
print(sys.modules[MODULE].core.native_library.why_missing("xatlas"))
"""
    )
    assert "embreex is not installed; install the zip that is made for this system" in told
    assert told.strip().endswith("None")


def test_a_library_that_does_not_load_gives_its_reason(installed):
    """As on a system that is older than the one it was built for."""
    (library,) = installed.user_folder.rglob("embreex/rtcore_scene*.so")
    library.write_bytes(b"not a library")
    told = installed.run(
        """
enable()
print(sys.modules[MODULE].core.native_library.why_missing("embreex"))
"""
    )
    assert "embreex does not load (" in told
    assert "invalid ELF header" in told or "too short" in told


LIGHTMAP = """
settings = bpy.context.scene.obscurance
settings.target, settings.lightmap_size, settings.unwrapper = "LIGHTMAP", 256, "UVUNWRAP"
try:
    bpy.ops.obscurance.bake()
except RuntimeError as error:
    print(error)
settings.unwrapper = "XATLAS"
print(bpy.ops.obscurance.bake())
"""


def test_without_an_unwrapper_attributes_and_the_other_one_bake(blender, zipped, tmp_path):
    """It is needed for nothing else than unwrapping, and the error says that there is another."""
    blender.install(without(zipped, "uvunwrap", tmp_path))
    told = blender.run("enable()" + BAKE + LIGHTMAP, CORNELL)
    assert "uvunwrap is not installed; install the zip" in told
    assert "choose the unwrapper xatlas (--unwrapper XATLAS)" in told
    assert told.count("{'FINISHED'}") == 2


def test_the_command_line_names_a_missing_ray_tracer(blender, zipped, tmp_path):
    """One line and status 1, and the file is not touched."""
    blender.install(without(zipped, "embreex", tmp_path))
    scene = shutil.copy(CORNELL, tmp_path)
    before = CORNELL.read_bytes()
    blender.run(
        """
import io, contextlib
enable()
with contextlib.redirect_stderr(io.StringIO()) as told:
    assert sys.modules[MODULE].command_line.main(["bake", sys.argv[1]]) == 1
assert "the ray tracer embreex is not installed" in told.getvalue(), told.getvalue()
""",
        scene,
    )
    assert (tmp_path / CORNELL.name).read_bytes() == before


# -------------------------------------------------------------------------------------------------------- preferences


def test_new_files_begin_with_the_defaults_of_the_user(installed):
    """A file that exists keeps its own."""
    installed.run(
        """
enable()
settings = lambda: bpy.context.scene.obscurance
settings().rays = 512
settings().falloff = "LINEAR"
bpy.ops.obscurance.store_defaults()
assert bpy.context.preferences.is_dirty
bpy.ops.wm.save_userpref()
bpy.ops.wm.read_homefile()
assert (settings().rays, settings().falloff) == (512, "LINEAR")
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert (settings().rays, settings().falloff) == (64, "SQRT")
settings().seed = 3
bpy.ops.obscurance.apply_defaults()
assert (settings().rays, settings().seed) == (512, 0)
""",
        CORNELL,
    )
    installed.run(  # in another session, except in 4.2, whose module crashes while it reads any preferences
        """
if bpy.app.version >= (4, 5):
    bpy.ops.wm.read_userpref()
    defaults = bpy.context.preferences.addons[MODULE].preferences.defaults
    assert defaults.changed() == {"rays": 512, "falloff": "LINEAR"}
"""
    )


def test_threads_of_the_preferences_hold_where_the_scene_leaves_it_open(installed):
    """The scene's own number goes first."""
    installed.run(
        """
enable()
bpy.context.preferences.addons[MODULE].preferences.threads = 3
settings = bpy.context.scene.obscurance
assert settings.to_settings().threads == 3
settings.threads = 2
assert settings.to_settings().threads == 2
"""
    )


@pytest.mark.parametrize("ceiling", [0, 512])
def test_the_cache_ceiling_rules_what_stays_in_memory(installed, ceiling):
    """With a ceiling the second bake does not build again and gives the same values; a new file frees it."""
    installed.run(
        """
package = enable()
tracers = package.blender.jobs.job.TRACERS
ceiling = int(sys.argv[2])
bpy.context.preferences.addons[MODULE].preferences.cache_ceiling = ceiling
built = []
build = tracers._build
tracers._build = lambda *a: built.append(1) or build(*a)
values = lambda: [tuple(d.color) for d in bpy.data.objects["Room"].data.attributes["Obscurance"].data]
"""
        + BAKE
        + """
first = values()
bpy.ops.obscurance.bake()
assert values() == first
assert len(built) == (1 if ceiling else 2)
bpy.ops.wm.read_homefile()
assert tracers._kept is None
""",
        CORNELL,
        ceiling,
    )
