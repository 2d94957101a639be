"""The ablations of Table I differ from the full model in what they name, and run."""

import onnxruntime
import pytest

torch = pytest.importorskip("torch")

from runtime.errors import FileError  # noqa: E402
from runtime.motion.model_files import FOLDED  # noqa: E402
from runtime.skeleton import SPORT_SKELETON  # noqa: E402
from training.ablations import SHARED, prepare  # noqa: E402
from training.export.graph import export_graph  # noqa: E402
from training.export.model import EmbeddingGraph, StyleGraph  # noqa: E402
from training.networks.generator import Generator  # noqa: E402
from training.networks.phase import PeriodicAutoencoder, two_hop_neighbours  # noqa: E402
from training.presets import ABLATIONS, ablation, preset  # noqa: E402


@pytest.mark.parametrize("name", ABLATIONS)
def test_every_variant_makes_a_frame(name: str) -> None:
    config = ablation(preset("tiny"), name)
    generator = Generator(config).eval()
    y, _, alpha = generator.decode_mixture(torch.randn(3, 472), torch.randn(3, config.style_size))
    assert y.shape == (3, config.output_size)
    assert alpha.shape == (3, config.experts)


def test_the_variants_change_what_they_are_named_for() -> None:
    full = preset("tiny")
    count = {n: sum(p.numel() for p in Generator(ablation(full, n)).parameters()) for n in ABLATIONS}
    assert count["4-experts"] < count["4-content-experts"] < count["full"] < count["no-content-encoder"]
    assert ablation(full, "no-content-encoder").style_size == 6 * full.text_size
    has_graph = [
        any("graph" in n for n, _ in PeriodicAutoencoder(ablation(full, name)).named_parameters())
        for name in ("full", "pae")
    ]
    assert has_graph == [True, False]
    joined = two_hop_neighbours(True) - two_hop_neighbours()
    hips = sorted(SPORT_SKELETON.index(f"{side}UpLeg") for side in ("Left", "Right"))
    assert torch.nonzero(joined).tolist() == [hips, hips[::-1]]


def test_without_a_content_encoder_the_sentences_are_the_code() -> None:
    words = torch.randn(2, 6, 384)
    graph = EmbeddingGraph(torch.zeros(6 * 384), 2.0 * torch.ones(6 * 384))
    assert torch.allclose(graph(words), words / 2.0)


def test_shared_stages_are_copied_and_missed(tmp_path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    for file in SHARED["full"]:
        (run / file).write_bytes(b"x")
    prepare(run, tmp_path / "out", "pae", tmp_path)
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["content_final.pt"]
    (run / "phase.npy").unlink()
    with pytest.raises(FileError, match=r"phase\.npy"):
        prepare(run, tmp_path / "other", "full", tmp_path)


def test_the_table_of_frames_is_shared_by_variants_of_the_same_clips_alone(tmp_path) -> None:
    run, clips = tmp_path / "run", tmp_path / "clips"
    for folder in (run / "frames", clips):
        folder.mkdir(parents=True)
    (clips / "walk.npz").write_bytes(b"walk")
    (run / "frames" / "table.json").write_text('{"files": [["walk.npz", 4]]}', encoding="utf-8")
    for file in SHARED["full"]:
        (run / file).write_bytes(b"x")
    prepare(run, tmp_path / "same", "full", clips)
    assert (tmp_path / "same" / "frames").resolve() == (run / "frames").resolve()
    (clips / "jog.npz").write_bytes(b"jog")
    prepare(run, tmp_path / "other", "full", clips)
    assert not (tmp_path / "other" / "frames").exists()


def test_without_a_content_encoder_the_style_graph_is_exported_and_loaded(tmp_path) -> None:
    """By torch's own exporter: the regression is too large there to be folded, and keeps its name in the graph."""
    pytest.importorskip("onnxscript")
    config = ablation(preset("tiny"), "no-content-encoder")
    graph = StyleGraph(Generator(config), torch.randn(config.style_size + 1, 12))
    z = torch.randn(6, config.style_size // 6)
    path = tmp_path / "style.onnx"
    error = export_graph(graph, (z,), ["z"], [*FOLDED, "speeds"], (None,), path)
    assert error < 1e-3
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert [output.name for output in session.get_outputs()] == [*FOLDED, "speeds"]
