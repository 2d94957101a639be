"""What was imported, cut and refused, for people and for programs."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runtime.controls import Gait
from runtime.skeleton import SPORT_SKELETON
from training.data.catalog import Refusal
from training.data.clip_files import TrainingClip
from training.data.labels import FOOT_JOINTS
from training.data.retarget import FPS


@dataclass(frozen=True)
class ClipSummary:
    """Numbers of one written clip."""

    name: str
    source: str
    style: str
    content: str
    split: str
    tier: str
    mirrored: bool
    seconds: float
    gait_seconds: dict[str, float]
    contact_ratio: float
    skating_cm_per_frame: float  # mean horizontal travel of feet in contact
    patches: int


@dataclass
class Report:
    """Everything one import did."""

    clips: list[ClipSummary] = field(default_factory=list)
    refused: list[Refusal] = field(default_factory=list)
    calibrations: dict[str, Any] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the report as JSON."""
        content = {
            "clips": [asdict(c) for c in self.clips],
            "refused": [asdict(r) for r in self.refused],
            "calibrations": self.calibrations,
        }
        path.write_text(json.dumps(content, indent=1), encoding="utf-8")

    def text(self) -> str:
        """The report as Markdown tables."""
        originals = [c for c in self.clips if not c.mirrored]
        total = sum(c.seconds for c in originals) / 60
        lines = [
            f"{len(originals)} clips, {total:.1f} minutes, and as many mirrored"
            f" ({sum(c.seconds for c in originals if c.split == 'held_out') / 60:.1f} minutes held out).",
            "",
        ]
        for title, key in (("Source", "source"), ("Style", "style")):
            lines += self._table(title, key, originals)
        lines += ["| Not imported, or cut | source | items |", "| --- | --- | --- |"]
        reasons = Counter((_kind(r.reason), r.source) for r in self.refused)
        lines += [f"| {reason} | {source} | {n} |" for (reason, source), n in sorted(reasons.items())]
        return "\n".join(lines) + "\n"

    @staticmethod
    def _table(title: str, key: str, clips: list[ClipSummary]) -> list[str]:
        gaits = [g.name.lower() for g in Gait]
        lines = [f"| {title} | clips | minutes | held out | {' | '.join(gaits)} | contact | skating cm/frame |"]
        lines += ["| --- " * (6 + len(gaits)) + "|"]
        groups: dict[str, list[ClipSummary]] = defaultdict(list)
        for clip in clips:
            groups[getattr(clip, key)].append(clip)
        for name, group in sorted(groups.items()):
            seconds = sum(c.seconds for c in group)
            held = sum(c.seconds for c in group if c.split == "held_out")
            per_gait = [sum(c.gait_seconds[g] for c in group) / 60 for g in gaits]
            contact = sum(c.contact_ratio * c.seconds for c in group) / seconds
            skating = sum(c.skating_cm_per_frame * c.seconds for c in group) / seconds
            minutes = " | ".join(f"{m:.1f}" for m in per_gait)
            lines.append(
                f"| {name} | {len(group)} | {seconds / 60:.1f} | {held / 60:.1f} | {minutes} | {contact:.2f} | {skating:.3f} |"
            )
        return [*lines, ""]


def _kind(reason: str) -> str:
    """A reason without its numbers."""
    return reason.split(":")[0].split(" left of ")[0]


def summarise(clip: TrainingClip) -> ClipSummary:
    """Numbers of a clip for the report."""
    positions, _ = SPORT_SKELETON.forward_kinematics(clip.hips, clip.local)
    feet = positions[:, FOOT_JOINTS]
    travel = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1)
    standing = clip.contacts[1:].astype(bool) & clip.contacts[:-1].astype(bool)
    return ClipSummary(
        clip.name, clip.source, clip.style, clip.content, clip.split, clip.tier, clip.mirrored,
        len(clip.hips) / FPS,
        {g.name.lower(): float(clip.gait[:, g].sum() / FPS) for g in Gait},
        float(clip.contacts.mean()),
        float(100.0 * travel[standing].mean()) if standing.any() else 0.0,
        len(clip.patches.heights),
    )  # fmt: skip
