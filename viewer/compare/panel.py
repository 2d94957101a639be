from viewer.gui.panels import Panel, PanelPlace


def panel(view):
    return Panel("Compare", PanelPlace.LEFT, lambda _: None, shown=lambda: False)
