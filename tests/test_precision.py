"""The comparison of a minute in fp32 and int8: what differs is shown, what does not is not."""

import numpy as np
import pytest
from walker import WalkerModel

import training.evaluation.on_straight_walks as precision
from runtime.errors import UsageError
from runtime.motion.features import OUTPUT
from runtime.motion.model_files import INT8_GRAPH
from training.evaluation.experiment import run


class Stooping(WalkerModel):
    """Its hips are 10 cm lower."""

    def step(self, x, noise, style):
        y, phase = super().step(x, noise, style)
        y[:, OUTPUT["joint_positions"]][:, 1] -= 0.1
        return y, phase


@pytest.fixture
def models(monkeypatch):
    made = {"fp32": WalkerModel, "int8": Stooping}
    monkeypatch.setattr(precision, "load_model", lambda folder, precision: made[precision]())
    monkeypatch.setattr(precision, "Prompter", lambda model: lambda prompt: np.zeros((6, 64), np.float32))


def test_a_run_is_compared_with_the_first_and_with_another_seed(models, tmp_path):
    means = precision.compare(tmp_path, 6.0)
    assert list(means) == ["fp32", "int8", "fp32, other seed"]
    away = {name: run["hips from the first run's (cm)"] for name, run in means.items()}
    assert away["fp32"] == 0.0
    assert away["fp32, other seed"] == 0.0  # the walker hears no noise
    hips = {name: run["hips over the ground (cm)"] for name, run in means.items()}
    assert hips["fp32"] == hips["fp32, other seed"]
    assert hips["fp32"] - hips["int8"] == pytest.approx(10.0, abs=3.0)
    assert means["fp32"]["root speed (m/s)"] > 0.3
    lines = precision.precision_table(means).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert lines[-1].startswith("| hips from the first run's (cm) | 0.000 |")


def test_a_model_with_an_8_bit_graph_is_taken_as_it_is(monkeypatch, tmp_path):
    monkeypatch.setattr(precision, "read_metadata", lambda folder: {"sha256": {INT8_GRAPH: "0"}})
    assert precision.with_twin(tmp_path, tmp_path / "other") == tmp_path


@pytest.mark.parametrize("seconds", ["0", "nan", "4000"])
def test_lengths_that_make_no_sense_are_refused(seconds):
    with pytest.raises(UsageError, match="--seconds"):
        run(precision.PRECISION, ["--seconds", seconds], "precision")
