"""Every format without room, and with texts that no file can hold: a sentence or a whole file, the old one kept."""

from dataclasses import replace
from pathlib import Path

import pytest

from runtime import atomic
from runtime.errors import FileError, UsageError
from runtime.formats.options import ExportOptions
from runtime.formats.table import FORMATS, save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import walk

WRITTEN = [suffix for suffix, form in FORMATS.items() if not form.film]
CLIP = Clip("walk", 60.0, *walk(30), prompts=(PromptEvent(0.0, "proud"),))
FLAT = Terrain.flat()
BAD = "a\udcffb"  # as a name that is not UTF-8 is read


def needs(suffix: str) -> None:
    try:
        FORMATS[suffix].check_program(Path("a"))
    except UsageError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("old", [b"", b"the file before"])
def test_without_room_the_old_file_stays_and_nothing_else(
    suffix: str, old: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs(suffix)
    path = tmp_path / f"out{suffix}"
    if old:
        path.write_bytes(old)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def full(written: Path) -> None:
        if written.parent == tmp_path:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic, "_finish", full)
    with pytest.raises(FileError, match=rf"out\{suffix}(\.json)?: No space left on device\."):
        save_motion(CLIP, path, ExportOptions(), FLAT)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("what", ["name", "terrain", "prompt", "file"])
def test_texts_that_are_not_utf8_are_written_with_a_sign_in_their_place(
    suffix: str, what: str, tmp_path: Path
) -> None:
    needs(suffix)
    clips = {
        "name": replace(CLIP, name=BAD),
        "terrain": replace(CLIP, terrain=f"/x/{BAD}.png"),
        "prompt": replace(CLIP, prompts=(PromptEvent(0.0, BAD, typed=BAD),)),
    }
    path = tmp_path / f"{BAD if what == 'file' else 'out'}{suffix}"
    save_motion(clips.get(what, CLIP), path, ExportOptions(), FLAT)
    assert path.stat().st_size > 0
