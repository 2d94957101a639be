"""Motion without a window: skeleton, features, networks, controller, terrain, prompts, clips and file formats."""

import os

# onnxruntime's official builds of 1.29 and later report each session to their maker unless this is set before they are
# imported. Nothing leaves the machine but prompts to a language model that was chosen; whoever wants to report sets it to 0.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
