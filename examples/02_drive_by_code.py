"""Drives a character by code instead of a gamepad: way points, gaits, a change of style and a jump, frame by frame."""

from math import hypot

from sport import ClipRecorder, Controller, Controls, Gait, Prompter, load_model, load_terrain, save_bvh

WAY_POINTS = ((0.0, 2.0, Gait.WALK), (1.5, 3.5, Gait.JOG), (0.0, 5.0, Gait.CROUCH))  # x, z in metres
REACHED_M = 0.5
MAX_FRAMES = 900


def main() -> None:
    """Walk the way points and write `way.bvh`."""
    model, recorder = load_model(), ClipRecorder()
    to_style = Prompter(model)
    controller = Controller(model, load_terrain("hills"), seed=1)
    controller.set_style(to_style("a proud queen"), transition_seconds=0.0)
    recorder.start()
    recorder.mark_prompt("a proud queen")

    goals, pose = list(WAY_POINTS), controller.pose
    for frame in range(MAX_FRAMES):
        if frame == 90:  # the style changes over a second, while walking
            controller.set_style(to_style("a limping old man"), transition_seconds=1.0)
            recorder.mark_prompt("a limping old man", transition_seconds=1.0)
        x, z, gait = goals[0]
        dx, dz = x - float(pose.root_position[0]), z - float(pose.root_position[2])
        distance = hypot(dx, dz)
        if distance < REACHED_M:
            print(f"{frame / 60:4.1f} s: at ({x:g}, {z:g})")
            goals.pop(0)
            if not goals:
                break
            continue
        pose = controller.step(Controls(move=(dx / distance, dz / distance), gait=gait))
        recorder.add(pose)
    for frame in range(60):  # a jump, then standing with the stick at rest
        recorder.add(controller.step(Controls(gait=Gait.JUMP if frame < 3 else Gait.WALK)))

    clip = recorder.stop("way", "hills")
    print(f"{save_bvh(clip, 'way.bvh')}: {clip.seconds:.1f} s, {len(goals)} way points left")


if __name__ == "__main__":
    main()
