"""The controller elsewhere: golden vectors, the plain reference loop, and the network's step in JavaScript."""

import functools
import http.server
import importlib.util
import json
import shutil
import subprocess
import threading
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from runtime.assets import model_folder
from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.features import FPS, INPUT, OUTPUT
from runtime.motion.model import MotionModel, load_model
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.library import load_terrain
from tests.helpers.browser import needs_browser, script, until
from tests.helpers.documents import ROOT, text_of
from tests.helpers.shipped import shipped_model

FOLDER = ROOT / "examples" / "engine"
NODE = shutil.which("node")
PACKAGE = FOLDER / "node_modules" / "onnxruntime-web"
needs_package = pytest.mark.skipif(
    NODE is None or not PACKAGE.is_dir(), reason="needs Node, and npm install in examples/engine"
)


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    """The loop of the example."""
    spec = importlib.util.spec_from_file_location("engine_controller", FOLDER / "controller.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def model() -> MotionModel:
    return load_model(precision="fp32")


@pytest.fixture(scope="module")
def golden() -> dict[str, np.ndarray]:
    with np.load(ROOT / "assets" / "golden_step.npz") as file:
        return {name: file[name] for name in file.files}


def test_golden_steps_are_those_of_the_shipped_network(
    golden: dict[str, np.ndarray], model: MotionModel
) -> None:
    style = model.fold_style(golden["z"])
    for x, noise, y in zip(golden["x"], golden["noise"], golden["y"], strict=True):
        np.testing.assert_allclose(model.step(x[None], np.float32(noise[None]), style)[0][0], y, atol=1e-4)


def test_8_bit_weights_stay_within_what_the_model_says_of_them(golden: dict[str, np.ndarray]) -> None:
    model = shipped_model()
    assert model.precision == "int8"
    style, most = model.fold_style(golden["z"]), model.metadata["quantised"]["joint_error_max_mm"] / 1000
    joints = OUTPUT["joint_positions"]
    for x, noise, y in zip(golden["x"], golden["noise"], golden["y"], strict=True):
        got = model.step(x[None], np.float32(noise[None]), style)[0][0]
        assert np.abs(got - y)[joints].max() < 2 * most


def test_the_plain_loop_walks_and_stands(reference: ModuleType, golden: dict[str, np.ndarray]) -> None:
    plain = reference.Controller(model_folder(), golden["z"], golden["offsets"], golden["parents"], seed=3)
    joints = np.array([plain.step(0.0, float(frame < 120))[2] for frame in range(220)])
    hips, ankles = joints[:, 0], joints[:, [4, 9]]
    speed = FPS * np.diff(hips[:, 2])
    assert speed[60:120].mean() == pytest.approx(plain.speed_of[reference.WALK], rel=0.15)
    assert np.abs(hips[:, 0]).max() < 0.3
    apart = ankles[60:120, 0, 2] - ankles[60:120, 1, 2]
    assert apart.max() > 0.3, "the left foot leads"
    assert apart.min() < -0.3, "the right foot leads"
    assert 0.0 < joints[..., 1].min() < 0.05, "feet are on the ground"
    assert np.ptp(joints[200:], axis=0).max() < 0.05, "a body that was told to stop stands"


def test_the_golden_motion_is_the_controllers(golden: dict[str, np.ndarray], model: MotionModel) -> None:
    controller = Controller(model, load_terrain("flat"), temperature=0.0)
    controller.set_style(golden["z"], 0.0)
    for frame, (x, z, gait) in enumerate(golden["stick"][:45]):
        controller.step(Controls((x, z), gait=Gait(int(gait))))
        hips, local = controller.unlocked
        joints = SPORT_SKELETON.forward_kinematics(hips, local)[0]
        assert np.abs(joints - golden["motion"][frame]).max() < 1e-4, frame


def test_the_page_on_engines_gives_every_entry(reference: ModuleType) -> None:
    text = text_of(ROOT / "docs" / "engine.md")
    for slices in (INPUT, OUTPUT):
        for name, entries in slices.items():
            assert f"| {entries.start} - {entries.stop - 1} |" in text, (name, entries)
    lengths = [entries.stop - entries.start for entries in OUTPUT.values()]
    assert [int(np.prod(shape)) for shape in reference.OUTPUT.values()] == lengths
    assert list(reference.INPUT.values()) == [entries.stop - entries.start for entries in INPUT.values()]
    assert [reference.STAND, reference.JUMP] == [Gait.STAND, Gait.JUMP]


DAMAGE = """
import { readFileSync } from "node:fs";
import { checkGraph, readNpz } from "./step.mjs";
const [graph, told, arrays] = ["models/compact/style.onnx", "models/compact/metadata.json", "golden_step.npz"]
  .map((path) => new Uint8Array(readFileSync(new URL(`../../assets/${path}`, import.meta.url))));
const said = [];
const tried = async (work) => said.push(await work().then(() => "", (error) => error.message));
const flipped = (bytes, at) => bytes.with(at, bytes[at] ^ 1);
await tried(async () => readNpz(arrays.buffer));
for (const bad of [flipped(arrays, 14), flipped(arrays, 90_000), arrays.slice(0, 90_000)]) await tried(async () => readNpz(bad.buffer));
await tried(() => checkGraph(told, "style", graph));
await tried(() => checkGraph(told, "style", flipped(graph, 5_000_000)));
await tried(() => checkGraph(told.slice(9), "style", graph));
console.log(JSON.stringify(said));
"""


@pytest.mark.skipif(NODE is None, reason="needs Node.js")
def test_damaged_arrays_and_graphs_are_one_sentence_in_node() -> None:
    script = DAMAGE.replace("import.meta.url", f'"{FOLDER.as_uri()}/"')
    call = [str(NODE), "--input-type=module", "-e", script]
    done = subprocess.run(call, cwd=FOLDER, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    whole, *arrays, graph, other, metadata = json.loads(done.stdout)
    assert (whole, graph) == ("", "")
    assert all(said.startswith("The arrays are damaged (") for said in arrays)
    assert other == "style.onnx is not the graph that metadata.json tells of: download the model again."
    assert metadata.startswith("metadata.json is damaged (")


@needs_package
def test_the_step_runs_in_node() -> None:
    call = [str(NODE), "check.mjs"]
    done = subprocess.run(call, cwd=FOLDER, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    assert json.loads(done.stdout)["worst"] < 1e-4


@needs_package
@needs_browser
def test_the_step_runs_in_a_browser(browser: Any) -> None:
    handler = functools.partial(_Quiet, directory=str(ROOT))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser.get(f"http://127.0.0.1:{server.server_port}/examples/engine/index.html")
        until(browser, "window.found", 90.0)
        server.shutdown()
    assert script(browser, "found.error") is None
    assert script(browser, "found.worst") < 1e-4
    assert "ms a step" in script(browser, "document.getElementById('result').textContent")
    assert script(browser, "document.querySelectorAll('svg line').length") == 90
    assert script(browser, "document.documentElement.scrollWidth <= innerWidth")


class _Quiet(http.server.SimpleHTTPRequestHandler):
    extensions_map = {**http.server.SimpleHTTPRequestHandler.extensions_map, ".mjs": "text/javascript"}  # noqa: RUF012

    def log_message(self, format: str, *args: object) -> None:
        pass
