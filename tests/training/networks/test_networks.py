"""The networks against the paper: Table I's parameter counts, blending identities, masks, exported graphs."""

import json
from dataclasses import replace

import numpy as np
import onnxruntime
import pytest
import torch

from runtime.motion.features import INPUT_SIZE, OUTPUT_SIZE
from runtime.motion.model_files import FOLDED
from runtime.skeleton import PART_JOINTS, PART_NAMES, SPORT_SKELETON
from training.batches import Normalisation
from training.export.graph import export_graph
from training.export.model import MixtureStepGraph, StyleGraph
from training.export.step import export_step
from training.networks.content import ContentEncoder, StatisticsReader, pose_statistics
from training.networks.generator import Generator, MotionEncoder
from training.networks.modulator import instance_norm
from training.networks.phase import two_hop_neighbours
from training.presets import ablation, preset

pytestmark = pytest.mark.needs_torch


def _millions(config, without_diffusion=False) -> float:
    with torch.device("meta"):
        generator = Generator(config)
    modules = [generator.encoder, generator.modulator, generator.mixture_decoder]
    if not without_diffusion:
        modules.append(generator.denoiser)
    return sum(p.numel() for m in modules for p in m.parameters()) / 1e6


def test_paper_preset_has_the_parameter_counts_of_table_1():
    paper = preset("paper")
    assert _millions(paper) == pytest.approx(55.46, rel=0.01)
    assert _millions(replace(paper, experts=4)) == pytest.approx(31.49, rel=0.01)
    assert _millions(replace(paper, content_experts=4)) == pytest.approx(47.05, rel=0.01)
    assert _millions(paper, without_diffusion=True) == pytest.approx(47.98, rel=0.01)
    assert _millions(replace(paper, style_size=6 * 512)) == pytest.approx(66.64, rel=0.01)


def test_motion_embedding_is_the_blend_of_separate_experts():
    """W = Σ_k alpha_k W_k (Sec. III-B), written out expert by expert."""
    torch.manual_seed(0)
    encoder = MotionEncoder(preset("tiny")).eval()
    x = torch.randn(3, 472)
    w, alpha = encoder(x)
    assert torch.allclose(alpha.sum(-1), torch.ones(3))
    expected = torch.zeros_like(w)
    for k in range(alpha.shape[1]):
        hidden = torch.nn.functional.elu(x[:, :342] @ encoder.first.weight[k] + encoder.first.bias[k])
        expected += alpha[:, k, None] * (hidden @ encoder.second.weight[k] + encoder.second.bias[k])
    assert torch.allclose(w, expected, atol=1e-5)


def test_modulator_is_the_recursive_mixture_of_adain_written_out():
    """E = Σ_k alpha_k AdaIN(W; Σ_j beta_j s_j^k) (Sec. III-D), expert by expert."""
    torch.manual_seed(1)
    config = preset("tiny")
    modulator = Generator(config).modulator
    w, z = torch.randn(2, config.embedding), torch.randn(2, 384)
    alpha = torch.softmax(torch.randn(2, 8), -1)
    beta = modulator.gating(z)
    fused = modulator.features(w, z)
    expected = torch.zeros_like(w)
    for k in range(8):
        weight, bias = modulator.content_weight[k], modulator.content_bias[k]
        s = sum(beta[:, j, None] * (fused[:, k] @ weight[j] + bias[j]) for j in range(8))
        deviation, mean = s.chunk(2, -1)
        expected += alpha[:, k, None] * ((1 + deviation) * instance_norm(w) + mean)
    assert torch.allclose(modulator(w, z, alpha), expected, atol=1e-5)


def test_two_hop_neighbourhoods_stay_in_the_part_or_on_the_spine():
    mask = two_hop_neighbours().bool()
    # Fig. 3 draws the other hip as a neighbour of a hip; in this skeleton it is four hops away
    left, right = (SPORT_SKELETON.index(n) for n in ("LeftUpLeg", "RightUpLeg"))
    up = {j: SPORT_SKELETON.parents[j] for j in (left, right)}
    assert up[left] != up[right]
    parents = SPORT_SKELETON.parents
    assert parents[up[left]] == parents[up[right]] == SPORT_SKELETON.index("Hips")
    assert not mask[left, right]
    knee, other_knee = SPORT_SKELETON.index("LeftLeg"), SPORT_SKELETON.index("RightLeg")
    assert mask[knee, SPORT_SKELETON.index("LeftFoot")]
    assert not mask[:, other_knee][list(PART_JOINTS["left_leg"])].any()
    assert mask[SPORT_SKELETON.index("LHipJoint"), SPORT_SKELETON.index("Hips")]


def test_text_parts_never_mix():
    torch.manual_seed(5)
    content = ContentEncoder(preset("tiny")).eval()
    text = torch.randn(1, 6, preset("tiny").sentence_size)
    changed = text.clone()
    changed[:, 2] += 1.0
    difference = (content.text(text).mean - content.text(changed).mean).abs().amax(-1)[0]
    assert difference[2] > 0
    assert (difference[[0, 1, 3, 4, 5]] == 0).all()


def test_motion_parts_do_not_see_other_parts():
    torch.manual_seed(6)
    content = ContentEncoder(preset("tiny")).eval()
    joints, root = torch.randn(1, 40, 31, 9), torch.randn(1, 40, 3)
    changed = joints.clone()
    changed[:, :, list(PART_JOINTS["right_arm"])] += 1.0
    difference = (content.motion(joints, root).mean - content.motion(changed, root).mean).abs().amax(-1)[0]
    assert difference[1] > 0
    assert (difference[[0, 2, 3, 4, 5]] < 1e-6).all()


def test_pose_statistics_tell_where_a_part_is_held_and_how_far_it_swings():
    torch.manual_seed(8)
    still = torch.randn(1, 1, 31, 9).expand(-1, 40, -1, -1)
    swinging = still.clone()
    swinging[:, :, SPORT_SKELETON.index("Head"), 1] += torch.sin(torch.arange(40.0) * 2 * torch.pi / 40)
    own, other = pose_statistics(still), pose_statistics(swinging)
    assert [p.shape[1] for p in own] == [18 * len(PART_JOINTS[name]) for name in PART_NAMES]
    head = PART_NAMES.index("head")
    changes = [(b - a).abs() for a, b in zip(own, other, strict=True)]
    assert [bool((c > 1e-3).any()) for c in changes] == [name == "head" for name in PART_NAMES]
    assert changes[head].max() == pytest.approx(0.5**0.5, rel=0.02)  # the deviation of a sine of height 1
    assert (changes[head] > 1e-3).sum() == 1


def test_pose_statistics_are_read_part_by_part_and_standardised():
    torch.manual_seed(9)
    reader = StatisticsReader()
    windows = 3.0 * torch.randn(64, 40, 31, 9) + torch.randn(64, 1, 31, 9)
    reader.measure(windows)
    values = torch.cat(reader.standardised(windows), 1)
    assert values.mean(0).abs().max() < 1e-4
    assert (values.std(0) - 1).abs().max() < 1e-3
    z = torch.randn(2, 6, 64)
    changed = z.clone()
    changed[:, 3] += 1.0
    differ = [bool((a != b).any()) for a, b in zip(reader(z), reader(changed), strict=True)]
    assert differ == [False, False, False, True, False, False]


def test_a_paper_content_encoder_reads_no_statistics():
    assert ContentEncoder(preset("paper")).statistics is None


def test_exported_graphs_agree_with_torch(exported_tiny):
    from runtime.errors import ModelError
    from runtime.motion.model import ExportedMotionEncoder, MotionModel, load_model
    from tests.helpers.tiny_model import tiny_trained

    trained = tiny_trained()
    normal, steps = trained.normal, trained.steps
    model = load_model(exported_tiny)
    z, x = torch.randn(1, 384), torch.randn(2, 472)
    noise = torch.randn(2, 5, 8, 473)
    with torch.no_grad():
        scaled = (x - normal.x_mean) / normal.x_deviation
        expected = trained.generator.sample(scaled, z.expand(2, -1), noise, steps)
        expected = expected * normal.y_deviation + normal.y_mean
    style = model.fold_style(z.view(6, 64).numpy())
    y, _ = model.step(x.numpy(), noise.numpy(), style)
    assert np.abs(y - expected.numpy()).max() < 1e-4

    # n + s (z - n) for a strength s
    drawn = model.fold_style(0.5 + 1.4 * (z.view(6, 64).numpy() - 0.5))
    strong = model.fold_style(z.view(6, 64).numpy(), strength=1.4)
    assert np.abs(strong.content_weight - drawn.content_weight).max() < 1e-5
    assert np.abs(strong.content_weight - style.content_weight).max() > 1e-4
    assert np.array_equal(strong.z, style.z)
    metadata = json.loads((exported_tiny / "metadata.json").read_text())
    for broken in ({}, {"neutral": [1.0], "default": 1.0}, {"neutral": [0.5] * 384, "default": 9.0}):
        with pytest.raises(ModelError, match="field 'strength'"):
            MotionModel(exported_tiny, metadata | {"strength": broken})

    joints, root = torch.randn(3, 40, 31, 9), torch.randn(3, 40, 3)
    scales = trained.sequence_scales
    with torch.no_grad():
        normalised = (joints - scales["joint_mean"]) / scales["joint_deviation"]
        code = trained.content.motion(normalised, root / scales["root_deviation"])
    mean, log_variance = ExportedMotionEncoder(exported_tiny).encode(joints.numpy(), root.numpy())
    assert np.abs(mean - code.mean.numpy()).max() < 1e-4
    assert np.abs(log_variance - code.log_variance.numpy()).max() < 1e-4


@torch.no_grad()
def test_a_model_without_diffusion_gives_the_output_of_stage_2_and_keeps_the_noise_as_an_input(tmp_path):
    torch.manual_seed(0)
    generator = Generator(preset("tiny")).eval()
    of_x, of_y = torch.randn(2, INPUT_SIZE), torch.randn(2, OUTPUT_SIZE)
    normal = Normalisation(of_x[0], of_x[1].abs() + 0.5, of_y[0], of_y[1].abs() + 0.5)
    z, x, noise = torch.randn(1, 384), torch.randn(3, INPUT_SIZE), torch.randn(3, 5, 8, OUTPUT_SIZE)
    folded = StyleGraph(generator, torch.zeros(385, 2))(z)[:3]
    graph = MixtureStepGraph(generator, normal)
    y, alpha = graph(x, noise, *folded)
    scaled = (x - normal.x_mean) / normal.x_deviation
    expected, _, expected_alpha = generator.decode_mixture(scaled, z.expand(3, -1))
    assert torch.allclose(y, expected * normal.y_deviation + normal.y_mean, atol=1e-4)
    assert torch.allclose(alpha, expected_alpha, atol=1e-6)

    pytest.importorskip("onnxscript")
    export_step(graph, generator, 5, tmp_path / "step.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "step.onnx"), providers=["CPUExecutionProvider"])
    names = ["x", "noise", "front_bias", "content_weight", "content_bias"]
    assert [i.name for i in session.get_inputs()] == names
    feed = dict(zip(names, [x.numpy(), noise.numpy(), *(f[None].numpy() for f in folded)], strict=True))
    first = session.run(["y"], feed)[0]
    assert np.array_equal(first, session.run(["y"], feed | {"noise": 0.0 * feed["noise"]})[0])


def test_without_a_content_encoder_the_style_graph_is_exported_and_loaded(tmp_path):
    """By torch's own exporter: the regression is too large there to be folded, and keeps its name in the graph."""
    pytest.importorskip("onnxscript")
    config = ablation(preset("tiny"), "no-content-encoder")
    graph = StyleGraph(Generator(config), torch.randn(config.style_size + 1, 12))
    z = torch.randn(6, config.style_size // 6)
    path = tmp_path / "style.onnx"
    assert export_graph(graph, {"z": z}, [*FOLDED, "speeds"], path, (None,)) < 1e-3
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert [output.name for output in session.get_outputs()] == [*FOLDED, "speeds"]
