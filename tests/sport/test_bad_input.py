"""Whatever is damaged, unknown or missing: one sentence with a remedy, exit code 2, and a viewer that goes on."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import rotations
from runtime.assets import PROJECT_ROOT, asset_path
from runtime.errors import ModelError
from runtime.formats.bvh import format_bvh, read_bvh
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.motion.model_files import INT8_GRAPH, read_metadata
from runtime.skeleton import REST_HIPS_HEIGHT, Skeleton
from runtime.takes.clip import Clip
from sport import cli
from tests.helpers.viewer_fakes import FakeRenderer

MODEL = asset_path("models/compact")
STEP = INT8_GRAPH  # the step graph that is loaded
LONG_PROMPT = "walk like a duck " * 589  # 10,000 characters and a few more


# --- damaged files
def still_clip() -> Clip:
    """Ten frames of the rest pose."""
    rotations = np.tile(np.array([1, 0, 0, 0], np.float32), (10, 31, 1))
    hips = np.tile(np.array([0, REST_HIPS_HEIGHT, 0], np.float32), (10, 1))
    return Clip("still", 60.0, hips, rotations, np.ones((10, 4), np.float32))


def damaged_bvh(folder: Path) -> Path:
    path = save_bvh(still_clip(), folder / "cut.bvh")
    *rows, last = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([*rows, f"x{last}"]), encoding="utf-8")
    return path


def worm_bvh(folder: Path) -> Path:
    """One chain: no body that could be played."""
    names = tuple(f"ring{k}" for k in range(9))
    skeleton = Skeleton(names, tuple(range(-1, 8)), np.full((9, 3), 0.1, np.float32))
    text = format_bvh(skeleton, {0: np.zeros((2, 3))}, rotations.identity((2, 9)), 60.0)
    (folder / "worm.bvh").write_text(text, encoding="utf-8")
    return folder / "worm.bvh"


def half_of(asset: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        data = asset_path(asset).read_bytes()
        path = folder / f"cut{Path(asset).suffix}"
        path.write_bytes(data[: len(data) // 2])
        return path

    return write


damaged_png, damaged_glb = half_of("terrains/bowl.png"), half_of("character/mannequin.glb")


def text_file(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text("not what its name says\n", encoding="utf-8")
        return folder / name

    return write


def model_copy(folder: Path) -> Path:
    shutil.copytree(MODEL, folder / "model")
    return folder / "model"


def model_with(**fields: Any) -> Callable[[Path], Path]:
    """A copy of the shipped model whose metadata have other `fields`."""

    def write(folder: Path) -> Path:
        path = model_copy(folder) / "metadata.json"
        metadata = json.loads(path.read_text(encoding="utf-8")) | fields
        path.write_text(json.dumps(metadata), encoding="utf-8")
        return path.parent

    return write


def model_with_graph(name: str, data: bytes | None, signed: bool = False) -> Callable[[Path], Path]:
    """A copy of the shipped model with other bytes in a graph, or without it; `signed` makes the hash fit."""

    def write(folder: Path) -> Path:
        target = model_copy(folder)
        (target / f"{name}.onnx").unlink()
        if data is not None:
            (target / f"{name}.onnx").write_bytes(data)
        if signed:
            metadata = json.loads((target / "metadata.json").read_text(encoding="utf-8"))
            metadata["sha256"][name] = hashlib.sha256(data or b"").hexdigest()
            (target / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")
        return target

    return write


def exchanged_graphs(folder: Path) -> Path:
    return model_with_graph(STEP, (MODEL / "style.onnx").read_bytes(), signed=True)(folder)


def flipped_bit(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        data = bytearray((MODEL / f"{name}.onnx").read_bytes())
        data[len(data) // 2] ^= 1
        return model_with_graph(name, bytes(data))(folder)

    return write


# --- the command line
def check_sentence(error: str, *words: str) -> None:
    """One line on stderr that names what is wrong and what to do."""
    assert error.startswith("sport: ")
    assert error.count("\n") == 1
    assert error.endswith(".\n")
    assert len(error) < 1000
    for word in words:
        assert word in error


MODELS: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "version": (model_with(layout_version=99), ("metadata.json", "layout_version", "99", "Export the model again")),
    "no version": (model_with(layout_version=None), ("metadata.json", "layout_version", "Export")),
    "format": (model_with(format="other"), ("metadata.json", "not the metadata of a SPORT model", "another model")),
    "skeleton": (model_with(joints=["Hips"]), ("metadata.json", "'joints'", "Install")),
    "config": (model_with(config=[]), ("metadata.json", "'config'", "Install")),
    "start": (model_with(start={"output": [1.0], "phase": []}), ("metadata.json", "'start.output'", "Install")),
    "steps": (model_with(reverse_steps=[{}] * 3), (f"{STEP}.onnx", "'noise'", "Install")),
    "no graph": (model_with_graph("style", None), ("style.onnx", "No such file", "Install")),
    "damaged step": (flipped_bit(STEP), (f"{STEP}.onnx", "damaged", "Install")),
    "damaged style": (flipped_bit("style"), ("style.onnx", "damaged", "Install")),
    "damaged prompt": (flipped_bit("prompt"), ("prompt.onnx", "damaged", "Install")),
    "no network": (model_with_graph(STEP, b"hello", signed=True), (f"{STEP}.onnx", "onnxruntime", "Install")),
    "no prompt network": (model_with_graph("prompt", b"hello", signed=True), ("prompt.onnx", "Install")),
    "exchanged": (exchanged_graphs, (f"{STEP}.onnx", "expected x, noise", "Install")),
}  # fmt: skip


GROUNDS: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "damaged PNG": (damaged_png, ("cut.png", "not a readable PNG", "Save it again")),
    "text as PNG": (text_file("map.png"), ("map.png", "not a readable PNG", "Save it again")),
    "text as NPY": (text_file("map.npy"), ("map.npy", "not a readable NPY", "numpy.save")),
    "text as mesh": (text_file("map.ply"), ("map.ply", "not a readable mesh", "Export the ground")),
}


@pytest.mark.parametrize(
    ("option", "make", "words"),
    [*(("--model", *case) for case in MODELS.values()), *(("--terrain", *case) for case in GROUNDS.values())],
    ids=[*MODELS, *GROUNDS],
)
def test_a_damaged_model_or_ground_is_one_sentence(
    option: str,
    make: Callable[[Path], Path],
    words: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out.bvh"
    assert cli.main(["generate", option, str(make(tmp_path)), "--seconds", "0.1", "--out", str(out)]) == 2
    check_sentence(capsys.readouterr().err, *words)
    assert not out.exists()


GENERATE: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "no model": (["--model", "TMP/nowhere"], ("nowhere", "No such file", "name another model folder")),
    "unknown terrain": (["--terrain", "moon"], ("'moon'", "flat, hills")),
    "missing map": (["--terrain", "TMP/none.png"], ("none.png", "Check the path")),
    "empty prompt": (["--prompt", "  "], ("prompt is empty", "Describe")),
    "long prompt": (["--prompt", LONG_PROMPT], ("prompt has 100", "at most 1000", "Shorten")),
    "prompt with a bell": (["--prompt", "walk\a"], ("prompt", "U+0007", "Type it")),
    "prompt script": (["--prompts", "walk; 4:drunk"], ("Prompts with times", "'walk'", "Write")),
    "folder as target": (["--out", "TMP"], ("this is a folder", "Add the name")),
    "file as folder": (["--out", "TMP/file/a.bvh"], ("a.bvh", "Choose a folder")),
    "no number": (["--seconds", "soon"], ("--seconds", "'soon'", "--help")),
    "long model": (["--model", "x" * 300], ("no model of this name", "Shipped")),
    "long character": (["--character", "x" * 300], ("xxx", "too long", "Check the path")),
    "rate that is none": (["--fps", "nan"], ("--fps nan", "expected 1 to 1000", "Try 60")),
    "rate without end": (["--fps", "inf"], ("--fps inf", "expected 1 to 1000", "Try 60")),
    "unknown camera": (["--camera", "nose", "--out", "TMP/a.mp4"], ("--camera nose", "Choose front")),
    "camera of the window": (["--camera", "keyed", "--out", "TMP/a.mp4"], ("--camera keyed", "Choose front")),
    "odd size": (["--size", "1281x721", "--out", "TMP/a.mp4"], ("--size 1281x721", "even numbers")),
}


@pytest.mark.parametrize("case", GENERATE)
def test_a_mistake_is_one_sentence(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, words = GENERATE[case]
    (tmp_path / "file").write_text("", encoding="utf-8")
    arguments = ["--out", str(tmp_path / "out.bvh"), *(a.replace("TMP", str(tmp_path)) for a in arguments)]
    try:
        code: int | str | None = cli.main(["generate", "--seconds", "0.1", *arguments])
    except SystemExit as end:  # how argparse ends the program
        code = end.code
    assert code == 2
    check_sentence(capsys.readouterr().err.replace("sport generate: ", "sport: "), *words)
    assert not (tmp_path / "out.bvh").exists()


VIEW: dict[str, tuple[str, Callable[[Path], Path | str], tuple[str, ...]]] = {
    "damaged GLB": ("--character", damaged_glb, ("cut.glb", "cut off", "export the file again")),
    "damaged BVH": ("--clip", damaged_bvh, ("cut.bvh", "MOTION", "Export the clip again")),
    "foreign BVH": ("--clip", worm_bvh, ("worm.bvh", "LeftFoot", "Name its joints")),
    "wrong version": ("--model", model_with(layout_version=2), ("metadata.json", "layout_version", "Export")),
    "folder as picture": ("--screenshot", lambda folder: folder, ("this is a folder", "Add the name")),
    "no size": ("--size", lambda _: "0x64", ("--size 0", "expected 64 to 8192 pixels")),
}


@pytest.mark.parametrize("case", VIEW)
def test_the_viewer_ends_with_one_sentence_when_nobody_watches(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    option, make, words = VIEW[case]
    view = ["view", "--offscreen", "--size", "64x64", "--terrain", "flat", "--no-panels"]
    assert cli.main([*view, option, str(make(tmp_path))]) == 2
    check_sentence(capsys.readouterr().err, *words)


def run_sport(arguments: list[str], **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "sport", *arguments]
    options = {"cwd": PROJECT_ROOT, "env": kept | environment, "timeout": 600}
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
@pytest.mark.parametrize("display", [{}, {"DISPLAY": ":4711"}])
def test_without_a_display(display: dict[str, str]) -> None:
    done = run_sport([], **display)
    assert done.returncode == 2
    screen = "DISPLAY" if not display else ":4711"
    check_sentence(done.stderr, "No window can be opened", screen, "--offscreen")


@pytest.mark.skipif(sys.platform != "linux", reason="how libraries are found differs")
@pytest.mark.parametrize(("library", "remedy"), [("libEGL.so.1", "libegl1"), ("libX11.so.6", "libx11-6")])
def test_without_a_library_of_the_system(library: str, remedy: str, tmp_path: Path) -> None:
    (tmp_path / library).write_text("no library", encoding="utf-8")  # found first, and cannot be loaded
    done = run_sport(["view", "--offscreen", "--size", "64x64"], LD_LIBRARY_PATH=str(tmp_path))
    assert done.returncode == 2
    check_sentence(done.stderr, library[3:6], remedy)


ODD_VALUES = [None, True, -1, 10**30, float("nan"), "", [], [[1.0]], {"a": 1}]


def test_no_metadata_raise_anything_else(tmp_path: Path) -> None:
    """Each field in turn replaced by each odd value: it is accepted or a ModelError that names the file."""
    shipped = json.loads((MODEL / "metadata.json").read_text(encoding="utf-8"))
    del shipped["calibration"]["codes"][2:]  # hundreds, read again for every value
    text = json.dumps(shipped)
    names = [(key,) for key in shipped] + [(a, b) for a in ("config", "start", "sha256") for b in shipped[a]]
    refused = []
    for *outer, key in names:
        for value in ODD_VALUES:
            metadata = json.loads(text)
            (metadata[outer[0]] if outer else metadata)[key] = value
            (tmp_path / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")
            try:
                read_metadata(tmp_path)
            except ModelError as error:
                refused.append(error)
    assert len(refused) > 9 * len(ODD_VALUES)
    begin = str(tmp_path / "metadata.json")
    assert all(error.problem.startswith(begin) and error.remedy for error in refused)


# --- the viewer while a person uses it
IN_THE_VIEWER: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "GLB": (damaged_glb, ("cut.glb", "export the file again")),
    "BVH": (damaged_bvh, ("cut.bvh", "Export the clip again")),
    "foreign BVH": (worm_bvh, ("worm.bvh", "Name its joints")),
    "PNG": (damaged_png, ("cut.png", "Save it again")),
    "unknown ending": (text_file("notes.txt"), ("notes.txt", "Drop a session")),
}


def test_the_viewer_says_it_goes_on_and_loses_nothing(tmp_path: Path) -> None:
    from viewer.app import App
    from viewer.options import ViewOptions
    from viewer.services import Services

    options = ViewOptions(offscreen=True, width=96, height=64, terrain="flat", panels=False)
    services = replace(Services(), make_renderer=lambda ctx, quality: FakeRenderer(ctx))  # all else is real
    app = App(options, services, config=tmp_path / "config")
    frames = 0

    def play(count: int = 2) -> None:
        nonlocal frames
        for _ in range(count):
            app.frame()
            frames += 1

    def shown() -> str:
        message = app.messages.current
        return message.text if message is not None else ""

    try:
        app.frame()
        terrain, style = app.scene.terrain, app.editor.session.live.prompt
        controller = app.scene.simulation.controller
        assert controller is not None
        app.takes.toggle_recording()
        app.window.inject_key("w", True)
        for case, (make, words) in IN_THE_VIEWER.items():
            folder = tmp_path / case
            folder.mkdir()
            app.open_files([make(folder)])
            play()
            assert all(word in shown() for word in words), (case, shown())
        for case, (make, words) in MODELS.items():
            folder = tmp_path / "models" / case
            folder.mkdir(parents=True)
            app.load_model(make(folder), 0)
            play(1)
            assert all(word in shown() for word in words), (case, shown())
            assert app.scene.simulation.controller is controller, case
        app.scene.load_terrain("moon")
        play()
        assert "'moon'" in shown()
        for prompt, words in ((" ", "prompt is empty"), (LONG_PROMPT, "at most 1000")):
            app.prompting.submit_prompt(prompt)
            play()
            assert words in shown()
        assert app.scene.terrain is terrain
        assert app.editor.session.live.prompt is style
        play(30)
        app.takes.toggle_recording()
        app.takes.play(1)
        app.bvh_export.path = str(tmp_path / "kept.bvh")
        app.bvh_export.export()
        app.frame()
    finally:
        app.close()
    assert len(load_clip_bvh(tmp_path / "kept.bvh")) == frames
    assert np.ptp(read_bvh(tmp_path / "kept.bvh").positions[:, 0], axis=0).max() > 10.0  # cm: it walked on
