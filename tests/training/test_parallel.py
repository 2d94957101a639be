"""Training in two processes: averaged gradients, equal weights, one writer."""

import pytest
import torch

from runtime.errors import UsageError
from training import parallel
from training.session import MovingAverage, Session, StageLength, TrainingState, load_checkpoint, train

pytestmark = pytest.mark.needs_torch

STEPS = 3


def _batches(rank: int):
    generator = torch.Generator().manual_seed(rank)
    while True:
        yield torch.randn(16, 4, generator=generator)


def _train(out, batches, module) -> None:
    optimizer = torch.optim.SGD(module.parameters(), lr=0.1)
    state = TrainingState(module, optimizer, MovingAverage(module))
    losses = lambda x: {"total": module(x).square().mean()}  # noqa: E731
    session = Session(out, torch.device("cpu"), half=False)
    train(session, "trial", state, batches, losses, lambda step: 0.1, StageLength(STEPS, 16))


def _train_together(out) -> None:
    assert parallel.join("stage2") == torch.device("cpu")
    rank = parallel.rank()
    torch.manual_seed(rank)  # they do not even begin alike
    module = torch.nn.Linear(4, 2)
    _train(out / "run", _batches(rank), module)
    assert parallel.of_first(0.5 + rank) == 0.5
    torch.save(module.state_dict(), out / f"{rank}.pt")


def test_two_processes_train_as_one_with_both_batches(tmp_path):
    parallel.run_together(2, _train_together, tmp_path)
    first, second = (torch.load(tmp_path / f"{rank}.pt") for rank in (0, 1))
    assert all(torch.equal(first[name], second[name]) for name in first)

    torch.manual_seed(0)
    module = torch.nn.Linear(4, 2)
    both = (torch.cat(pair) for pair in zip(_batches(0), _batches(1), strict=True))
    _train(tmp_path / "alone", both, module)
    assert torch.allclose(module.weight, first["weight"], atol=1e-6)
    assert load_checkpoint(tmp_path / "run" / "trial.pt")["step"] == STEPS


def test_stages_that_write_files_are_run_alone(monkeypatch):
    assert parallel.join("all") is None
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(UsageError, match="train all"):
        parallel.join("all")


def test_only_the_first_process_writes_checkpoints(tmp_path, monkeypatch):
    from training.session import save_checkpoint

    monkeypatch.setenv("RANK", "1")
    save_checkpoint(tmp_path / "x.pt", {"a": 1})
    assert not (tmp_path / "x.pt").exists()
    session = Session(tmp_path, seed=3)
    assert session.batch_generator(2).initial_seed() != session.generator(2).initial_seed()
