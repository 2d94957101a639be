"""What is asked of a model, as sentences with pass or fail."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan
from typing import Any

from training.evaluation.motion.capture import TERRAIN_GROUP
from training.evaluation.motion.motion import GESTURES

NORMAL_STYLES = ("neutral", "neutral_bn", "neutral_bn2")
MAX_NORMAL_SKATING_CM = 0.05
ROUGH_SHARE = 1.5
HALVES_SHARE = 2.0
RECOGNITION_SHARE = 0.8
MEASURES = {
    "soles": "under toes and heels",
    "toe_soles": "under the toes",
    "toes": "the paper's formula",
}


@dataclass(frozen=True)
class Bar:
    """One demand: how many of how many cases meet it, and which miss it by how much."""

    name: str
    met: int
    cases: int
    missed: tuple[str, ...]  # worst first

    @property
    def passed(self) -> bool:
        return self.cases > 0 and self.met == self.cases


def check(model: dict[str, Any], held_out: dict[str, Any]) -> list[Bar]:
    """All bars of one model's scores."""
    bars = _distance_bars(model["following"])
    for measure, words in MEASURES.items():
        flat, normal, rough = _skating_cases(model["courses"], measure)
        bars += [
            _bar(
                f"skating on flat ground after lock, {words}: at most the capture's in the same style", flat
            ),
            _bar(f"skating of a normal walk and jog, {words}: at most {MAX_NORMAL_SKATING_CM} cm", normal),
            _bar(f"skating on rough ground, {words}: at most {ROUGH_SHARE} times that on flat", rough),
        ]
    score, target = model["following"]["recognition"]["score"], held_out["recognition"]["score"]
    shared = {
        style: (own, RECOGNITION_SHARE * target[style]) for style, own in score.items() if target.get(style)
    }
    bars.append(_at_least("style recognition: at least 80 % of the held-out capture's score", shared))
    if shared:
        mean = tuple(sum(v) / len(shared) for v in zip(*shared.values(), strict=True))
        bars.append(_at_least("style recognition, mean over styles: the same", {"mean": (mean[0], mean[1])}))
    same = model["diversity"]["temperature_0"]["pose"]
    bars.append(_bar("temperature 0 is deterministic", [("diversity", same, 0.0)]))
    return bars


def _distance_bars(following: dict[str, Any]) -> list[Bar]:
    """The distances of all walking and running styles together, then one by one."""
    bars = []
    for name, overall in following["fmd"].items():
        moving = {k: v["fmd"][name] for k, v in following["styles"].items() if _walks(k)}
        for words, of in (
            ("the same takes, cut in two", lambda found: found),
            ("whole takes", lambda found: found["takes"]),
        ):
            bar = f"{name} distance: at most twice that of two halves of the capture, {words}"
            bars.append(_bar(f"{bar}: all styles together", [_case("all", of(overall))]))
            cases = [_case(style, of(found)) for style, found in moving.items()]
            bars.append(_bar(f"{bar}: one by one", [c for c in cases if not isnan(c[1])]))
    return bars


def _walks(group: str) -> bool:
    return group != TERRAIN_GROUP and not group.startswith(GESTURES)


def _case(name: str, found: dict[str, Any]) -> tuple[str, float, float]:
    return name, found["distance"], HALVES_SHARE * found["reference"]


def _skating_cases(courses: dict[str, Any], measure: str) -> tuple[list, list, list]:
    """Cases (name, value, limit) of the three skating bars."""
    flat, normal, rough = [], [], []
    for style, gaits in courses.items():
        for gait, found in gaits.items():
            name, value = f"{style} {gait}", found["flat"]["after"][measure]
            limit = found["captured"][measure]
            if not isnan(limit):
                flat.append((name + ("" if found["captured"]["held_out"] else "*"), value, limit))
            if style in NORMAL_STYLES:
                normal.append((name, value, MAX_NORMAL_SKATING_CM))
            rough.append((name, found["rough"]["after"][measure], ROUGH_SHARE * value))
    return flat, normal, rough


def _bar(name: str, cases: list[tuple[str, float, float]]) -> Bar:
    """Of cases (name, value, limit); those with value > limit miss it."""
    missed = sorted((c for c in cases if not c[1] <= c[2]), key=lambda c: c[2] - c[1])
    return Bar(
        name,
        len(cases) - len(missed),
        len(cases),
        tuple(f"{label} {value:.3g} > {limit:.3g}" for label, value, limit in missed),
    )


def _at_least(name: str, cases: dict[str, tuple[float, float]]) -> Bar:
    """Of cases (value, limit); those with value < limit miss it."""
    missed = sorted(
        (k for k, (value, limit) in cases.items() if value < limit), key=lambda k: cases[k][0] - cases[k][1]
    )
    texts = tuple(f"{k} {cases[k][0]:.2f} < {cases[k][1]:.2f}" for k in missed)
    return Bar(name, len(cases) - len(missed), len(cases), texts)
