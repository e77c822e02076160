"""Pages in headless Chromium, what they show, and broken volumes to show by them."""

import base64
import http.server
import io
import json
import subprocess
import threading
import time
import urllib.request

import numpy as np
import OpenImageIO as oiio

from pictures import picture, pixels


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stderr}")
    return result.stdout


def broken_atlases(volume):
    """Volumes that a page must not take for `volume`, the .json of one baked with --target threejs -o
    NAME.exr. Pairs of what is wrong and the name of a .json beside it, which the next one overwrites."""
    facts = json.loads(volume.read_text())
    layout = facts["layout"]
    (width, height), columns, rows = layout["tile"], layout["columns"], layout["rows"]
    image = pixels(volume.with_name(facts["files"][0]["file"]))
    atlas = image.reshape(rows, height, columns, width, 4).swapaxes(1, 2)
    atlas = atlas.reshape(rows * columns, height, width, 4)
    probes = atlas[:layout["slices"]].reshape(7, -1, height, width, 4).copy()

    def coefficients(change):  # [block, slice, y, x, channel] as [slice, y, x, 28 floats]
        floats = np.moveaxis(probes, 0, 3).reshape(*probes.shape[1:4], 28).copy()
        change(floats)
        return np.moveaxis(floats.reshape(*probes.shape[1:4], 7, 4), 3, 0)

    def swap(floats):  # y and x
        floats[..., 3:6], floats[..., 9:12] = floats[..., 9:12].copy(), floats[..., 3:6].copy()

    def negate(floats):  # band 1
        floats[..., 3:12] *= -1

    broken = {"flipped axis": probes[:, :, :, ::-1], "swapped coefficient": coefficients(swap),
              "wrong sign": coefficients(negate), "wrong slice order": probes[:, ::-1],
              "missing pi": probes / np.pi}
    for name, changed in broken.items():
        atlas[:layout["slices"]] = changed.reshape(-1, height, width, 4)
        back = atlas.reshape(rows, columns, height, width, 4).swapaxes(1, 2)
        out = oiio.ImageBuf(oiio.ImageSpec(image.shape[1], image.shape[0], 4, "half"))
        out.set_pixels(oiio.ROI(), np.ascontiguousarray(back.reshape(image.shape)))
        out.write(str(volume.with_name("broken_atlas.exr")))
        facts["files"][0]["file"] = "broken_atlas.exr"
        volume.with_name("broken.json").write_text(json.dumps(facts))
        yield name, "broken.json"


def serve(folders, texts):
    """Serves each of `folders` below its name, "" at the root, and `texts` in place of files. The
    address, and what ends it."""

    class Handler(http.server.SimpleHTTPRequestHandler):
        extensions_map = {**http.server.SimpleHTTPRequestHandler.extensions_map,
                          ".js": "text/javascript", ".mjs": "text/javascript"}

        def name(self):
            return self.path.split("?")[0].lstrip("/")

        def translate_path(self, path):
            first, _, rest = self.name().partition("/")
            return str(folders[first] / rest if first in folders else folders[""] / self.name())

        def send_head(self):
            text = texts.get(self.name())
            if text is None:
                return super().send_head()
            self.send_response(200)
            self.send_header("Content-Type", self.guess_type(self.name()))
            self.send_header("Content-Length", str(len(text.encode())))
            self.end_headers()
            return io.BytesIO(text.encode())

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()

    def close():
        server.shutdown()
        server.server_close()

    return f"http://127.0.0.1:{server.server_address[1]}", close


class Chromium:
    """Chromium by chromedriver (W3C WebDriver)."""

    def __init__(self, size):
        self.size = size
        self.driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL, text=True)
        for line in self.driver.stdout:
            if "started successfully on port" in line:
                self.address = f"http://127.0.0.1:{line.split()[-1].rstrip('.')}"
                break
        arguments = ["--headless=new", "--no-sandbox", "--use-gl=angle",
                     "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
                     "--force-device-scale-factor=1", "--hide-scrollbars"]
        # Milliseconds: a busy machine draws slowly.
        session = self.call("POST", "/session", {"capabilities": {"alwaysMatch": {
            "timeouts": {"script": 110000}, "goog:chromeOptions": {"args": arguments}}}})
        self.address += "/session/" + session["sessionId"]

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, method=method)
        return json.load(urllib.request.urlopen(request, timeout=120))["value"]

    def script(self, text):
        return self.call("POST", "/execute/sync", {"script": text, "args": []})

    def open(self, url):
        """Loads the page; its state, and what it says."""
        self.call("POST", "/url", {"url": url})
        # Screenshots are of the view, which is smaller than the window.
        for _ in range(2):
            width, height = self.script("return [outerWidth - innerWidth, outerHeight - innerHeight]")
            self.call("POST", "/window/rect",
                      {"width": self.size[0] + width, "height": self.size[1] + height})
        end = time.monotonic() + 100
        while time.monotonic() < end:
            state = self.script("return [document.body.dataset.state ?? '', "
                                "document.getElementById('message').textContent]")
            if state[0]:
                return state
            time.sleep(0.2)
        raise AssertionError(f"{url} did not load")

    def screenshot(self, path):
        """The canvas as it is drawn now: what the browser has on the screen may be a frame behind it,
        even of the page before."""
        url = self.script("dispatchEvent(new Event('resize'));"
                          "return document.querySelector('canvas').toDataURL()")
        path.write_bytes(base64.b64decode(url.partition(",")[2]))
        return picture(path)

    def close(self):
        self.call("DELETE", "")
        self.driver.kill()
        self.driver.wait()
        self.driver.stdout.close()
