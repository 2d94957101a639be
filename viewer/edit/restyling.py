"""Restyling: the take that plays, whoever moved in it, walked again by a prompt as another take beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import Reference, Session, Take
from runtime.takes.restyle import PathError, path_error, restyled
from viewer.edit.resimulation import Resimulation

LATE_S = 0.15  # by which the new take may be off the time of the clip without a word


def restyle(editing: Resimulation, prompt: str) -> None:
    """Walk the take that plays along its path and at its time by a prompt, on the ground in force.

    What comes of it is a take like any other; the clip that led it stays beside it as its reference.
    """
    takes, playback = editing.takes, editing.playback
    controller = takes.scene.simulation.controller
    if playback is None or controller is None or editing.busy or not prompt.strip():
        return
    take, ground, terrain = playback.take, takes.scene.ground, takes.scene.terrain
    clip, number = playback.clip.trim(playback.first, playback.last), takes.session.counter + 1

    def work(progress: Callable[[float], None]) -> tuple[Motion, PathError]:
        walker = controller.twin()
        walker.set_terrain(terrain)
        made, inputs = restyled(clip, walker, editing.style(0, prompt, None), progress)
        made = replace(made, name=f"{take.title}, restyled", size=terrain.unit_m)
        return Motion.of(made, inputs), path_error(made, clip)

    def change(found: tuple[Motion, PathError], session: Session) -> Session:
        led = session.take(take.number)
        if led is None or led.motion != take.motion:
            return session
        made = edits.with_new_take(session, Take(motion=found[0], ground=ground), number)
        return replace(made, reference=Reference(take=take.number))

    def done(found: tuple[Motion, PathError]) -> None:
        error = found[1]
        takes.play(number)
        if error.time_s > LATE_S:
            text = f"{take.title} goes faster than these words can: the new take is {error.time_s:.1f} s off its time."
            takes.messages.warn(text)
        else:
            takes.messages.note(
                f"{take.title} restyled: {100.0 * error.path_m:.0f} cm off its path, {error.time_s:.2f} s off its time."
            )

    editing.submit(f"restyling of {take.title}", take, work, change, done, edits.with_number)
