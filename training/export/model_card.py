"""The model card of exported networks: `model_card.md` filled with the values of a model."""

from pathlib import Path
from typing import Any


def model_card(metadata: dict[str, Any], curves: dict[str, str]) -> str:
    """Return the card as Markdown from the content of `metadata.json`; `curves` maps stages to their last losses."""
    notes = metadata["notes"]
    rollouts = any(credit.startswith("Rollouts") for credit in metadata["credits"])
    return (
        Path(__file__)
        .with_name("model_card.md")
        .read_text(encoding="utf-8")
        .format(
            **{name: metadata[name] for name in ("name", "exported", "layout_version")},
            preset=metadata["config"]["name"],
            eight_bits=_eight_bits(metadata.get("quantised", {})),
            clips=notes["clips"],
            minutes=notes["frames"] / 3600,
            style_count=len(notes["styles"]),
            styles=", ".join(notes["styles"]),
            licence=notes["licence"][:1].upper() + notes["licence"][1:],
            credits="\n".join(f"- {credit}" for credit in metadata["credits"]),
            history="\n".join(_history(notes, curves)),
            error=max(metadata["onnx_error"].values()),
            variance=", ".join(f"{v:.4f}" for v in metadata["sigma_bar_squared"]),
            rollouts="distilled rollouts of PFNN and from " if rollouts else "",
        )
    )


def _history(notes: dict[str, Any], curves: dict[str, str]) -> list[str]:
    """Return steps and last losses of the stages, and later changes of the weights."""
    again = any(len(counts) > 1 for counts in notes["steps"].values())
    steps = ", ".join(f"{stage} {' + '.join(map(str, counts))}" for stage, counts in notes["steps"].items())
    sums = " A sum is of models that each went on from the weights of the one before." if again else ""
    return [
        f"Seed {notes['seed']}; steps of the stages: {steps}.{sums}",
        *([f"- weights: {notes['mean_of_weights']}"] if "mean_of_weights" in notes else []),
        *[f"- {stage}: {text}" for stage, text in curves.items()],
    ]


def _eight_bits(quantised: dict[str, Any]) -> str:
    """Return the paragraph on the 8-bit step graph, if there is one."""
    if "relative_error" not in quantised:
        return ""
    but = f", but for {', '.join(quantised['kept'])}" if quantised.get("kept") else ""
    return (
        f"\n\n`step_int8.onnx` is `step.onnx` with 8-bit weights{but}; {quantised['default']} is loaded unless another"
        f" precision is asked for. Over {quantised['frames']} frames of its own walks it is"
        f" {quantised['relative_error']:.2%} from full precision, joints {quantised['joint_error_mm']:.1f} mm on average"
        f" and {quantised['joint_error_max_mm']:.1f} mm at most."
    )
