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
    """Layer sizes; the comments give the paper's value where a preset departs from it."""

    name: str = "compact"
    experts: int = 8  # outer experts k, of the motion encoder, the modulator and the decoder
    content_experts: int = 8  # inner experts j of the recursive modulator
    hidden: int = 512  # hidden width of the motion experts (paper 2048 in our reading)
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
    part_contrast: bool = True  # False: stage 1 contrasts the whole body only
    # stage 1 also reads each part's mean pose and its range off the codes (paper: no)
    pose_statistics: bool = True
    # stage 1 reads off the codes what a part does in a walk: steps, swings, ranges (paper: no)
    measures: bool = True
    text_encoder: str = "all-MiniLM-L6-v2"  # paper CLIP ViT-B/32, of 512
    text_size: int = 384  # numbers of a sentence embedding
    direction_words: bool = True  # also numbers for words such as left and right (paper: the embedding alone)
    # every sentence is read as of the left side, and mirrored back (paper: left and right are words like others)
    one_sided_words: bool = True
    # Eq. 14 with the captured motion in place of E_d's own codes, and the denoiser's output added to these codes
    # (paper: the codes alone, which the denoiser learns from nothing)
    residual_diffusion: bool = True
    # what is diffused is split by the experts' weights; False: every expert's code is the whole of it (paper: no)
    residual_shares: bool = False
    # arms, torso and head of other clips are put on the captured body while training (paper: no)
    composition: bool = True
    # after stage 1 the text network learns phrases in longer sentences, `training.stages.words` (paper: no)
    longer_sentences: bool = True

    @property
    def sentence_size(self) -> int:
        """Numbers that the content encoder reads of a sentence."""
        return self.text_size + (len(GROUPS) if self.direction_words else 0) + self.one_sided_words

    @staticmethod
    def of(stored: Mapping[str, Any]) -> ModelConfig:
        """The sizes in a model's metadata, which may hold fields of other versions."""
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
OPEN = "open"  # sizes of compact, trained on archives alone that allow commercial use
PRESETS: dict[str, ModelConfig] = {
    "compact": _COMPACT,
    OPEN: replace(_COMPACT, name=OPEN),
    "paper": _PAPER,
    "paper-rotations": replace(_PAPER, name="paper-rotations", output_size=OUTPUT_SIZE),
    "small": replace(  # a quarter of compact: what ablations are compared with where there is little time
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
    "distilled-diffusion": {"residual_diffusion": False},  # Eq. 14 as it stands in the paper
    "expert-shares": {"residual_shares": True},  # eight targets of their own in place of one
    "whole-body-contrast": {"part_contrast": False},
    "two-sided-words": {"one_sided_words": False},
    "no-pose-statistics": {"pose_statistics": False},
    "no-measures": {"measures": False},
    "no-composition": {"composition": False},
    "no-longer-sentences": {"longer_sentences": False},
}


def ablation(base: ModelConfig, name: str) -> ModelConfig:
    """`base` changed as the ablation `name` says; UsageError lists the names."""
    if name not in ABLATIONS:
        raise UsageError(f"--ablation {name}: unknown.", f"Use one of {', '.join(ABLATIONS)}.")
    changed = replace(base, name=f"{base.name}-{name}", **ABLATIONS[name])
    if not changed.content_encoder:
        changed = replace(changed, style_size=6 * changed.text_size)
    return changed


def preset(name: str) -> ModelConfig:
    """The preset called `name`; UsageError lists the names."""
    if name not in PRESETS:
        raise UsageError(f"--preset {name}: unknown.", f"Use one of {', '.join(PRESETS)}.")
    return PRESETS[name]
