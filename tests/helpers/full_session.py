"""A session with one of everything, and its components."""

import sqlite3
import zlib
from contextlib import closing
from dataclasses import replace
from functools import cache, reduce
from pathlib import Path

import numpy as np

from runtime.character.shape import BodyShape
from runtime.character.writer import write_character
from runtime.controls import Controls, Gait
from runtime.motion.control_scripts import Waypoint
from runtime.motion.controller import Controller
from runtime.motion.snapshot import take_snapshot
from runtime.motion.style import StyleMix
from runtime.prompts.answer import Answer
from runtime.prompts.parts import PartDescriptions
from runtime.session import edits
from runtime.session.character_files import read_character_files, write_character_files
from runtime.session.document import DocumentWriter
from runtime.session.history import History
from runtime.session.motion import Motion
from runtime.session.prompt_blend import PromptBlend
from runtime.session.session import CharacterChoice, Ground, ModelName, Reference, Session, Take, Variant
from runtime.session.session_file import SessionFile
from runtime.session.tables import TABLES, checksum
from runtime.takes.camera_keys import CameraKey
from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit
from runtime.takes.input_recording import InputRecorder, InputRecording, StyleChange
from runtime.takes.metadata import Origin, PromptEvent, gait_of
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.takes.pins import Pin, Pinned
from runtime.takes.pose_edits import PoseEdits
from runtime.takes.pose_layer import JointValue, PoseKey, PoseLayer, Tangent
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from tests.helpers.gltf_characters import user_character
from tests.helpers.walker import WalkerModel

MISSING_FILM = "/nowhere/walk.mp4"


def answer(prompt: str, fill: float = 0.5, **values: object) -> Answer:
    """Return an answered prompt whose code is `fill` everywhere."""
    words = PartDescriptions(*(f"{prompt}, part {k}" for k in range(6)))
    return replace(Answer(prompt, words, words, np.full((6, 64), fill, np.float32)), **values)  # type: ignore[arg-type]


def controller() -> Controller:
    """Return a character of the synthetic walker."""
    return Controller(WalkerModel(), Terrain.flat(), seed=7)


@cache
def driven_take(frames: int = 90) -> tuple[Clip, InputRecording]:
    """Return a walk with styles, a terrain, a restart and two gaits, and its inputs from before the first frame."""
    walker, clips, recorder = controller(), ClipRecorder(), InputRecorder()
    ground = Terrain("dunes", np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4), 20.0, (-30.0, -30.0))
    walker.set_terrain(ground)
    recorder.mark_ground("dunes.png", ground)
    blend = PromptBlend((answer("a proud king"), answer("drunk", 0.25)), (0.5,) * 6, frozenset({"head"}))
    mixed = StyleMix((0.4, 0.6), (np.ones((6, 64), np.float32),) * 2)
    for z, note in ((answer("a king").z, None), (mixed, blend)):
        walker.set_style(z, 0.2)
        recorder.mark_style(StyleChange(0, z, 0.2, PromptEvent(0.0, "style", 0.2, "", "typed"), note))
        clips.mark_prompt("style", 0.2, typed="typed")
        for number in range(frames // 2 + 10):
            controls = Controls((0.2, 1.0), None, Gait.JOG if number > 20 else Gait.WALK)
            recorder.before_steps(walker)
            clips.add(walker.step(controls), gait_of(controls))
            recorder.add(controls, walker)
        walker.reset(1.0, 0.0, 0.5)
        walker.step(Controls())
        recorder.mark_restart(1.0, 0.0, 0.5)
    clip = clips.last(frames / 60, "Take 1", "dunes.png", Origin("walker", "ab" * 32, "fp32", 7, 0.7, 1.0))
    inputs = recorder.cut(clips.next_frame - len(clip))
    assert inputs is not None
    return clip, inputs


def still(frames: int, name: str = "still", seed: int = 0, fps: float = 60.0) -> Clip:
    """Return a clip without inputs: frames that jitter about a pose."""
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(0.0, 0.01, (frames, 31, 4)), axis=0) + np.array([1.0, 0.0, 0.0, 0.0])
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    hips = np.cumsum(rng.normal(0.0, 0.01, (frames, 3)), axis=0) + np.array([0.0, 1.0, 0.0])
    contacts = rng.integers(0, 2, (frames, 4))
    return Clip(name, fps, *(part.astype(np.float32) for part in (hips, turns, contacts)))


def full_session(cache: Path, source: Path) -> Session:
    """Return a session with one of everything; character files are in `cache`, their originals in `source`."""
    write_character(source / "me.glb", user_character())
    kept = write_character_files(read_character_files(source / "me.glb"), cache)
    kept_path = kept.relative_to(cache).as_posix()
    own_body = CharacterChoice(BodyShape(height=1.1), str(source / "me.glb"), kept_path)
    heights = np.random.default_rng(2).random((9, 7)).astype(np.float32)
    ground = Ground.of("hills.png", Terrain("hills", heights, 0.5, (-1.0, -1.5), "a note", 1.0))
    points = np.random.default_rng(3).random((20, 4, 3)).astype(np.float32)
    pins = (
        Pin(Pinned.LEFT_HAND, (0.25, 1.0, 0.5), 0.5, 1.0, rail=(1.0, 1.0, 1.0)),
        Pin(Pinned.LOOK, (0.0, 1.5, 5.0), 0.0, 0.25, along=True),
        Pin(Pinned.POSE, start=0.25, end=0.5, of=0.75),
    )
    poses = PoseEdits(
        pins,
        (
            FootplantEdit(0, (3, 9), (3, 12)),
            FootplantEdit(1, None, (20, 25)),
            FootplantEdit(1, (40, 44), None),
        ),
        PoseLayer(
            (
                PoseKey(0.25, (JointValue(16, 0.0, 0.5, 0.0),), (JointValue(0, 0.0, -0.25, 0.0),)),
                PoseKey(0.5, (JointValue(16, 0.25, 0.0, 0.0),), tangent=Tangent.LINEAR),
            ),
            keeps=True,
        ),
    )
    path = (Waypoint(0.0, 0.0), Waypoint(1.0, 2.5, 0.5, Gait.JOG))
    king = answer("a king", source="gpt", nearest=(("queen", 0.5),), note="n")
    blend = PromptBlend((king, answer("drunk")), (0.0, 0.25, 0.5, 1.0, 0.5, 0.5), frozenset({"torso"}))
    cameras = (CameraKey(0.0, 0.5, 0.25, 4.0), CameraKey(1.0, 1.5, 0.25, 3.0, 0.5, 0.0, 0.25))
    clip, inputs = driven_take()
    takes = [
        Take(motion=Motion.of(clip, inputs), name="my take ü", rating=4, note="for the queen", trim=(3, 70), poses=poses, cameras=cameras, path=path,
             color=3, ground=ground),
        Take(motion=Motion.of(replace(still(20, "of a file"), placed=None, size=0.5)), recorded=False,
             own=OwnSkeleton((-1, 0, 1, 1), points)),
    ]  # fmt: skip
    session = reduce(edits.with_new_take, takes, Session())
    session = edits.mirrored_copy(session, 1)
    return replace(
        session,
        live=Take(poses=PoseEdits(pins[:1]), path=path, cameras=cameras[:1], prompt=blend),
        ground=ground,
        character=own_body,
        model=ModelName("models/full", "full", "ab" * 32, 5),
        reference=Reference(video=MISSING_FILM, character=own_body, offset_s=0.25, over=True),
        variants=(Variant(1, blend), Variant(2, PromptBlend((answer("an old man"), None)), 4)),
    )


def text_of(session: Session) -> str:
    """Return a session as text, with the contents that it references."""
    contents: dict[str, bytes] = {}
    text = DocumentWriter(lambda key, content: contents.update({key: content})).session(session)
    return "\n".join([text, *(f"{key} {contents[key]!r}" for key in sorted(contents))])


def history_of(*sessions: Session) -> History:
    """Return a history with these sessions as steps, after an empty first one."""
    history = History()
    for number, session in enumerate(sessions):
        history.push(f"edit {number}", session)
    return history


def written(path: Path, history: History, cache: Path) -> Path:
    """Write a history to a file and close it."""
    file = SessionFile.create(path, cache)
    file.write(history)
    assert file.close(), file.problem
    return path


def reseal(path: Path) -> None:
    """Update the checksums of rows changed by another program, as an attacker would."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA ignore_check_constraints = ON")
        connection.execute("BEGIN")
        for table in TABLES:
            for number, *row in connection.execute(f"SELECT rowid, * FROM {table}").fetchall():
                if all(type(value) in (int, str, bytes) for value in row[:-1]):
                    fits = checksum(table, row[:-1])
                    connection.execute(f"UPDATE {table} SET checksum = ? WHERE rowid = ?", (fits, number))
        connection.execute("COMMIT")


def snapshot_bytes() -> bytes:
    """Return the state of a character after a short walk."""
    walker = controller()
    for _ in range(5):
        walker.step(Controls((0.0, 1.0)))
    return take_snapshot(walker).to_bytes()


def packed_zeros(size: int) -> bytes:
    """Return `zlib.compress(bytes(size))` for multiples of 4 MiB, compressing a single piece."""
    packer = zlib.compressobj(wbits=-15)
    piece = packer.compress(bytes(1 << 22)) + packer.flush(zlib.Z_FULL_FLUSH)
    checksum = size % 65521 << 16 | 1
    return b"\x78\x9c" + piece * (size >> 22) + packer.flush() + checksum.to_bytes(4, "big")
