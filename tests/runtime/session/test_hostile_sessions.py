"""Session files that nobody vouches for: documents that lie, bombs, other tables. One sentence each, in little time and memory."""

import json
import os
import sqlite3
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import FileError, SportError
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import unwritten_files
from runtime.session.tables import INPUT
from runtime.session.unwritten import keep
from tests.helpers.counting import bounded
from tests.helpers.full_session import full_session, history_of, packed_zeros, reseal, written

DEEP = "[" * 100_000
HUGE = "1" * 5000


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a session that has one of everything, and its cache."""
    folder = tmp_path_factory.mktemp("whole")
    session = full_session(folder / "cache", folder)
    return written(folder / "a.sport", history_of(session, session), folder / "cache")


@pytest.fixture
def path(whole: Path, tmp_path: Path) -> Path:
    """A copy of it, as from another installation."""
    (tmp_path / "a.sport").write_bytes(whole.read_bytes())
    return tmp_path / "a.sport"


def change(path: Path, sql: str, *values: Any) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        assert connection.execute(sql, values).rowcount != 0
    reseal(path)


def value_of(path: Path, sql: str) -> Any:
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(sql).fetchone()[0]


def document(path: Path, edit: Callable[[Any], Any]) -> None:
    """Another text for the last step."""
    old = json.loads(value_of(path, "SELECT document FROM steps ORDER BY number DESC"))
    new = edit(old) or old
    text = new if isinstance(new, str) else json.dumps(new)
    change(path, "UPDATE steps SET document = ? WHERE number = (SELECT max(number) FROM steps)", text)


def blob(path: Path, reference: str, edit: Callable[[bytes], bytes]) -> str:
    """Another content under the key of a reference, and the reference with its length."""
    kind, _, key = reference.split(" ")
    with closing(sqlite3.connect(path)) as connection:
        (content,) = connection.execute("SELECT content FROM blobs WHERE key = ?", (key,)).fetchone()
    made = edit(zlib.decompress(content))
    change(path, "UPDATE blobs SET size = ?, content = ? WHERE key = ?", len(made), zlib.compress(made), key)
    return f"{kind} {len(made)} {key}"


def take(path: Path, edit: Callable[[Any], None]) -> None:
    """Another text for the first take."""

    def changed(document: Any) -> None:
        def text(content: bytes) -> bytes:
            value = json.loads(content)
            edit(value)
            return json.dumps(value).encode().ljust(len(content))  # other steps expect as many bytes

        document["takes"][0] = blob(path, document["takes"][0], text)

    document(path, changed)


def header(path: Path, edit: Callable[[Any], Any], of: str = "NOT LIKE") -> None:
    """Another header for the first motion, or `of` "LIKE" for the first input."""
    at = f"motions WHERE key {of} '%{INPUT}'"
    key, text = value_of(path, f"SELECT key || char(10) || header FROM {at}").split("\n", 1)
    old = json.loads(text)
    new = edit(old)
    new = old if new is None else new
    new = new if isinstance(new, str) else json.dumps(new)
    change(path, "UPDATE motions SET header = ? WHERE key = ?", new, key)


def setting(*keys: Any, to: Any) -> Callable[[Any], None]:
    """An edit that puts a value to a place in a JSON value."""

    def edit(value: Any) -> None:
        for key in keys[:-1]:
            value = value[key]
        value[keys[-1]] = to

    return edit


# --- documents that lie
CAMERA = {"seconds": 0.0, "yaw": 0.0, "pitch": 0.0, "distance": 4.0, "x": 0.0, "y": 0.0, "z": 0.0}
POINT = {"x": 0, "z": 0, "speed": 1, "gait": 1}
DOCUMENTS: dict[str, Callable[[Any], Any]] = {
    "no JSON": lambda _: "{",
    "no object": lambda _: [1],
    "deep": lambda _: DEEP,
    "a long number": lambda _: f'{{"takes": {HUGE}}}',
    "a field of another program": setting("other", to=1),
    "no takes": lambda d: d.pop("takes") and d,
    "takes that are none": setting("takes", to=5),
    "a take that is not there": setting("takes", to=["|u1 5 " + "0" * 32]),
    "a take that is no text": lambda d: setting("takes", to=[d["ground"][1]["heights"]])(d),
    "one take twice": lambda d: setting("takes", to=d["takes"] * 2)(d),
    "a million takes": lambda d: setting("takes", to=d["takes"][:1] * 300_000)(d),
    "a counter below zero": setting("counter", to=-1),
    "a ground of two numbers": setting("ground", to=["x", 5]),
    "a ground with NaN": setting("ground", 1, "cell_m", to=float("nan")),
    "a ground of no size": setting("ground", 1, "cell_m", to=0.0),
    "a ground of huge heights": setting("ground", 1, "heights", to="<f4 23170x23170 " + "0" * 32),
    "heights of another kind": lambda d: setting("ground", 1, "heights", to="|u1 9x7 " + "0" * 32)(d),
    "a reference that is none": setting("ground", 1, "heights", to="<f4 9x7"),
    "a character outside its folder": setting("character", "key", to="../../evil.glb"),
    "a character with a device": setting("character", "key", to="a/con\0.glb"),
    "a body of no shape": setting("character", "shape", "height", to=1e9),
    "a body with another share": setting("character", "shape", "wings", to=1.0),
    "a model with no seed": setting("model", "seed", to=None),
    "a film that is a list": setting("reference", "video", to=["a"]),
    "a film with a null in its name": setting("reference", "video", to="a\0b"),
    "ten variants": lambda d: setting("variants", to=d["variants"] * 6)(d),
    "a variant of no prompt": setting("variants", to=[[1, None, 0]]),
    "weights of a blend": setting("live", "prompt", "weights", to=[2.0] * 6),
    "an answer of nobody": setting("live", "prompt", "answers", 0, "source", to="oracle"),
    "an answer without words": setting("live", "prompt", "answers", 0, "words", to={}),
    "a long description": setting("live", "prompt", "answers", 0, "words", "head", to="x" * 10_000),
    "a style of another shape": setting("live", "prompt", "answers", 0, "z", to="<f4 1x1 " + "0" * 32),
    "a camera that is none": setting("live", "cameras", to=[[0, 0, 0]]),
    "cameras without end": setting("live", "cameras", to=[CAMERA] * 2000),
    "a path of no gait": setting("live", "path", to=[POINT | {"gait": 99}]),
    "a path without speed": setting("live", "path", to=[POINT | {"speed": 0}]),
    "a surrogate in a name": setting("live", "name", to="\ud800"),
    "a pin of nothing": setting("live", "poses", to={"pins": [{}], "footplants": []}),
    "pins without end": lambda d: setting("live", "poses", "pins", to=d["live"]["poses"]["pins"] * 5000)(d),
}
TAKES: dict[str, Callable[[Any], None]] = {
    "no motion": setting("motion", to=None),
    "a motion that is not there": setting("motion", to="../../x"),
    "a motion that is a number": setting("motion", to=5),
    "a trim of one number": setting("trim", to=[1]),
    "a trim backwards": setting("trim", to=[9, 3]),
    "a color below zero": setting("color", to=-3),
    "a plant of no foot": setting("poses", "footplants", to=[{"foot": 2, "old": None, "new": None}]),
    "a plant of no frames": setting("poses", "footplants", to=[{"foot": 0, "old": [9, 3], "new": None}]),
    "a skeleton of strings": setting("own", to=[["a"], "x", "y"]),
    "a skeleton of other bytes": setting("own", to=[[-1, 0], "<f4 3x3 " + "0" * 32, "|u1 7 " + "0" * 32]),
    "a name with a null": setting("name", to="a\0"),
    "six stars": setting("rating", to=6),
    "a note without end": setting("note", to="x" * 5000),
}
HEADERS: dict[str, Callable[[Any], Any]] = {
    "no JSON": lambda _: "}",
    "deep": lambda _: DEEP,
    "no header": lambda _: [],
    "2^40 frames": lambda h: h | {"frames": 1 << 40},
    "no rate": lambda h: h | {"fps": 0},
    "a giant": lambda h: h | {"size": 1e6},
    "a prompt that is none": lambda h: h | {"prompts": [{}] * 3 + [{"words": 5}]},
    "invalid words": lambda h: h | {"prompts": [{**h["prompts"][0], "words": "[1]"}]},
    "placed at infinity": lambda h: h | {"placed": [0, 0, float("inf"), 0]},
    "seconds of no gait": lambda h: h | {"gait_seconds": [["walk"]]},
}


def refused(path: Path) -> None:
    """That a file is refused with one sentence that names it, and stays as it is."""
    before = path.read_bytes()
    with bounded(), pytest.raises(FileError) as caught:
        SessionFile.open(path, path.parent / "cache")
    text = str(caught.value)
    assert path.name in text
    assert "\n" not in text
    assert len(text) < 1000
    assert caught.value.remedy
    text.encode()
    assert path.read_bytes() == before


def opened_without(path: Path, steps: int, frames: set[int]) -> None:
    """That a file opens without what lies: that many steps are there, and takes of that many frames."""
    with bounded():
        file, history = SessionFile.open(path, path.parent / "cache")
    takes = history.present.session.takes
    assert "cannot be read" in file.repaired or "have changed" in file.repaired
    assert len(history.steps) == steps + (file.recovered > 0)
    assert {len(take.made.clip) for take in takes} == frames
    assert file.flush(20.0)
    assert file.close()
    again, found = SessionFile.open(path, path.parent / "cache")  # once is enough
    assert again.recovered == 0
    assert {take.frames for take in found.present.session.takes} == frames
    again.close()


LIES = [
    *(pytest.param(document, edit, 2, id=f"a document: {case}") for case, edit in DOCUMENTS.items()),
    *(pytest.param(take, edit, 3, id=f"a take: {case}") for case, edit in TAKES.items()),
    *(pytest.param(header, edit, 3, id=f"a header: {case}") for case, edit in HEADERS.items()),
]


@pytest.mark.parametrize(("put", "edit", "steps"), LIES)
def test_a_session_opens_without_what_lies(
    put: Callable[[Path, Any], None], edit: Callable[[Any], Any], steps: int, path: Path
) -> None:
    """At the step before a document; of a take the motion stays, and a motion has another header."""
    put(path, edit)
    opened_without(path, steps, {20, 90})


def test_a_take_of_an_older_program_has_no_rating_and_no_note(path: Path) -> None:
    def older(value: Any) -> None:
        del value["rating"], value["note"]

    take(path, older)
    file, history = SessionFile.open(path, path.parent / "cache")
    first = history.present.session.takes[0]
    assert (first.title, first.rating, first.note) == ("my take ü", 0, "")
    file.close()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"damaged",
        zlib.compress(b"["),
        zlib.compress(b"{}1"),
        zlib.compress(b'[["keep_only", [[], []], {}]]'),
        zlib.compress(b'[["put_step", [{"bytes": 5}], {}]]'),
        zlib.compress(b'[["put_step", ["x", "y"], {"z": 1}]]'),
        zlib.compress(b'[["put_step", [[], {}, []], {}]]'),
        zlib.compress(b'[["set_meta", ["at", 5], {}]]'),
        packed_zeros(2 << 30),
    ],
)  # fmt: skip
def test_changes_that_lie_are_one_sentence(content: bytes, path: Path) -> None:
    path.with_name(f".{path.name}.unwritten").write_bytes(content)
    refused(path)
    path.with_name(f".{path.name}.unwritten").unlink()
    SessionFile.open(path, path.parent / "cache")[0].close()


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
@pytest.mark.parametrize("planted", ["a link", "writable for all", "of another user"])
@pytest.mark.parametrize("place", [0, 1])
def test_changes_of_somebody_else_are_left_alone(
    planted: str, place: int, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPORT_CONFIG_DIR", str(tmp_path / "state"))
    file, real = unwritten_files(path)[place], tmp_path / "real"
    file.parent.mkdir(parents=True, exist_ok=True)
    content = zlib.compress(b'[["drop_steps", [], {"first": 0}]]')
    if planted == "a link":
        real.write_bytes(content)
        file.symlink_to(real)
    else:
        file.write_bytes(content)
        file.chmod(0o666 if planted == "writable for all" else 0o600)
    if planted == "of another user":
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    opened, history = SessionFile.open(path, path.parent / "cache")
    assert len(history.steps) == 3
    opened.close()


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_what_is_handed_over_follows_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPORT_CONFIG_DIR", str(tmp_path / "state"))
    path, mine = tmp_path / "a.sport", tmp_path / "mine"
    mine.write_text("mine")
    beside, own = unwritten_files(path)
    own.parent.mkdir(parents=True)
    own.parent.chmod(0o777)  # anybody may write there
    for file in (beside, own):
        file.symlink_to(mine)
    assert keep(path, [("put_step", [5, "x", "{}"], {})], 5.0) == beside
    assert mine.read_text() == "mine"
    assert not beside.is_symlink()
    assert own.is_symlink()


def test_a_step_that_is_at_none_is_the_last_one(path: Path) -> None:
    for value in ("99", "-1", "x", "9" * 5000):
        change(path, "UPDATE meta SET value = ? WHERE name = 'at'", value)
        file, history = SessionFile.open(path, path.parent / "cache")
        assert history.at == len(history.steps) - 1
        file.close()


def test_a_view_that_is_none_is_ignored(path: Path) -> None:
    for value in (DEEP, "[1]", '{"yaw": NaN, "name": [], "x": 5, "camera": "\\ud800"}', HUGE):
        change(path, "INSERT OR REPLACE INTO meta VALUES ('view', ?, 0)", value)
        file, _ = SessionFile.open(path, path.parent / "cache")
        assert set(file.view) <= {"x"}
        file.close()


# --- bombs
def put_blob(path: Path, key: str, size: int, content: bytes) -> None:
    change(path, "INSERT OR REPLACE INTO blobs VALUES (?, ?, ?, 0)", key, size, content)


def bombs(path: Path) -> Iterator[None]:
    """Each of these would be gigabytes."""
    key, zeros = "0" * 32, packed_zeros(4096 * 4096 * 4)
    ground = {"name": "x", "cell_m": 1.0, "x": 0.0, "z": 0.0, "note": "", "unit_m": 1.0}

    def grounds(count: int) -> Callable[[Any], None]:
        def edit(value: Any) -> None:
            for k in range(count):
                put_blob(path, f"{k:032}", 1 << 26, zeros)
            value["live"]["ground"] = ["x", {**ground, "heights": f"<f4 4096x4096 {0:032}"}]
            value["ground"] = ["x", {**ground, "heights": f"<f4 4096x4096 {1:032}"}]

        return edit

    document(path, grounds(2))
    yield
    put_blob(path, key, 100, packed_zeros(1 << 28))
    document(path, setting("takes", to=[f"|u1 100 {key}"]))
    yield
    put_blob(path, key, 1 << 28, b"x")
    document(path, setting("takes", to=[f"|u1 {1 << 28} {key}"]))
    yield
    document(path, lambda _: "[" + "[]," * 4_000_000 + "0]")
    yield


@pytest.mark.parametrize("number", range(4))
def test_a_bomb_is_left_out_before_it_unfolds(number: int, path: Path) -> None:
    next(islice(bombs(path), number, None))
    opened_without(path, 2, {20, 90})


def test_a_motion_of_too_many_frames_is_refused_when_it_is_looked_at(path: Path) -> None:
    """The header alone is small: its frames are made when somebody plays them."""
    header(path, lambda h: h | {"frames": 1_999_999})
    file, history = SessionFile.open(path, path.parent / "cache")
    with bounded():
        for found in history.present.session.takes:
            if found.frames > 1000:
                with pytest.raises(FileError, match=r"a\.sport"):
                    _ = found.made.clip
    file.close()


def looked_at(path: Path) -> list[str]:
    """What is said when a file is opened, and every motion loaded with its input."""
    file, history = SessionFile.open(path, path.parent / "cache")
    said = [f"{path.name}: {file.repaired}"] if file.repaired else []
    for found in history.present.session.takes:
        for load in (lambda t=found: t.made.clip, lambda t=found: t.made.inputs):  # type: ignore[misc]
            try:
                load()
            except FileError as error:
                said.append(str(error))
    assert file.close()
    return said


PIECES: dict[str, str] = {
    "a piece is missing": "DELETE FROM frames WHERE number = 0",
    "other bytes": "UPDATE frames SET content = zeroblob(40)",
    "a count that is too small": "UPDATE frames SET count = 1",
    "a count that is too large": "UPDATE frames SET count = 1000000",
    "a size that lies": "UPDATE frames SET size = 536870912",
    "no size": "UPDATE frames SET size = 0",
    "a piece twice": "INSERT INTO frames SELECT motion, number + 1, count, size, content, checksum FROM frames",
    "the pieces of a tail": "INSERT INTO frames SELECT motion || '.tail', number, count, size, content, checksum FROM frames",
    "a piece of another motion": "UPDATE frames SET content = (SELECT content FROM frames ORDER BY count LIMIT 1)",
}


@pytest.mark.parametrize("case", PIECES)
def test_frames_that_lie_are_one_sentence_when_they_are_looked_at(case: str, path: Path) -> None:
    change(path, PIECES[case])
    said = looked_at(path)
    assert said
    assert all("a.sport: " in text and "\n" not in text for text in said)


INPUTS: dict[str, Callable[[Any], Any]] = {
    "no JSON": lambda _: "[",
    "deep": lambda _: DEEP,
    "no keyframes": setting("keyframes", to=[]),
    "a keyframe after the end": lambda v: setting(
        "keyframes", to=[*v["keyframes"], [5000, v["keyframes"][0][1]]]
    )(v),
    "keyframes backwards": lambda v: setting(
        "keyframes", to=[*v["keyframes"], [-1000, v["keyframes"][0][1]]]
    )(v),
    "a keyframe at 2^70": lambda v: setting("keyframes", 0, 0, to=1 << 70)(v),
    "a keyframe after the first frame": setting("keyframes", 0, 0, to=5),
    "a state that is none": lambda v: setting("keyframes", 0, 1, to=v["lead"])(v),
    "a lead of another length": setting("lead_frames", to=7),
    "a lead below zero": setting("lead_frames", to=-1),
    "a change of nothing": setting("changes", 0, 1, to={}),
    "a restart far away": setting("changes", to=[[0, {"restart": [1e300, 0, 0]}]]),
    "a style that is none": setting("changes", to=[[0, {"seconds": 1, "style": 5}]]),
    "changes without end": lambda v: setting("changes", to=v["changes"] * 5_000)(v),
}


@pytest.mark.parametrize("case", INPUTS)
def test_an_input_that_lies_is_one_sentence_and_its_take_still_plays(case: str, path: Path) -> None:
    header(path, INPUTS[case], "LIKE")
    with bounded():
        said = looked_at(path)
    assert len(said) == 1  # of the two takes of this motion the second has no input any more
    assert "a.sport: " in said[0]
    assert "\n" not in said[0]


def test_what_is_named_a_hundred_times_is_made_once(path: Path) -> None:
    header(path, lambda v: v | {"keyframes": v["keyframes"] * 100}, "LIKE")
    file, history = SessionFile.open(path, path.parent / "cache")
    inputs = history.present.session.takes[0].made.inputs
    assert len({id(key.snapshot) for key in inputs.keyframes}) == 1
    file.close()


def test_a_character_that_lies_is_one_sentence_and_nothing_is_written_outside(
    path: Path, tmp_path: Path
) -> None:
    name = value_of(path, "SELECT key FROM blobs WHERE key LIKE 'character %'")
    for files in (
        {"../../evil.glb": f"|u1 1 {'0' * 32}"},
        {"a.glb": f"|u1 1 {'0' * 32}", "/etc/x": f"|u1 1 {'0' * 32}"},
        {"a.txt": f"|u1 1 {'0' * 32}"},
        {"a.glb": "nothing"},
        ["a.glb"],
        5,
    ):
        content = json.dumps(files).encode()
        put_blob(path, name, len(content), zlib.compress(content))
        put_blob(path, "0" * 32, 1, zlib.compress(b"x"))
        file, history = SessionFile.open(path, tmp_path / "cache")
        with pytest.raises(SportError):
            file.character_path(history.present.session.character)
        file.close()
    assert not list(tmp_path.rglob("evil*"))
    assert not list((tmp_path / "cache").rglob("*.glb"))
