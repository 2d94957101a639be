"""What a model's weights have been through is noted by the run, travels in the checkpoint, and reaches the card."""

import json

import pytest

pytest.importorskip("torch")

from runtime.assets import asset_path
from runtime.errors import FileError
from training.export.model_card import model_card
from training.packed_run import BEFORE, History


@pytest.fixture
def run(tmp_path):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "stage2.txt").write_text("step 900 of 1000, losses rec 0.06\n")
    return tmp_path


def test_a_run_from_nothing_knows_its_own_steps(run) -> None:
    history = History.of_run(run)
    assert history.steps == {"stage2": [900]}
    assert history.losses == {"stage2": "step 900 of 1000, losses rec 0.06"}


def test_a_run_that_goes_on_adds_its_steps_and_keeps_the_others(run) -> None:
    History({"phase": [5], "stage2": [7000, 20]}, {"phase": "step 5 of 5"}).write(run)
    history = History.of_run(run)
    assert history.steps == {"phase": [5], "stage2": [7000, 20, 900]}
    assert history.losses["phase"] == "step 5 of 5"


def test_a_checkpoint_carries_it_into_the_next_run(run, tmp_path) -> None:
    from training.packed_run import pack, unpack
    from training.session import save_checkpoint

    for name in ("phase_final.pt", "content_final.pt", "scales.pt", "stage3_final.pt"):
        save_checkpoint(run / name, {"module": {}})
    pack(run, tmp_path / "packed.pt")
    unpack(tmp_path / "packed.pt", tmp_path / "next")
    assert History.of_run(tmp_path / "next").steps == {"stage2": [900]}


@pytest.mark.parametrize("text", ["{", "[]", '{"steps": {"stage2": 5}, "losses": {}}'])
def test_a_damaged_history_is_named(run, text) -> None:
    (run / BEFORE).write_text(text)
    with pytest.raises(FileError, match=BEFORE):
        History.of_run(run)


def test_a_log_without_steps_is_named(run) -> None:
    (run / "logs" / "stage2.txt").write_text("nothing")
    with pytest.raises(FileError, match=r"stage2\.txt"):
        History.of_run(run)


@pytest.fixture
def metadata() -> dict:
    return json.loads(asset_path("models/compact/metadata.json").read_text("utf-8"))


def test_the_card_adds_up_the_models_that_went_on(metadata) -> None:
    metadata["notes"]["steps"] = {"phase": [5], "stage2": [7000, 20]}
    card = model_card(metadata, {"phase": "step 3 of 3, losses total 0.5"})
    assert "phase 5, stage2 7000 + 20." in card
    assert "step 3 of 3" in card
    assert "went on from the weights of the one before" in card
    metadata["notes"]["steps"] = {"phase": [5]}
    assert "went on" not in model_card(metadata, {})


def test_a_card_tells_of_its_8_bit_graph(metadata) -> None:
    assert "8-bit" not in model_card(metadata | {"quantised": {}}, {})
    kept = metadata["quantised"] | {"kept": ["linear_3"], "relative_error": 0.0086, "frames": 480}
    card = model_card(metadata | {"quantised": kept}, {})
    assert "8-bit weights, but for linear_3;" in card
    assert "480 frames of its own walks it is 0.86% from" in card
