"""The models in the package: found by name, each one walks, and its card says what may be done with it."""

import json
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import DEFAULT_MODEL, asset_path, model_folder, model_name, shipped_models
from runtime.controls import Controls
from runtime.errors import FileError, ModelError
from runtime.motion.controller import Controller
from runtime.motion.model import load_model
from runtime.terrain.height_map import Terrain

BOUND = ("Bandai", "Holden")


def test_names_and_folders() -> None:
    default = asset_path("models") / DEFAULT_MODEL
    assert next(iter(shipped_models())) == DEFAULT_MODEL
    assert model_folder() == model_folder(DEFAULT_MODEL) == model_folder(Path(DEFAULT_MODEL)) == default
    assert model_folder(f"./{DEFAULT_MODEL}") == Path(DEFAULT_MODEL)  # a folder here, not the shipped one
    assert model_folder("some/where") == Path("some/where")
    names = [model_name(path) for path in (None, default, Path("x"))]
    assert names == [DEFAULT_MODEL, DEFAULT_MODEL, ""]
    with pytest.raises(FileError, match=r"nowhere: no model of this name is shipped.*Shipped: compact"):
        load_model("nowhere")
    with pytest.raises(ModelError, match=r"nowhere.metadata\.json"):
        load_model("./nowhere")


@pytest.mark.parametrize("name", shipped_models())
def test_every_shipped_model_walks(name: str) -> None:
    controller = Controller(load_model(name), Terrain.flat(), seed=1)
    for _ in range(90):
        pose = controller.step(Controls(move=(0.0, 1.0)))
    assert controller.model.name == name
    assert np.linalg.norm(pose.root_position[[0, 2]]) > 1.0


@pytest.mark.parametrize("name", shipped_models())
def test_a_card_says_what_may_be_done(name: str) -> None:
    metadata = json.loads((shipped_models()[name] / "metadata.json").read_text("utf-8"))
    bound = any(word in credit for credit in metadata["credits"] for word in BOUND)
    assert metadata["notes"]["licence"].startswith("non-commercial" if bound else "CC BY 4.0")
    card = (shipped_models()[name] / "README.md").read_text("utf-8")
    assert metadata["notes"]["licence"][1:] in card
    assert all(credit in card for credit in metadata["credits"])
