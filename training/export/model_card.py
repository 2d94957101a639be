"""The model card that travels with the exported networks."""

from __future__ import annotations

from typing import Any


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
        *_eight_bits(metadata.get("quantised", {})),
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
        *_history(notes, curves),
        f"- ONNX against torch, largest difference: {max(metadata['onnx_error'].values()):.1e}",
        "- Analytic-DPM variance per step of tau: "
        + ", ".join(f"{v:.4f}" for v in metadata["sigma_bar_squared"]),
        "",
        "## Limits",
        *_limits(metadata),
        "",
    ]
    return "\n".join(lines)


def _history(notes: dict[str, Any], curves: dict[str, str]) -> list[str]:
    """Steps and last losses of the stages, and what was done to the weights afterwards."""
    again = any(len(counts) > 1 for counts in notes["steps"].values())
    steps = ", ".join(f"{stage} {' + '.join(map(str, counts))}" for stage, counts in notes["steps"].items())
    sums = " A sum is of models that each went on from the weights of the one before." if again else ""
    return [
        f"Seed {notes['seed']}; steps of the stages: {steps}.{sums}",
        *([f"- weights: {notes['mean_of_weights']}"] if "mean_of_weights" in notes else []),
        *[f"- {stage}: {text}" for stage, text in curves.items()],
    ]


def _limits(metadata: dict[str, Any]) -> list[str]:
    """What the model cannot do, as far as its data tell."""
    rollouts = any(credit.startswith("Rollouts") for credit in metadata["credits"])
    return [
        f"- Trained on {len(metadata['notes']['styles'])} captured styles, on recombinations of their parts, and on parametric"
        " edits of parts; a prompt far from them is composed from the nearest ones, part by part.",
        "- Words of nodding, of sides that training never showed and of slight rhythm show less than others; the shares of"
        " single phrases are in `assets/prompts/shares.json`.",
        "- Terrain is known from "
        + ("distilled rollouts of PFNN and from " if rollouts else "")
        + "flat capture laid over hills and stairs; there is only about a minute of captured stairs and uneven ground."
        " Obstacles that its metadata do not name (`crosses`) are keyed by the program.",
        "- Jumping was seen in the neutral style only.",
    ]


def _eight_bits(quantised: dict[str, Any]) -> list[str]:
    """What is said of the 8-bit step graph, where there is one."""
    if "relative_error" not in quantised:
        return []
    but = f", but for {', '.join(quantised['kept'])}" if quantised.get("kept") else ""
    return [
        "",
        f"`step_int8.onnx` is `step.onnx` with 8-bit weights{but}; {quantised['default']} is loaded unless another precision"
        f" is asked for. Over {quantised['frames']} frames of its own walks it is {quantised['relative_error']:.2%} from"
        f" full precision, joints {quantised['joint_error_mm']:.1f} mm on average and"
        f" {quantised['joint_error_max_mm']:.1f} mm at most.",
    ]
