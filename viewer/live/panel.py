"""The live link's part of the scene panel: one switch."""

from __future__ import annotations

from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.live.link import LiveLink


def draw(link: LiveLink) -> None:
    """A button that stays lit while poses are sent."""
    where = "" if link.address.loopback else ", not this computer"
    whom = (
        "Unity, Warudo, VSeeFace and other VMC receivers"
        if link.name == "VMC"
        else "Blender or another program"
    )
    hint = f"Sends the pose to {whom}, by UDP to {link.address}{where}"
    if link.on:
        hint += f"; {link.sent} poses sent"
    text = f"{link.name} to {link.address}" if link.on else link.name
    width = imgui.get_content_region_avail().x
    if widgets.toggle(f"{text}###{link.name.lower()}", link.on, width, hint) != link.on:
        link.switch()
