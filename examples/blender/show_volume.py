"""Shows a light volume in Blender (tested: 3.4.1) as glowing air, in its scene where one is given.

    lpvbake bake room.glb -o room.vdb --target blender
    blender --python show_volume.py -- room.glb room.vdb
    blender --background --python show_volume.py -- room.glb room.vdb --render room.png

A metre of air adds the mean luminance of its place, times --strength, to what is seen through it.
Air of `lpvbake bake --medium` is shown as it is: what it scatters (grid scatter) as emission, times
--strength, what it takes (extinction) as absorption.
The scene keeps its lamps, and its camera, or gets one in front of everything.

Blender turns glTF's axes on import (+Y up becomes +Z up) but no VDB's: `--target blender` writes
the volume turned as well, and puts voxels where Blender draws them, from an index to the next.
"""

import argparse
import math
import pathlib
import sys
import tempfile

import bpy
import mathutils
import numpy

GRID = "sh_l0"
AIR = ("scatter", "extinction")
MEAN = 0.5 / math.sqrt(math.pi)  # mean luminance of coefficient 1


def size_of(text):
    width, height = map(int, text.split("x"))
    if min(width, height) < 1:
        raise ValueError(text)
    return width, height


def arguments():
    parser = argparse.ArgumentParser(prog="show_volume.py", description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="+", metavar="FILE", help=".vdb; .gltf or .glb if wanted")
    parser.add_argument("--strength", type=float, default=1.0, help="of the glow (%(default)s)")
    parser.add_argument("--render", metavar="PICTURE", help="render a PNG with Cycles")
    parser.add_argument("--size", type=size_of, default="640x480", metavar="WxH",
                        help="of the picture (%(default)s)")
    parser.add_argument("--samples", type=int, default=32, help="for each pixel (%(default)s)")
    own = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    options = parser.parse_args(own)
    for file in options.files:
        if pathlib.Path(file).suffix.lower() not in (".vdb", ".gltf", ".glb"):
            parser.error(f"{file}: is neither .vdb nor .gltf nor .glb")
        if not pathlib.Path(file).is_file():
            parser.error(f"{file}: no such file")
    return options


def import_scene(path):
    # Blender 3.4 asks numpy for names that numpy 1.24 has no more.
    for name, kind in (("bool", bool), ("int", int), ("float", float)):
        if name not in vars(numpy):
            setattr(numpy, name, kind)
    # Photometric units as they are; else it divides those of lamps alone by 683. The option's name
    # has changed.
    gltf = bpy.ops.import_scene.gltf
    units = [name for name in gltf.get_rna_type().properties.keys() if "lighting_mode" in name]
    gltf(filepath=path, **dict.fromkeys(units, "COMPAT"))


def import_volume(path, strength):
    bpy.ops.object.volume_import(filepath=path)
    volume = bpy.context.object
    grids = volume.data.grids
    if not grids.load() or GRID not in grids:
        raise SystemExit(f"{path}: has no grid {GRID} {grids.error_message}")
    has_air = all(name in grids for name in AIR)
    volume.data.materials.append(air(strength) if has_air else glow(strength))
    # It is seen, but lights nothing.
    for rays in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(volume, "visible_" + rays, False)


class VolumeMaterial:
    """A material of emission, and of absorption that is added to it."""

    def __init__(self, name):
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.nodes, self.links = self.material.node_tree.nodes, self.material.node_tree.links
        self.nodes.clear()
        self.output = self.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"]

    def grid(self, name):
        values = self.nodes.new("ShaderNodeAttribute")
        values.attribute_name = name
        return values.outputs["Color"]

    def add(self, shader):
        if self.output.is_linked:
            both = self.nodes.new("ShaderNodeAddShader")
            self.links.new(self.output.links[0].from_socket, both.inputs[0])
            self.links.new(shader, both.inputs[1])
            shader = both.outputs["Shader"]
        self.links.new(shader, self.output)

    def emit(self, grid, strength):
        emission = self.nodes.new("ShaderNodeEmission")
        emission.inputs["Strength"].default_value = strength
        self.links.new(self.grid(grid), emission.inputs["Color"])
        self.add(emission.outputs["Emission"])

    def absorb(self, grid):
        """Absorption takes its density times 1 - its colour: a node for each channel."""
        channels = self.nodes.new("ShaderNodeSeparateColor")
        self.links.new(self.grid(grid), channels.inputs["Color"])
        for channel, colour in (("Red", (0, 1, 1, 1)), ("Green", (1, 0, 1, 1)), ("Blue", (1, 1, 0, 1))):
            absorption = self.nodes.new("ShaderNodeVolumeAbsorption")
            absorption.inputs["Color"].default_value = colour
            self.links.new(channels.outputs[channel], absorption.inputs["Density"])
            self.add(absorption.outputs["Volume"])


def glow(strength):
    volume = VolumeMaterial("glow")
    volume.emit(GRID, strength * MEAN)
    return volume.material


def air(strength):
    volume = VolumeMaterial("air")
    volume.emit(AIR[0], strength)
    volume.absorb(AIR[1])
    return volume.material


def camera_in_front(scene):
    """Sees everything, along +Y (glTF's -Z)."""
    bpy.context.view_layer.update()
    points = numpy.array([thing.matrix_world @ mathutils.Vector(corner)
                          for thing in scene.objects if thing.type in ("MESH", "VOLUME")
                          for corner in thing.bound_box])
    low, high = points.min(axis=0), points.max(axis=0)
    data = bpy.data.cameras.new("camera")
    aspect = scene.render.resolution_x / scene.render.resolution_y
    half = 0.55 * max(high[0] - low[0], (high[2] - low[2]) * aspect)
    distance = half / math.tan(data.angle_x / 2)
    data.clip_end = 10 * (distance + high[1] - low[1])
    data.clip_start = data.clip_end / 1e5
    camera = bpy.data.objects.new("camera", data)
    camera.location = ((low[0] + high[0]) / 2, low[1] - distance, (low[2] + high[2]) / 2)
    camera.rotation_euler = (math.pi / 2, 0, 0)
    scene.collection.objects.link(camera)
    return camera


def prepare(scene, path, size, samples, kind):
    settings = scene.render
    settings.resolution_x, settings.resolution_y, settings.resolution_percentage = *size, 100
    settings.image_settings.file_format = kind
    settings.filepath = path
    scene.cycles.samples = samples


def expose(scene, size):
    """Sets the exposure by a small picture: its brightest tenth begins at half of white."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(pathlib.Path(folder) / "small.exr")
        prepare(scene, path, [max(1, side * 32 // max(size)) for side in size], 16, "OPEN_EXR")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(path)
        brightness = numpy.array(image.pixels[:]).reshape(-1, 4)[:, :3].max(axis=1)
        bpy.data.images.remove(image)
    bright = numpy.percentile(brightness, 90)
    if bright > 0:
        scene.view_settings.exposure = math.log2(0.5 / bright)


def main():
    options = arguments()
    for thing in list(bpy.data.objects):  # what Blender starts with
        bpy.data.objects.remove(thing)
    scene = bpy.context.scene
    scene.world = None
    scene.render.engine = "CYCLES"
    scene.cycles.use_denoising = False  # it needs a library that not every Blender has
    scene.view_settings.view_transform = "Standard"
    size = options.size
    scene.render.resolution_x, scene.render.resolution_y = size  # for the camera

    for file in map(str, map(pathlib.Path.resolve, map(pathlib.Path, options.files))):
        if file.lower().endswith(".vdb"):
            import_volume(file, options.strength)
        else:
            import_scene(file)
    cameras = [thing for thing in scene.objects if thing.type == "CAMERA"]
    scene.camera = cameras[0] if cameras else camera_in_front(scene)
    expose(scene, size)

    path = str(pathlib.Path(options.render or "show_volume.png").resolve())
    prepare(scene, path, size, options.samples, "PNG")
    if options.render:
        bpy.ops.render.render(write_still=True)
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D":
                    space.shading.type = "RENDERED"
                    space.region_3d.view_perspective = "CAMERA"


main()
