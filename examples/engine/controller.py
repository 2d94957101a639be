"""The controller outside this program: numpy and onnxruntime alone, one style on level ground, before foot lock.

`docs/engine.md` explains each step. `python examples/engine/controller.py` walks the shipped golden motion and a circle.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnxruntime

DT, FPS, PRESENT = 1 / 60, 60, 60  # seconds, Hz, index of the present in windows of 121 frames
STAND, WALK, JOG, CROUCH, JUMP, OTHER = range(6)
SAMPLES = np.arange(0, 120, 10)  # the network's 12 samples of the path, the present is the seventh
SOLES = [4, 5, 9, 10]  # left foot, left toe base, right foot, right toe base
SLOWED = [
    17,
    18,
    19,
    24,
    25,
    26,
    11,
    12,
    13,
    14,
    15,
    16,
]  # shoulder, arm, forearm of both sides, and the trunk
LIMBS = [20, 27, 16, 3, 8, 4, 9]  # hands, head, knees, feet
AT_REST = np.array([0.07, 0.07, 0.07, 0.05, 0.05, 0.02, 0.02])  # m/s
INPUT = {"path": 24, "facing": 24, "heights": 36, "joints": 93, "velocities": 93, "gait": 72, "phase": 130}
OUTPUT = {"path": (6, 2), "facing": (6, 2), "joints": (31, 3), "velocities": (31, 3), "root": (3,), "contacts": (4,),
          "phase": (7, 5, 2), "rotations": (31, 6)}  # fmt: skip


def kept(half_life: float) -> float:
    """Share of a difference that is left after a frame."""
    return float(0.5 ** (DT / half_life))


def angle(value):
    """Radians brought to -pi..pi."""
    return (value + np.pi) % (2 * np.pi) - np.pi


def turned(vectors, yaw):
    """World vectors (..., 2) or (..., 3) of vectors relative to a root that faces `yaw`; its negative is the inverse."""
    x, z, result = vectors[..., 0], vectors[..., -1], np.array(vectors, np.float64)
    result[..., 0], result[..., -1] = np.cos(yaw) * x + np.sin(yaw) * z, np.cos(yaw) * z - np.sin(yaw) * x
    return result


def unwrapped(angles):
    """Angles (n, m) without jumps of 2 pi along the first axis."""
    result = angles.copy()
    result[1:] -= 2 * np.pi * np.cumsum(np.round(np.diff(angles, axis=0) / (2 * np.pi)), axis=0)
    return result


def matrices(six):
    """Rotation matrices (..., 3, 3) of 6D rotations: their first two columns, made orthonormal."""
    x = six[..., :3] / np.linalg.norm(six[..., :3], axis=-1, keepdims=True)
    y = six[..., 3:] - (x * six[..., 3:]).sum(-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def left(missing, reach: float, seconds: float):
    """What is left of `missing` in each of the coming 61 frames: exponential above `reach`, linear from there to 0."""
    fast, t = np.log(max(missing / reach, 1.0)), np.arange(61) / FPS / seconds
    slow = np.maximum(min(missing, reach) - reach * (t - fast), 0.0)
    return np.where(t < fast, missing * np.exp(-t), slow)


def over(speeds, threshold: float):
    """0 below to 1 above a threshold, over a third of it to both sides."""
    t = np.clip(1.5 * (speeds / threshold - 1) + 0.5, 0, 1)
    return t * t * (3 - 2 * t)


def between(samples: int, frames: int):
    """Shares (frames, samples) of samples ten frames apart in every frame, linear; the last is kept beyond it."""
    at = np.minimum(np.arange(frames), 10 * (samples - 1))
    return np.maximum(1 - np.abs(at[:, None] - 10 * np.arange(samples)) / 10, 0.0)


def quaternions(m):
    """Unit quaternions (..., 4), w first and positive, of rotation matrices."""
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    rows = np.stack([np.stack([1 + xx + yy + zz, wx, wy, wz], -1), np.stack([wx, 1 + xx - yy - zz, xy, xz], -1),
                     np.stack([wy, xy, 1 - xx + yy - zz, yz], -1), np.stack([wz, xz, yz, 1 - xx - yy + zz], -1)], -2)  # fmt: skip
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), -1)  # the largest is the best conditioned
    q = np.take_along_axis(rows, best[..., None, None], -2)[..., 0, :]
    return q / np.linalg.norm(q, axis=-1, keepdims=True) * np.where(q[..., :1] < 0, -1, 1)


def vectors(m):
    """Rotation vectors (..., 3), axis times radians, of rotation matrices."""
    q = quaternions(m)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    return q[..., 1:] * np.where(
        length > 1e-12, 2 * np.arctan2(length, q[..., :1]) / np.maximum(length, 1e-12), 2.0
    )


def turns(v):
    """Rotation matrices (..., 3, 3) of rotation vectors (Rodrigues)."""
    size = np.linalg.norm(v, axis=-1)[..., None, None]
    zero = np.zeros(v.shape[:-1])
    k = np.stack([zero, -v[..., 2], v[..., 1], v[..., 2], zero, -v[..., 0], -v[..., 1], v[..., 0], zero], -1)
    k = k.reshape(*v.shape[:-1], 3, 3)
    return np.eye(3) + np.sinc(size / np.pi) * k + 0.5 * np.sinc(size / (2 * np.pi)) ** 2 * (k @ k)


class Noise:
    """N(0, 1) at every time and smooth over time: each number is a sum of three slow waves."""

    def __init__(self, seed: int) -> None:
        self.waves = np.random.default_rng(seed).standard_normal((6, 5 * 8 * 473), np.float32) / np.float32(
            np.sqrt(3)
        )

    def __call__(self, seconds: float):
        turns = 2 * np.pi * seconds / np.array([1.7, 2.9, 5.3])
        weights = np.concatenate([np.cos(turns), np.sin(turns)]).astype(np.float32)
        return (weights @ self.waves).reshape(1, 5, 8, 473)


class Controller:
    """One character; `step` is 1/60 s."""

    def __init__(self, model: Path, z, offsets, parents, seed=0, temperature=0.7, response=0.0) -> None:
        meta = json.loads((model / "metadata.json").read_text(encoding="utf-8"))
        session = onnxruntime.InferenceSession
        folded = session(model / "style.onnx").run(None, {"z": np.float32(z)})
        self.style = {name: value[None] for name, value in
                      zip(("front_bias", "content_weight", "content_bias"), folded, strict=False)}  # fmt: skip
        walk, jog = np.clip(folded[3][:2], [0.4, 1.2], [2.2, 5.0])
        # amplitude and turns a second of the phases at rest, by what the arms are to do
        neutral = np.float32(meta["strength"]["neutral"]).reshape(6, 64)
        arms = np.concatenate([np.float32(z)[:2], neutral[2:]])
        self.rest = session(model / "style.onnx").run(None, {"z": arms})[3][2:].reshape(2, 5)
        self.clock, self.clock_share = np.zeros(5), np.zeros(5)
        self.full = {WALK: float(walk), JOG: float(max(jog, 1.3 * walk)), CROUCH: 0.8}
        self.network = session(model / "step.onnx")
        self.noise, self.temperature, self.frame = Noise(seed), float(temperature), 0
        self.offsets, self.parents = np.float64(offsets), np.array(parents)
        y = self.split(np.array(meta["start"]["output"], np.float64))
        self.joints, self.velocities = y["joints"], np.zeros((31, 3))
        start = np.array(meta["start"]["phase"]).reshape(13, 10)
        self.phase = np.stack(
            [np.interp(np.arange(121), np.arange(0, 121, 10), c) for c in start.T], -1
        ).reshape(121, 5, 2)
        self.stand()
        self.response = response
        self.game = 0.13**response  # of the times that a body takes for a change
        self.change_s = 0.72 * np.clip(np.sqrt(1.3 / walk), 0.85, 1.12) * self.game
        self.wished = self.requested = self.smooth = self.speed = self.measured = 0.0
        self.expected = self.followed = self.stood = 0.0  # of the regulator
        self.integral, self.share, self.feet = 1.0, 1.0, self.joints[SOLES]
        self.foot_speed = self.slow = 0.0
        self.arms = self.local(matrices(y["rotations"]))[SLOWED]
        self.late, self.late_speed = np.zeros((12, 3)), np.zeros((12, 3))
        self.seen, self.usual = matrices(y["rotations"]), np.ones(7)  # world rotations relative to the root
        self.calm, self.rate, self.asked = 1.0, 1.0, 0.0

    def local(self, world):
        """Rotations (31, 3, 3) against the parents."""
        result = world.copy()
        result[1:] = np.swapaxes(world[self.parents[1:]], -1, -2) @ world[1:]
        return result

    def stand(self, gait=None) -> None:
        """A path that rests at the origin, facing +Z."""
        self.xz, self.yaw = np.zeros((121, 2)), np.zeros(121)
        self.gait = np.eye(6)[np.full(121, STAND)] if gait is None else gait
        self.wish, self.velocity, self.wish_yaw, self.wanted_yaw = np.zeros(2), np.zeros(2), 0.0, 0.0

    def settle(self, gait: int = WALK) -> None:
        """Come to rest in the style, in two seconds that are not shown."""
        for _ in range(120):
            self.step(0.0, 0.0, gait, facing=0.0)
        self.stand(self.gait)

    @staticmethod
    def split(y):
        """The named parts of an output (473,)."""
        ends = np.cumsum([np.prod(shape) for shape in OUTPUT.values()])[:-1]
        return {
            name: part.reshape(OUTPUT[name]) for name, part in zip(OUTPUT, np.split(y, ends), strict=True)
        }

    def step(self, x: float, z: float, gait: int = WALK, facing: float | None = None):
        """Hips (3,), world rotations (31, 3, 3) and joints (31, 3) 1/60 s later; `x`, `z` are the stick, at most 1 long."""
        velocity, gait, facing = self.request(x, z, gait, facing)
        self.steer(velocity, gait, facing)
        calm = 1 - 0.65 * self.gait[PRESENT, STAND]
        noise = np.float32(self.temperature * calm) * self.noise(self.frame * DT)
        self.frame += 1
        feed = {"x": self.input()[None], "noise": noise, **self.style}
        y = self.split(self.network.run(["y"], feed)[0][0].astype(np.float64))
        here, yaw = self.xz[PRESENT], self.yaw[PRESENT]
        hips, seen = self.calmed(y)
        place = np.array([here[0], 0.0, here[1]])
        hips = turned(hips, yaw) + place
        about = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        world, joints = about @ seen, np.tile(hips, (31, 1))
        local = self.slowed(self.local(world))
        for joint, parent in enumerate(self.parents[1:], 1):
            world[joint] = world[parent] @ local[joint]
            joints[joint] = joints[parent] + world[parent] @ self.offsets[joint]
        self.feed_back(y, turned(joints - place, -yaw), here, yaw)
        return hips, world, joints

    def calmed(self, y):
        """Hips (3,) and world rotations (31, 3, 3) relative to the root, as far as a body at rest moves in a frame: `self.rate` of its way."""
        new = matrices(y["rotations"])
        world, joints = new, np.tile(y["joints"][0], (31, 1))
        for joint, parent in enumerate(self.parents[1:], 1):
            joints[joint] = joints[parent] + world[parent] @ self.offsets[joint]
        speed = np.linalg.norm((joints - self.joints)[LIMBS], axis=-1) * FPS
        self.calm_down(speed, y["contacts"])
        limit = np.maximum(self.calm * self.usual, AT_REST)
        rate = min((limit / np.maximum(speed, 1e-9)).min(), 1.0)
        self.rate = rate + (self.rate - rate) * kept(0.05 * max(self.calm, 1e-3))
        if self.rate == 1:
            self.seen = new
            return y["joints"][0], new
        before, after = self.local(self.seen), self.local(new)
        world = turns(self.rate * vectors(after @ np.swapaxes(before, -1, -2))) @ before
        for joint, parent in enumerate(self.parents[1:], 1):
            world[joint] = world[parent] @ world[joint]
        self.seen = world = matrices(np.concatenate([world[..., 0], world[..., 1]], -1))  # without rounding
        return self.joints[0] + self.rate * (y["joints"][0] - self.joints[0]), world

    def calm_down(self, speed, contacts):
        """How fast limbs may be that move at `speed`: `self.calm` of their usual speed, less and less of it at rest."""
        turning = abs(angle(self.wish_yaw - self.wanted_yaw)) > 0.03
        changes = np.abs(self.gait[PRESENT] - self.gait[PRESENT - 1]).max() > 0.03
        free = self.wished == 0 and self.clock_share.max() == 0 and not turning
        if not free:
            self.usual = np.maximum(np.maximum(self.usual * kept(2.0), speed), 1.0)
        self.asked = self.asked + DT if free and self.requested < 0.25 and not changes else 0.0
        settled = self.calm * kept(0.12)
        if not (contacts.reshape(2, 2).max(-1) > 0.5).all():  # until both feet stand it steps on
            settled = max(settled, min(self.calm, 0.6))
        self.calm = settled if self.asked > 0.2 else 1 + (self.calm - 1) * kept(0.05)

    def slowed(self, local):
        """Local rotations with arms that turn by 20 rad/s at most, 0.15 at rest: what is too fast comes later, by a damped spring."""
        arms, before, rest = local[SLOWED], self.arms, self.resting()
        fastest, half_life = 20 * (0.15 / 20) ** rest, 0.2 * (0.35 / 0.2) ** rest
        self.arms = arms
        turn = vectors(arms @ np.swapaxes(before, -1, -2))
        speed = np.linalg.norm(turn, axis=-1, keepdims=True) * FPS
        if rest <= 0 and np.abs(self.late).max() <= 1e-3 and speed.max() <= 20:
            self.late, self.late_speed = np.zeros((12, 3)), np.zeros((12, 3))
            return local
        excess = turn * np.maximum(0, 1 - fastest / np.maximum(speed, 1e-9))
        late = vectors(turns(self.late) @ turns(-excess))
        rate = 2 * np.log(2) / half_life
        went, left = self.late_speed + rate * late, np.exp(-rate * DT)
        self.late, self.late_speed = left * (late + went * DT), left * (self.late_speed - rate * went * DT)
        local[SLOWED] = turns(self.late) @ arms
        return local

    def resting(self) -> float:
        """0 while the body moves or gesticulates, to 1 when its plan stands still."""
        stops = self.wished == 0
        return np.clip(1 - self.requested / 0.8, 0, 1) * (1 - self.clock_share.max()) if stops else 0.0

    def request(self, x: float, z: float, gait: int, facing: float | None):
        """The velocity, gait and facing that the stick requests."""
        size = float(np.hypot(x, z))
        x, z, amount = (x / size, z / size, 1.0) if size > 1 else (x, z, size)
        full, moving = self.full[gait], amount * self.full[gait] > 0.12
        velocity = np.array([x, z]) * full if moving else np.zeros(2)
        self.wished = amount * full if moving else 0.0
        if not moving and gait != CROUCH:
            gait = STAND
        if facing is None and moving:
            facing = np.arctan2(velocity[0], velocity[1])
        return velocity, gait, facing

    def steer(self, velocity, gait: int, facing) -> None:
        """Plan the coming second towards the request, as fast as a body changes, and blend it into the path."""
        self.wish = velocity + (self.wish - velocity) * kept(0.1) ** (1 / self.game)
        change, walk = self.velocity - self.wish, self.full[WALK]
        # seconds of a turn
        quarter = np.interp(np.hypot(*self.velocity) / walk, (0, 1, 2), (0.95, 1.25, 0.75))
        missing = np.hypot(*change)
        plan = self.wish + (left(missing, walk, self.change_s) / max(missing, 1e-9))[:, None] * change
        facing = self.wanted_yaw if facing is None else facing
        self.wish_yaw = facing + angle(self.wish_yaw - facing) * kept(0.1) ** (1 / self.game)
        turn = angle(self.wanted_yaw - self.wish_yaw)
        yaws = self.wanted_yaw - turn + np.sign(turn) * left(abs(turn), np.pi / 2, quarter * self.game)
        self.velocity, self.wanted_yaw = plan[1], yaws[1]

        slow_jog = 0.75 * self.wished if gait == JOG else np.inf
        speeds = np.hypot(plan[:, 0], plan[:, 1])
        moves, jogs = over(speeds, 0.15), over(speeds, min(0.5 * (walk + self.full[JOG]), slow_jog))
        labels = np.tile(np.eye(6)[gait], (61, 1))
        if gait in (STAND, WALK, JOG):
            labels = np.stack([1 - moves, moves * (1 - jogs), moves * jogs, *np.zeros((3, 61))], -1)
        frames = np.arange(1, 62)[:, None]
        change = self.gait[PRESENT] - labels[0]
        crouches = abs(change[CROUCH]) > 0.02  # a crouch is never sudden
        half_life = max(0.35 * self.game, 0.08) if crouches else 0.08
        self.gait[PRESENT:] = labels + change * kept(half_life) ** frames

        time = np.arange(1, 61) / 60
        plan = plan[1:] * self.gain(float(np.hypot(*self.velocity)), gait)
        steps = np.diff(self.xz[PRESENT:], axis=0)
        steps += (plan / FPS - steps) * (1 - (1 - time) ** 8)[:, None]
        self.xz[PRESENT + 1 :] = self.xz[PRESENT] + np.cumsum(steps, axis=0)
        self.yaw[PRESENT + 1 :] += angle(yaws[1:] - self.yaw[PRESENT + 1 :]) * (1 - (1 - time) ** 3)

    def gain(self, planned: float, gait: int) -> float:
        """What the speed regulator makes of the planned speed: more where the feet carry less."""
        self.smooth += (planned - self.smooth) * (1 - kept(0.25))
        self.requested, moving = planned, self.wished > 0 or planned > 0.05
        self.expected += (planned - self.expected) * (1 - kept(0.36))
        self.followed += (self.speed * self.share - self.followed) * (1 - kept(0.12))
        self.stood = self.stood + DT if self.followed < 0.4 * self.expected and moving else 0.0
        most = 3.0 if self.stood > 0.7 else 2.0
        error = np.clip((self.expected - self.followed) / max(planned, 0.12), -1, 1)
        self.integral = np.clip(self.integral + 0.6 * error * DT, 0.35, most)
        gain = np.clip(self.integral + 2.0 * error, 0.35, most)
        if not moving:
            self.expected = self.followed = 0.0
            self.integral = gain = 1.0
        if gait == JOG and self.followed < 0.8 * planned and self.stood < 0.7:  # more would be a dive
            gain = min(gain, 1.0)
        return float(gain)

    def input(self):
        """x (472,), float32; heights are 0 on level ground."""
        yaw, facing = self.yaw[PRESENT], np.stack([np.sin(self.yaw[SAMPLES]), np.cos(self.yaw[SAMPLES])], -1)
        parts = [turned(self.xz[SAMPLES] - self.xz[PRESENT], -yaw), turned(facing, -yaw), np.zeros(36), self.joints,
                 self.velocities, self.gait[SAMPLES], self.phase[::10]]  # fmt: skip
        return np.concatenate([part.ravel() for part in parts]).astype(np.float32)

    def feed_back(self, y, joints, here, yaw: float) -> None:
        """What the next frame begins from; `joints` are relative to the root."""
        self.joints, self.velocities = joints, y["velocities"] * self.rate
        forecast, shares = y["phase"], between(7, 61)
        length = shares @ np.hypot(forecast[..., 0], forecast[..., 1])
        turns = shares @ unwrapped(np.arctan2(forecast[..., 0], forecast[..., 1]))
        coming = length[..., None] * np.stack([np.sin(turns), np.cos(turns)], -1)
        now = self.phase[PRESENT]
        self.phase = np.concatenate([self.phase[1:61], coming])
        if self.rate < 1:  # the phases come a part of their way
            went = angle(np.arctan2(coming[0, :, 0], coming[0, :, 1]) - np.arctan2(now[:, 0], now[:, 1]))
            back = (self.rate - 1) * went
            s, c = coming[..., 0], coming[..., 1]
            self.phase[PRESENT:] = np.stack(
                [s * np.cos(back) + c * np.sin(back), c * np.cos(back) - s * np.sin(back)], -1
            )
        feet, before = joints[SOLES], self.feet
        self.feet = feet
        self.unstall(np.linalg.norm(feet - before, axis=-1).sum() * FPS / 4)

        resting = self.gait[PRESENT, STAND]
        self.swing_at_rest(resting > 0.9)
        velocity = turned(y["root"][:2] * self.rate, yaw)
        weights = np.clip(y["contacts"], 0, 1) ** 2
        back = (weights[:, None] * (feet - before)[:, [0, 2]]).sum(0) * FPS / max(weights.sum(), 0.25)
        firm = self.resting() * min(weights.sum() / 0.5, 1.0)  # the planted feet carry a body that stops
        velocity = velocity + (turned(-back, yaw) - velocity) * firm
        if self.wished == 0:  # no creeping at rest
            most = max(9 * self.requested, kept(0.24) ** (1 / self.game) * self.speed)
            velocity = velocity * min(1.0, most / max(np.hypot(*velocity), 1e-6))
        self.speed = float(np.hypot(*velocity))
        self.measured += (self.speed - self.measured) * (1 - kept(0.25))
        self.carry(weights.sum(), float(np.hypot(*back)))
        # strides a little longer or shorter
        if self.measured > 0.5 * self.requested and self.requested > 0.12:
            there = self.smooth / max(self.requested, 1e-9)  # a start is not overshot
            going, settled = (np.clip(v, self.response, 1) for v in (2 * there - 1, 10 * there - 9))
            longer = np.clip(self.smooth / max(self.measured, 1e-9), 0.65, 1 + 0.25 * going)
            if settled < 1 and self.gait[PRESENT, JOG] <= 0.5:
                most = max(1.12 * self.requested / max(self.speed, 1e-9), 1.0) + 0.25 * settled
                longer = min(longer, most)
            velocity = velocity * longer
        turn = y["root"][2] * self.rate * DT
        self.advance(velocity, turn, turned(y["path"], yaw + turn), turned(y["facing"], yaw + turn))

    def unstall(self, foot_speed: float) -> None:
        """Turn the phases on while the root travels and the feet hardly move."""
        self.foot_speed += (foot_speed - self.foot_speed) * (1 - kept(0.1))
        travels = self.measured > 0.5 * self.requested and self.requested > 0.3
        self.slow = self.slow + DT if travels and self.foot_speed < 0.35 * self.requested else 0.0
        if self.slow > 0.25:
            sine, cosine = self.phase[..., 0].copy(), self.phase[..., 1].copy()
            s, c = np.sin(2 * np.pi * 2 * DT), np.cos(2 * np.pi * 2 * DT)
            self.phase = np.stack([sine * c + cosine * s, cosine * c - sine * s], -1)

    def swing_at_rest(self, stands: bool) -> None:
        """Clocks for the phases of what goes on moving in a standing body, such as a waving hand."""
        swings = (self.rest[0] > 1.3) & (self.rest[1] > 0.97) & stands
        rate = np.clip(2.0 / np.maximum(self.rest[0], 1.3) * self.rest[1], 0.7, 2.0)
        now = np.arctan2(self.phase[PRESENT, :, 0], self.phase[PRESENT, :, 1]) / (2 * np.pi)
        self.clock = np.where(self.clock_share == 0, now, self.clock) + rate / FPS
        share = self.clock_share + (swings - self.clock_share) * (1 - kept(0.25))
        self.clock_share = np.where(swings | (share > 0.01), share, 0.0)
        around = 2 * np.pi * (self.clock + rate * (np.arange(-60, 61) * DT)[:, None])
        swung = 2.0 * np.stack([np.sin(around), np.cos(around)], -1)
        self.phase = self.phase + self.clock_share[:, None] * (swung - self.phase)

    def carry(self, weight: float, back: float) -> None:
        """The share of the root's speed that the planted feet carry, which the regulator goes by."""
        share = np.clip(back / max(self.measured, 0.3), 0.5, 1.5) if weight > 0.25 else self.share
        self.share += ((1.0 if self.measured < 0.3 else share) - self.share) * (1 - kept(0.3))

    def advance(self, velocity, turn: float, path, facing) -> None:
        """Move the path on by a frame: the past shifts, the coming second is the network's."""
        for window in (self.xz, self.yaw, self.gait):
            window[:PRESENT] = window[1 : PRESENT + 1].copy()
        self.xz[PRESENT] += velocity * DT
        self.yaw[PRESENT] += turn
        frames = np.arange(1, 61)
        held = between(6, 61)[1:]
        onward = held.copy()  # beyond the last sample the path goes on as it went
        onward[:, -1] += np.maximum(frames - 50, 0) / 10
        onward[:, -2] -= np.maximum(frames - 50, 0) / 10
        self.xz[PRESENT + 1 :] = self.xz[PRESENT] + onward @ (path - path[0])
        around = angle(np.arctan2(facing[:, 0], facing[:, 1]) - self.yaw[PRESENT])
        self.yaw[PRESENT + 1 :] = self.yaw[PRESENT] + held @ unwrapped(around[:, None])[:, 0]


def main() -> None:
    """Walk the golden motion and say how far the joints are from it, then walk a circle."""
    root = Path(__file__).resolve().parents[2]
    with np.load(root / "assets/golden_step.npz") as file:
        golden = {name: file[name] for name in file.files}
    model, body = root / "assets/models/compact", (golden["offsets"], golden["parents"])
    character = Controller(model, golden["z"], *body, temperature=0.0)
    shown = [character.step(x, z, int(gait), None)[2] for x, z, gait in golden["stick"]]
    print(f"golden motion: {1e3 * np.abs(np.array(shown) - golden['motion']).max():.6f} mm at most")
    character = Controller(model, golden["z"], *body, seed=1)
    character.settle()
    for frame in range(300):
        heading = frame / 60
        hips, _, _ = character.step(np.sin(heading), np.cos(heading))
        if frame % 60 == 59:
            print(
                f"{(frame + 1) / 60:.0f} s: hips at x {hips[0]:+.2f} m, y {hips[1]:.2f} m, z {hips[2]:+.2f} m"
            )


if __name__ == "__main__":
    main()
