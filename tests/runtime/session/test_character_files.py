"""Files of characters: in the session under names that every system takes, and out again in folders of their own."""

import json
from dataclasses import replace
from pathlib import Path
from unicodedata import normalize
from urllib.parse import quote, unquote

import pytest

from runtime.character.character import load_character
from runtime.character.writer import write_character
from runtime.session.character_files import read_character_files, write_character_files
from runtime.session.session import CharacterChoice, Session
from runtime.session.session_file import SessionFile
from tests.helpers.full_session import history_of, written
from tests.helpers.gltf_characters import user_character


def write_gltf(path: Path, *uris: str) -> Path:
    """A document that refers to these images."""
    document = {"asset": {"version": "2.0"}, "images": [{"uri": uri} for uri in uris]}
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "name",
    ["a:b.glb", "what?.glb", 'say "hi".glb', "<x>|*.glb", "back\\slash.glb", "n" * 240 + ".glb", "ü" * 120 + ".glb", ".glb.glb",
     " .glb", "a .glb", "tab\there.glb", "line\nbreak.glb", "bell\x07.glb", "%41.glb", "#1.glb", "con.glb", "𝄞é.glb", "dots...glb",
     b"latin-\xe9.glb".decode(errors="surrogateescape"), "CAPS.GLB"],
)  # fmt: skip
def test_a_character_of_any_name_is_in_the_session_and_comes_out_again(name: str, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    write_character(source / "me.glb", user_character())
    (source / "me.glb").rename(source / name)
    (source / (Path(name).stem[:50] + ".json")).write_text("{}", encoding="utf-8")
    kept = write_character_files(read_character_files(source / name), tmp_path / "cache")
    choice = CharacterChoice(path=name, key=kept.relative_to(tmp_path / "cache").as_posix())
    path = written(tmp_path / "a.sport", history_of(replace(Session(), character=choice)), tmp_path / "cache")
    file, history = SessionFile.open(path, tmp_path / "another")
    out = file.character_path(history.present.session.character)
    file.close()
    assert out.suffix.lower() == ".glb"
    load_character(out)


def test_files_that_a_character_refers_to_get_names_that_can_be_kept(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "tex:tures").mkdir(parents=True)
    (source / "tex:tures" / "skin?.png").write_bytes(b"PNG")
    files = read_character_files(write_gltf(source / "me.gltf", "tex:tures/skin%3F.png", "../secret.png"))
    assert list(files) == ["me.gltf", "file 1.png"]
    assert json.loads(files["me.gltf"])["images"][0]["uri"] == "file%201.png"


def test_names_that_are_one_file_elsewhere_are_kept_apart(tmp_path: Path) -> None:
    names = ["skin.png", "SKIN.png", "é.png", "e\u0301.png", "file 1.png"]
    for number, name in enumerate(names):
        (tmp_path / name).write_bytes(bytes([number]))
    files = read_character_files(write_gltf(tmp_path / "me.gltf", *map(quote, names)))
    assert len({normalize("NFC", name).casefold() for name in files}) == 1 + len(names)
    uris = [image["uri"] for image in json.loads(files["me.gltf"])["images"]]
    assert [files[unquote(uri)] for uri in uris] == [bytes([number]) for number in range(len(names))]


def test_a_characters_files_come_out_in_a_folder_of_their_own(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "textures").mkdir(parents=True)
    (source / "textures" / "skin.png").write_bytes(b"PNG")
    (source / "me.joints.json").write_text("{}", encoding="utf-8")
    (source / "other.json").write_text("{}", encoding="utf-8")
    files = read_character_files(write_gltf(source / "me.gltf", "textures/skin.png", "../secret.png"))
    assert list(files) == ["me.gltf", "textures/skin.png", "me.joints.json"]
    path = write_character_files(files, tmp_path / "cache")
    assert (path.name, path.parent.parent) == ("me.gltf", tmp_path / "cache")
    assert (path.parent / "textures" / "skin.png").read_bytes() == b"PNG"
    assert write_character_files(files, tmp_path / "cache") == path
