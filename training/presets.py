"""Sizes of the networks: one frozen dataclass, and the presets by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from runtime.errors import UsageError
from runtime.motion.features import OUTPUT_SIZE, PAPER_OUTPUT_SIZE
from runtime.prompts.content import GROUPS


@dataclass(frozen=True)
class ModelConfig:
    """Layer sizes; comments give the paper's value where the default differs."""

    name: str = "compact"
    experts: int = 8  # outer experts k of motion encoder, modulator and decoder
    content_experts: int = 8  # inner experts j of the recursive modulator
    hidden: int = 512  # width of the motion experts (paper 2048 in our reading)
    embedding: int = 512  # size of W and E (paper 1024)
    front: tuple[int, int] = (256, 64)  # modulator front (paper 512, 128)
    gating_hidden: int = 64
    style_size: int = 384  # Z^t, six parts of 64
    output_size: int = OUTPUT_SIZE  # 287 in the paper, 473 with joint rotations
    denoiser_width: int = 192  # paper 384
    denoiser_blocks: int = 4  # paper 12
    dropout: float = 0.1  # paper 0.3
    diffusion_steps: int = 1000  # N
    inference_steps: int = 5  # dim(tau)
    phase_hidden: int = 31  # channels between the two convolutions of the periodic autoencoder
    phase_kernel: int = 25  # frames (DeepPhase: the whole window, 121)
    part_aware_phase: bool = True  # False: PAE instead of BP-PAE
    joined_hips: bool = False  # True: each hip joint sees the other one, as Fig. 3 draws it
    content_layers: int = 1  # temporal transformer and sequence decoder (paper 6)
    content_heads: int = 4
    content_feedforward: int = 256  # paper 1024
    content_encoder: bool = True  # False: raw text embeddings as Z^t
    part_contrast: bool = True  # False: the contrastive loss of stage 1 uses the whole body only
    # stage 1 also predicts each part's mean pose and range from the codes (paper: no)
    pose_statistics: bool = True
    # stage 1 also predicts measures of each part's motion from the codes: steps, swings, ranges (paper: no)
    measures: bool = True
    text_encoder: str = "all-MiniLM-L6-v2"  # paper CLIP ViT-B/32 with 512
    text_size: int = 384  # size of a sentence embedding
    direction_words: bool = True  # features for words such as left and right (paper: the embedding alone)
    # every sentence is encoded as for the left side, then mirrored (paper: left and right are ordinary words)
    one_sided_words: bool = True
    # the diffusion learns the residual of the captured motion to E_d's codes, to which it is added
    # (paper: Eq. 14, the denoiser learns the codes themselves)
    residual_diffusion: bool = True
    # True: the residual is split by expert weight; False: each expert's code has all of it (paper: no residual)
    residual_shares: bool = False
    # training combines arms, torso and head of other clips with the captured body (paper: no)
    composition: bool = True
    # after stage 1 the text network learns longer sentences, `training.stages.words` (paper: no)
    longer_sentences: bool = True

    @property
    def sentence_size(self) -> int:
        """Input size of the content encoder per sentence."""
        return self.text_size + (len(GROUPS) if self.direction_words else 0) + self.one_sided_words

    @staticmethod
    def of(stored: Mapping[str, Any]) -> ModelConfig:
        """Read the sizes in a model's metadata, which may contain fields of other versions."""
        known = {name: stored[name] for name in ModelConfig.__dataclass_fields__ if name in stored}
        return ModelConfig(**known | {"front": tuple(stored["front"])})


_COMPACT = ModelConfig()
_PAPER = ModelConfig(
    name="paper",
    hidden=2048,
    embedding=1024,
    front=(512, 128),
    output_size=PAPER_OUTPUT_SIZE,
    denoiser_width=384,
    denoiser_blocks=12,
    dropout=0.3,
    phase_kernel=121,
    content_layers=6,
    content_feedforward=1024,
    direction_words=False,
    one_sided_words=False,
    pose_statistics=False,
    measures=False,
    residual_diffusion=False,
    composition=False,
    longer_sentences=False,
)
OPEN = "open"  # sizes of compact, trained only on archives that allow commercial use
PRESETS: dict[str, ModelConfig] = {
    "compact": _COMPACT,
    OPEN: replace(_COMPACT, name=OPEN),
    "paper": _PAPER,
    "paper-rotations": replace(_PAPER, name="paper-rotations", output_size=OUTPUT_SIZE),
    "small": replace(  # a quarter of compact, for ablations with little training time
        _COMPACT,
        name="small",
        hidden=256,
        embedding=256,
        front=(128, 32),
        denoiser_width=128,
        denoiser_blocks=3,
    ),
    "tiny": replace(
        _COMPACT, name="tiny", hidden=16, embedding=16, front=(8, 4), denoiser_width=16, denoiser_blocks=1
    ),
}

# The rows of Table I and of Sec. IV-C as changes of a preset. "w/o diffusion" needs no training of its own: it is
# stage 2 of the full model (`sport train export --decoder mixture`).
ABLATIONS: dict[str, dict[str, Any]] = {
    "full": {},
    "pae": {"part_aware_phase": False},
    "joined-hips": {"joined_hips": True},
    "4-experts": {"experts": 4},
    "4-content-experts": {"content_experts": 4},
    "no-content-encoder": {"content_encoder": False, "direction_words": False, "one_sided_words": False},
    "6-content-layers": {"content_layers": 6},
    "no-direction-words": {"direction_words": False},
    "distilled-diffusion": {"residual_diffusion": False},  # Eq. 14 as in the paper
    "expert-shares": {"residual_shares": True},  # each expert has its own target
    "whole-body-contrast": {"part_contrast": False},
    "two-sided-words": {"one_sided_words": False},
    "no-pose-statistics": {"pose_statistics": False},
    "no-measures": {"measures": False},
    "no-composition": {"composition": False},
    "no-longer-sentences": {"longer_sentences": False},
}


def ablation(base: ModelConfig, name: str) -> ModelConfig:
    """Return `base` with the changes of the ablation `name`; UsageError lists the names."""
    if name not in ABLATIONS:
        raise UsageError(f"--ablation {name}: unknown.", f"Use one of {', '.join(ABLATIONS)}.")
    changed = replace(base, name=f"{base.name}-{name}", **ABLATIONS[name])
    if not changed.content_encoder:
        changed = replace(changed, style_size=6 * changed.text_size)
    return changed


def preset(name: str) -> ModelConfig:
    """Return the preset `name`; UsageError lists the names."""
    if name not in PRESETS:
        raise UsageError(f"--preset {name}: unknown.", f"Use one of {', '.join(PRESETS)}.")
    return PRESETS[name]
