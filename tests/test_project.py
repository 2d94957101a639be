"""Projects: saved and loaded everything is the same bit by bit, and what is damaged or hostile ends in one sentence."""

from __future__ import annotations

import json
import time
import tracemalloc
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fuzz.projects import project
from gltf_characters import user_character
from hypothesis import given, settings
from hypothesis import strategies as st
from test_drive import STYLES, Studio, Take, same, style

from runtime.character.character import load_character
from runtime.character.writer import write_character
from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel, load_model
from runtime.projects.archive import DOCUMENT, ArchiveReader, ArchiveWriter
from runtime.projects.project import Project, StoredTake, StoredVersion, load_project, save_project
from runtime.session.character_files import read_character_files, write_character_files
from runtime.session.frames import BYTES, packed_frames, unpacked_frames
from runtime.takes import drive_edits
from runtime.takes.clip import Clip
from runtime.takes.drive import played_again
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import make_terrain


@pytest.fixture(scope="module")
def model() -> MotionModel:
    return load_model()


@pytest.fixture(scope="module")
def take(model: MotionModel) -> Take:
    studio = Studio(Controller(model, make_terrain("flat"), seed=3))
    studio.style(1, 0.0)  # a mix
    studio.walk(40)
    studio.restart()
    studio.style(2)
    studio.walk(60)
    return studio.take(90)


def saved(path: Path, **changes: object) -> dict:
    """Save the small project, with other values at the top of its text; the text."""
    save_project(project(), path)
    archive = ArchiveReader.open(path)
    document = archive.document | changes
    with zipfile.ZipFile(path) as file:
        members = {m.filename: file.read(m) for m in file.infolist()}
    with zipfile.ZipFile(path, "w") as file:
        for name, content in (members | {DOCUMENT: json.dumps(document).encode()}).items():
            file.writestr(name, content)
    return document


def test_a_take_is_driven_again_as_before_saving(take: Take, model: MotionModel, tmp_path: Path) -> None:
    clip, drive = take
    save_project(Project((StoredTake(StoredVersion(clip, drive, label="first")),)), tmp_path / "a.sport")
    shown = load_project(tmp_path / "a.sport").takes[0].shown
    assert shown.drive is not None
    assert close(shown.clip, clip)
    assert replace(shown.clip.prompts[0]) == clip.prompts[0]
    edit, again = (drive_edits.with_prompt(d, style(45)) for d in (drive, shown.drive))
    wanted, _ = played_again(clip, edit.drive, Controller(model, make_terrain("flat"), seed=9), edit.first)
    made, _ = played_again(
        shown.clip, again.drive, Controller(model, make_terrain("flat"), seed=9), again.first
    )
    assert close(made, wanted)
    assert same(made, wanted, edit.first)  # what is driven again, bit by bit
    assert not same(made, clip, edit.first)


def close(a: Clip, b: Clip) -> bool:
    """Whether frames are the same within what `runtime.session.frames` promises: 0.05 mm and 0.005 degrees."""
    apart = np.linalg.norm(a.local_rotations - b.local_rotations, axis=-1)
    return bool(
        np.abs(a.hips_positions - b.hips_positions).max() < 0.05e-3
        and np.degrees(4.0 * np.arcsin(apart / 2.0)).max() < 0.005
        and np.abs(a.contacts - b.contacts).max() <= 1 / 256 + 1e-6
        and (a.gaits is None) == (b.gaits is None)
        and (a.gaits is None or np.array_equal(a.gaits, b.gaits))
    )


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 350), st.floats(0.0, 3.0))
def test_packed_frames_are_within_their_bound_and_stay_the_same_when_packed_again(
    seed: int, count: int, speed: float
) -> None:
    rng = np.random.default_rng(seed)
    rotations = np.cumsum(rng.normal(size=(count, 31, 4)) * speed, axis=0) + rng.normal(size=(31, 4))
    rotations = (rotations / np.linalg.norm(rotations, axis=-1, keepdims=True)).astype(np.float32)
    hips = (rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-3, 2)).astype(np.float32)
    clip = Clip(
        "x",
        60.0,
        hips,
        rotations,
        rng.random((count, 4), np.float32),
        gaits=rng.integers(-1, 5, count, np.int8),
    )
    back = repacked(clip)
    assert close(back, clip)
    again = repacked(back)
    assert np.array_equal(again.hips_positions, back.hips_positions)
    assert close(again, clip)


def repacked(clip: Clip) -> Clip:
    data = packed_frames(clip.hips_positions, clip.local_rotations, clip.contacts, clip.gaits)
    hips, rotations, contacts, gaits = unpacked_frames(data, len(clip))
    return replace(clip, hips_positions=hips, local_rotations=rotations, contacts=contacts, gaits=gaits)


def test_everything_of_a_project_is_kept_and_the_same_content_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "a.sport", tmp_path / "b.sport"
    save_project(project(), first)
    found = load_project(first)
    save_project(found, second)
    assert second.read_bytes() == first.read_bytes()
    take = found.takes[0]
    assert (take.name, take.recorded, len(take.older), take.shown.label) == ("my take", True, 1, "words")
    assert take.shown.drive is not None
    assert take.shown.drive.ground(0) is not None
    assert found.terrain is not None
    assert np.array_equal(found.terrain.heights, project().terrain.heights)  # type: ignore[union-attr]
    assert dict(found.view) == {"camera": "orbit", "yaw": 0.5}


def test_words_that_were_typed_live_on_when_a_take_is_driven_again(take: Take, model: MotionModel) -> None:
    clip, drive = take
    change = replace(style(45), event=PromptEvent(0.0, "six words", 0.4, "", "what was typed"))
    made, _ = played_again(
        clip,
        drive_edits.with_prompt(drive, change).drive,
        Controller(model, make_terrain("flat"), seed=3),
        45,
    )
    assert made.prompts[-1].typed == "what was typed"


def test_other_versions_and_other_files_are_refused_with_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.sport"
    saved(path, version=4)
    with pytest.raises(FileError, match=r"a\.sport: a project of version 4; this program reads version 3"):
        load_project(path)
    saved(path, format="sport-take")
    with pytest.raises(FileError, match="not a project of this program"):
        load_project(path)
    path.write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(FileError, match=r"a\.sport: not a project"):
        load_project(path)


@pytest.mark.parametrize(
    "changes",
    [
        {"takes": [{}]},
        {"character": {"../../evil.glb": 0}},
        {"character": {"me.glb": 0, "/etc/passwd": 0}},
        {"grounds": [{"name": "x", "cell_m": 1, "x": 0, "z": 0, "note": "", "heights": 10**9}]},
        {"arrays": [["|O", [1]]] * 40},
        {"arrays": [["<f4", [10**9, 10**9]]] * 40},
        {"place": [0, 0, 1e400]},
    ],
)
def test_damage_ends_in_a_sentence(changes: dict, tmp_path: Path) -> None:
    path = tmp_path / "a.sport"
    saved(path, **changes)
    with pytest.raises(FileError, match=r"a\.sport"):
        load_project(path)


def test_a_compressed_archive_is_refused_before_it_unfolds(tmp_path: Path) -> None:
    path = tmp_path / "a.sport"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(DOCUMENT, b" " * 100_000_000)
    with pytest.raises(FileError, match="compressed members"):
        load_project(path)


def test_what_could_not_be_opened_again_is_not_saved_and_the_old_file_stays(
    take: Take, tmp_path: Path
) -> None:
    path = tmp_path / "a.sport"
    save_project(project(), path)
    before = path.read_bytes()
    clip, drive = take
    bad = drive_edits.with_prompt(drive, replace(style(30), z=np.full((6, 64), np.nan, np.float32))).drive
    with pytest.raises(
        FileError, match=r"a\.sport: not saved, as it could not be opened again \(a style that is not"
    ):
        save_project(Project((StoredTake(StoredVersion(clip, bad)),)), path)
    with pytest.raises(FileError, match="no poses"):
        save_project(
            Project((StoredTake(StoredVersion(replace(clip, hips_positions=clip.hips_positions * np.nan))),)),
            path,
        )
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_arrays_that_are_shared_are_stored_once(tmp_path: Path) -> None:
    writer = ArchiveWriter()
    assert writer.array(STYLES) == writer.array(STYLES) == 0
    assert writer.array(STYLES.copy()) == 0
    assert writer.array(STYLES + 1) == 1


@pytest.mark.parametrize(
    "name",
    ["a:b.glb", "what?.glb", 'say "hi".glb', "<x>|*.glb", "back\\slash.glb", "n" * 240 + ".glb", "ü" * 120 + ".glb", ".glb.glb",
     " .glb", "a .glb", "tab\there.glb", "line\nbreak.glb", "bell\x07.glb", "%41.glb", "#1.glb", "con.glb", "𝄞é.glb", "dots...glb",
     b"latin-\xe9.glb".decode(errors="surrogateescape"), "CAPS.GLB"],
)  # fmt: skip
def test_every_name_of_a_character_is_saved_and_opened_again(name: str, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    write_character(source / "me.glb", user_character())
    (source / "me.glb").rename(source / name)
    (source / (Path(name).stem[:50] + ".json")).write_text("{}", encoding="utf-8")
    path = tmp_path / "a.sport"
    save_project(Project(character=read_character_files(source / name)), path)
    out = write_character_files(load_project(path).character, tmp_path / "cache")
    assert out.suffix.lower() == ".glb"
    load_character(out)


def test_files_that_a_character_refers_to_get_names_that_can_be_kept(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "tex:tures").mkdir(parents=True)
    (source / "tex:tures" / "skin?.png").write_bytes(b"PNG")
    document = {
        "asset": {"version": "2.0"},
        "images": [{"uri": "tex:tures/skin%3F.png"}, {"uri": "../secret.png"}],
    }
    (source / "me.gltf").write_text(json.dumps(document), encoding="utf-8")
    files = read_character_files(source / "me.gltf")
    assert list(files) == ["me.gltf", "file 1.png"]
    assert json.loads(files["me.gltf"])["images"][0]["uri"] == "file%201.png"


def bomb(path: Path, members: list[bytes], table: list, **changes: object) -> None:
    """A project whose text and arrays are given."""
    save_project(project(), path)
    archive = ArchiveReader.open(path)
    document = archive.document | {"arrays": table} | changes
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(DOCUMENT, json.dumps(document))
        for number, content in enumerate(members):
            file.writestr(f"arrays/{number}", content)


def refused(path: Path, problem: str) -> None:
    """That a project is refused within 300 MB of memory and a second."""
    tracemalloc.start()
    started = time.process_time()
    try:
        with pytest.raises(FileError, match=problem):
            load_project(path)
        assert time.process_time() - started < 1.0
        assert tracemalloc.get_traced_memory()[1] < 300 << 20
    finally:
        tracemalloc.stop()


def test_a_bomb_is_refused_before_it_unfolds(tmp_path: Path) -> None:
    """Each of these made gigabytes of less than a megabyte."""
    path, bare = tmp_path / "a.sport", {"grounds": [], "character": {}}
    ground = {"name": "x", "cell_m": 1.0, "x": 0.0, "z": 0.0, "note": "", "heights": 0}
    zeros, more = zlib.compress(bytes(4 * 4096 * 4096), 1), zlib.compress(bytes(1 << 26), 1)
    bomb(path, [zeros] * 3, [["<f4", [4096, 4096]]] * 3, grounds=[{**ground, "heights": k} for k in range(3)])
    refused(path, "unfolds to more than")
    bomb(path, [b"x"], [["|u1", [1 << 28]]], grounds=[], character={"me.glb": 0})
    refused(path, "unfolds to more than")
    bomb(path, [more], [["|u1", [100]]], grounds=[], character={"me.glb": 0})
    refused(path, "expected 100 bytes")
    version = {**ArchiveReader.open(path).document["takes"][0]["shown"], "count": 2_000_000, "drive": None}
    version |= {"frames": [0] * 6666 + [1]}
    sizes = [["|u1", [300 * BYTES]], ["|u1", [200 * BYTES]]]
    takes = [{"name": "", "recorded": True, "camera": [], "shown": version, "older": [], "newer": []}]
    parts = [zlib.compress(bytes(count * BYTES)) for count in (300, 200)]
    bomb(path, parts, sizes, **bare, takes=takes)
    refused(path, "unfolds to more than")
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(DOCUMENT, b"[" + b"[]," * 4_000_000 + b"0]")
    refused(path, "not a project")


def test_what_is_named_a_hundred_times_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "a.sport"
    save_project(project(), path)
    document = ArchiveReader.open(path).document
    (take,) = document["takes"]
    take["shown"]["drive"]["keyframes"] *= 100
    saved(path, takes=[{**take, "older": [take["shown"]] * 20}] * 5)
    found = load_project(path)
    versions = [v for take in found.takes for v in (take.shown, *take.older)]
    assert len({id(v.clip.local_rotations) for v in versions}) == 1
    assert len({id(key.snapshot) for v in versions if v.drive for key in v.drive.keyframes}) == 1


def test_a_characters_files_come_out_in_a_folder_of_their_own(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "textures").mkdir(parents=True)
    (source / "textures" / "skin.png").write_bytes(b"PNG")
    (source / "me.joints.json").write_text("{}", encoding="utf-8")
    (source / "other.json").write_text("{}", encoding="utf-8")
    document = {
        "asset": {"version": "2.0"},
        "images": [{"uri": "textures/skin.png"}, {"uri": "../secret.png"}],
    }
    (source / "me.gltf").write_text(json.dumps(document), encoding="utf-8")
    files = read_character_files(source / "me.gltf")
    assert list(files) == ["me.gltf", "textures/skin.png", "me.joints.json"]
    path = write_character_files(files, tmp_path / "cache")
    assert (path.name, path.parent.parent) == ("me.gltf", tmp_path / "cache")
    assert (path.parent / "textures" / "skin.png").read_bytes() == b"PNG"
    assert write_character_files(files, tmp_path / "cache") == path
