"""Run by Blender: blender --background --python blender_views.py -- JOBS.json RESULTS.json

JOBS is a list of {"file": a .vdb, "views": [{"sums": {grid: factor}, "along": axis that is looked
along, 0 to 2, "centre": [x, y, z], "pixel": metres, "size": [width, height], "picture": .exr}]}. A
picture shows, without perspective, the sum of the grids times the factors, integrated along rays:
right and up are +X and +Z, along Y; +Y and +Z, along X; +X and +Y, along Z. RESULTS says of each
file what Blender knows of its grids.
"""

import json
import math
import sys

import bpy

QUARTER = math.pi / 2
TURNS = [(QUARTER, 0, QUARTER), (QUARTER, 0, 0), (0, 0, 0)]  # of a camera that looks along -Z
BACK = [(1, 0, 0), (0, -1, 0), (0, 0, 1)]


def emission(sums):
    material = bpy.data.materials.new("sums")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    total = None
    for grid, factor in sums.items():
        values = nodes.new("ShaderNodeAttribute")
        values.attribute_name = grid
        step = nodes.new("ShaderNodeVectorMath")
        step.operation = "MULTIPLY_ADD"
        step.inputs[1].default_value = [factor] * 3
        links.new(values.outputs["Vector"], step.inputs[0])
        if total:
            links.new(total, step.inputs[2])
        total = step.outputs[0]
    emit = nodes.new("ShaderNodeEmission")
    links.new(total, emit.inputs["Color"])
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(emit.outputs[0], output.inputs["Volume"])
    return material


def main():
    jobs, results = sys.argv[sys.argv.index("--") + 1:]
    said = {"version": bpy.app.version_string, "files": []}
    for job in json.load(open(jobs)):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.object.volume_import(filepath=job["file"])
        volume = bpy.context.object
        loaded = volume.data.grids.load()
        said["files"].append({
            "loaded": loaded, "error": volume.data.grids.error_message,
            "grids": {grid.name: {"type": grid.data_type, "channels": grid.channels,
                                  "matrix": [list(row) for row in grid.matrix_object]}
                      for grid in volume.data.grids}})
        scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        scene.cycles.samples = 256
        scene.cycles.use_denoising = False
        scene.cycles.use_adaptive_sampling = False
        scene.cycles.filter_width = 0.01  # rays through the centres of pixels
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"
        data = bpy.data.cameras.new("camera")
        data.type = "ORTHO"
        camera = bpy.data.objects.new("camera", data)
        scene.collection.objects.link(camera)
        scene.camera = camera
        for view in job["views"]:
            volume.data.materials.clear()
            volume.data.materials.append(emission(view["sums"]))
            scene.render.resolution_x, scene.render.resolution_y = view["size"]
            data.ortho_scale = view["pixel"] * max(view["size"])
            data.clip_end = 1000
            camera.rotation_euler = TURNS[view["along"]]
            camera.location = [at + 100 * back
                               for at, back in zip(view["centre"], BACK[view["along"]])]
            scene.render.filepath = view["picture"]
            bpy.ops.render.render(write_still=True)
    json.dump(said, open(results, "w"))


main()
