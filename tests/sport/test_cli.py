"""The `sport` command: help, exit codes, and one sentence for every mistake."""

import subprocess
import sys
import types
from importlib.metadata import version

import pytest

from runtime.assets import PROJECT_ROOT
from runtime.formats.bvh import read_bvh
from runtime.formats.bvh_clip import load_clip_bvh
from sport import cli


@pytest.fixture
def viewed(monkeypatch):
    """Options that reach the viewer, in place of a window."""
    seen = []
    app = types.ModuleType("viewer.app")
    app.run = lambda options: seen.append(options) or 0
    monkeypatch.setitem(sys.modules, "viewer.app", app)
    return seen


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    for word in ("view", "generate", "bench", "train", "examples", "--offscreen", "--out"):
        assert word in text


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"sport {version('sport-viewer')}\n"


@pytest.mark.parametrize(
    "option",
    [("--session", "none.sport"), ("--clip", "none.bvh"), ("--character", "none.glb"), ("--joint-map", "none.json"),
     ("--terrain", "none.png"), ("--terrain", "nothing"), ("--model", "nothing")],
)  # fmt: skip
def test_files_that_are_not_there_are_refused_before_anything_is_loaded(viewed, option, capsys):
    assert cli.main(["view", *option]) == 2
    error = capsys.readouterr().err
    assert option[1] in error
    assert error.count("\n") == 1
    assert viewed == []


@pytest.mark.parametrize("seconds", ["inf", "nan", "-3", "1e9", "0"])
def test_impossible_lengths_are_named(seconds, tmp_path, capsys):
    assert cli.main(["generate", "--seconds", seconds, "--out", str(tmp_path / "a.bvh")]) == 2
    said = f"sport: --seconds {float(seconds):g}: expected 0.017 (one frame) to 3600. Try 10.\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [("a.glb", ("--range", "30:"), "--range 30: the clip lasts 30.0 s."),
     ("a.glb", ("--range", "1.6:", "--controls", "walk 1.5"), "--range 1.6: the clip lasts 1.5 s."),
     ("a.gif", ("--fps", "60"), "1800 frames; .gif takes 1200 at most."),
     ("a.webp", ("--fps", "60", "--range", ":25"), "1501 frames; .webp takes 1200 at most.")],
)  # fmt: skip
def test_a_range_or_film_that_does_not_fit_is_refused_before_anything_walks(
    name, options, expected, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("runtime.generate.generate_clip", lambda **_: pytest.fail("walked"))
    length = () if "--controls" in options else ("--seconds", "30")
    assert cli.main(["generate", *length, *options, "--out", str(tmp_path / "new" / name)]) == 2
    assert expected in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_plain_sport_opens_the_viewer(viewed):
    assert cli.main([]) == 0
    assert viewed[0].offscreen is False
    assert viewed[0].terrain is None


def test_view_options_arrive(viewed, tmp_path):
    shot = tmp_path / "shot.png"
    cli.main(["view", "--offscreen", "--frames", "9", "--screenshot", str(shot), "--size", "640x360",
                "--terrain", "stairs", "--prompt", "proud", "--seed", "4", "--no-panels"])  # fmt: skip
    options = viewed[0]
    assert (options.offscreen, options.frames, options.screenshot) == (True, 9, shot)
    assert (options.width, options.height, options.terrain, options.prompt) == (640, 360, "stairs", "proud")
    assert (options.seed, options.panels) == (4, False)


@pytest.mark.parametrize("options", [["--screenshot"], ["--offscreen", "--save-frames"]])
def test_pictures_that_cannot_be_written_are_told_before_anything_runs(viewed, options, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert cli.main(["view", *options, str(tmp_path / "file" / "out.png")]) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / "file") in error
    assert error.count("\n") == 1
    assert viewed == []


def test_generate_writes_a_clip_that_is_the_same_each_time(walker, tmp_path, capsys):
    arguments = ["generate", "--prompt", "proud", "--path", "circle", "--seconds", "0.5", "--seed", "3"]
    one, two = tmp_path / "one.bvh", tmp_path / "two.bvh"
    assert cli.main([*arguments, "--out", str(one)]) == 0
    assert cli.main([*arguments, "--out", str(two)]) == 0
    assert one.read_bytes() == two.read_bytes()
    assert "30 frames" in capsys.readouterr().out
    assert len(load_clip_bvh(one)) == 30
    assert cli.main([*arguments, "--fps", "30", "--unit", "m", "--out", str(two)]) == 0
    motion = read_bvh(two)
    assert (round(motion.fps), len(motion.positions)) == (30, 15)
    assert 0.5 < motion.positions[0, 0, 1] < 1.5


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["generate", "--gait", "fly", "--out", "OUT"], "--gait"),
        (["generate", "--path", "up", "--out", "OUT"], "--path"),
        (["generate", "--seconds", "-1", "--out", "OUT"], "--seconds"),
        (["generate", "--seconds", "nan", "--out", "OUT"], "--seconds"),
        (["generate", "--seed", "-1", "--out", "OUT"], "--seed"),
        (["generate", "--fps", "0", "--out", "OUT"], "frames per second"),
        (["generate", "--unit", "inch", "--out", "OUT"], "inch"),
        (["view", "--size", "big"], "--size big"),
        (["view", "--frames", "0"], "--frames 0"),
        (["bench", "--frames", "1"], "--frames 1"),
    ],
)
def test_mistakes_are_one_sentence_and_exit_code_2(walker, viewed, arguments, expected, tmp_path, capsys):
    out = tmp_path / "out.bvh"
    assert cli.main([str(out) if a == "OUT" else a for a in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("sport: ")
    assert expected in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_unknown_commands_and_missing_options_exit_with_2(capsys):
    for arguments in (["dance"], ["generate"]):
        with pytest.raises(SystemExit) as end:
            cli.main(arguments)
        assert end.value.code == 2
    assert "--out" in capsys.readouterr().err


def test_training_without_torch_says_what_to_install():
    code = (
        "import sys\nsys.modules['torch'] = None  # as if it were not installed\n"
        "from sport.cli import main\nsys.exit(main(['train', 'all', '--out', 'x']))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "'torch'" in done.stderr
    assert "[train]" in done.stderr


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom sport import cli\n"
        "try:\n    cli.main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('numpy', 'onnxruntime', 'torch', 'imgui_bundle', 'trimesh', 'PIL') if m in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")


def test_a_folder_whose_name_is_too_long_is_one_sentence(walker, tmp_path, capsys):
    out = tmp_path / ("long" * 100) / "walk.bvh"
    assert cli.main(["generate", "--prompt", "a walk", "--seconds", "0.1", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "walk.bvh" in said
    assert "new" not in said
