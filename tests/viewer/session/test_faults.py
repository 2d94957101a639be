"""Real processes that record or edit and are killed, interrupted or find no room; all of them: `python -m tests.faults`."""

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.faults import faults
from tests.faults.faults import Outcome

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX")
QUICK = ("killed by SIGKILL", "display gone", "Ctrl+C four times", "disk full", "two runs end at once")


@pytest.mark.parametrize("name", QUICK)
def test_at_most_the_last_quarter_of_a_second_is_lost(name: str, tmp_path: Path) -> None:
    fault: Callable[[Path, float], Outcome] | None = faults.all_faults().get(name)
    if fault is None:
        pytest.skip("no Xvfb here")
    assert fault(tmp_path / "run", 0.8).problems == []
