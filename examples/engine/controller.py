"""The shortest loop that walks, outside this program: numpy and onnxruntime alone, one style on level ground.

`docs/engine.md` explains each step and names what the controller of this program adds. `python examples/engine/controller.py`
walks a circle.
"""

import json
from pathlib import Path

import numpy as np
import onnxruntime

DT, FPS, PRESENT = 1 / 60, 60, 60  # seconds, Hz, index of the present in windows of 121 frames
STAND, WALK, JOG, CROUCH, JUMP, OTHER = range(6)
SAMPLES = np.arange(0, 120, 10)  # the network's 12 samples of the path, the present is the seventh
INPUT = {"path": 24, "facing": 24, "heights": 36, "joints": 93, "velocities": 93, "gait": 72, "phase": 130}
OUTPUT = {"path": (6, 2), "facing": (6, 2), "joints": (31, 3), "velocities": (31, 3), "root": (3,), "contacts": (4,),
          "phase": (7, 5, 2), "rotations": (31, 6)}  # fmt: skip


def kept(half_life: float) -> float:
    """Fraction of a difference that is left after a frame."""
    return float(0.5 ** (DT / half_life))


def angle(value):
    """Radians brought to -pi..pi."""
    return (value + np.pi) % (2 * np.pi) - np.pi


def turned(vectors, yaw):
    """World vectors (..., 2) or (..., 3) of vectors relative to a root that faces `yaw`; its negative is the inverse."""
    x, z, result = vectors[..., 0], vectors[..., -1], np.array(vectors, np.float64)
    result[..., 0], result[..., -1] = np.cos(yaw) * x + np.sin(yaw) * z, np.cos(yaw) * z - np.sin(yaw) * x
    return result


def matrices(six):
    """Rotation matrices (..., 3, 3) of 6D rotations: their first two columns, made orthonormal."""
    x = six[..., :3] / np.linalg.norm(six[..., :3], axis=-1, keepdims=True)
    y = six[..., 3:] - (x * six[..., 3:]).sum(-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def every_frame(samples):
    """Samples (n, ...) ten frames apart in every frame from the first one to 60 ahead, linear; the last goes on."""
    at, own = np.arange(61), 10 * np.arange(len(samples))
    columns = samples.reshape(len(samples), -1).T
    return np.stack([np.interp(at, own, column) for column in columns], -1).reshape(61, *samples.shape[1:])


class Noise:
    """N(0, 1) at every time and smooth over time: each number is a sum of three slow waves."""

    def __init__(self, seed: int) -> None:
        waves = np.random.default_rng(seed).standard_normal((6, 5 * 8 * 473), np.float32)
        self.waves = waves / np.float32(np.sqrt(3))

    def __call__(self, seconds: float):
        turns = 2 * np.pi * seconds / np.array([1.7, 2.9, 5.3])
        weights = np.concatenate([np.cos(turns), np.sin(turns)]).astype(np.float32)
        return (weights @ self.waves).reshape(1, 5, 8, 473)


class Controller:
    """One character; `step` is 1/60 s."""

    def __init__(self, model: Path, z, offsets, parents, seed=0, temperature=0.7) -> None:
        meta = json.loads((model / "metadata.json").read_text(encoding="utf-8"))
        names = ("front_bias", "content_weight", "content_bias", "speeds")
        style = onnxruntime.InferenceSession(model / "style.onnx").run(names, {"z": np.float32(z)})
        self.style = {name: value[None] for name, value in zip(names[:3], style, strict=False)}
        self.speed_of = {WALK: float(style[3][0]), JOG: float(style[3][1]), CROUCH: 0.8}
        self.network = onnxruntime.InferenceSession(model / "step.onnx")
        self.noise, self.temperature, self.frame = Noise(seed), temperature, 0
        self.offsets, self.parents = np.float64(offsets), np.array(parents)
        y = self.split(np.array(meta["start"]["output"], np.float64))
        self.joints, self.velocities = y["joints"], np.zeros((31, 3))
        phase, at = np.array(meta["start"]["phase"]).reshape(13, 10), np.arange(0, 121, 10)
        self.phase = np.stack([np.interp(np.arange(121), at, c) for c in phase.T], -1).reshape(121, 5, 2)
        self.xz, self.yaw = (
            np.zeros((121, 2)),
            np.zeros(121),
        )  # the path: a second back, the present, a second on
        self.gait = np.eye(6)[np.full(121, STAND)]

    @staticmethod
    def split(y):
        """The named parts of an output (473,)."""
        ends = np.cumsum([np.prod(shape) for shape in OUTPUT.values()])[:-1]
        parts = zip(OUTPUT.items(), np.split(y, ends), strict=True)
        return {name: part.reshape(shape) for (name, shape), part in parts}

    def step(self, x: float, z: float, gait: int = WALK):
        """Hips (3,), world rotations (31, 3, 3) and joints (31, 3) 1/60 s later; `x`, `z` are the stick, at most 1 long."""
        self.steer(np.array([x, z]) * self.speed_of[gait], gait)
        feed = {
            "x": self.input()[None],
            "noise": self.temperature * self.noise(self.frame * DT),
            **self.style,
        }
        feed["noise"] = feed["noise"].astype(np.float32)
        y = self.split(self.network.run(["y"], feed)[0][0].astype(np.float64))
        self.frame += 1
        here, yaw = self.xz[PRESENT].copy(), self.yaw[PRESENT]
        place = np.array([here[0], 0.0, here[1]])
        hips = turned(y["joints"][0], yaw) + place
        about = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        world, joints = about @ matrices(y["rotations"]), np.tile(hips, (31, 1))
        for joint, parent in enumerate(self.parents[1:], 1):
            joints[joint] = joints[parent] + world[parent] @ self.offsets[joint]
        self.feed_back(y, turned(joints - place, -yaw))
        return hips, world, joints

    def steer(self, velocity, gait: int) -> None:
        """Blend the coming second of the path towards a velocity (m/s), and its gait to what that asks for."""
        moves = bool(np.hypot(*velocity) > 0.1)
        heading = np.arctan2(*velocity) if moves else self.yaw[PRESENT]
        time = np.arange(1, 61) / 60
        steps = np.diff(self.xz[PRESENT:], axis=0)
        steps += (velocity / FPS - steps) * (1 - (1 - time) ** 2)[:, None]
        self.xz[PRESENT + 1 :] = self.xz[PRESENT] + np.cumsum(steps, axis=0)
        self.yaw[PRESENT + 1 :] += angle(heading - self.yaw[PRESENT + 1 :]) * (1 - (1 - time) ** 2)
        wanted = np.eye(6)[gait if moves or gait == CROUCH else STAND]
        self.gait[PRESENT:] = wanted + (self.gait[PRESENT] - wanted) * kept(0.08) ** np.arange(1, 62)[:, None]

    def input(self):
        """x (472,), float32; heights are 0 on level ground."""
        yaw, facing = self.yaw[PRESENT], np.stack([np.sin(self.yaw[SAMPLES]), np.cos(self.yaw[SAMPLES])], -1)
        parts = [turned(self.xz[SAMPLES] - self.xz[PRESENT], -yaw), turned(facing, -yaw), np.zeros(36), self.joints,
                 self.velocities, self.gait[SAMPLES], self.phase[::10]]  # fmt: skip
        return np.concatenate([part.ravel() for part in parts]).astype(np.float32)

    def feed_back(self, y, joints) -> None:
        """What the next frame begins from; `joints` are relative to the root."""
        self.joints, self.velocities = joints, y["velocities"]
        amplitude = every_frame(np.hypot(y["phase"][..., 0], y["phase"][..., 1]))
        turns = every_frame(np.unwrap(np.arctan2(y["phase"][..., 0], y["phase"][..., 1]), axis=0))
        coming = amplitude[..., None] * np.stack([np.sin(turns), np.cos(turns)], -1)
        self.phase = np.concatenate([self.phase[1:61], coming])
        yaw, turn = self.yaw[PRESENT], y["root"][2] * DT
        for window in (
            self.xz,
            self.yaw,
            self.gait,
        ):  # the past shifts by a frame, the coming second is the network's
            window[:PRESENT] = window[1 : PRESENT + 1].copy()
        self.xz[PRESENT] += turned(y["root"][:2], yaw) * DT
        self.yaw[PRESENT] += turn
        path, facing = turned(y["path"], yaw + turn), turned(y["facing"], yaw + turn)
        around = np.unwrap(angle(np.arctan2(facing[:, 0], facing[:, 1]) - self.yaw[PRESENT]))
        self.xz[PRESENT + 1 :] = self.xz[PRESENT] + every_frame(path - path[0])[1:]
        self.xz[PRESENT + 51 :] += (path[5] - path[4]) * np.arange(1, 11)[:, None] / 10  # goes on as it went
        self.yaw[PRESENT + 1 :] = self.yaw[PRESENT] + every_frame(around)[1:]


def main() -> None:
    """Walk a circle of 6 s and say where the hips are."""
    root = Path(__file__).resolve().parents[2]
    with np.load(root / "assets/golden_step.npz") as file:
        golden = {name: file[name] for name in file.files}
    model = root / "assets/models/compact"
    character = Controller(model, golden["z"], golden["offsets"], golden["parents"], seed=1)
    for frame in range(360):
        heading = frame / 60
        hips, _, _ = character.step(np.sin(heading), np.cos(heading))
        if frame % 60 == 59:
            second, (x, y, z) = (frame + 1) // 60, hips
            print(f"{second} s: hips at x {x:+.2f} m, y {y:.2f} m, z {z:+.2f} m")


if __name__ == "__main__":
    main()
