"""Claims of a sentence about a body part, as measures: "elbow bent sharply" is an elbow flexion of at least 65 degrees.

A claim is a pattern and a range of one measure, absolute or relative to the neutral walk, defined in words.toml. Its
fraction is the position of a walk between neutral and the range: 0 at neutral or farther away, 1 within the range.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from math import inf, isinf
from pathlib import Path
from typing import Any, NamedTuple

from runtime.measures.table import BodyMeasures, Measure, kind_of, measures_of

MAX_STEPS = 3.0  # limit of one measure's change in a sum
_SLIGHT = r"slightly|gently|a little|softly|lightly|weakly"
_FAR = r"far|deeply|widely|heavily|strongly|very|thrown"
_DEGREES = (  # patterns of slight, plain and strong degrees
    rf"(?=.*\b(?:{_SLIGHT})\b)",
    rf"(?!.*\b(?:{_SLIGHT}|{_FAR})\b)",
    rf"(?=.*\b(?:{_FAR}|hanging down|low\b))",
)


@dataclass(frozen=True)
class Claim:
    """A clause that matches `pattern` claims that `measure` is between `low` and `high`, relative to `against`.

    "is": absolute values. "plus": added to the neutral walk's value. "times": factors on the neutral walk's value.
    """

    pattern: re.Pattern[str]
    measure: Measure
    low: float
    high: float
    against: str

    def range(self, neutral: float) -> tuple[float, float]:
        """Return the lowest and highest value that satisfy the claim."""
        if self.against == "times":
            return self.low if isinf(self.low) else neutral * self.low, (
                self.high if isinf(self.high) else neutral * self.high
            )
        plus = neutral if self.against == "plus" else 0.0
        return plus + self.low, plus + self.high

    @property
    def step(self) -> float:
        """One step of the measure."""
        return self.measure.step or inf


class _Judged(NamedTuple):
    """A claim with the values of its measure in the neutral and in another walk."""

    claim: Claim
    neutral: float
    walked: float

    @property
    def kept_by_neutral(self) -> bool:
        return self._away(self.neutral) == 0.0

    @property
    def fraction(self) -> float:
        size = self._away(self.neutral) or self.claim.step
        return float(max(0.0, 1.0 - self._away(self.walked) / size))

    @property
    def excess(self) -> float:
        """By how many steps a walk exceeds a one-sided claim; 0 for claims with two limits."""
        low, high = self.claim.range(self.neutral)
        if not isinf(low) and not isinf(high):
            return 0.0
        beyond = self.walked - low if isinf(high) else high - self.walked
        size = max(self.claim.step, self._away(self.neutral))
        return min(max(beyond / size - 1.0, 0.0), MAX_STEPS)

    def _away(self, value: float) -> float:
        low, high = self.claim.range(self.neutral)
        return max(low - value, value - high, 0.0)


def clause_fraction(
    part: str, clause: str, neutral: BodyMeasures, walked: BodyMeasures
) -> tuple[float, bool] | None:
    """Return the lowest fraction of a clause's claims about a part, and whether any of them is unmet by the neutral walk.

    None if no claim matches. If any claim is unmet by the neutral walk, only such claims count.
    """
    judged = _judged(part, clause, neutral, walked)
    changes = [each for each in judged if not each.kept_by_neutral]
    return (min(each.fraction for each in changes or judged), bool(changes)) if judged else None


def clauses(sentence: str) -> list[str]:
    """Split a sentence into clauses."""
    return [clause.strip() for clause in sentence.split(",") if clause.strip()]


def sentence_fraction(part: str, sentence: str, neutral: BodyMeasures, walked: BodyMeasures) -> float | None:
    """Return the lowest fraction of a sentence's claims that the neutral walk does not meet; None if there are none."""
    judged = _judged(part, sentence, neutral, walked)
    return min((each.fraction for each in judged if not each.kept_by_neutral), default=None)


def claims(part: str, sentence: str) -> frozenset[tuple[str, str]]:
    """Return the measures of a sentence's claims, each with "more", "less" or "within"."""
    return frozenset(
        (claim.measure.name, "more" if isinf(claim.high) else "less" if isinf(claim.low) else "within")
        for claim in _made(part, sentence)
    )


def unclaimed_change(part: str, sentence: str, neutral: BodyMeasures, walked: BodyMeasures) -> float:
    """Return the unclaimed change of a part's measures in a walk, in steps, plus the excess of claimed ones."""
    claimed = {claim.measure for claim in _made(part, sentence)}
    before, now = getattr(neutral, part), getattr(walked, part)
    total = 0.0
    for name, row in measures_of(part).items():
        if row.step is not None and row not in claimed:
            total += min(abs(getattr(now, name) - getattr(before, name)) / row.step, MAX_STEPS)
    return total + sum(each.excess for each in _judged(part, sentence, neutral, walked))


def _judged(part: str, sentence: str, neutral: BodyMeasures, walked: BodyMeasures) -> list[_Judged]:
    before, now = vars(getattr(neutral, part)), vars(getattr(walked, part))
    return [_Judged(c, before[c.measure.name], now[c.measure.name]) for c in _made(part, sentence)]


def _made(part: str, sentence: str) -> list[Claim]:
    own = _known()[kind_of(part)]
    return [claim for clause in clauses(sentence) for claim in own if claim.pattern.search(clause)]


@cache
def _known() -> dict[str, list[Claim]]:
    """Read the claims of words.toml, by kind of part."""
    words = tomllib.loads(Path(__file__).with_name("words.toml").read_text("utf-8"))
    return {kind: [c for row in rows for c in _read(kind, row)] for kind, rows in words["claims"].items()}


def _read(kind: str, row: Mapping[str, Any]) -> Iterator[Claim]:
    """Yield the claim of a row, or three of slight, plain and strong degree."""
    measure, says = measures_of(kind)[row["measure"]], row["says"]
    against = next(word for word in ("is", "plus", "times") if word in row)
    if len(row[against]) == 2:
        low, high = row[against]
        yield Claim(re.compile(says), measure, low, high, against)
        return
    for degree, size in zip(_DEGREES, row[against], strict=True):
        low, high = (size, inf) if size > (1.0 if against == "times" else 0.0) else (-inf, size)
        yield Claim(re.compile(rf"^{degree}.*{says}"), measure, low, high, against)
