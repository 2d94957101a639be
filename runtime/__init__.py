"""Motion without a window: skeleton, features, networks, controller, terrain, prompts, clips and file formats."""

import os

# onnxruntime's official builds of 1.29 and later send telemetry for each session unless this is set before their import.
# Nothing leaves the machine except prompts to a language model that the user chose; set it to 0 to allow telemetry.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
