"""The rivals' networks by their papers' equations, and one of them from clips to a folder that walks."""

import math

import numpy as np
import pytest
import torch

from runtime.assets import model_folder
from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.features import INPUT, INPUT_SIZE, OUTPUT, OUTPUT_SIZE
from runtime.motion.model import load_model
from runtime.terrain.height_map import Terrain
from tests.helpers.quick_export import export_quickly
from tests.helpers.synthetic_clips import save_motion
from tests.helpers.walker import walk
from training.baselines import networks as phases
from training.baselines.folders import Order
from training.baselines.networks import (
    FilmModulated,
    PhaseFunctioned,
    StyleByLabel,
    blended,
    catmull_rom,
    footstep_window,
)
from training.baselines.train import BaselineStepGraph
from training.evaluation.motion.evaluated_model import count_parameters
from training.presets import preset

pytestmark = pytest.mark.needs_torch


def test_pfnns_phase_function_is_a_cyclic_catmull_rom_spline():
    """Holden 2017, Eq. 7: through the control points, with half their neighbours' difference as slope, all round."""
    knots = torch.randn(4, 3, dtype=torch.float64)
    at = torch.arange(4, dtype=torch.float64) * (2 * math.pi / 4)
    torch.testing.assert_close(catmull_rom(knots, at), knots)
    torch.testing.assert_close(catmull_rom(knots, at + 2 * math.pi), knots)
    step = 1e-5
    slope = (catmull_rom(knots, at + step) - catmull_rom(knots, at - step)) / (2 * step) * (2 * math.pi / 4)
    torch.testing.assert_close(slope, 0.5 * (knots.roll(-1, 0) - knots.roll(1, 0)), atol=1e-4, rtol=1e-4)
    half = (-knots.roll(1, 0) + 9 * knots + 9 * knots.roll(-1, 0) - knots.roll(-2, 0)) / 16
    torch.testing.assert_close(catmull_rom(knots, at + math.pi / 4), half)


def test_blended_experts_are_the_layer_of_blended_weights():
    weights, biases, x = torch.randn(4, 5, 3), torch.randn(4, 5), torch.randn(2, 3)
    share = torch.softmax(torch.randn(2, 4), 1)
    expected = torch.einsum("bk,koi,bi->bo", share, weights, x) + share @ biases
    torch.testing.assert_close(blended(weights, biases, share, x), expected)


def test_film_scales_and_shifts_hidden_layers_by_style():
    network = FilmModulated(3, hidden=8, experts=2).eval()
    x, label = torch.randn(4, INPUT_SIZE), torch.eye(3)[[0, 1, 2, 0]]
    plain = network(x, label)
    torch.testing.assert_close(plain, network(x, torch.eye(3)[[1, 2, 0, 1]]))  # neutral at first
    network.film.data[1, 0, 1] = -1.0  # gamma = 0 on the second layer: only beta goes on
    network.film.data[1, 1, 1] = 0.5
    changed = network(x, label)
    torch.testing.assert_close(changed[[0, 2, 3]], plain[[0, 2, 3]])
    share = torch.softmax(network.gating(x[1:2, INPUT["phase"]]), 1)
    h = torch.full((1, 8), 0.5)
    torch.testing.assert_close(changed[1:2], blended(network.weights[2], network.biases[2], share, h))


def test_the_footstep_phase_turns_once_for_two_steps():
    """Holden 2017, Sec. 4.1: 0 where the right foot comes down, half a turn where the left one does, straight between."""
    contacts = walk(400)[2] > 0.5
    left, right = contacts[:, :2].any(1), contacts[:, 2:].any(1)
    turns = phases.footstep_phase(left, right)
    assert np.all(np.diff(turns) > 0)
    assert np.allclose(turns[phases.onsets(right)] % 1.0 % 1.0, 0.0, atol=1e-9)
    assert np.allclose(turns[phases.onsets(left)] % 1.0, 0.5, atol=1e-9)
    assert np.diff(turns).mean() == pytest.approx(1 / 64, rel=0.02)
    vectors = phases.phase_vectors(contacts)
    assert np.allclose(np.linalg.norm(vectors[:, phases.FOOTSTEP], axis=-1), 1.0)
    before, after = phases.windows(vectors)
    assert np.array_equal(before[100, 6], vectors[99])
    assert np.array_equal(after[100, 1], vectors[110])
    standing = phases.phase_vectors(np.ones((300, 4), bool))
    assert np.linalg.norm(standing[150, 0]) == pytest.approx(0.1)


def test_pfnn_moves_its_phase_on_by_what_it_predicts():
    window = footstep_window(torch.tensor([0.3]), torch.tensor([0.1])).reshape(7, 5, 2)
    for k, frames in enumerate((1, 11, 21)):
        angle = 0.3 + 0.1 * frames
        torch.testing.assert_close(window[k, 4], torch.tensor([math.sin(angle), math.cos(angle)]))
    assert not window[:, :4].any()
    network = PhaseFunctioned(1, hidden=8).eval()
    x = torch.randn(2, INPUT_SIZE)
    x[1, : INPUT["phase"].start] = x[0, : INPUT["phase"].start]
    first, second = network(x, torch.ones(2, 1))
    # another phase, other weights
    assert not torch.allclose(first[: OUTPUT["phase"].start], second[: OUTPUT["phase"].start])


def test_style_by_label_differs_by_label_alone():
    network = StyleByLabel(2, preset("small")).eval()
    x = torch.randn(1, INPUT_SIZE)
    a, b = (network(x, torch.eye(2)[k : k + 1]) for k in range(2))
    assert a.shape == (1, OUTPUT_SIZE)
    assert not torch.allclose(a, b)


def test_a_graph_takes_any_number_of_characters():
    """torch.export refuses a network that fixes the batch of its example."""
    graph = BaselineStepGraph(PhaseFunctioned(1, 16).eval())
    batch = torch.export.Dim("batch", min=1, max=64)
    example = (
        torch.zeros(2, INPUT_SIZE), torch.zeros(2, 1, 1, OUTPUT_SIZE), torch.ones(2, 1), torch.zeros(2, 1),
        torch.zeros(2, 1),
    )  # fmt: skip
    exported = torch.export.export(graph, example, dynamic_shapes=tuple({0: batch} for _ in example))
    assert exported.module()(*(e[:1] for e in example))[0].shape == (1, OUTPUT_SIZE)


def test_from_clips_to_a_folder_that_walks(tmp_path, monkeypatch):
    from training.baselines import train

    small = train.Method("mason2022", lambda styles: FilmModulated(styles, 32))
    monkeypatch.setitem(train.METHODS, "mason2022", small)
    monkeypatch.setattr(train, "MAX_LEARNING_RATE", 3e-3)
    monkeypatch.setattr(train, "BATCH", 64)
    export_quickly(monkeypatch)

    clips = tmp_path / "clips"
    clips.mkdir()
    for name, style in (("a", "neutral"), ("b", "old")):
        save_motion(clips, name, walk(240), style=style)
    out, shipped = tmp_path / "model", model_folder()
    order = Order("mason2022", clips, out, shipped, steps=40, seed=0)
    losses = []
    folder = train.make(order, losses.append)
    first, last = (float(losses[k].split(": ")[1]) for k in (1, -1))
    assert last < 0.8 * first
    model = load_model(folder)
    assert count_parameters(model.metadata) == model.metadata["parameters"] > 10_000
    controller = Controller(model, Terrain.flat())
    for _ in range(20):
        assert np.isfinite(controller.step(Controls((0.0, 1.0))).positions).all()
    assert controller.message == ""
