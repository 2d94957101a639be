"""What must not be read or written: one sentence each, and nothing that was recorded is lost.

As root nothing is denied, so that the processes run without that right.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from runtime.assets import PROJECT_ROOT, asset_path
from runtime.session.session import Session
from runtime.session.session_file import SessionFile
from tests.fuzz.networks import write_model
from tests.helpers.full_session import history_of, written

RIGHTS = "-dac_override,-dac_read_search,-fowner"
ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
DROPPED = ["setpriv", f"--bounding-set={RIGHTS}", f"--inh-caps={RIGHTS}"] if ROOT else []
NO_RIGHTS = os.name == "nt" or (ROOT and shutil.which("setpriv") is None)
pytestmark = pytest.mark.skipif(NO_RIGHTS, reason="rights of POSIX")
COMMANDS = """
import contextlib, io, json, sys
from sport import cli
answers = []
for words in json.load(sys.stdin):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            code = cli.main(words)
        except SystemExit as end:
            code = end.code
    answers.append([code, said.getvalue()])
print(json.dumps(answers))
"""
VIEW = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from tests.helpers.viewer_fakes import fake_services
from viewer.app import App
from viewer.options import ViewOptions
folder, named = Path(sys.argv[2]), sys.argv[3:]
options = ViewOptions(offscreen=True, terrain="flat", session=named[0] if named else None)
app = App(options, fake_services(), config=folder / "config")
for _ in range(3):
    app.frame()
app.takes.toggle_recording()
for _ in range(20):
    app.frame()
app.takes.toggle_recording()
app.frame()
app.interrupt()
code = app.end()
print("\\n".join(message.text for message in app.messages.recent))
app.close()
sys.exit(code)
"""


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    for path in [tmp_path, *tmp_path.rglob("*")]:
        path.chmod(0o700)


def process(*words: str, folder: Path, given: str = "") -> subprocess.CompletedProcess[str]:
    temporary = folder / "temporary"
    temporary.mkdir()
    environment = {**os.environ, "SPORT_CONFIG_DIR": str(folder / "config"), "TMPDIR": str(temporary)}
    environment["PYTHONPATH"] = str(PROJECT_ROOT)
    return subprocess.run(
        [*DROPPED, sys.executable, *words],
        input=given, capture_output=True, text=True, env=environment, check=False, timeout=600,
    )  # fmt: skip


def test_every_file_that_is_denied_is_named_in_one_sentence(place: Path) -> None:
    model, whole = place / "model", place / "whole"
    write_model(model)
    shutil.copytree(model, whole)
    folder = place / "folder"
    folder.mkdir()
    names = ("ground.png", "take.bvh", "words.json", "list.csv", "me.glb")
    files = [place / name for name in names]
    shutil.copy(asset_path("terrains/bowl.png"), files[0])
    for file in files[1:]:
        file.write_text("{}", encoding="utf-8")
    ground, take, words, rows, me = (str(file) for file in files)
    for path in [*files, *model.iterdir()]:
        path.chmod(0)
    folder.chmod(0o500)
    start = ["generate", "--prompt", "x", "--seconds", "0.1", "--model", str(whole)]
    out = ["--out", str(place / "out.bvh")]
    commands = [
        [*start[:-1], str(model), *out],
        [*start, *out, "--terrain", ground],
        [*start, "--out", str(folder / "out.bvh")],
        [*start, "--out", str(folder / "new" / "out.bvh")],
        [*start[:1], *start[3:], *out, "--parts", words],
        ["convert", take, "--out", str(place / "out.glb")],
        ["generate", "--batch", rows, "--out", str(place / "many")],
        [*start, "--out", str(place / "out.glb"), "--character", me],
    ]
    done = process("-c", COMMANDS, folder=place, given=json.dumps(commands))
    assert done.returncode == 0, done.stderr
    for command, (code, said) in zip(commands, json.loads(done.stdout), strict=True):
        assert code == 2, (command, said)
        assert said.startswith("sport: "), (command, said)
        assert said.count("\n") == 1, (command, said)
        assert "Traceback" not in said


def takes_of(path: Path) -> list[int]:
    file, history = SessionFile.open(path, path.parent)
    frames = [len(take.made.clip) for take in history.present.session.takes]
    file.close()
    return frames


def test_a_take_outlives_a_folder_that_nobody_may_write(place: Path) -> None:
    (place / "config").mkdir(mode=0o500)
    done = process("-c", VIEW, str(PROJECT_ROOT), str(place), folder=place)
    assert "Traceback" not in done.stderr, done.stderr
    (path,) = (place / "temporary").rglob("*.sport")
    assert str(path) in done.stdout
    assert "until you save it elsewhere" in done.stdout
    assert done.returncode == 1, done.stderr
    assert takes_of(path) == [20]


def test_a_session_in_a_folder_that_nobody_may_write_is_refused_and_the_take_is_kept(place: Path) -> None:
    (place / "mine").mkdir()
    named = written(place / "mine" / "a.sport", history_of(Session(counter=5)), place)
    before = named.read_bytes()
    (place / "mine").chmod(0o500)
    (place / "config").mkdir()
    recording, opening = "app.takes.toggle_recording()", "app.sessions.open(Path(named[0])); "
    text = VIEW.replace("session=named[0] if named else None", "").replace(recording, opening + recording, 1)
    done = process("-c", text, str(PROJECT_ROOT), str(place), str(named), folder=place)
    assert "Traceback" not in done.stderr, done.stderr
    assert "a.sport" in done.stdout
    assert done.returncode == 0, done.stderr
    (path,) = (place / "config" / "sessions").glob("*.sport")
    assert takes_of(path) == [20]
    assert named.read_bytes() == before
