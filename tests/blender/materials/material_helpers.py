"""Node trees, meshes and images that Blender itself builds, and their reflectance and emission."""

import bpy
import numpy as np

from obscurance_addon.blender.materials.snapshot import snapshot_material
from obscurance_addon.blender.materials.surfaces import read_surface
from obscurance_addon.core.notes import Notes
from obscurance_addon.core.shading.shading import shade_faces
from obscurance_addon.core.shading.surfaces import NO_TRIANGLES

RED, GREEN, BLUE, WHITE = (0.75, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.25), (0.9, 0.9, 0.9)
COLOR = (0.2, 0.4, 0.6)


class Tree:
    """A material with nothing but an output, and short ways to add nodes to it."""

    def __init__(self, name="Paint"):
        self.material = bpy.data.materials.new(name)
        if bpy.app.version < (5, 0, 0):
            self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.output = self.tree.nodes.new("ShaderNodeOutputMaterial")

    def node(self, kind, inputs=(), **properties):
        return add_node(self.tree, kind, inputs, **properties)

    def link(self, source, target):
        return self.tree.links.new(source, target)

    def surface(self, socket):
        self.link(socket, self.output.inputs["Surface"])
        return self

    def diffuse(self, socket=None, color=COLOR):
        """Diffuse BSDF as the surface, with a colour or with what comes out of a socket."""
        node = self.node("ShaderNodeBsdfDiffuse", {"Color": (*color, 1.0)})
        if socket is not None:
            self.link(socket, node.inputs["Color"])
        return self.surface(node.outputs[0])

    def principled(self, **inputs):
        node = self.node("ShaderNodeBsdfPrincipled", {"Base Color": (*COLOR, 1.0)})
        for name, value in inputs.items():
            input_of(node, name.replace("_", " ")).default_value = value
        self.surface(node.outputs[0])
        return node

    def rgb(self, color=COLOR):
        node = self.node("ShaderNodeRGB")
        node.outputs[0].default_value = (*color, 1.0)
        return node.outputs[0]

    def number(self, value):
        node = self.node("ShaderNodeValue")
        node.outputs[0].default_value = value
        return node.outputs[0]

    def image(self, image, **properties):
        return self.node("ShaderNodeTexImage", image=image, **properties)


def input_of(node, identifier):
    return next(socket for socket in node.inputs if socket.identifier == identifier)


def add_node(tree, kind, inputs=(), **properties):
    node = tree.nodes.new(kind)
    for name, value in properties.items():
        setattr(node, name, value)
    for name, value in dict(inputs).items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, input_of(node, name))
        else:
            input_of(node, name).default_value = value
    return node


def out_of(node, identifier):
    return next(socket for socket in node.outputs if socket.identifier == identifier)


def quads(*uvs, uv_name="UVMap"):
    """A mesh of unit squares side by side, each with the given box (u0, v0, u1, v1) of a UV map."""
    corners = [(x + dx, dy, 0.0) for x in range(len(uvs)) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))]
    mesh = bpy.data.meshes.new("quads")
    mesh.from_pydata(corners, [], np.arange(len(corners)).reshape(-1, 4).tolist())
    if uv_name:
        put_uv(mesh, uv_name, uvs)
    return mesh


def put_uv(mesh, name, uvs):
    boxes = [(u0, v0, u1, v0, u1, v1, u0, v1) for u0, v0, u1, v1 in uvs]
    mesh.uv_layers.new(name=name, do_init=False)
    mesh.uv_layers[name].uv.foreach_set("vector", np.array(boxes, np.float32).ravel())


def make_image(rows, *, byte=True, space=None, name="image"):
    """An image that holds (h, w, 3 or 4) stored values."""
    rows = np.asarray(rows, np.float32)
    height, width = rows.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=not byte)
    if space:
        # Changing the colour space drops the pixels of a generated image: it comes first.
        image.colorspace_settings.name = space
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., : rows.shape[2]] = rows
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def quarters(side=8, **options):
    """Red and green below, blue and white above."""
    rows = np.empty((side, side, 3), np.float32)
    half = side // 2
    rows[:half, :half], rows[:half, half:], rows[half:, :half], rows[half:, half:] = RED, GREEN, BLUE, WHITE
    return make_image(rows, **options)


def shade(*args, **kw):
    """Reflectance and emission of the faces of a mesh (or of one face without mesh), as `shading_of`."""
    found = shading_of(*args, **kw)
    return found.reflectance, found.emission


def transmission_of(tree, mesh=None, notes=None):
    found = shading_of(tree, mesh, notes=notes)
    transmission = np.zeros_like(found.reflectance) if found.transmission is None else found.transmission
    assert transmission.dtype == np.float32
    return transmission[0] if mesh is None else transmission


def shading_of(painted_with, mesh=None, face_material=None, notes=None, images=None):
    """Values of the faces of a mesh, or of one face without mesh."""
    painted_with = painted_with if isinstance(painted_with, list) else [painted_with]
    found = Notes()
    shadings = [
        snapshot_material(material.material if isinstance(material, Tree) else material, found, images)
        for material in painted_with
    ]
    if notes is not None:
        notes += found.lines()
    surface, n_faces = NO_TRIANGLES, 1
    if mesh is not None:
        mesh.calc_loop_triangles()
        surface, n_faces = read_surface(mesh, shadings), len(mesh.polygons)
    if face_material is None:
        face_material = np.zeros(n_faces, np.int32)
    return shade_faces(shadings, face_material, surface)


def reflectance_of(tree, mesh=None, notes=None):
    reflectance, _ = shade(tree, mesh, notes=notes)
    assert reflectance.dtype == np.float32
    return reflectance[0] if mesh is None else reflectance


def emission_of(tree, mesh=None, notes=None):
    _, emission = shade(tree, mesh, notes=notes)
    assert emission.dtype == np.float32
    return emission[0] if mesh is None else emission


def close(actual, expected, tolerance=5e-6):
    np.testing.assert_allclose(actual, np.broadcast_to(expected, np.shape(actual)), rtol=0, atol=tolerance)


def put_color(mesh, name, colors, domain, data_type="FLOAT_COLOR"):
    mesh.attributes.new(name, data_type, domain)
    rgba = np.ones((len(colors), 4), np.float32)
    rgba[:, :3] = colors
    mesh.attributes[name].data.foreach_set("color", rgba.ravel())
    mesh.update()


def painted(kind="ShaderNodeVertexColor", output="Color", **properties):
    tree = Tree()
    return tree.diffuse(tree.node(kind, **properties).outputs[output])
