"""Scripts that the shipped font lacks: fonts of the system by platform, merged when a text needs them."""

import sys
from pathlib import Path

import pytest

from tests.helpers import hand
from tests.helpers.app_driver import Start, message, run
from viewer.gui import system_fonts

TEXT = "元気に歩く"


def write_font(path: Path, characters: str) -> None:
    """A TrueType font with a square for each of these characters."""
    from fontTools.fontBuilder import FontBuilder
    from fontTools.pens.ttGlyphPen import TTGlyphPen

    pen = TTGlyphPen(None)
    pen.moveTo((100, 0))
    for point in ((100, 700), (800, 700), (800, 0)):
        pen.lineTo(point)
    pen.closePath()
    square, names = pen.glyph(), {ord(c): f"g{ord(c)}" for c in characters}
    order = [".notdef", *names.values()]
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder(order)
    builder.setupCharacterMap(names)
    builder.setupGlyf(dict.fromkeys(order, square))
    builder.setupHorizontalMetrics(dict.fromkeys(order, (1000, 100)))
    builder.setupHorizontalHeader(ascent=900, descent=-200)
    builder.setupNameTable({"familyName": "Squares", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(path)


def test_japanese_is_drawn_with_a_font_of_the_system(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("fontTools")
    (tmp_path / "NotoSansCJK-Regular.ttc").write_bytes(b"no font at all")
    write_font(tmp_path / "ipag.ttf", TEXT)
    monkeypatch.setitem(system_fonts.FOLDERS, sys.platform, (str(tmp_path),))
    app = start(panels=True)
    run(app, 2)
    regular = app.shell.fonts.regular
    assert not regular.is_glyph_in_font(ord(TEXT[0]))
    hand.text(app.window, "x")  # no frame is lost
    app.prompting.boxes[0].text = TEXT
    run(app, 3)
    assert all(regular.is_glyph_in_font(ord(c)) for c in TEXT)
    assert "No font" not in message(app)
