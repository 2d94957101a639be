"""Measured figures travel with a model: in its metadata and in its card."""

import json

import pytest

from runtime.assets import asset_path
from runtime.errors import FileError
from training.export.model_card import main, model_card

RECALL = {"text_to_motion": {"r1": 0.74}, "motion_to_text": {"r1": 0.86}}
TEXT = {"retrieval": RECALL}


@pytest.fixture
def model(tmp_path):
    folder = tmp_path / "model"
    folder.mkdir()
    metadata = json.loads(asset_path("models/compact/metadata.json").read_text("utf-8"))
    metadata["curves"] = {"phase": "step 3 of 3, losses total 0.5"}
    metadata.pop("metrics", None)
    (folder / "metadata.json").write_text(json.dumps(metadata))
    return folder


def test_a_card_without_measurements_says_so(model) -> None:
    metadata = json.loads((model / "metadata.json").read_text())
    card = model_card(metadata, metadata["curves"])
    assert "Not measured yet." in card
    assert "step 3 of 3" in card


def test_figures_reach_metadata_and_card(model, tmp_path) -> None:
    text = tmp_path / "text.json"
    text.write_text(json.dumps(TEXT))
    main([str(model), "--text", str(text)])
    card = (model / "README.md").read_text()
    assert "- text→motion R@1 on held-out captured clips: at least 60 %: 74 %" in card
    assert len(json.loads((model / "metadata.json").read_text())["metrics"]) == 2


def test_a_damaged_measurement_is_named(model, tmp_path) -> None:
    broken = tmp_path / "text.json"
    broken.write_text("{")
    with pytest.raises(FileError, match=r"text\.json"):
        main([str(model), "--text", str(broken)])


def test_a_card_tells_of_its_8_bit_graph(model) -> None:
    metadata = json.loads((model / "metadata.json").read_text())
    assert "8-bit" not in model_card(metadata | {"quantised": {}}, {})
    kept = metadata["quantised"] | {"kept": ["linear_3"]}
    assert "8-bit weights, but for linear_3;" in model_card(metadata | {"quantised": kept}, {})
    quantised = {
        "default": "int8",
        "relative_error": 0.0086,
        "joint_error_mm": 0.81,
        "joint_error_max_mm": 5.4,
    }
    card = model_card(metadata | {"quantised": quantised | {"frames": 480}}, {})
    assert "int8 is loaded unless" in card
    assert "480 frames of its own walks it is 0.86% from" in card
