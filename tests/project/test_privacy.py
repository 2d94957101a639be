"""Loading and running the networks leaves no trace outside the program, and asks nobody."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_RUN = """
from runtime.motion.controller import Controller
from runtime.controls import Controls
from runtime.motion.model import load_model
from runtime.terrain.height_map import Terrain
Controller(load_model(), Terrain.flat()).step(Controls())
import os
print(os.environ.get("ORT_DISABLE_TELEMETRY"))
"""


@pytest.mark.parametrize(("asked", "told"), [(None, "1"), ("0", "0")])
def test_onnxruntime_reports_nothing_unless_it_is_told_to(
    tmp_path: Path, asked: str | None, told: str
) -> None:
    # by itself it is silent under CI and in unit tests, but not on a person's machine
    silent = (
        "CI",
        "GITHUB_ACTIONS",
        "TF_BUILD",
        "ORT_RUNNING_UNIT_TESTS",
        "ORT_DISABLE_TELEMETRY",
        "ORT_TELEMETRY_DISABLED",
    )
    environment = {k: v for k, v in os.environ.items() if k not in silent and not k.startswith("XDG_")}
    environment |= {"HOME": str(tmp_path)} | ({} if asked is None else {"ORT_DISABLE_TELEMETRY": asked})
    if asked is None:
        command = [sys.executable, "-c", _RUN]
        done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
        assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    else:  # said, not done: a test sends nothing
        script = "import os, runtime; print(os.environ['ORT_DISABLE_TELEMETRY'])"
        command = [sys.executable, "-c", script]
        done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert done.stdout.strip() == told
