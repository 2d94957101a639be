"""The live links' part of the scene panel: a switch each."""

from __future__ import annotations

from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.widgets import px
from viewer.live.link import LiveLink

_RECEIVERS = {"VMC": "Unity, Warudo, VSeeFace and other VMC receivers"}


def draw(*links: LiveLink) -> None:
    """Buttons side by side that stay lit while poses are sent."""
    width = (imgui.get_content_region_avail().x - px(4) * (len(links) - 1)) / len(links)
    for number, link in enumerate(links):
        if number:
            imgui.same_line(0, px(4))
        where = "" if link.address.loopback else ", not this computer"
        whom = _RECEIVERS.get(link.name, "Blender or another program")
        hint = f"Sends the pose to {whom}, by UDP to {link.address}{where}"
        if link.on:
            hint += f"; {link.sent} poses sent"
        text = f"{link.name} :{link.address.port}" if link.on else link.name
        if widgets.toggle(f"{text}###{link.name.lower()}", link.on, width, hint) != link.on:
            link.switch()
