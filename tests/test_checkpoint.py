"""A packed run gives its weights back, and stage 2 can begin with them."""

import pytest

torch = pytest.importorskip("torch")

from sport.runtime.errors import FileError, UsageError  # noqa: E402
from sport.training.checkpoint import START, pack, unpack  # noqa: E402
from sport.training.networks.generator import Generator  # noqa: E402
from sport.training.presets import preset  # noqa: E402
from sport.training.session import load_checkpoint, save_checkpoint  # noqa: E402


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


def test_a_run_that_lacks_a_stage_is_named(run, tmp_path) -> None:
    (run / "content_final.pt").unlink()
    with pytest.raises(FileError, match=r"content_final\.pt"):
        pack(run, tmp_path / "packed.pt")


def test_a_run_is_never_overwritten(run, tmp_path) -> None:
    pack(run, tmp_path / "packed.pt")
    with pytest.raises(UsageError, match="empty folder"):
        unpack(tmp_path / "packed.pt", run)
