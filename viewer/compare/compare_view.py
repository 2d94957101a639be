class CompareView:
    open = False
    steps = 0

    def __init__(self, *a):
        pass

    def toggle(self):
        pass

    def close(self):
        pass

    def shown(self, x):
        return []

    def advance(self, dt, c):
        return False

    def frame_all(self, *a):
        pass
