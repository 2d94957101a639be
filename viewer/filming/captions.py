"""Captions: the prompt in force, over the lower edge of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from runtime.takes.metadata import PromptEvent, title

SMALLEST = 8  # letters, pixels
_BACK, _INK = (20, 28, 40, 170), (240, 244, 250, 255)


def caption(prompts: Sequence[PromptEvent], seconds: float) -> str:
    """What was typed for the prompt in force at a moment, in quotation marks; "" before the first."""
    begun = [event for event in prompts if event.seconds <= seconds + 1e-6]
    if not begun:
        return ""
    last = begun[-1]
    return f"“{title(replace(last, prompt=last.typed, typed='') if last.typed else last)}”"


def write_caption(frame: NDArray[np.uint8], text: str) -> None:
    """Lay `text` over a frame `(H, W, 3)`, in place."""
    if text:
        left, top, pixels = draw_caption((frame.shape[1], frame.shape[0]), text)
        under = frame[top : top + pixels.shape[0], left : left + pixels.shape[1]]
        opacity = pixels[..., 3:] / 255.0
        under[:] = np.round(under * (1.0 - opacity) + pixels[..., :3] * opacity).astype(np.uint8)


@lru_cache(maxsize=8)
def draw_caption(size: tuple[int, int], text: str) -> tuple[int, int, NDArray[np.float32]]:
    """Left, top, and pixels `(h, w, 4)` of a caption for a frame: as large as fits, cut where even small letters do not."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGBA", size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)

    def width(letters: int) -> float:
        return draw.textlength(text, ImageFont.load_default(letters)) + 2.2 * letters

    letters = max(SMALLEST, image.height // 22)
    while letters > SMALLEST and width(letters) > 0.96 * image.width:
        letters -= 1
    while len(text) > 1 and width(letters) > 0.96 * image.width:
        text = text[:-2] + "…"
    half, middle = width(letters) / 2, image.height - 1.3 * letters
    box = (image.width / 2 - half, middle - letters, image.width / 2 + half, middle + letters)
    draw.rounded_rectangle(box, radius=letters, fill=_BACK)
    # letters are laid over the bar, not put in its place
    ink = Image.new("RGBA", size, (0, 0, 0, 0))
    font = ImageFont.load_default(letters)
    ImageDraw.Draw(ink).text((image.width / 2, middle), text, fill=_INK, font=font, anchor="mm")
    done = Image.alpha_composite(image, ink)
    left, top, right, bottom = done.getbbox() or (0, 0, 1, 1)
    return left, top, np.asarray(done.crop((left, top, right, bottom)), np.float32)
