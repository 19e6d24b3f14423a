"""What a user does in the window, one function each; `test_window.py` plays them all.

def show_something(window):
    yield from window.open("cornell_box.blend")
    yield from window.sidebar()
    yield from window.press("bpy.ops.obscurance.bake")
    yield from window.until(lambda: "Obscurance" in bpy.data.meshes[0].attributes, "the result")
    yield from window.picture("something")
"""
