"""A packed run gives its weights and its history back, which reaches the card; stage 2 can begin with them."""

import json
import shutil

import pytest
import torch

from runtime.assets import asset_path
from runtime.errors import FileError, UsageError
from tests.helpers.tiny_model import tiny_trained
from training.export.graph import store_model_in_half
from training.export.model_card import model_card
from training.networks.generator import Generator
from training.packed_run import BEFORE, START, History, pack, unpack
from training.presets import preset
from training.session import load_checkpoint, save_checkpoint

pytestmark = pytest.mark.needs_torch


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run"
    torch.manual_seed(1)
    generator = Generator(preset("tiny"))
    save_checkpoint(folder / "stage3_final.pt", {"module": generator.state_dict()})
    content = {"module": {"w": torch.randn(3)}, "config": {"name": "tiny"}}
    save_checkpoint(folder / "content_final.pt", content)
    save_checkpoint(folder / "phase_final.pt", {"module": {"w": torch.randn(3)}})
    save_checkpoint(folder / "scales.pt", {"x_mean": torch.tensor([1e-7, 3.14159274])})
    (folder / "logs").mkdir()
    (folder / "logs" / "stage2.txt").write_text("step 900 of 1000, losses rec 0.06\n")
    return folder


def test_weights_come_back_in_half_precision_and_scales_exactly(run, tmp_path) -> None:
    pack(run, tmp_path / "packed.pt")
    unpack(tmp_path / "packed.pt", tmp_path / "new")
    before = load_checkpoint(run / "stage3_final.pt")["module"]
    after = load_checkpoint(tmp_path / "new" / START)["module"]
    assert before.keys() == after.keys()
    for name, value in before.items():
        assert after[name].dtype == value.dtype
        assert torch.allclose(after[name], value, atol=1e-3, rtol=1e-3)
    Generator(preset("tiny")).load_state_dict(after)
    means = [load_checkpoint(place / "scales.pt")["x_mean"] for place in (tmp_path / "new", run)]
    assert torch.equal(*means)
    assert load_checkpoint(tmp_path / "new" / "content_final.pt")["config"] == {"name": "tiny"}
    assert History.of_run(tmp_path / "new").steps == {"stage2": [900]}


def test_what_the_graphs_hold_is_read_from_them(run, exported_tiny, tmp_path) -> None:
    """The exporter's matrices, some with their axes in another order, are not written twice."""
    trained = tiny_trained()
    save_checkpoint(run / "stage3_final.pt", {"module": trained.generator.state_dict()})
    save_checkpoint(run / "content_final.pt", {"module": trained.content.state_dict()})
    model = tmp_path / "model"
    shutil.copytree(exported_tiny, model)
    store_model_in_half(model)
    sizes = {}
    for name, folder in (("whole", None), ("shared", model)):
        file = tmp_path / f"{name}.pt"
        pack(run, file, folder)
        unpack(file, tmp_path / name, folder)
        sizes[name] = file.stat().st_size
    assert sizes["shared"] < 0.7 * sizes["whole"]
    for file in (START, "content_final.pt"):
        whole, shared = (load_checkpoint(tmp_path / name / file)["module"] for name in sizes)
        assert whole.keys() == shared.keys()
        assert all(torch.equal(whole[name], shared[name]) for name in whole)
    with pytest.raises(FileError, match=r"not the graph .* --model"):
        unpack(tmp_path / "shared.pt", tmp_path / "other", exported_tiny)


def test_a_run_that_lacks_a_stage_is_named(run, tmp_path) -> None:
    (run / "content_final.pt").unlink()
    with pytest.raises(FileError, match=r"content_final\.pt"):
        pack(run, tmp_path / "packed.pt")


def test_a_run_is_never_overwritten(run, tmp_path) -> None:
    pack(run, tmp_path / "packed.pt")
    with pytest.raises(UsageError, match="empty folder"):
        unpack(tmp_path / "packed.pt", run)


# --- history
def test_a_run_from_nothing_knows_its_own_steps(run) -> None:
    history = History.of_run(run)
    assert history.steps == {"stage2": [900]}
    assert history.losses == {"stage2": "step 900 of 1000, losses rec 0.06"}


def test_a_run_that_goes_on_adds_its_steps_and_keeps_the_others(run) -> None:
    History({"phase": [5], "stage2": [7000, 20]}, {"phase": "step 5 of 5"}).write(run)
    history = History.of_run(run)
    assert history.steps == {"phase": [5], "stage2": [7000, 20, 900]}
    assert history.losses["phase"] == "step 5 of 5"


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
