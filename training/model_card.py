"""The model card that travels with the exported networks."""

from __future__ import annotations

from typing import Any

_LIMITS = """- Trained on about 35 captured styles; a prompt far from them is composed from the nearest ones, part by part.
- Terrain is known from distilled rollouts of PFNN and from flat capture laid over hills and stairs; there is only about
  a minute of captured stairs and uneven ground, and no capture of climbing over walls.
- Jumping and crouching were seen in the neutral style only."""


def model_card(metadata: dict[str, Any], curves: dict[str, str]) -> str:
    """Markdown text from `metadata.json`'s content; `curves` maps a stage to its last logged losses."""
    notes, config = metadata["notes"], metadata["config"]
    lines = [
        f"# Model `{metadata['name']}`",
        "",
        f"Exported {metadata['exported']} by `sport train export --preset {config['name']}`; layout version"
        f" {metadata['layout_version']}. Files: `prompt.onnx` (sentence embeddings to Z^t), `style.onnx` (Z^t to the"
        " modulator's folded weights), `step.onnx` (one frame, five denoising steps), `motion.onnx` (motion to Z^m,"
        " for evaluation), `metadata.json`.",
        "",
        "## Data",
        f"{notes['clips']} clips with their mirrored and terrain copies, {notes['frames'] / 3600:.0f} minutes at 60 Hz,"
        f" {len(notes['styles'])} styles: {', '.join(notes['styles'])}.",
        "",
        "## Licence and credits",
        f"{notes['licence'][:1].upper()}{notes['licence'][1:]}.",
        *[f"- {credit}" for credit in metadata["credits"]],
        "",
        "## Training",
        f"Seed {notes['seed']}; steps of the stages: "
        + ", ".join(f"{k} {v}" for k, v in notes["steps"].items())
        + ".",
        *[f"- {stage}: {text}" for stage, text in curves.items()],
        f"- ONNX against torch, largest difference: {max(metadata['onnx_error'].values()):.1e}",
        "- Analytic-DPM variance per step of tau: "
        + ", ".join(f"{v:.4f}" for v in metadata["sigma_bar_squared"]),
        "",
        "## Limits",
        _LIMITS,
        "",
    ]
    return "\n".join(lines)
