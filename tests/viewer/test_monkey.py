"""A short run of random actions; `python -m tests.monkey` makes longer ones."""

from tests import monkey
from tests.helpers.viewer_fakes import fake_services


def test_random_actions_raise_nothing() -> None:
    assert len(monkey.run(25, 1, fake_services(), say=lambda _: None).done) == 12
