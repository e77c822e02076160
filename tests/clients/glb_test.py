#!/usr/bin/env python3
"""What programs that others wrote make of scenes with their volume in one file: Khronos' gltf-validator
of the whole, ktx-parse of the textures, and the extension's own JSON schemas. Each has to refuse what is
broken.

Usage: glb_test.py LPVBAKE EXAMPLES CACHE SCHEMAS

What comes from the npm registry is kept in the folder CACHE; SCHEMAS is the folder of the extension's.
"""

import copy
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import jsonschema

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import npm

LPVBAKE = sys.argv[1]
EXAMPLES, CACHE, SCHEMAS = pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]).resolve(), pathlib.Path(sys.argv[4])
NAME = "EXT_light_volume"


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=120)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stderr}")
    return result.stdout


def parts(path):
    """The JSON and the chunk."""
    data = path.read_bytes()
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20:20 + size]), data[28 + size:]


def put(path, root, chunk):
    text = json.dumps(root).encode()
    text = text.ljust((len(text) + 3) // 4 * 4)
    number = lambda value: value.to_bytes(4, "little")
    path.write_bytes(b"glTF" + number(2) + number(28 + len(text) + len(chunk)) + number(len(text)) + b"JSON" + text
                     + number(len(chunk)) + b"BIN\0" + chunk)


class Glb(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        cls.validator = npm.package(CACHE, *npm.GLTF_VALIDATOR)
        cls.ktx_parse, cls.three = npm.of_pages(CACHE, "ktx-parse"), npm.three(CACHE)
        run(sys.executable, EXAMPLES / "make_scenes.py", cls.folder / "scenes")
        cls.lit = {}
        for scene in (EXAMPLES / "cornell_box.gltf", *sorted((cls.folder / "scenes").glob("*.gltf"))):
            # The volume of another program is packed otherwise.
            for target, precision in (("threejs", "half"), ("generic", "float")):
                lit = cls.folder / f"{scene.stem}_{target}.glb"
                run(LPVBAKE, "bake", scene, "-o", lit, "--target", target, "--precision", precision, "--resolution",
                    "12", "--fit", "none", "--default-light")
                cls.lit[lit] = scene

    def report(self, file):
        return json.loads(run("node", pathlib.Path(__file__).with_name("glb.mjs"), self.validator, file))

    def test_gltf_validator_finds_no_fault(self):
        for lit, scene in self.lit.items():
            with self.subTest(file=lit.name):
                issues = self.report(lit)["issues"]
                self.assertEqual([issue for issue in issues["messages"] if issue["severity"] == 0], [])
                self.assertLessEqual(issues["numWarnings"], self.report(scene)["issues"]["numWarnings"])
        print(f"gltf-validator: {len(self.lit)} files without an error")

    def test_gltf_validator_sees_what_is_broken(self):
        root, chunk = parts(next(iter(self.lit)))
        broken = self.folder / "broken.glb"

        def errors(change):
            changed = copy.deepcopy(root)
            change(changed)
            put(broken, changed, chunk)
            return self.report(broken)["issues"]["numErrors"]

        self.assertEqual(errors(lambda _: None), 0)
        for change in (lambda root: root["bufferViews"][-1].update(byteLength=len(chunk)),
                       lambda root: root["bufferViews"][-1].update(buffer=1),
                       lambda root: root["buffers"][0].update(byteLength=len(chunk) + 100),
                       lambda root: root["nodes"][-1].update(matrix=[1] * 16),
                       lambda root: root["scenes"][0]["nodes"].append(99),
                       lambda root: root.pop("extensionsUsed")):
            self.assertGreater(errors(change), 0)

    def test_textures_are_those_of_ktx2_files(self):
        lit = next(lit for lit in self.lit if lit.name == "cornell_box_generic.glb")
        run(LPVBAKE, "convert", lit, self.folder / "apart.ktx2")
        root, chunk = parts(lit)
        textures = root["extensions"][NAME]["volumes"][0]["textures"]
        self.assertEqual(len(textures), 9 + 1 + 3)
        for texture in textures:
            view = root["bufferViews"][texture["bufferView"]]
            self.assertEqual(view["byteOffset"] % 16, 0)
            inside = self.folder / "inside.ktx2"
            inside.write_bytes(chunk[view["byteOffset"]:view["byteOffset"] + view["byteLength"]])
            name = texture["channels"][0].split(".")[0]
            texels = []
            for file in (inside, self.folder / f"apart_{name}.ktx2"):
                facts = json.loads(run("node", pathlib.Path(__file__).with_name("ktx2.mjs"), self.ktx_parse,
                                       self.three, file, self.folder / "texels"))
                texels.append((facts["vkFormat"], facts["pixelDepth"], (self.folder / "texels").read_bytes()))
            self.assertEqual(texels[0], texels[1], name)

    def test_schemas_describe_what_is_written(self):
        loaded = {path.name: json.loads(path.read_text()) for path in SCHEMAS.glob("*.json")}

        def is_valid(name, document):
            resolver = jsonschema.RefResolver(base_uri="", referrer=loaded[name], store=loaded)
            return jsonschema.Draft202012Validator(loaded[name], resolver=resolver).is_valid(document)

        for schema in loaded.values():
            jsonschema.Draft202012Validator.check_schema(schema)
        for lit in self.lit:
            root = parts(lit)[0]
            document = root["extensions"][NAME]
            self.assertTrue(is_valid(f"glTF.{NAME}.schema.json", document), lit)
            node = next(node for node in root["nodes"] if NAME in node.get("extensions", {}))
            self.assertTrue(is_valid(f"node.{NAME}.schema.json", node["extensions"][NAME]), lit)
            for key in ("cells", "order", "convention", "units", "textures"):
                less = copy.deepcopy(document)
                del less["volumes"][0][key]
                self.assertFalse(is_valid(f"glTF.{NAME}.schema.json", less), key)
            for change in ({"order": 5}, {"units": "lx"}, {"cells": [1, 2]}, {"unknown": 1}, {"falloff": -1}):
                wrong = copy.deepcopy(document)
                wrong["volumes"][0].update(change)
                self.assertFalse(is_valid(f"glTF.{NAME}.schema.json", wrong), change)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
