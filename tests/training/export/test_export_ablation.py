"""The export without diffusion: the same interface, the output of stage 2, and no use of the noise."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnxscript")

from runtime.motion.features import INPUT_SIZE, OUTPUT_SIZE  # noqa: E402
from training.batches import Normalisation  # noqa: E402
from training.export.model import (  # noqa: E402
    MixtureStepGraph,
    StyleGraph,
)
from training.export.step import export_step  # noqa: E402
from training.networks.generator import Generator  # noqa: E402
from training.presets import PRESETS  # noqa: E402

INPUTS = ["x", "noise", "front_bias", "content_weight", "content_bias"]


@pytest.fixture(scope="module")
def parts():
    torch.manual_seed(0)
    generator = Generator(PRESETS["tiny"]).eval()
    normal = Normalisation(
        torch.randn(INPUT_SIZE),
        torch.rand(INPUT_SIZE) + 0.5,
        torch.randn(OUTPUT_SIZE),
        torch.rand(OUTPUT_SIZE) + 0.5,
    )
    z = torch.randn(6, 64)
    folded = StyleGraph(generator, torch.zeros(385, 2))(z)[:3]
    return generator, normal, z, [f.detach() for f in folded]


@torch.no_grad()
def test_it_gives_the_output_of_stage_2(parts):
    generator, normal, z, folded = parts
    x = torch.randn(3, INPUT_SIZE)
    noise = torch.randn(3, 5, 8, OUTPUT_SIZE)
    y, alpha = MixtureStepGraph(generator, normal)(x, noise, *folded)
    style = z.reshape(1, -1).expand(3, -1)
    expected, _, expected_alpha = generator.decode_mixture((x - normal.x_mean) / normal.x_deviation, style)
    assert torch.allclose(y, expected * normal.y_deviation + normal.y_mean, atol=1e-4)
    assert torch.allclose(alpha, expected_alpha, atol=1e-6)


def test_the_exported_graph_keeps_the_noise_as_an_input_and_ignores_it(parts, tmp_path):
    import onnxruntime

    generator, normal, _, folded = parts
    path = tmp_path / "step.onnx"
    export_step(MixtureStepGraph(generator, normal), generator, 5, path)
    noise = torch.randn(2, 5, 8, OUTPUT_SIZE)
    example = (torch.randn(2, INPUT_SIZE), noise, *(tensor[None] for tensor in folded))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert [i.name for i in session.get_inputs()] == INPUTS
    feed = dict(zip(INPUTS, [e.numpy() for e in example], strict=True))
    first = session.run(["y"], feed)[0]
    second = session.run(["y"], feed | {"noise": np.zeros((2, 5, 8, OUTPUT_SIZE), np.float32)})[0]
    assert np.array_equal(first, second)
