"""A short run of random actions; `python -m tests.monkey` makes longer ones."""

from __future__ import annotations

import pytest

from tests import monkey


@pytest.mark.parametrize("seed", [1])
def test_random_actions_raise_nothing(seed: int) -> None:
    found = monkey.run(25, seed, say=lambda _: None)
    assert len(found.done) == 12
