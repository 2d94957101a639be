"""Which files of the data sets are locomotion, and what style and content each shows."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from runtime.errors import FileError
from training.data.archives import ARCHIVES, BY_NAME

SOURCES = tuple(archive.name for archive in ARCHIVES)

_STYLE100_CONTENT = {
    "FW": "walk forward", "BW": "walk backward", "SW": "walk sideways", "FR": "run forward", "BR": "run backward",
    "SR": "run sideways", "ID": "idle", "TR1": "mixed transitions",
}  # fmt: skip
_BANDAI_1_STYLES = {
    "normal": "neutral_bn", "happy": "happy", "sad": "sad", "angry": "angry_bn", "proud": "proud",
    "not-confident": "not_confident", "masculinity": "masculine", "feminine": "feminine", "childish": "childish",
    "old": "old", "tired": "tired", "active": "active", "musical": "musical",
}  # fmt: skip
_BANDAI_2_STYLES = {
    "active": "active2", "elderly": "elderly", "exhausted": "exhausted", "feminine": "feminine2",
    "masculine": "masculine2", "normal": "neutral_bn2", "youthful": "youthful",
}  # fmt: skip
_BANDAI_CONTENT = {
    "walk": "walk forward", "run": "run forward", "dash": "dash forward", "walk-back": "walk backward",
    "walk-left": "walk left", "walk-right": "walk right", "walk-turn-left": "walk turn left",
    "walk-turn-right": "walk turn right",
}  # fmt: skip
_GESTURES = {
    f"{verb}-{hand}": f"{short}_{hand.replace('-', '_')}"
    for verb, short in (("wave", "wave"), ("raise-up", "raise"))
    for hand in ("left-hand", "right-hand", "both-hands")
}
_GESTURE_PERFORMERS = ("normal", "active", "youthful")
GESTURE_CLIPS = 12  # per gesture: standing still needs few examples
_CMU_STYLES = {"exaggerated stride": "cmu_exaggerated_stride", "hop": "cmu_hop"}
_CMU_REFUSED = ("playground", "dance", "basketball", "soccer", "ladder", "grab", "jumping jacks", "balance")


@dataclass(frozen=True)
class ClipSource:
    """One file to import."""

    path: Path
    name: str  # unique among all sources
    source: str
    style: str
    content: str
    tier: str = "exact"
    terrain: str = "flat"  # "flat", "rollout" (known height map) or "contacts" (to be fitted)

    @property
    def capture(self) -> str:
        """The clips of one skeleton and one capture, which share their calibration: the source or a part of it."""
        if self.source == "bandai_namco":
            return self.name.split("_")[0]
        if self.source == "accad":
            return "_".join(self.name.lower().split("_")[:2])
        if self.source == "100style_more":
            return "100style"
        return "cmu_plain" if self.name.startswith("cmu_131") else self.source


@dataclass(frozen=True)
class Refusal:
    """A file, or a part of it, that does not enter the data set."""

    name: str
    source: str
    reason: str


def list_clips(data: Path, free_only: bool = False) -> tuple[list[ClipSource], list[Refusal]]:
    """All clips below `data` (one folder per archive) and the files that are left out, in a stable order.

    `free_only` leaves out the archives that may not go into weights which anybody may publish.
    """
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for source in SOURCES:
        if free_only and not BY_NAME[source].free:
            refused.append(Refusal(source, source, "licence is non-commercial"))
            continue
        folder = source_folder(data, source)
        if folder is None:
            refused.append(Refusal(source, source, "archive not present"))
            continue
        found, left_out = _LISTERS[source](folder)
        clips += found
        refused += left_out
    if not clips:
        raise FileError(
            f"{data}: none of {', '.join(SOURCES)} found.", "Give the folder of the archives with --data."
        )
    return clips, refused


def source_folder(data: Path, source: str) -> Path | None:
    """Folder with the unpacked files of `source`: DATA/NAME/NAME or DATA/NAME."""
    for folder in (data / source / source, data / source):
        if folder.is_dir():
            return folder
    return None


def _list_100style(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = []
    for path in sorted(folder.rglob("*.bvh")):
        style, _, code = path.stem.partition("_")
        tier = "estimated_root" if "estimated" in path.parent.name else "exact"
        key = re.sub(r"(?<!^)(?=[A-Z])", "_", style).lower()
        key = "neutral_100style" if key == "neutral" else key
        clips.append(
            ClipSource(
                path, f"100style_{path.stem}", "100style", key, _STYLE100_CONTENT.get(code, code), tier
            )
        )
    return clips, []


def _list_bandai(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    gestures: dict[tuple[str, str], list[Path]] = {}
    for path in sorted(folder.rglob("*.bvh")):
        dataset, content, performer, _ = path.stem.split("_")
        styles = _BANDAI_1_STYLES if dataset == "dataset-1" else _BANDAI_2_STYLES
        name = _bandai_name(path)
        if content in _GESTURES and performer in _GESTURE_PERFORMERS:
            gestures.setdefault((content, performer), []).append(path)
        elif content in _GESTURES:
            refused.append(Refusal(name, "bandai_namco", "gesture of another performer"))
        elif content in _BANDAI_CONTENT:
            clips.append(ClipSource(path, name, "bandai_namco", styles[performer], _BANDAI_CONTENT[content]))
        else:
            refused.append(Refusal(name, "bandai_namco", f"not locomotion: {content}"))
    for (content, _), paths in gestures.items():
        paths.sort(key=lambda p: (-p.stat().st_size, p.name))  # the longest
        style, wanted = _GESTURES[content], GESTURE_CLIPS // len(_GESTURE_PERFORMERS)
        for path in paths[:wanted]:
            clips.append(ClipSource(path, _bandai_name(path), "bandai_namco", style, style.replace("_", " ")))
        for path in paths[wanted:]:
            refused.append(
                Refusal(
                    _bandai_name(path), "bandai_namco", f"more than {GESTURE_CLIPS} clips of this gesture"
                )
            )
    return clips, refused


def _bandai_name(path: Path) -> str:
    dataset, content, rest = path.stem.split("_", 2)
    return f"bandai{dataset[-1]}_{content}_{rest}"


def _list_cmu(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    index = folder / "index.json"
    try:
        descriptions = json.loads(index.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{index}: {error}.", "Unpack the archive again.") from error
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        text = str(descriptions.get(path.stem, "")).lower()
        name = f"cmu_{path.stem}"
        words = re.findall(r"[a-z]+", text)
        wanted = {"walk", "run", "jog", "jump", "hop", "march", "navigate", "steps"} & set(words)
        if not wanted or any(word in text for word in _CMU_REFUSED):
            refused.append(Refusal(name, "cmu", f"not locomotion: {text or 'no description'}"))
            continue
        style = next((key for word, key in _CMU_STYLES.items() if word in text), "neutral_cmu")
        terrain = "contacts" if "uneven" in text or "steps" in text else "flat"
        clips.append(ClipSource(path, name, "cmu", style, text, terrain=terrain))
    return clips, refused


def _list_jlpm(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = [
        ClipSource(p, f"jlpm_{p.stem}", "jlpm", "neutral_cmu", "mixed walk jog")
        for p in sorted(folder.glob("*.bvh"))
    ]
    return clips, []


def _list_pfnn(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = [
        ClipSource(p, f"pfnn_{p.stem}", "pfnn", "neutral_rough", "mixed locomotion")
        for p in sorted(folder.glob("*.bvh"))
    ]
    return clips, []


def _list_rollouts(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = [
        ClipSource(
            p,
            f"rollout_{p.stem}",
            "pfnn_rollouts",
            "neutral_rough",
            "mixed locomotion on terrain",
            terrain="rollout",
        )
        for p in sorted(folder.glob("*.bvh"))
    ]
    return clips, []


_O3DE_CONTENT = {
    "Crouching": "crouched walk", "Jumps": "mixed walk jog jump onto a platform", "Run": "run forward",
    "RunPivotTurn": "run turns", "Jog": "jog forward", "JogPivotTurn": "jog turns", "Walk": "walk forward",
}  # fmt: skip
_O3DE_REFUSED = {"Pushes": "pushed by somebody: no movement that one asks for"}


def _list_o3de(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        take = path.stem.rstrip("0123456789")
        name = f"o3de_{path.stem}"
        if take in _O3DE_REFUSED:
            refused.append(Refusal(name, "o3de", _O3DE_REFUSED[take]))
            continue
        content = _O3DE_CONTENT.get(take, f"mixed walk jog: {take}")
        terrain = "contacts" if take == "Jumps" else "flat"
        clips.append(ClipSource(path, name, "o3de", "neutral", content, terrain=terrain))
    return clips, refused


# what a take of ACCAD shows, by a part of its name: style and content, or why it is left out
_ACCAD: dict[str, tuple[str, str] | str] = {
    "CartWheel": "acrobatics: hands carry",
    "Crawl": "on hands and knees: contacts are those of feet",
    "Lie": "lying: contacts are those of feet",
    "Sway": "standing exercise", "Swing": "standing exercise",
    "PutDownBox": "bends to the floor with a box",
    "WithBox": ("carrying_box", "walk"),
    "SkipToStand": ("skipping", "skip"), "StandToSkip": ("skipping", "skip"), "Skip": ("skipping", "skip walk"),
    "Look": ("looking_around", "idle"), "A01_Stand": ("neutral", "idle"), "A1_Stand": ("neutral", "idle"),
    "Hop": ("neutral", "mixed walk jog hop"), "Leap": ("neutral", "walk jump"), "Jump": ("neutral", "mixed walk jog jump"),
    "WalkToRun": ("neutral", "mixed walk jog"), "RunToWalk": ("neutral", "mixed walk jog"),
    "Crouch": ("neutral", "crouch"),
}  # fmt: skip


def _list_accad(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        name = f"accad_{path.stem}"
        found = next((v for word, v in _ACCAD.items() if word in path.name), None)
        if isinstance(found, str):
            refused.append(Refusal(name, "accad", found))
            continue
        words = re.sub(r"(?<=[a-z])(?=[A-Z0-9])", " ", path.stem.split("_")[2]).lower()
        style, content = found or ("neutral", words.replace("side step", "walk sideways"))
        clips.append(ClipSource(path, name, "accad", style, content))
    return clips, refused


def _list_cmu91(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    paths = sorted(folder.glob("*.bvh"))
    return [ClipSource(p, f"cmu91_{p.stem}", "cmu91", "neutral", "jump and turn") for p in paths], []


def _list_fair(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    shown = {"zombie": ("zombie", "walk forward"), "jumping": ("neutral", "jump on the spot")}
    paths = [p for p in sorted(folder.glob("*.bvh")) if p.stem in shown]
    return [ClipSource(p, f"fair_{p.stem}", "fair_zombie", *shown[p.stem]) for p in paths], []


_LISTERS = {
    "o3de": _list_o3de,
    "accad": _list_accad,
    "100style_more": _list_100style,
    "cmu91": _list_cmu91,
    "fair_zombie": _list_fair,
    "100style": _list_100style,
    "bandai_namco": _list_bandai,
    "cmu": _list_cmu,
    "jlpm": _list_jlpm,
    "pfnn": _list_pfnn,
    "pfnn_rollouts": _list_rollouts,
}
