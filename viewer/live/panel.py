"""The live link's part of the scene panel: one switch."""

from __future__ import annotations

from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.live.link import LiveLink


def draw(link: LiveLink) -> None:
    """A button that stays lit while poses are sent."""
    where = "" if link.address.loopback else ", not this computer"
    hint = f"Sends the pose to Blender or another program, by UDP to {link.address}{where}"
    if link.on:
        hint += f"; {link.sent} poses sent"
    text = f"Live link to {link.address}" if link.on else "Live link"
    width = imgui.get_content_region_avail().x
    if widgets.toggle(f"{text}###live link", link.on, width, hint) != link.on:
        link.switch()
