"""What a run keeps in memory, and how that is measured: causes, not megabytes, which depend on the machine."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from runtime.assets import PROJECT_ROOT, model_folder
from runtime.motion.model_files import open_graph, read_graph, read_metadata

TRAINING_ONLY = {"torch", "onnx", "onnxscript", "scipy", "sklearn", "matplotlib", "pandas", "trimesh", "PIL"}
RUN = """
import json, sys
from viewer.app import App, run
from viewer.options import ViewOptions
run(ViewOptions(offscreen=True, frames=2, terrain="hills", prompt="an exhausted soldier"))
print(json.dumps(sorted({name.split(".")[0] for name in sys.modules})))
"""


def test_a_run_of_the_viewer_loads_no_library_that_it_does_not_use(tmp_path: Path) -> None:
    """With the real model, prompts, character and renderer: each of these libraries costs tens of megabytes."""
    environment = {**os.environ, "SPORT_CONFIG_DIR": str(tmp_path)}
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(command, cwd=PROJECT_ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    loaded = set(json.loads(done.stdout.splitlines()[-1]))
    assert {"onnxruntime", "tokenizers", "moderngl"} <= loaded  # it was a real run
    assert not loaded & (TRAINING_ONLY | {"training"})


def test_a_session_keeps_no_second_copy_of_its_file() -> None:
    folder = model_folder()
    data = read_graph(folder, "prompt", read_metadata(folder))
    session = open_graph(folder / "prompt.onnx", data, 1)
    assert not [name for name, value in vars(session).items() if value is data]
    words = np.zeros((1, 6, session.get_inputs()[0].shape[2]), np.float32)
    assert session.run(["z"], {"embeddings": words})[0].shape == (1, 6, 64)
