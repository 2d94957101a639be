"""Stage words, after stage 1: the text network learns to understand longer sentences by their phrases.

Only the text network is trained, on its own codes: those of all training sentences are kept, so that an already trained
motion generator stays valid; sentences of `training.augmentation.sentences` get the codes of their phrases.
"""

import copy
import logging
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from runtime.prompts.content import part_inputs
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES
from training.augmentation.sentences import LongerSentence, longer_sentences, other_sentences
from training.networks.content import ContentEncoder, PartTextEncoder
from training.presets import ModelConfig
from training.session import StageLength, StageSchedule
from training.styles import StyleTexts

log = logging.getLogger("sport.train")

BATCH = 128
MAX_WORD_NOISE = 0.1  # relative to the length of a sentence embedding


@dataclass
class Targets:
    """Sentences `(U, D)` of one part, their target codes `(U, 128)` (mean and log-variance), and the codes' deviation."""

    words: Tensor
    codes: Tensor
    deviation: Tensor  # (128,)


def learn_longer_sentences(
    content: ContentEncoder,
    config: ModelConfig,
    texts: StyleTexts,
    encoder: TextEncoderLike,
    length: StageLength,
    seed: int = 0,
) -> dict[str, float]:
    """Train `content.text` in place; returns mean distances (in deviations of the codes) before and after, and "steps"."""
    torch.manual_seed(seed + 5)
    network = content.text.cpu().train()
    goals = targets(copy.deepcopy(network).eval(), config, texts, encoder)
    before = {f"{name}_before": _error(network, goal) for name, goal in goals.items()}
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3)
    schedule, steps = StageSchedule(length), 0
    while (at := schedule.at(steps)) < length.steps:
        optimizer.param_groups[0]["lr"] = 0.5e-3 * (1.0 + math.cos(math.pi * at / length.steps))
        loss = torch.stack([_distance(network, goal, noise=True) for goal in goals.values()]).sum()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        steps += 1
    network.eval()
    result = before | {name: _error(network, goal) for name, goal in goals.items()} | {"steps": float(steps)}
    log.info("longer sentences: %s", "  ".join(f"{k} {v:.3f}" for k, v in result.items()))
    return result


def targets(
    teacher: PartTextEncoder, config: ModelConfig, texts: StyleTexts, encoder: TextEncoderLike
) -> dict[str, list[Targets]]:
    """Return the targets of known, longer and alternative sentences of every part, from the codes of `teacher`."""
    found: dict[str, list[Targets]] = {"known": [], "longer": [], "other": []}
    for k, part in enumerate(PART_NAMES):
        words = torch.as_tensor(np.asarray(texts.embeddings[k], np.float32))
        with torch.no_grad():
            codes = codes_of(teacher, words, k)
        spread = codes.std(0)
        spread = spread.clamp_min(0.2 * float(spread.mean()) + 1e-4)
        known = Targets(words, codes, spread)
        found["known"].append(known)
        for name, sentences in (("longer", longer_sentences()), ("other", other_sentences())):
            own = [s for s in sentences if s.part == part]
            made = (
                Targets(*_targets(teacher, config, encoder, own, k, codes.mean(0)), spread) if own else known
            )
            found[name].append(made)
    return found


def _targets(
    teacher: PartTextEncoder,
    config: ModelConfig,
    encoder: TextEncoderLike,
    sentences: list[LongerSentence],
    k: int,
    middle: Tensor,
) -> tuple[Tensor, Tensor]:
    """Return sentences of part k and their codes: the `middle` code plus the sum of its phrases' differences from it, or
    the mean of phrases with the same meaning."""

    def inputs(lines: list[str]) -> Tensor:
        options = config.direction_words, config.one_sided_words
        return torch.as_tensor(part_inputs(encoder, [PART_NAMES[k]] * len(lines), lines, *options))

    phrases = sorted({p for s in sentences for p in s.of})
    with torch.no_grad():
        codes = dict(zip(phrases, codes_of(teacher, inputs(phrases), k), strict=True))
    added = [torch.stack([codes[p] - middle for p in s.of]) for s in sentences]
    goal = [middle + (a.mean(0) if s.alike else a.sum(0)) for a, s in zip(added, sentences, strict=True)]
    return inputs([s.text for s in sentences]), torch.stack(goal)


def disturbed(words: Tensor, one_sided: bool) -> Tensor:
    """Return sentences `(..., D)` with noise of random strength, keeping their side."""
    size = words.shape[-1] - one_sided
    noise = MAX_WORD_NOISE * torch.rand_like(words[..., :1]) * torch.randn_like(words) / size**0.5
    noise[..., size:] = 0.0
    return words + noise


def codes_of(network: PartTextEncoder, words: Tensor, k: int) -> Tensor:
    """Return mean and log-variance `(B, 128)` of sentences `(B, D)` of part k."""
    code = network(words[:, None].expand(-1, len(PART_NAMES), -1))
    return torch.cat([code.mean[:, k], code.log_variance[:, k]], dim=1)


def _distance(network: PartTextEncoder, targets: list[Targets], noise: bool = False) -> Tensor:
    """Return the mean square distance, in deviations, of BATCH random sentences of every part from their targets."""
    rows = [torch.randint(len(one.words), (BATCH,)) for one in targets]
    words = torch.stack([one.words[r] for one, r in zip(targets, rows, strict=True)], dim=1)
    goal = torch.stack([one.codes[r] for one, r in zip(targets, rows, strict=True)], dim=1)
    code = network(disturbed(words, network.one_sided) if noise else words)
    away = torch.cat([code.mean, code.log_variance], dim=-1) - goal
    return (away / torch.stack([one.deviation for one in targets])).square().mean()


@torch.no_grad()
def _error(network: PartTextEncoder, targets: list[Targets]) -> float:
    """Return the root mean square distance, in deviations."""
    return float(torch.stack([_distance(network, targets) for _ in range(20)]).mean().sqrt())
