"""The pictures of docs/see_it.md: a live node under the sample drive, drawn by Foxglove Studio in headless Chromium.

    python benchmarks/pictures.py [--run MCAP] [--chromium /usr/bin/chromium] [--output docs/see_it]

Records a live node (its log, and its markers as it published them), then opens the recording in the last Foxglove
Studio whose source was open, 1.48, as npm has it built, with the layout in config/foxglove. Needs npm, Chromium and
`pip install playwright`; works in build/pictures. `--run` draws an earlier recording, build/pictures/run/run_0.mcap.
"""

from __future__ import annotations

import argparse
import contextlib
import heapq
import http.server
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.replay.parameters import complete, read_config
from tire_dynamics.ros.markers import MARKER_ARRAY

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "pictures"
CONFIG = ROOT / "config" / "vehicle.yaml"
LAYOUT = ROOT / "config" / "foxglove" / "tire_dynamics.json"
POSITIONS = "[1.35, 0.78, 0.305, 1.35, -0.78, 0.305, -1.35, 0.78, 0.305, -1.35, -0.78, 0.305]"
PARAMETERS = {"tf.parent_frame": "base_link", "tf.positions": POSITIONS, "ring_shape_scale": "5.0"}
PACKAGES = ("@foxglove/studio-base@1.48.0", "react@17.0.2", "react-dom@17.0.2")
MOMENT = 16.0  # [s] after the first output: braking
FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--ignore-gpu-blocklist"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a GPU
)
PAGE = """<!doctype html><meta charset="utf-8"><style>html, body, #root {margin: 0; height: 100%}</style>
<div id="root"></div>
<script>window.global = window; window.process = {env: {}}; window.FOXGLOVE_STUDIO_VERSION = "1.48.0";</script>
<script src="/react/umd/react.production.min.js"></script>
<script src="/react-dom/umd/react-dom.production.min.js"></script>
<script>window["react"] = React; window["react-dom"] = ReactDOM;</script>
<script src="/@foxglove/studio-base/assets/index.js"></script>
<script>
(async () => {
  const data = await (await fetch("/layout")).json();
  const id = "tire_dynamics", saved = new Date().toISOString();
  const layouts = new Map([[id, {id, name: id, permission: "CREATOR_WRITE", baseline: {data, savedAt: saved}}]]);
  const layoutStorage = {
    list: async () => [...layouts.values()],
    get: async (_, key) => layouts.get(key),
    put: async (_, layout) => (layouts.set(layout.id, layout), layout),
    delete: async (_, key) => { layouts.delete(key); },
    importLayouts: async () => {},
  };
  const settings = new Map(Object.entries({
    colorScheme: "light", timezone: "UTC", "telemetry.telemetryEnabled": false,
    "telemetry.crashReportingEnabled": false, hideSignInPrompt: true, "ui.open-dialog-startup": false,
    enableNewTopNav: true,
  }));
  const appConfiguration = {
    get: (key) => settings.get(key),
    set: async (key, value) => { settings.set(key, value); },
    addChangeListener() {}, removeChangeListener() {},
  };
  await initI18n();
  ReactDOM.render(React.createElement(App, {
    deepLinks: [location.href], appConfiguration, layoutStorage, extensionLoaders: [], enableGlobalCss: true,
    dataSources: [new RemoteDataSourceFactory()],
  }), document.getElementById("root"));
})();
</script>"""
WORKSPACE = {
    "state": {"leftSidebarOpen": False, "rightSidebarOpen": False, "onboarding": {}, "sidebarItem": None},
    "version": 0,
}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--run", type=Path, help="a recording to draw, instead of a new one")
    options.add_argument("--chromium", default="/usr/bin/chromium")
    options.add_argument("--output", type=Path, default=ROOT / "docs" / "see_it")
    chosen = options.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    run = chosen.run or record()
    packages = WORK / "node_modules"
    if not (packages / "@foxglove").is_dir():
        subprocess.run(["npm", "install", "--silent", "--prefix", str(WORK), *PACKAGES], check=True)
    chosen.output.mkdir(parents=True, exist_ok=True)
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    camera = layout["configById"]["3D!tires"]["cameraState"]
    for name, size, part, distance in (
        ("foxglove", (1600, 1000), whole(layout), camera["distance"]),
        ("foxglove_belts", (1200, 640), "3D!tires", 0.85 * camera["distance"]),
    ):
        picture = chosen.output / f"{name}.png"
        camera["distance"] = distance
        draw(run, {**layout, "layout": part}, size, picture, packages, chosen.chromium)
        shrink(picture)
        print(f"{picture}  {picture.stat().st_size / 1000:.0f} kB")


def whole(layout: dict[str, Any]) -> Any:
    """The arrangement without the panel that calls a service, which this old Studio does not have."""

    def without(node: Any) -> Any:
        if isinstance(node, str):
            return None if node.startswith("CallService!") else node
        first, second = without(node["first"]), without(node["second"])
        return {**node, "first": first, "second": second} if first and second else first or second

    return without(layout["layout"])


# -- the recording ----------------------------------------------------------------------------------------------


def record() -> Path:
    """A live node under the sample drive: its log and its markers, in one bag."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # apart from whatever else runs here
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    for old in ("log", "markers", "run"):
        shutil.rmtree(WORK / old, ignore_errors=True)
    parameters = {**PARAMETERS, "log.directory": str(WORK / "log")}
    arguments = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    node = start("node", "--ros-args", "--params-file", str(CONFIG), *arguments)
    player = None
    try:
        time.sleep(3.0)
        with listening(WORK / "markers"):
            player = start("play", str(ROOT / "bags" / "sample"), "--wait", "20")
            if player.wait(120.0):
                raise SystemExit("the player failed")
    finally:
        for process in filter(None, (node, player)):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.wait(20.0)
    (log,) = (WORK / "log").iterdir()
    bags = [BagReader(log), BagReader(WORK / "markers")]
    with BagWriter(WORK / "run") as bag:
        topics: dict[str, int] = {}
        for topic, msgtype, logged, published, data in heapq.merge(*(b.messages() for b in bags), key=lambda m: m[2]):
            if topic not in topics:
                topics[topic] = bag.add_topic(topic, msgtype, "latched" if topic == "/tf_static" else "default")
            bag.write(topics[topic], logged, published, data)
    return WORK / "run" / "run_0.mcap"


def start(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "tire_dynamics.cli.main", *arguments])


@contextlib.contextmanager
def listening(folder: Path) -> Iterator[None]:
    """Write the markers of all wheels to a bag meanwhile."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from visualization_msgs.msg import MarkerArray

    rclpy.init()
    listener = rclpy.create_node("pictures")
    executor = SingleThreadedExecutor()
    executor.add_node(listener)
    done = threading.Event()
    with BagWriter(folder) as bag:
        for wheel in complete(read_config(CONFIG))["wheels"]:
            topic = bag.add_topic(f"/{wheel}/markers", MARKER_ARRAY, "default")

            def write(data: bytes, topic: int = topic) -> None:
                now = time.time_ns()
                bag.write(topic, now, now, bytes(data))

            listener.create_subscription(MarkerArray, f"/{wheel}/markers", write, 100, raw=True)

        def spin() -> None:
            while not done.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
            rclpy.shutdown()


# -- the picture ------------------------------------------------------------------------------------------------


def draw(run: Path, layout: Any, size: tuple[int, int], picture: Path, packages: Path, chromium: str) -> None:
    """What Foxglove Studio shows of a recording at ``MOMENT``."""
    from playwright.sync_api import sync_playwright

    first = next(logged for topic, _, logged, _, _ in BagReader(run).messages() if topic.endswith("/axle_wrench"))
    when = datetime.fromtimestamp(first * 1e-9 + MOMENT, timezone.utc)
    pages = {"/": PAGE.encode(), "/layout": json.dumps(layout).encode(), "/run.mcap": run.read_bytes()}
    with serving(pages, packages) as address, sync_playwright() as player:
        browser = player.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        page.add_init_script(f"localStorage.setItem('fox.workspace', {json.dumps(json.dumps(WORKSPACE))})")
        page.on("pageerror", lambda error: print(f"page: {error}", file=sys.stderr))
        query = {"ds": "remote-file", "ds.url": f"{address}/run.mcap", "layoutId": "tire_dynamics"}
        page.goto(f"{address}/?{urlencode({**query, 'time': when.isoformat().replace('+00:00', 'Z')})}")
        page.wait_for_selector("canvas", timeout=180_000)
        page.wait_for_timeout(25_000)  # the recording is read to its end, drawn in software
        page.mouse.move(5, size[1] - 5)
        page.add_style_tag(content="[role=tooltip], [role=alert] {display: none !important}")
        page.wait_for_timeout(500)
        page.screenshot(path=str(picture), timeout=180_000)
        browser.close()


@contextlib.contextmanager
def serving(pages: dict[str, bytes], folder: Path) -> Iterator[str]:
    """Serve pages and the files of a folder on this machine, in ranges where asked."""

    class Handler(http.server.SimpleHTTPRequestHandler):
        def do_HEAD(self) -> None:
            self.answer(False)

        def do_GET(self) -> None:
            self.answer(True)

        def answer(self, whole: bool) -> None:
            path = self.path.split("?")[0]
            name = path.strip("/") if path not in pages else ""
            chunk = re.fullmatch(r"/([\w.-]+\.(js|wasm|png|ttf))", path)  # what Studio loads beside its index.js
            file = folder / (f"@foxglove/studio-base/assets/{chunk[1]}" if chunk else name)
            if path not in pages and not file.is_file():
                self.send_error(404)
                return
            data = pages[path] if path in pages else file.read_bytes()
            wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
            total, begin, end = len(data), 0, len(data)
            if wanted:
                begin, end = int(wanted[1]), min(int(wanted[2] or total - 1) + 1, total)
            self.send_response(206 if wanted else 200)
            if wanted:
                self.send_header("Content-Range", f"bytes {begin}-{end - 1}/{total}")
            self.send_header("Accept-Ranges", "bytes")
            self.send_header("Content-Type", "text/html" if path == "/" else self.guess_type(str(file)))
            self.send_header("Content-Length", str(end - begin))
            self.end_headers()
            if whole:
                with contextlib.suppress(ConnectionError):  # Studio drops a request that it no longer needs
                    self.wfile.write(data[begin:end])

        def log_message(self, *_: Any) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()


def shrink(picture: Path) -> None:
    """The same picture with 256 colours: a fraction of the bytes."""
    from PIL import Image  # comes with matplotlib

    Image.open(picture).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    main()
