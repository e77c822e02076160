#!/usr/bin/env python3
"""The pages of Babylon.js and PlayCanvas in headless Chromium, beside `lpvbake render` of the same volume
and camera, and that the comparison fails where the volume is broken; and whether WebGL 2 takes
examples/shaders/lpvbake.glsl.

Usage: web_test.py LPVBAKE EXAMPLES CACHE

The engines come from the npm registry, once, into the folder CACHE.
"""

import json
import pathlib
import re
import sys
import tempfile
import unittest

import numpy as np

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(sys.argv[2]) / "web"))
import offline
from chromium import Chromium, broken_atlases, run, serve
from pictures import picture

LPVBAKE, EXAMPLES, CACHE = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
CAMERA, EXPOSURE, SIZE = "0,1,4:0,1,0:35", "4", (500, 320)  # Chromium's least width
# Mean difference of what is shown, 0 to 1; shadow maps and rays differ, and edges.
TOLERANCE = 0.005


def serve_pages(folder):
    """Serves a folder, below it the pages, and the packages that they ask a CDN for, of that version."""
    pages, known = {}, {}

    def place(name, version):
        known[f"{name}-{version}"] = offline.package(CACHE, name, version, offline.PACKAGES[name, version])
        return f"../{name}-{version}/"

    for name in ("babylon", "playcanvas"):
        pages[f"{name}/index.html"] = offline.page(name, place)
        engine = "babylonjs-" if name == "babylon" else "playcanvas-"
        pages[f"{name}/without.html"] = re.sub(rf"\.\./{engine}[0-9]", "../none", pages[f"{name}/index.html"])
    return serve({"": folder, "web": EXAMPLES / "web", **known}, pages)


class Volumes:
    """A scene, its volumes and its pictures, for all pages."""

    def __init__(self, folder):
        self.folder = folder
        self.scene = folder / "scene.gltf"
        self.scene.write_bytes((EXAMPLES / "cornell_box.gltf").read_bytes())
        run(LPVBAKE, "bake", self.scene, "-o", folder / "volume.exr", "-o", folder / "volume.ktx2",
            "--target", "threejs")
        self.pack(folder / "volume.json", "bytes", "unorm8")
        self.expected = {show: self.render(show, "volume.json", "--camera", CAMERA, "--exposure", EXPOSURE)
                         for show in ("direct", "indirect")}
        (folder / "lights.json").write_text(json.dumps({"lights": [
            {"type": "spot", "intensity": 200, "color": [1, 0.8, 0.5], "position": [0.5, 1.9, 0.5],
             "direction": [-0.6, -1, -0.5], "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}}]}))
        light = ["--no-scene-lights", "--sun", "20,30,300", "--sky", "0.2:0.4:1,30", "--lights",
                 folder / "lights.json"]
        run(LPVBAKE, "bake", self.scene, "-o", folder / "given.ktx2", "--target", "threejs", "--resolution",
            "16", *light)
        facts = json.loads(run(LPVBAKE, "info", folder / "given_atlas.ktx2", "--format", "json"))
        self.given = self.render("final", "given_atlas.ktx2", "--exposure", facts["metadata"]["exposure"], *light)

    def pack(self, volume, name, precision="half"):
        packing = ["--packing", "ratio"] if precision == "unorm8" else []
        run(LPVBAKE, "convert", volume, self.folder / f"{name}.ktx2", "--target", "threejs", "--precision",
            precision, *packing)

    def render(self, show, volume, *options):
        path = self.folder / "render.png"
        # The volume is fitted to three.js' lookup, and read by it.
        run(LPVBAKE, "render", self.scene, self.folder / volume, "-o", path, "--size", f"{SIZE[0]}x{SIZE[1]}",
            "--show", show, *options)
        return picture(path)


def setUpModule():
    global chromium, volumes, address
    temporary = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(temporary.cleanup)
    volumes = Volumes(pathlib.Path(temporary.name))
    address, close = serve_pages(volumes.folder)
    unittest.addModuleCleanup(close)
    chromium = Chromium(SIZE)
    unittest.addModuleCleanup(chromium.close)


class Offline(unittest.TestCase):
    def test_pages_take_nothing_from_elsewhere(self):
        folder = volumes.folder / "offline"
        folder.mkdir()
        (folder / "packages").symlink_to(CACHE.resolve())
        run(sys.executable, EXAMPLES / "web/offline.py", folder)
        for file in ("scene.gltf", "volume_atlas.ktx2"):
            (folder / file).write_bytes((volumes.folder / file).read_bytes())
        of_folder, close = serve({"": folder}, {})
        self.addCleanup(close)
        for name in offline.PAGES:
            self.assertNotIn("https://", re.sub("<!--.*?-->", "", (folder / name / "index.html").read_text(), flags=re.S))
            self.assertEqual(chromium.open(f"{of_folder}/{name}/index.html?scene=../scene.gltf&"
                                           "volume=../volume_atlas.ktx2&panel=0"), ["ready", ""])


class Page:
    def encoded(self, shown):
        """As sRGB."""
        return shown

    def open(self, volume, query="", page="index"):
        return chromium.open(f"{address}/{self.name}/{page}.html?scene=../scene.gltf&volume=../{volume}"
                             f"&panel=0&{query}")

    def view(self, volume, query):
        self.assertEqual(self.open(volume, query), ["ready", ""])
        return self.encoded(chromium.screenshot(volumes.folder / "view.png"))

    def difference(self, show, volume):
        view = self.view(volume, f"show={show}&camera={CAMERA}&exposure={EXPOSURE}")
        self.assertEqual(view.shape, volumes.expected[show].shape)
        return float(np.mean(np.abs(view - volumes.expected[show])))

    def test_shows_what_render_shows(self):
        for show in ("direct", "indirect"):
            difference = self.difference(show, "volume_atlas.ktx2")
            print(f"{self.name}, {show}: mean difference {difference:.4f}")
            self.assertGreater(volumes.expected[show].mean(), 0.05, show)
            self.assertLess(difference, TOLERANCE, show)

    def test_bytes_show_it_too(self):
        difference = self.difference("indirect", "bytes_sh_l0.ktx2")
        print(f"{self.name}, unorm8: mean difference {difference:.4f}")
        self.assertLess(difference, TOLERANCE)

    def test_broken_volumes_look_different(self):
        for name, volume in broken_atlases(volumes.folder / "volume.json"):
            forms = {"half": "broken_atlas.ktx2"}
            if name == "swapped coefficient":
                forms["unorm8"] = "broken_sh_l0.ktx2"
            for precision, file in forms.items():
                volumes.pack(volumes.folder / volume, "broken", precision)
                difference = self.difference("indirect", file)
                print(f"{self.name}, {name}, {precision}: mean difference {difference:.4f}")
                self.assertGreater(difference, 5 * TOLERANCE, (name, precision))

    def test_lights_sky_and_exposure_are_those_of_the_bake_and_the_camera_that_of_the_file(self):
        difference = float(np.mean(np.abs(self.view("given_atlas.ktx2", "show=both") - volumes.given)))
        print(f"{self.name}, lights of the bake: mean difference {difference:.4f}")
        self.assertLess(difference, TOLERANCE)

    def test_panel_and_pointer_change_what_is_seen(self):
        direct = self.view("volume_atlas.ktx2", f"show=direct&camera={CAMERA}&exposure={EXPOSURE}")
        chromium.script("const { show } = document.getElementById('panel').elements; show.value = 'indirect';"
                        "show[0].dispatchEvent(new Event('input', { bubbles: true }))")
        indirect = self.encoded(chromium.screenshot(volumes.folder / "view.png"))
        self.assertLess(float(np.mean(np.abs(indirect - volumes.expected["indirect"]))), TOLERANCE)
        chromium.script("const canvas = document.querySelector('canvas');"
                        "canvas.dispatchEvent(new PointerEvent('pointermove', { buttons: 1, movementX: 60 }));"
                        "canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: 200 }))")
        turned = self.encoded(chromium.screenshot(volumes.folder / "view.png"))
        # Around the point looked at, by 60 / 200, and away.
        far = 4 * 1.001 ** 200
        eye = f"{-far * np.sin(0.3):.6f},1,{far * np.cos(0.3):.6f}"
        expected = volumes.render("indirect", "volume.json", "--camera", f"{eye}:0,1,0:35", "--exposure", EXPOSURE)
        self.assertLess(float(np.mean(np.abs(turned - expected))), TOLERANCE)
        self.assertGreater(float(np.mean(np.abs(turned - indirect))), 5 * TOLERANCE)
        self.assertGreater(float(np.mean(np.abs(direct - indirect))), 5 * TOLERANCE)

    def test_says_what_is_wrong(self):
        run(LPVBAKE, "convert", volumes.folder / "volume.json", volumes.folder / "band.ktx2")
        for page, volume, said in (("index", "band_sh_l0.ktx2", "--target threejs"),
                                   ("index", "none.ktx2", "none.ktx2: 404"),
                                   ("without", "volume_atlas.ktx2", "could not be loaded")):
            state, message = self.open(volume, page=page)
            self.assertEqual(state, "failed", page)
            self.assertIn(said, message)
        for volume, query, said in (("volume.json", "", "volume.json is no light volume"),
                                    ("volume_atlas.ktx2", "camera=1,2", "camera=1,2 is none of")):
            state, message = self.open(volume, query)
            self.assertEqual(state, "failed")
            self.assertIn(said, message)
        for camera in ("inside", "orbit", "orbit:20,10,3"):
            self.assertEqual(self.open("volume_atlas.ktx2", f"camera={camera}"), ["ready", ""])


class Babylon(Page, unittest.TestCase):
    name = "babylon"


class PlayCanvas(Page, unittest.TestCase):
    name = "playcanvas"

    def encoded(self, shown):
        linear = shown ** 2.2  # its gammaCorrectOutput
        return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


class Header(unittest.TestCase):
    """examples/shaders/lpvbake.glsl in GLSL ES 3.00."""

    def log(self, order, packing, walls, header):
        light = 1 + 3 * order if packing == "LPV_UNORM8" else (order + 1) ** 2
        source = "\n".join([
            "#version 300 es", "precision highp float; precision highp sampler3D;",
            f"#define LPV_ORDER {order}", f"#define {packing}",
            f"uniform sampler3D lpv_sh[{light}], lpv_validity, lpv_base;",
            f"uniform vec4 lpv_low[{light}], lpv_high[{light}];",
            "#define LPV_WALLS\nuniform sampler3D lpv_walls[3];" if walls else "", header,
            "in vec3 position, normal; out vec4 colour;",
            "void main() { LpvVolume volume = LpvVolume(vec3(0), 1.0);",
            f"colour.rgb = lpv_irradiance_l{order}(lpv_facing(volume, position, normal), normal)",
            "+ lpv_irradiance_l1_nonlinear(lpv_trilinear(volume, position), normal); }"])
        return chromium.script(f"""
            const gl = document.createElement('canvas').getContext('webgl2');
            const program = gl.createProgram();
            const add = (kind, source) => {{
                const shader = gl.createShader(kind);
                gl.shaderSource(shader, source);
                gl.compileShader(shader);
                gl.attachShader(program, shader);
                return gl.getShaderInfoLog(shader);
            }};
            const log = add(gl.VERTEX_SHADER, `#version 300 es
                out vec3 position, normal; void main() {{ position = normal = gl_Position.xyz = vec3(0); }}`)
                + add(gl.FRAGMENT_SHADER, {json.dumps(source)});
            gl.linkProgram(program);
            return log + gl.getProgramInfoLog(program);""")

    def test_webgl_takes_it(self):
        header = (EXAMPLES / "shaders/lpvbake.glsl").read_text()
        for order in (1, 2):
            for packing in ("LPV_PLAIN", "LPV_UNORM8", "LPV_BC6H"):
                for walls in (False, True):
                    self.assertEqual(self.log(order, packing, walls, header), "", (order, packing, walls))
        self.assertIn("lpv_nothing", self.log(1, "LPV_PLAIN", False, header + "float f = lpv_nothing;"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
