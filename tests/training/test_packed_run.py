"""A packed run gives its weights back, and stage 2 can begin with them."""

import shutil

import pytest

torch = pytest.importorskip("torch")

from runtime.errors import FileError, UsageError  # noqa: E402
from tests.helpers.tiny_model import tiny_trained  # noqa: E402
from training.export.graph import store_model_in_half  # noqa: E402
from training.networks.generator import Generator  # noqa: E402
from training.packed_run import START, pack, unpack  # noqa: E402
from training.presets import preset  # noqa: E402
from training.session import load_checkpoint, save_checkpoint  # noqa: E402


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run"
    torch.manual_seed(1)
    generator = Generator(preset("tiny"))
    save_checkpoint(folder / "stage3_final.pt", {"module": generator.state_dict()})
    save_checkpoint(
        folder / "content_final.pt", {"module": {"w": torch.randn(3)}, "config": {"name": "tiny"}}
    )
    save_checkpoint(folder / "phase_final.pt", {"module": {"w": torch.randn(3)}})
    save_checkpoint(folder / "scales.pt", {"x_mean": torch.tensor([1e-7, 3.14159274])})
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
    assert torch.equal(
        load_checkpoint(tmp_path / "new" / "scales.pt")["x_mean"],
        load_checkpoint(run / "scales.pt")["x_mean"],
    )
    assert load_checkpoint(tmp_path / "new" / "content_final.pt")["config"] == {"name": "tiny"}


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
