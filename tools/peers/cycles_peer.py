"""Blender's Cycles: bakes diffuse light, direct and indirect, without colour.

Every vertex has a white triangle of its own, seen by no ray, in whose centre one texel is baked:
exactly at the vertex and along its normal. A colour attribute would take a bake at every face
corner, six times as many, and its normals from the faces. Light tree on, nothing clamped or
skipped, 1024 bounces. Adaptive sampling leaves a bake as it is, to the bit; path guiding was
farther off after more time (Cornell-type box, 16 samples: 15.8 % after 3.3 s, 14.3 % after 2.2 s
without). Light with a goniometric diagram is an area or point light whose strength is looked up by
direction.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .peer_scene import (
    C_COUNT,
    GAMMA_COUNT,
    TEXEL_TRIANGLE,
    Array,
    LackingError,
    PeerLuminaire,
    PeerScene,
)

BOUNCES = 1024
# Size of a vertex's triangle, of the scene's size: at 5e-5 those behind a picture leave its gap.
TRIANGLE = 5e-6


class CyclesPeer:
    """quality : samples a vertex"""

    def __init__(self, scene: PeerScene, threads: int, mode: str) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._count = len(scene.positions)
        self._scene = bpy.context.scene
        self._configure(threads)
        _link("surfaces", _surfaces(scene))
        for number, luminaire in enumerate(scene.luminaires):
            _add_luminaire(f"luminaire{number}", luminaire)
        self._image = self._add_receivers(scene)

    def illuminance(self, quality: int, seed: int) -> Array:
        """(N, 3) lx by channel."""
        self._scene.cycles.samples = quality
        self._scene.cycles.seed = seed
        bpy.ops.object.bake(
            type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0, use_clear=True
        )
        texels = np.empty(4 * self._image.size[0] * self._image.size[1], np.float32)
        self._image.pixels.foreach_get(texels)
        return np.pi * texels.reshape(-1, 4)[: self._count, :3].astype(np.float64)

    def _configure(self, threads: int) -> None:
        render, cycles = self._scene.render, self._scene.cycles
        render.engine = "CYCLES"
        render.threads_mode, render.threads = "FIXED", threads
        cycles.device = "CPU"
        cycles.use_adaptive_sampling = cycles.use_guiding = False
        cycles.use_denoising = False
        cycles.use_light_tree = True
        cycles.use_auto_tile = False
        cycles.light_sampling_threshold = 0.0
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
        cycles.max_bounces = cycles.diffuse_bounces = BOUNCES

    def _add_receivers(self, scene: PeerScene) -> Any:
        """The vertices' triangles, and the image that they are baked to."""
        side = int(np.ceil(np.sqrt(self._count)))
        image = bpy.data.images.new("illuminance", side, side, float_buffer=True, is_data=True)
        mesh = _triangles("receivers", scene.receiver_triangles(TRIANGLE))
        number = np.arange(self._count)
        texels = np.stack([number % side, number // side], axis=1)[:, None] + 0.5 + TEXEL_TRIANGLE
        mesh.uv_layers.new(name="texel").data.foreach_set(
            "uv", (texels / side).astype(np.float32).ravel()
        )
        material = bpy.data.materials.new("receiver")
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        white = nodes.new("ShaderNodeBsdfDiffuse")
        white.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        output = nodes.new("ShaderNodeOutputMaterial")
        material.node_tree.links.new(white.outputs["BSDF"], output.inputs["Surface"])
        target = nodes.new("ShaderNodeTexImage")
        target.image = image
        nodes.active = target
        mesh.materials.append(material)
        receivers = _link("receivers", mesh)
        # What no ray sees isn't there: camera rays, of which a bake has none, do.
        for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(receivers, f"visible_{ray}", False)
        receivers.select_set(True)
        bpy.context.view_layer.objects.active = receivers
        return image


def _link(name: str, content: Any) -> Any:
    item = bpy.data.objects.new(name, content)
    bpy.context.scene.collection.objects.link(item)
    return item


def _triangles(name: str, corners: Array) -> Any:
    count = len(corners)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(3 * count)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", np.arange(3 * count, dtype=np.int32))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    mesh.update()
    mesh.shade_flat()
    return mesh


def _surfaces(scene: PeerScene) -> Any:
    mesh = _triangles("surfaces", scene.corners)
    colour = np.ones((len(scene.corners), 4), np.float32)
    colour[:, :3] = scene.reflectance
    mesh.attributes.new("reflectance", "FLOAT_COLOR", "FACE").data.foreach_set(
        "color", colour.ravel()
    )
    mesh.attributes.new("one_sided", "FLOAT", "FACE").data.foreach_set(
        "value", (~scene.double_sided).astype(np.float32)
    )
    material = bpy.data.materials.new("surface")
    material.use_nodes = True
    tree = material.node_tree
    nodes = tree.nodes
    nodes.clear()
    reflectance, one_sided = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeAttribute")
    reflectance.attribute_name, one_sided.attribute_name = "reflectance", "one_sided"
    geometry, absorbs = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMath")
    absorbs.operation = "MULTIPLY"
    diffuse, mix = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeMixShader")
    output = nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(geometry.outputs["Backfacing"], absorbs.inputs[0])
    tree.links.new(one_sided.outputs["Fac"], absorbs.inputs[1])
    tree.links.new(reflectance.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(absorbs.outputs[0], mix.inputs[0])
    tree.links.new(diffuse.outputs["BSDF"], mix.inputs[1])  # the other is left black
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    return mesh


def _add_luminaire(name: str, luminaire: PeerLuminaire) -> None:
    """Lights have the power of a Lambertian surface: with lumens for watts, values are lux."""
    kinds = {"rect": "AREA", "disk": "AREA", "sphere": "POINT"}
    if luminaire.shape not in kinds:
        raise LackingError(f"Cycles has no {luminaire.shape} light")
    light = bpy.data.lights.new(name, kinds[luminaire.shape])
    brightest = float(luminaire.colour.max())
    light.color = luminaire.colour / brightest
    light.energy = luminaire.luminous_flux * brightest
    width, height = (float(size) for size in luminaire.size)
    if luminaire.shape == "rect":
        light.shape, light.size, light.size_y = "RECTANGLE", width, height
    elif luminaire.shape == "disk":
        light.shape, light.size = "DISK", 2 * width
    else:
        light.shadow_soft_size = width
        light.use_soft_falloff = False  # a sphere, not a disk that faces each point
    if luminaire.candela is not None:
        _shine_by_diagram(light, luminaire)
    to_world = np.eye(4)
    to_world[:3, :3] = luminaire.axes.T
    to_world[:3, 3] = luminaire.origin
    _link(name, light).matrix_world = to_world.T.tolist()


def _shine_by_diagram(light: Any, luminaire: PeerLuminaire) -> None:
    """Strength by direction, in those of a surface of constant luminance."""
    candela = luminaire.candela
    assert candela is not None
    flat = luminaire.shape != "sphere"
    if flat and candela[:, GAMMA_COUNT // 2 + 2 :].any():
        raise LackingError("Cycles has no flat light that shines to both sides")
    table = np.ones((C_COUNT, GAMMA_COUNT, 4), np.float32)
    table[..., :3] = (candela * (1 if flat else 4) * np.pi / luminaire.luminous_flux)[..., None]
    image = bpy.data.images.new(light.name, GAMMA_COUNT, C_COUNT, float_buffer=True, is_data=True)
    image.pixels.foreach_set(table.ravel())
    image.pack()
    light.use_nodes = True
    tree = light.node_tree
    nodes = tree.nodes
    nodes.clear()

    def math(operation: str, *inputs: Any) -> Any:
        node = nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, inputs, strict=False):
            if isinstance(value, float):
                socket.default_value = value
            else:
                tree.links.new(value, socket)
        return node.outputs[0]

    towards = nodes.new("ShaderNodeNewGeometry").outputs["Incoming"]
    local = []
    for axis in luminaire.axes:
        node = nodes.new("ShaderNodeVectorMath")
        node.operation = "DOT_PRODUCT"
        tree.links.new(towards, node.inputs[0])
        node.inputs[1].default_value = axis
        local.append(node.outputs["Value"])
    x, y, z = local
    down = math("MULTIPLY", z, -1.0)
    gamma = math("ARCCOSINE", down)
    around = math("ARCTAN2", y, x)
    c = math("ADD", around, math("MULTIPLY", math("LESS_THAN", around, 0.0), 2 * np.pi))
    # Texels' values lie at their centres.
    u = math("MULTIPLY_ADD", gamma, (GAMMA_COUNT - 1) / np.pi / GAMMA_COUNT, 0.5 / GAMMA_COUNT)
    v = math("MULTIPLY_ADD", c, (C_COUNT - 1) / (2 * np.pi) / C_COUNT, 0.5 / C_COUNT)
    place = nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(u, place.inputs[0])
    tree.links.new(v, place.inputs[1])
    texture = nodes.new("ShaderNodeTexImage")
    texture.image, texture.extension = image, "EXTEND"
    tree.links.new(place.outputs[0], texture.inputs[0])
    strength = texture.outputs["Color"]
    if flat:
        strength = math("DIVIDE", strength, math("MAXIMUM", down, 1e-6))
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputLight")
    tree.links.new(strength, emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
