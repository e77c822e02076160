"""Pages in headless Chromium, and what they show."""

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


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if result.returncode != 0:
        raise AssertionError(f"{command} ended with {result.returncode}\n{result.stderr}")
    return result.stdout


def pixels(path):
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))


def picture(path):
    return pixels(path)[..., :3]


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
        session = self.call("POST", "/session", {"capabilities": {"alwaysMatch": {
            "goog:chromeOptions": {"args": arguments}}}})
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
