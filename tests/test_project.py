"""Projects: saved and loaded everything is the same bit by bit, and what is damaged or hostile ends in one sentence."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fuzz.projects import project
from test_drive import STYLES, Studio, Take, same, style

from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel, load_model
from runtime.projects.archive import DOCUMENT, ArchiveReader, ArchiveWriter
from runtime.projects.character_files import read_character_files, write_character_files
from runtime.projects.project import Project, StoredTake, StoredVersion, load_project, save_project
from runtime.takes import drive_edits
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
    assert same(shown.clip, clip)
    assert replace(shown.clip.prompts[0]) == clip.prompts[0]
    edit, again = (drive_edits.with_prompt(d, style(45)) for d in (drive, shown.drive))
    wanted, _ = played_again(clip, edit.drive, Controller(model, make_terrain("flat"), seed=9), edit.first)
    made, _ = played_again(
        shown.clip, again.drive, Controller(model, make_terrain("flat"), seed=9), again.first
    )
    assert same(made, wanted)
    assert not same(made, clip)


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
    saved(path, version=2)
    with pytest.raises(FileError, match=r"a\.sport: a project of version 2; this program reads version 1"):
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


def test_a_style_that_is_not_finite_is_refused(take: Take, tmp_path: Path) -> None:
    clip, drive = take
    bad = drive_edits.with_prompt(drive, replace(style(30), z=np.full((6, 64), np.nan, np.float32))).drive
    save_project(Project((StoredTake(StoredVersion(clip, bad)),)), tmp_path / "a.sport")
    with pytest.raises(FileError, match="not finite"):
        load_project(tmp_path / "a.sport")


def test_arrays_that_are_shared_are_stored_once(tmp_path: Path) -> None:
    writer = ArchiveWriter()
    assert writer.array(STYLES) == writer.array(STYLES) == 0
    assert writer.array(STYLES.copy()) == 1


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
