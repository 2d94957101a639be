"""Steps that are recorded give what computed ones give; graphs are stood in for by the operations that they would hold."""

from contextlib import nullcontext

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from tests.training.test_composition import drawn, frames, table, texts  # noqa: F401
from tests.training.test_resume import run
from training import gpu
from training.stages import content, diffusion, phase

pytestmark = pytest.mark.needs_torch

aten = torch.ops.aten
WAITS = (aten._local_scalar_dense, aten.nonzero, aten.lift_fresh, aten.masked_select, aten.equal)


class Graph(TorchDispatchMode):
    """As a CUDA graph: what was recorded changes nothing until it is replayed, in the same memory.

    Nothing in it may wait for a device: no number read, no rows counted, no list or array copied.
    """

    def __init__(self) -> None:
        super().__init__()
        self.calls, self.before = [], []

    def __enter__(self):
        self.random = torch.get_rng_state()
        return super().__enter__()

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        assert function.overloadpacket not in WAITS, function
        if function.overloadpacket in (aten.index, aten.index_put, aten.index_put_):
            assert not any(i is not None and i.dtype == torch.bool for i in args[1])
        for argument, value in zip(function._schema.arguments, args, strict=False):
            writes = argument.alias_info is not None and argument.alias_info.is_write
            # means of a norm, whose schema does not say so
            if writes or argument.name.startswith("running_"):
                self.before += [(t, t.detach().clone()) for t in tree_leaves(value)]
        result = function(*args, **kwargs)
        self.calls.append((function, args, kwargs, result))
        return result

    def __exit__(self, *error):
        super().__exit__(*error)
        torch.set_rng_state(self.random)
        with torch.no_grad():
            for tensor, value in reversed(self.before):
                tensor.copy_(value)

    @torch.no_grad()
    def replay(self) -> None:
        for function, args, kwargs, result in self.calls:
            again = function(*args, **kwargs)
            for old, new in zip(tree_leaves(result), tree_leaves(again), strict=True):
                if (
                    torch.is_tensor(old)
                    and old.untyped_storage().data_ptr() != new.untyped_storage().data_ptr()
                ):
                    old.copy_(new)


@pytest.fixture
def as_on_a_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "CUDAGraph", Graph)
    monkeypatch.setattr(torch.cuda, "graph", lambda graph, **_: graph)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda: None)
    monkeypatch.setattr("training.session.own_stream", lambda *_: nullcontext())
    monkeypatch.setattr(gpu, "WARM_STEPS", 1)
    for module in ("batches", "composition", "rollouts", "stages.content"):
        monkeypatch.setattr(f"training.{module}.rows_of", lambda chosen: slice(None))


@pytest.mark.parametrize(
    ("stage", "steps"), [("phase", 8), ("content", 8), ("stage2", 10), ("stage3", 10), ("ground", 10)]
)
def test_a_recorded_step_waits_for_nothing_and_gives_the_same_bytes(
    stage, steps, frames, table, texts, tmp_path, monkeypatch, as_on_a_gpu  # noqa: F811
):  # fmt: skip
    monkeypatch.setattr(diffusion, "measure_codes", lambda *_, **__: None)
    monkeypatch.setattr(phase, "encode_table", lambda *_: None)
    monkeypatch.setattr(content, "STATISTICS_WINDOWS", 16)
    replayed = []
    replay = Graph.replay
    monkeypatch.setattr(Graph, "replay", lambda self: (replayed.append(self), replay(self)))
    computed = run(stage, tmp_path / "computed", frames, table, texts, steps)
    assert not replayed
    assert run(stage, tmp_path / "recorded", frames, table, texts, steps, recorded=True) == computed
    assert len(replayed) >= 6


def test_all_rows_chosen_from_are_the_rows_alone(frames, as_on_a_gpu):  # noqa: F811
    rows, plan = drawn(frames, 1)
    patch = torch.zeros_like(rows)
    everything = (*frames.pairs(rows, patch, plan), frames.outputs(rows, patch, plan))
    changed = plan.changed.any(1).nonzero()[:, 0]
    apart = (*frames.pairs(rows[changed], patch[changed], plan[changed]), None)
    for whole, some in zip(everything[:2], apart[:2], strict=True):
        assert torch.equal(whole[changed], some)
    plain = frames.outputs(rows, patch)
    kept = ~plan.changed.any(1)
    assert torch.equal(everything[2][kept], plain[kept])
