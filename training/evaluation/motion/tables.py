"""Markdown tables of an evaluation, and the criteria that a model passes or misses."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

from training.evaluation.metrics.motion import GESTURES
from training.evaluation.motion.capture import TERRAIN_GROUP
from training.markdown import number, table

SKATING = ("soles", "toe_soles", "toes")  # the strictest first: the paper's formula is zero by construction
SECTION = "motion evaluation"  # name of the markers in a document


def markdown(results: dict[str, Any]) -> str:
    """Return all tables of `results`, the content of `--json`."""
    sets, held_out = results["feature_sets"], results["held_out"]
    rows = [_held_out_row(held_out, sets), *(_model_row(model, sets) for model in results["models"])]
    head = ["", *(f"FMD, {n} features" for n in sets)]
    head += ["skating under soles / under toes / at toe joints, before lock", "after lock"]
    head += [
        "diversity T 1 / T 0",
        "network / frame (ms)",
        "parameters",
        "recognised / alike",
        "transition jerk",
        "path error (m)",
    ]
    lines = [f"`{results['command']}`", "", *table(head, rows)]
    for model in results["models"]:
        lines += [f"### {model['name']}", "", *_bars(model, held_out)]
        lines += [*_styles(model, held_out, sets), *_skating(model), *_terrain(model)]
    return "\n".join(lines) + "\n"


def _held_out_row(row: dict[str, Any], sets: Sequence[str]) -> list[str]:
    return [
        row["name"],
        *(f"{number(row['fmd'][n]['distance'], 1)}, {row['fmd'][n]['windows']} windows" for n in sets),
        "–",
        _three(mean_skating(row["skating"])),
        *("–", "–", "–"),
        _recognised(row["recognition"]),
        *("–", "–"),
    ]


def _model_row(model: dict[str, Any], sets: Sequence[str]) -> list[str]:
    fmd, diversity, times = model["following"]["fmd"], model["diversity"], model["runtime"]
    flat = [found["flat"] for gaits in model["courses"].values() for found in gaits.values()]
    return [
        f"{model['name']} ({model['decoder']})",
        *(f"{_distance(fmd[n])}, {fmd[n]['takes']['windows']} windows" for n in sets),
        *(_three([mean([c[side][m] for c in flat]) for m in SKATING]) for side in ("before", "after")),
        f"{diversity['temperature_1']:.3f} / {diversity['temperature_0']:.3f}",
        f"{times['network_ms']:.2f} / {times['frame_ms']:.2f}",
        f"{model['parameters'] / 1e6:.2f} M",
        _recognised(model["following"]["recognition"]),
        number(model["transitions"].get("ratio"), 2),
        number(mean([c["path_error_m"] for c in flat]), 2),
    ]


def _recognised(found: dict[str, Any]) -> str:
    means = f"{mean(found['score']):.2f} / {mean(found['merged_score']):.2f}"
    return f"{means}, {len(found['score'])} styles"


def mean_skating(gaits: dict[str, dict[str, float]]) -> list[float]:
    """Return the three skating measures over all frames of walking and jogging."""
    frames = sum(g["frames"] for g in gaits.values())
    return [
        sum(g[m] * g["frames"] for g in gaits.values() if g["frames"]) / frames if frames else float("nan")
        for m in SKATING
    ]


def _three(values: Sequence[float]) -> str:
    return " / ".join(number(v, 3) for v in values)


def mean(values: Sequence[float] | dict[str, float]) -> float:
    """Return the mean of values, or of a mapping's values; NaN if there are none."""
    listed = list(values.values()) if isinstance(values, dict) else list(values)
    return sum(listed) / len(listed) if listed else float("nan")


def _bars(model: dict[str, Any], held_out: dict[str, Any]) -> list[str]:
    rows = []
    for bar in check(model, held_out):
        missed = ", ".join(bar.missed[:4]) + (" …" if len(bar.missed) > 4 else "")
        rows.append([bar.name, "pass" if bar.passed else "**miss**", f"{bar.met} of {bar.cases}", missed])
    return table(["bar", "", "met by", "worst"], rows)


def _styles(model: dict[str, Any], held_out: dict[str, Any], sets: Sequence[str]) -> list[str]:
    own, target = model["following"]["recognition"], held_out["recognition"]
    rows = []
    for style, found in model["following"]["styles"].items():
        fmd, known = found["fmd"], "–"
        if style in own["score"]:
            score, taken_for = own["score"][style], own["taken_for"][style]
            known = f"{score:.2f} / {target['score'][style]:.2f}"
            known += f" ({taken_for})" if score < 0.5 and taken_for != style else ""
        windows = f"{fmd[sets[0]]['takes']['windows']} / {fmd[sets[0]]['windows']}"
        speed, error = f"{found['speed_ratio']:.2f}", f"{found['path_error_m']:.2f}"
        rows.append([style, *(_distance(fmd[n]) for n in sets), windows, known, speed, error])
    head = ["style", *(f"FMD {n}" for n in sets), "windows", "recognised: own / held out"]
    return table([*head, "speed", "path error (m)"], rows)


def _distance(found: dict[str, Any]) -> str:
    """Format the distance and, in brackets, its ratios to that between halves of the capture: whole takes, cut takes."""
    ratios = f"{number(found['takes']['ratio'], 1)} x, {number(found['ratio'], 1)} x"
    return f"{number(found['takes']['distance'], 1)} ({ratios})"


def _skating(model: dict[str, Any]) -> list[str]:
    rows = []
    for style, gaits in model["courses"].items():
        for gait, found in gaits.items():
            mark = "" if found["captured"]["held_out"] else "*"
            cells = [found["captured"], found["flat"]["before"], found["flat"]["after"]]
            cells += [found["rough"]["before"], found["rough"]["after"]]
            speed = f"{found['flat']['speed_m_s']:.2f} / {found['flat']['requested_m_s']:.2f}"
            rows.append([f"{style} {gait}{mark}", *(_three([c[m] for m in SKATING]) for c in cells), speed])
    head = ["skating under soles / under toes / at toe joints", "capture", "flat, before lock", "after"]
    return table([*head, "rough, before", "after", "m/s: real / requested"], rows)


def _terrain(model: dict[str, Any]) -> list[str]:
    keys = ("sunk_joint_p99", "sunk_sole_p95", "sunk_sole_p99", "float_p50", "float_p95", "path_error_m")
    rows = [[name, *(number(row[k], 2) for k in keys)] for name, row in model["terrain"].items()]
    head = ["ground", "joints sunk p99 (cm)", "soles sunk p95", "p99", "lowest point over ground p50", "p95"]
    return table([*head, "path error (m)"], rows)


NORMAL_STYLES = ("neutral", "neutral_bn", "neutral_bn2")
MAX_NORMAL_SKATING_CM = 0.05
ROUGH_RATIO = 1.5
HALVES_RATIO = 2.0
RECOGNITION_FRACTION = 0.8
MEASURES = {"soles": "under toes and heels", "toe_soles": "under the toes", "toes": "the paper's formula"}


@dataclass(frozen=True)
class Demand:
    """A criterion: number of cases that meet it, and those that miss it with their margins."""

    name: str
    met: int
    cases: int
    missed: tuple[str, ...]  # worst first

    @property
    def passed(self) -> bool:
        return self.cases > 0 and self.met == self.cases


def check(model: dict[str, Any], held_out: dict[str, Any]) -> list[Demand]:
    """Check all criteria on a model's scores."""
    bars = _distance_bars(model["following"])
    for measure, words in MEASURES.items():
        bars += [_bar(name.format(words), c) for name, c in _skating_cases(model["courses"], measure).items()]
    score, target = model["following"]["recognition"]["score"], held_out["recognition"]["score"]
    known = [(s, own, RECOGNITION_FRACTION * target[s]) for s, own in score.items() if target.get(s)]
    name = "style recognition: at least 80 % of the held-out capture's score"
    bars.append(_bar(name, known, least=True))
    if known:
        overall = ("mean", mean([own for _, own, _ in known]), mean([limit for _, _, limit in known]))
        bars.append(_bar("style recognition, mean over styles: the same", [overall], least=True))
    same = [("diversity", model["diversity"]["temperature_0"], 0.0)]
    return [*bars, _bar("temperature 0 is deterministic", same)]


def _distance_bars(following: dict[str, Any]) -> list[Demand]:
    """Check the distance of all walking and running styles together, then one by one."""
    bars = []
    for name, overall in following["fmd"].items():
        moving = {k: v["fmd"][name] for k, v in following["styles"].items() if _walks(k)}
        for words, whole in (("the same takes, cut in two", False), ("whole takes", True)):
            together, *cases = [
                (style, found["distance"], HALVES_RATIO * found["reference"])
                for style, both in [("all", overall), *moving.items()]
                for found in [both["takes"] if whole else both]
            ]
            bar = f"{name} distance: at most twice that of two halves of the capture, {words}"
            bars.append(_bar(f"{bar}: all styles together", [together]))
            bars.append(_bar(f"{bar}: one by one", [c for c in cases if not isnan(c[1])]))
    return bars


def _walks(group: str) -> bool:
    return group != TERRAIN_GROUP and not group.startswith(GESTURES)


def _skating_cases(courses: dict[str, Any], measure: str) -> dict[str, list[tuple[str, float, float]]]:
    """Return cases (name, value, limit) of the three skating criteria; {} in their names stands for the measure."""
    flat, normal, rough = [], [], []
    for style, gaits in courses.items():
        for gait, found in gaits.items():
            name, value = f"{style} {gait}", found["flat"]["after"][measure]
            limit = found["captured"][measure]
            if not isnan(limit):
                flat.append((name + ("" if found["captured"]["held_out"] else "*"), value, limit))
            if style in NORMAL_STYLES:
                normal.append((name, value, MAX_NORMAL_SKATING_CM))
            rough.append((name, found["rough"]["after"][measure], ROUGH_RATIO * value))
    return {
        "skating on flat ground after lock, {}: at most the capture's in the same style": flat,
        f"skating of a normal walk and jog, {{}}: at most {MAX_NORMAL_SKATING_CM} cm": normal,
        f"skating on rough ground, {{}}: at most {ROUGH_RATIO} times that on flat": rough,
    }


def _bar(name: str, cases: list[tuple[str, float, float]], least: bool = False) -> Demand:
    """Check cases (name, value, limit): values above the limit miss it, with `least` those below."""
    sign, relation = (-1.0, "<") if least else (1.0, ">")
    over = [
        (sign * (value - limit), f"{label} {value:.3g} {relation} {limit:.3g}")
        for label, value, limit in cases
    ]
    missed = sorted((c for c in over if not c[0] <= 0.0), key=lambda c: -c[0])
    return Demand(name, len(cases) - len(missed), len(cases), tuple(text for _, text in missed))
