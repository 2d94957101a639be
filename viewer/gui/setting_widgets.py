"""Widgets of settings: range, text and hint stand with the setting, in `viewer.settings`."""

from __future__ import annotations

from runtime.options import spec_of
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.settings import Settings


def slider(settings: Settings, name: str) -> None:
    """A slider of a number."""
    spec = spec_of(settings, name)
    moved, value = widgets.slider(
        f"##{name}",
        getattr(settings, name) * spec.factor,
        spec.low * spec.factor,
        spec.high * spec.factor,
        spec.label,
        spec.logarithmic,
    )
    if moved:
        setattr(settings, name, (float(round(value)) if spec.whole else value) / spec.factor)
    widgets.tooltip(spec.hint)


def drag(settings: Settings, name: str) -> None:
    """A number that is dragged or typed."""
    spec, value, flags = spec_of(settings, name), getattr(settings, name), imgui.SliderFlags_.always_clamp
    _, value = imgui.drag_float(f"##{name}", value, spec.speed, spec.low, spec.high, spec.label, flags)
    setattr(settings, name, value)
    widgets.tooltip(spec.hint)


def toggle(settings: Settings, name: str, width: float) -> None:
    """A button that stays lit while a setting is on."""
    spec = spec_of(settings, name)
    setattr(settings, name, widgets.toggle(spec.label, getattr(settings, name), width, spec.hint))


def choice(settings: Settings, name: str) -> None:
    """One of a few values side by side."""
    options = list((spec_of(settings, name).choices or {}).items())
    setattr(settings, name, widgets.segmented(name, options, getattr(settings, name)))
