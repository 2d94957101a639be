"""Draws scripts that the shipped font lacks, such as Japanese, with fonts of the system."""

import logging
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from viewer.gl_bindings import imgui
from viewer.gui.theme import FONT_SIZE_PX

# By script, preferred ones first, in lower case.
NAMES: dict[str, tuple[str, ...]] = {
    "Chinese and Japanese": (
        "notosanscjk-regular.ttc", "notosanscjkjp-regular.otf", "notosansjp-regular.otf", "notosansjp-regular.ttf",
        "yugothm.ttc", "yugothr.ttc", "meiryo.ttc", "msgothic.ttc", "msyh.ttc", "simsun.ttc",
        "ヒラギノ角ゴシック w3.ttc", "hiragino sans gb.ttc", "pingfang.ttc", "arial unicode.ttf",
        "takaopgothic.ttf", "ipagp.ttf", "ipag.ttf", "vl-gothic-regular.ttf", "wqy-microhei.ttc", "wqy-zenhei.ttc",
        "droidsansfallbackfull.ttf", "droidsansfallback.ttf", "unifont.ttf", "unifont.otf",
    ),
    "Korean": ("malgun.ttf", "applesdgothicneo.ttc", "nanumgothic.ttf", "notosanskr-regular.otf", "notosanskr-regular.ttf"),
    "other scripts": (
        "dejavusans.ttf", "segoeui.ttf", "seguisym.ttf", "tahoma.ttf", "notosans-regular.ttf", "freesans.ttf",
        "nirmala.ttf", "nirmala.ttc", "leelawui.ttf", "geeza pro.ttc", "geezapro.ttc", "kohinoor.ttc", "thonburi.ttc",
        "notosansarabic-regular.ttf", "notosanshebrew-regular.ttf", "notosansdevanagari-regular.ttf",
        "notosansthai-regular.ttf", "apple symbols.ttf",
    ),
}  # fmt: skip
FOLDERS: dict[str, tuple[str, ...]] = {
    "linux": ("~/.local/share/fonts", "~/.fonts", "/usr/local/share/fonts", "/usr/share/fonts"),
    "darwin": ("~/Library/Fonts", "/Library/Fonts", "/System/Library/Fonts"),
    "win32": ("${LOCALAPPDATA}/Microsoft/Windows/Fonts", "${WINDIR}/Fonts"),
}
FIRST_CODE = 0x0250  # code point of the first character that may be missing
_LOG = logging.getLogger("sport.viewer")


def find_fonts() -> list[Path]:
    """Return the installed fonts of `NAMES`, in that order, user fonts before system fonts."""
    known = [name for names in NAMES.values() for name in names]
    found: dict[str, Path] = {}
    for folder in FOLDERS.get(sys.platform, FOLDERS["linux"]):
        for root, _, files in os.walk(os.path.expanduser(os.path.expandvars(folder))):
            for name in files:
                if name.lower() in known:
                    found.setdefault(name.lower(), Path(root) / name)
    return [found[name] for name in known if name in found]


@dataclass
class SystemFonts:
    """Adds system fonts to the panels' font when a text first needs them."""

    regular: Any
    _seen: set[str] = field(default_factory=set)  # characters already checked
    _rest: list[Path] | None = None  # fonts not loaded yet; None before the first search

    def cover(self, texts: Iterable[str]) -> str:
        """Load fonts for new characters; return those that no font contains."""
        new = {c for text in texts if not text.isascii() for c in text if ord(c) >= FIRST_CODE} - self._seen
        self._seen |= new
        missing = self._lacking(new)
        if missing and self._rest is None:
            self._rest = find_fonts()
        while missing and self._rest:
            self._merge(self._rest.pop(0))
            missing = self._lacking(missing)
        return "".join(sorted(missing))

    def _lacking(self, characters: set[str]) -> set[str]:
        return {c for c in characters if not self.regular.is_glyph_in_font(ord(c))}

    def _merge(self, path: Path) -> None:
        config = imgui.ImFontConfig()
        config.merge_mode, config.dst_font = True, self.regular
        try:
            imgui.get_io().fonts.add_font_from_file_ttf(str(path), FONT_SIZE_PX, config)
        except RuntimeError:  # ImGui's error for an invalid font
            _LOG.warning("%s: this font cannot be read.", path)
            return
        _LOG.info("Font %s", path)
