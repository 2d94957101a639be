"""Style and content of each file of the data sets, or why it is left out."""

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from training.data.readers import read_json


@dataclass(frozen=True)
class Shown:
    """Style and content of a file."""

    style: str
    content: str
    tier: str = "exact"
    terrain: str = "flat"  # "flat", "rollout" (known height map) or "contacts" (to be fitted)
    # files of one skeleton and one person or studio, calibrated together; by default the source
    capture: str = ""


@dataclass(frozen=True, kw_only=True)
class ClipSource(Shown):
    """One file to import."""

    path: Path
    name: str  # unique among all sources
    source: str


@dataclass(frozen=True)
class Refusal:
    """A file, or a part of it, that is excluded from the training clips."""

    name: str
    source: str
    reason: str


Listing = tuple[list[ClipSource], list[Refusal]]


_O3DE_CONTENT = {
    "Crouching": "crouched walk", "Jumps": "mixed walk jog jump onto a platform", "Run": "run forward",
    "RunPivotTurn": "run turns", "Jog": "jog forward", "JogPivotTurn": "jog turns", "Walk": "walk forward",
}  # fmt: skip


def o3de(path: Path) -> Shown | str:
    """Open 3D Engine's motion-matching takes: neutral locomotion, crouching, jumps onto a platform."""
    take = path.stem.rstrip("0123456789")
    if take == "Pushes":
        return "pushed by another: no movement that one wants"
    content = _O3DE_CONTENT.get(take, f"mixed walk jog: {take}")
    return Shown("neutral", content, terrain="contacts" if take == "Jumps" else "flat")


# by a part of the take's name: style and content, or why it is left out
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


def accad(path: Path) -> Shown | str:
    """ACCAD, Ohio State University, two people: starts, stops, turns, side steps, skipping, crouching, runs."""
    found = next((v for word, v in _ACCAD.items() if word in path.name), None)
    if isinstance(found, str):
        return found
    person, _, take, *_ = path.stem.split("_")
    words = re.sub(r"(?<=[a-z])(?=[A-Z0-9])", " ", take).lower()
    style, content = found or ("neutral", words.replace("side step", "walk sideways"))
    return Shown(style, content, capture=f"accad_{person.lower()}")


_STYLE100_CONTENT = {
    "FW": "walk forward", "BW": "walk backward", "SW": "walk sideways", "FR": "run forward", "BR": "run backward",
    "SR": "run sideways", "ID": "idle", "TR1": "mixed transitions",
}  # fmt: skip


def style100(path: Path) -> Shown:
    """100STYLE: styles walked and run in all directions, idles and transitions."""
    style, _, code = path.stem.partition("_")
    key = re.sub(r"(?<!^)(?=[A-Z])", "_", style).lower()
    key = "neutral_100style" if key == "neutral" else key
    tier = "estimated_root" if "estimated" in path.parent.name else "exact"
    return Shown(key, _STYLE100_CONTENT.get(code, code), tier)


_BANDAI_STYLES = {
    "dataset-1": {
        "normal": "neutral_bn", "happy": "happy", "sad": "sad", "angry": "angry_bn", "proud": "proud",
        "not-confident": "not_confident", "masculinity": "masculine", "feminine": "feminine", "childish": "childish",
        "old": "old", "tired": "tired", "active": "active", "musical": "musical",
    },
    "dataset-2": {
        "active": "active2", "elderly": "elderly", "exhausted": "exhausted", "feminine": "feminine2",
        "masculine": "masculine2", "normal": "neutral_bn2", "youthful": "youthful",
    },
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


def bandai(path: Path) -> Shown | str:
    """Bandai Namco Research Motiondataset: twenty styles of walking, running and turning, and gestures."""
    dataset, content, performer, _ = path.stem.split("_")
    capture = f"bandai{dataset[-1]}"
    if content in _GESTURES:
        if performer not in _GESTURE_PERFORMERS:
            return "gesture of another performer"
        return Shown(_GESTURES[content], _GESTURES[content].replace("_", " "), capture=capture)
    if content in _BANDAI_CONTENT:
        return Shown(_BANDAI_STYLES[dataset][performer], _BANDAI_CONTENT[content], capture=capture)
    return f"not locomotion: {content}"


def bandai_name(stem: str) -> str:
    """Return the unique name of a Bandai Namco file."""
    dataset, rest = stem.split("_", 1)
    return f"bandai{dataset[-1]}_{rest}"


def longest_gestures(clips: list[ClipSource]) -> Listing:
    """Keep the longest files of each gesture and performer."""
    kept: list[ClipSource] = []
    refused: list[Refusal] = []
    gestures: dict[tuple[str, str], list[ClipSource]] = {}
    for clip in clips:
        _, content, performer, _ = clip.path.stem.split("_")
        if content in _GESTURES:
            gestures.setdefault((content, performer), []).append(clip)
        else:
            kept.append(clip)
    wanted = GESTURE_CLIPS // len(_GESTURE_PERFORMERS)
    for own in gestures.values():
        own.sort(key=lambda c: (-c.path.stat().st_size, c.path.name))
        kept += own[:wanted]
        reason = f"more than {GESTURE_CLIPS} clips of this gesture"
        refused += [Refusal(c.name, c.source, reason) for c in own[wanted:]]
    return kept, refused


_CMU_STYLES = {"exaggerated stride": "cmu_exaggerated_stride", "hop": "cmu_hop"}
_CMU_REFUSED = ("playground", "dance", "basketball", "soccer", "ladder", "grab", "jumping jacks", "balance")
_CMU_WANTED = {"walk", "run", "jog", "jump", "hop", "march", "navigate", "steps"}


@lru_cache(1)
def _cmu_descriptions(folder: Path) -> dict[str, str]:
    return read_json(folder / "index.json", "Unpack the archive again.")


def cmu(path: Path) -> Shown | str:
    """CMU motion capture: walks, runs, jumps, stairs, uneven ground."""
    text = str(_cmu_descriptions(path.parent).get(path.stem, "")).lower()
    wanted = _CMU_WANTED & set(re.findall(r"[a-z]+", text))
    if not wanted or any(word in text for word in _CMU_REFUSED):
        return f"not locomotion: {text or 'no description'}"
    style = next((key for word, key in _CMU_STYLES.items() if word in text), "neutral_cmu")
    terrain = "contacts" if "uneven" in text or "steps" in text else "flat"
    capture = "cmu_plain" if path.stem.startswith("131_") else "cmu"
    return Shown(style, text, terrain=terrain, capture=capture)


# idles and loops: AnimatedDrawings (zombie, wave), ProAnimationBank (arms crossed, a twitching stand, cycles)
FAIR: dict[str, Shown | str] = {
    "zombie": Shown("zombie", "walk forward"),
    "jumping": Shown("neutral", "jump on the spot"),
}
_ON_THE_SPOT = "a cycle on the spot: its feet slide"
SMALL: dict[str, Shown | str] = {
    "crackhead": Shown("twitching", "idle"),
    "wave_hello": Shown("wave_right_hand", "wave right hand", capture="fair_zombie"),
    "dab": "a gesture that no words ask for",
    "crossarms": "shows arms crossed, which training holds out",
    "walk": _ON_THE_SPOT,
    "jog": _ON_THE_SPOT,
    "run": _ON_THE_SPOT,
}
