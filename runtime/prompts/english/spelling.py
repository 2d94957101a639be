"""Detects prompts that are not English, the library's only language, and corrects typing errors."""

import re
import unicodedata
from collections.abc import Iterable
from functools import cached_property

from runtime.prompts.english.words import word_set

MIN_CORRECTED_LETTERS = 5  # letters of a word that is corrected: shorter words have too many neighbours
MIN_SUBSTITUTED_LETTERS = 8  # where a letter is substituted: "lugging" is not "lagging"


# The most frequent short words of languages in Latin script that are not English words.
_FOREIGN = word_set(
    "ein eine einen einem einer eines der das dem den des und mit auf im ist wie ohne nicht sehr geht gehend "
    "mann frau kind alter alte müde sich läuft von zum zur wird "
    "un une le la les du et avec sans sur qui dans est très comme homme femme enfant marche fatigué vieux vieil "
    "el los las una unos y con sin que del muy como hombre mujer niño camina viejo cansado cansada para por "
    "il lo gli uno della dello che molto uomo donna stanco stanca vecchio cammina bambino nel sulla "
    "o os um uma com sem muito homem mulher velho cansado criança anda "
    "een het van niet zeer oude moe loopt vrouw "
    "en ett och med utan inte mycket gammal trött går kvinna gubbe et ikke og meget gammel "
    "jest się nie bardzo stary zmęczony idzie człowiek kobieta z na "
    "bir ve ile çok yaşlı yorgun adam kadın yürüyen "
    "seorang yang dan dengan tidak sangat orang lelah tua berjalan pria wanita "
    "ja vanha väsynyt mies nainen kävelee erittäin egy öreg fáradt férfi nagyon starý unavený muž žena velmi"
)
ENGLISH = word_set(
    "a an the and with while but of in to is are as who that whose his her their its this someone somebody person "
    "man woman people he she they walking walks walk running standing very like on at for from by not no without "
    "moving slowly quickly into through him them over under after before"
)
_SHARED = word_set("a an in on man y o z of do no me")  # English words, or too short to be conclusive


# "haed", "rigth": transpositions in body part names
_TURNED = {
    word[:i] + word[i + 1] + word[i] + word[i + 2 :]: word
    for word in ("left", "right", "hand", "head", "knee", "back", "neck", "shoulder", "elbow", "torso")
    for i in range(1, len(word) - 1)
    if word[i] != word[i + 1]
}


class Spelling:
    """Corrects words to `known` ones that are one letter insertion, deletion, substitution or swap away.

    `others` are words that are never corrected: "hoarse" is not "horse".
    """

    def __init__(self, known: Iterable[str], others: Iterable[str] = ()) -> None:
        self._known = frozenset(known)
        self._right = self._known.union(others)

    def corrected(self, text: str) -> tuple[str, dict[str, str]]:
        """Return the text with typing errors corrected, and the corrections by word."""
        read: dict[str, str] = {}

        def correct(match: re.Match[str]) -> str:
            word = match.group(0)
            right = _TURNED.get(word.lower()) or self.nearest(word.lower())
            if right is None:
                return word
            read[word] = right
            return right

        return re.sub(r"[^\W\d_]+(?:'[^\W\d_]+)?", correct, text), read

    def nearest(self, word: str) -> str | None:
        """Return the known word one letter away from a lower-case word, or None if the word is not a typing error."""
        right = word in self._right or self._inflected(word)
        if right or len(word) < MIN_CORRECTED_LETTERS or not word.isascii():
            return None
        found = {known for form in (word, *_shortened(word)) for known in self._forms.get(form, ())}
        near = [known for known in found if known[0] == word[0] and _one_off(word, known)]
        return min(near, key=lambda known: (abs(len(known) - len(word)), known), default=None)

    def _inflected(self, word: str) -> bool:
        """Return whether a word is an inflection of a known one."""
        endings = ("s", "es", "d", "ed", "ing", "ly", "er", "y", "ness", "ful", "less", "'s")
        stems = {word.removesuffix(ending) for ending in endings if word.endswith(ending)}
        return any(form in self._known for stem in stems for form in (stem, stem + "e", stem[:-1]))

    @cached_property
    def _forms(self) -> dict[str, tuple[str, ...]]:
        """Every known word, indexed by itself and by each form with one letter deleted."""
        forms: dict[str, tuple[str, ...]] = {}
        for word in sorted(self._known):
            if len(word) >= MIN_CORRECTED_LETTERS and word.isalpha():
                for form in (word, *_shortened(word)):
                    forms[form] = (*forms.get(form, ()), word)
        return forms


def _shortened(word: str) -> set[str]:
    return {word[:i] + word[i + 1 :] for i in range(len(word))}


def _one_off(one: str, other: str) -> bool:
    """Return whether two words differ by one insertion, deletion, substitution or transposition."""
    if len(one) != len(other):
        return abs(len(one) - len(other)) == 1
    different = [i for i, (a, b) in enumerate(zip(one, other, strict=True)) if a != b]
    if len(different) == 2:
        i, j = different
        return j == i + 1 and one[i] == other[j] and one[j] == other[i]
    return len(different) == 1 and len(one) >= MIN_SUBSTITUTED_LETTERS


def is_foreign(text: str, known: frozenset[str]) -> bool:
    """Return whether a prompt is in another script or, as far as its words tell, in another language.

    `known` are English words of the library.
    """
    letters = [c for c in text if c.isalpha()]
    if sum(not unicodedata.name(c, "").startswith("LATIN") for c in letters) > len(letters) / 2:
        return True
    words = re.findall(r"[^\W\d_]+", text.lower())
    native, other = ENGLISH | (known & set(words)) - _FOREIGN, _FOREIGN - _SHARED
    english = sum(word in native for word in words)
    foreign = sum(word in other or not (word.isascii() or word in known) for word in words)
    return foreign > english


def knows_no_word(text: str, known: frozenset[str]) -> bool:
    """Return whether no word of a prompt is a known English one."""
    return (known | ENGLISH).isdisjoint(re.findall(r"[^\W\d_]+", text.lower()))
