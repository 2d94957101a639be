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
from training.data.clip_files import TrainingClip
from training.data.labels import FOOT_JOINTS
from training.data.record import Refusal
from training.data.retarget import FPS
from training.data.sets import DATA_SETS


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

    @staticmethod
    def load(path: Path) -> Report:
        """Read what `save` wrote."""
        content = json.loads(path.read_text(encoding="utf-8"))
        return Report(
            [ClipSummary(**c) for c in content["clips"]],
            [Refusal(**r) for r in content["refused"]],
            content["calibrations"],
        )

    def markdown(self) -> str:
        """The report with what a reader must know about it."""
        rows = [
            f"| {key} | {c['foot_turn_euler_yxz_degrees'][0]} | {c['toe_offset_m'][0]} | {c['ankle_height_m']} |"
            for key, c in sorted(self.calibrations.items())
        ]
        table = "| Skeleton | foot turn YXZ, degrees | toe offset, m | ankle height, m |\n| --- | --- | --- | --- |\n"
        return f"{_preface()}\n{self.text()}\n{_CALIBRATION}\n{table}" + "\n".join(rows) + "\n"

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
        gaits = [g.label for g in Gait]
        lines = [
            f"| {title} | clips | minutes | held out | {' | '.join(gaits)} | contact | skating cm/frame |"
        ]
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


_PREFACE = """# Training data

Written by `python -m training.data.importer --data DIR --out DIR --report docs/results/data.md`. `python -m training.data.contact_sheet`
draws a contact sheet of every source: left limbs orange, right limbs blue, contacts green, the ground as a grid.

Clips are retargeted by calibrated rest poses, brought to 60 Hz, cut (lead-ins, T-poses, spikes) and their feet locked
to the ground by two-bone IK. "Skating" is the horizontal travel of joints in contact, cm per frame. Names that end in
`_t` are copies of clips captured on a floor, put on random hills (up to 20 degrees) or stairs by IK: their feet are
right, their posture is that of level ground. Names that end in `_m` are mirror images, which the tables leave out.

**Heads.** Retargeted as they are, the heads of some captures look at the ground. Their faces are tilted up by a constant
angle, a third of it in the neck and two thirds in the head, which brings the median face pitch of neutral walks from
between -11 and -29 to about -6 degrees: {head_lifts}.

**Terrain.** There is about a minute of captured stairs and uneven ground (`cmu`), with a ground fitted to the feet.
`pfnn_rollouts` is distilled motion of a published network, not capture. No clip shows real climbing over walls.
The root translation of some `100style` clips (tier `estimated_root`) was estimated from foot contacts.

**Held out.** Takes of 100STYLE and JLPM longer than 20 s give their last 8 % (2 s apart from the rest); elsewhere whole
clips, about 8 %, never the only one of its style and content. Copies and mirror images follow their original.

**Credits.** {credits}.
"""
_CALIBRATION = """Calibration of the feet (left; the right mirrors it), measured where they stand flat:
"""


def _preface() -> str:
    lifts = ", ".join(
        f"`{capture}` {degrees:g}"
        for record in DATA_SETS
        for capture, degrees in record.head_lift_degrees.items()
    )
    credits = ". ".join(dict.fromkeys(record.credit for record in DATA_SETS))
    return _PREFACE.replace("{head_lifts}", lifts).replace("{credits}", credits)


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
