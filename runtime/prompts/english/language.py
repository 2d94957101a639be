"""Whether a prompt is English, the only language that the library knows."""

from __future__ import annotations

import re
import unicodedata

from runtime.prompts.english.words import word_set

# The commonest little words of languages in Latin script that are no English words.
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
_SHARED = word_set("a an in on man y o z of do no me")  # English words, or too short to tell


def is_foreign(text: str, known: frozenset[str]) -> bool:
    """Whether a prompt is in another script, or in another language for all that its words tell.

    `known` are English words, the library's own.
    """
    letters = [c for c in text if c.isalpha()]
    if letters and sum(not unicodedata.name(c, "").startswith("LATIN") for c in letters) > len(letters) / 2:
        return True
    words = re.findall(r"[^\W\d_]+", text.lower())
    english = sum(word in ENGLISH or (word in known and word not in _FOREIGN) for word in words)
    foreign = sum(word in _FOREIGN and word not in _SHARED for word in words)
    foreign += sum(not word.isascii() and word not in known and word not in _FOREIGN for word in words)
    return foreign > english


def knows_no_word(text: str, known: frozenset[str]) -> bool:
    """Whether no word of a prompt is a known English one."""
    words = re.findall(r"[^\W\d_]+", text.lower())
    return not any(word in known or word in ENGLISH for word in words)
