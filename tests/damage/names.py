"""Characters, films and takes of forty names in all scripts, opened ten times here and on another machine: `python -m tests.damage.names`."""

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from runtime.character.writer import write_character
from runtime.session import edits
from runtime.session.character_files import read_character_files, write_character_files
from runtime.session.history import History
from runtime.session.motion import Motion
from runtime.session.session import CharacterChoice, Reference, Session, Take
from runtime.session.session_file import DROPPED_STEPS, SessionFile
from tests.helpers.full_session import history_of, still, written
from tests.helpers.gltf_characters import user_character

OPENINGS = 10
NAMES = (
    "héros", "主角", "ヒーロー", "영웅", "герой", "ήρωας", "גיבור", "بطل", "नायक", "বীর", "ஹீரோ", "హీరో", "พระเอก", "ვაჟკაცი", "հերոս",
    "ጀግና", "ວິລະຊົນ", "វីរបុរស", "သူရဲကောင်း", "баатар", "ᠪᠠᠭᠠᠲᠤᠷ", "قهرمان", "ہیرو", "දක්ෂ", "ᎦᎵᏉᎯ", "ᐊᖓᔪᖅᑳᖅ",
    "e\u0301tudes", "Ünïcödé", "Straße", "İstanbul", "ﬁligree", "½ step", "a'b", "a b", "a.b.c", "50%", "#1", "😀 dancer", "𝄞 clef", "ⅷ",
)  # fmt: skip


def session_of(name: str, cache: Path, source: Path) -> Session:
    """A session whose take, character, film and reference character have a name."""
    write_character(source / f"{name}.glb", user_character())
    kept = write_character_files(read_character_files(source / f"{name}.glb"), cache)
    choice = CharacterChoice(path=str(source / f"{name}.glb"), key=kept.relative_to(cache).as_posix())
    session = edits.with_new_take(Session(), Take(motion=Motion.of(still(30, name)), name=name, note=name))
    film = Reference(video=f"/films/{name}.mp4", character=choice)
    return replace(session, character=choice, reference=film)


def lost(name: str, folder: Path, openings: int = OPENINGS) -> str:
    """What of a name is missing after it was opened so often, edited each time, here and elsewhere; "" for nothing."""
    session = session_of(name, folder / "cache", folder)
    path = written(folder / f"{name}.sport", history_of(session), folder / "cache")
    (folder / "elsewhere").mkdir()
    other = folder / "elsewhere" / "copy.sport"
    shutil.copyfile(path, other)
    for file, cache in ((path, folder / "cache"), (other, folder / "elsewhere" / "cache")):
        shutil.rmtree(cache, ignore_errors=True)
        for _ in range(openings):
            opened, history = SessionFile.open(file, cache)
            problem = _missing(opened, history, session)
            if problem:
                opened.close()
                return f"{name}: {problem} in {file.parent.name}"
            for number in range(DROPPED_STEPS // openings + 1):
                history.push("edit", edits.renamed(history.present.session, 1, f"{name} {number}"))
                opened.write(history)
            history.push("edit", edits.renamed(history.present.session, 1, name))
            opened.write(history)
            if not opened.close():
                return f"{name}: not written"
            shutil.rmtree(cache, ignore_errors=True)
    return ""


def _missing(file: SessionFile, history: History, wanted: Session) -> str:
    now = history.present.session
    path = file.character_path(now.character)
    if path is None or not path.is_file() or now.character != wanted.character:
        return "the character is lost"
    if now.reference != wanted.reference:
        return "the film is lost"
    take, before = now.takes[0], wanted.takes[0]
    was = (before.title, before.note, before.made.header.name)
    same = (take.title, take.note, take.made.clip.name) == was
    return "" if same and len(take.made.clip) == 30 else "the take is lost"


def main() -> int:
    """Run all names and print those of which something is lost."""
    wrong = 0
    for name in NAMES:
        with tempfile.TemporaryDirectory() as folder:
            problem = lost(name, Path(folder))
        wrong += bool(problem)
        if problem:
            print(problem)
    print(f"{len(NAMES)} names, {OPENINGS} openings here and elsewhere: {wrong} lost something")
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
