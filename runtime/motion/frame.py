"""One frame of N characters: `step` shows the whole sequence of 1/60 s from top to bottom.

The same function steps one character and a crowd.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, degrees, inf, pi, radians
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, Flags
from runtime.controls import Controls, Gait
from runtime.edits.body import EditedPose
from runtime.edits.request import EditRequest
from runtime.feet.foot_lock import Support
from runtime.motion import features
from runtime.motion.features import DT, InputParts, OutputParts, split_output
from runtime.motion.limbs import KEYFRAMED, LIMBS, resolve_penetration
from runtime.motion.model import MotionModel, drifting_noise
from runtime.motion.pace import STALLED_RATE_HZ, advance_by_cycles
from runtime.motion.phase import advance_phase, at_rate
from runtime.motion.pose_smoothing import ADDED_PATIENCE_FRACTION
from runtime.motion.request import probe_paths, read_request, root_velocity_of, steer
from runtime.motion.root_motion import rest_share, root_velocity, settled_pose
from runtime.motion.state import CharacterState, bound_speed, network_pose, placed, shown_poses, standing
from runtime.motion.style import Style
from runtime.motion.swing import composed_fraction
from runtime.motion.trajectory import PRESENT, SAMPLES
from runtime.records import copied, joined, part
from runtime.scalar_math import Vector
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import EDGE_M, RUN_M
from runtime.terrain.room import has_walls
from runtime.terrain.steps import within_steps
from runtime.traversal.obstacle_probe import CLEAR, ObstacleProbe
from runtime.traversal.plan import decide
from runtime.traversal.traversal import end_when_over
from runtime.traversal.traversal_frame import seen_heights, traversal_pose

MAX_OUTPUT = 1e4  # metres, m/s, rad/s: larger outputs are faults, and would lose bone lengths to rounding
REST_TEMPERATURE = 0.35  # of the temperature, while standing: breathing and shifts of weight remain
MIN_GAIT_SPEED_M_PER_S = 0.3  # m/s; slower, feet may rest for a while without a stall
STEADY_SPEED_FRACTION = 0.7  # of the planned speed: below it, a body is still starting and does not swing yet
# radians a second, averaged over this many frames: faster, the walk is turning
TURN_FRAMES, MAX_WALKING_TURN_RAD_PER_S = 6, 0.7
MAX_LIFT_M_PER_S = 3.0  # m/s, of the ground height under the body: jogging up a wall of 1 m takes 2.5
# minimum flexion of a jogging knee: captured jogs extend to 11 to 25 degrees, the network's to 3
JOGGING_KNEE_RAD = radians(12.0)
FUTURE = len(features.FUTURE_OFFSETS)
NECK = SPORT_SKELETON.index("Neck")
ANKLES = [SPORT_SKELETON.index("LeftFoot"), SPORT_SKELETON.index("RightFoot")]
_PHASES = features.PHASE_OFFSETS + PRESENT


class Frame(NamedTuple):
    """Results of a frame other than the new state."""

    hips: Array  # (N, 3) before foot lock: the network's, arms inertialised in a blend, or keyframed
    local: Array  # (N, 31, 4)
    reasons: tuple[str | None, ...]  # why a character is blocked
    faults: Flags  # (N,) the network's output was invalid (`MAX_OUTPUT`): the character was reset to standing

    def part(self, index: int) -> Frame:
        """Return the frame of one character."""
        one = slice(index, index + 1)
        return Frame(self.hips[one], self.local[one], self.reasons[one], self.faults[one])


def step(
    model: MotionModel,
    state: CharacterState,
    controls: Sequence[Controls],
    terrain: Terrain,
    temperature: Sequence[float],
    response: Sequence[float],
) -> tuple[CharacterState, Frame]:
    """Return the state 1/60 s later and the frame; `state` is not changed.

    `controls`, `temperature` (of the sampler) and `response` (see `trajectory`) have one entry per character.
    """
    before, state = state, copied(state)
    state.styles = tuple(style.advanced(DT) for style in state.styles)
    styles = state.walkable.styles(model, state.styles)

    probes = probe_paths(model, state, controls, terrain)
    request = read_request(state, controls, probes, styles)
    # at an obstacle the body responds without smoothing
    haste = [
        1.0 if probe.finds or traversal.kind else usual
        for probe, traversal, usual in zip(probes, state.traversals, response, strict=True)
    ]
    steer(state, request, styles, haste)

    x = _input(state, probes, terrain)
    noise = _noise(model, state, temperature)
    state.frame = state.frame + 1
    flat = _network(model, x, noise, styles)
    sound: Flags = np.maximum.reduce(np.abs(flat), -1) < MAX_OUTPUT  # also false for NaN
    if not all(sound.tolist()):
        flat[~sound] = 0.0  # these characters are reset below
    y = split_output(flat.astype(np.float64))

    local, joints = settled_pose(state, *network_pose(y), y.contacts)
    blending = [blend.blending for blend in state.styles]
    inertialised = state.arms.apply(local, blending, rest_share(state))
    if any(inertialised):
        hips = joints[inertialised, 0]
        joints[inertialised] = SPORT_SKELETON.forward_kinematics(hips, local[inertialised])[0]
    # the feet of a settled body stay in place
    contacts = np.maximum(
        np.minimum(np.maximum(y.contacts, 0.0), 1.0), 1.0 - state.settling.fraction[:, None]
    )
    gains = [style.swings for style in styles]
    steady = _steady(state, state.measured_speed)
    walks = state.trajectory.gait[:, PRESENT, Gait.WALK].tolist()
    walking = [goes and walk > 0.5 for goes, walk in zip(steady, walks, strict=True)]
    swung = state.swings.apply(joints[:, 0], local, contacts, gains, walking)
    network = placed(*swung, state.trajectory, state.ground)
    even = _undisturbed(state, probes, steady)
    balanced = _undisturbed(state, probes, _steady(state, state.root_speed))
    shifts = _watch_strides(state, even, balanced, [composed_fraction(own) for own in gains])
    unlocked = _plant(state, *network, joints, contacts, shifts, even, terrain)
    _cross(state, unlocked, network, probes, styles)
    _feed_back(state, y, joints, probes, styles, terrain, haste)

    reasons = tuple(probe.reason for probe in probes)
    state = _set_back(model, before, state, sound, terrain)
    bound_speed(state.poses, before.poses)
    return state, Frame(*unlocked, reasons, ~sound)


def _steady(state: CharacterState, speed: Array) -> list[bool]:
    """Return which characters, at root speeds `(N,)` in m/s, walk steadily ahead, rather than start, stop, turn or jump."""
    turned = state.trajectory.yaw[:, PRESENT] - state.trajectory.yaw[:, PRESENT - TURN_FRAMES]
    numbers = (state.wished_speed, speed, state.requested_speed, turned)
    most = MAX_WALKING_TURN_RAD_PER_S * TURN_FRAMES * DT
    return [
        wished > 0.0
        and goes > STEADY_SPEED_FRACTION * requested
        and abs((turn + pi) % (2.0 * pi) - pi) < most
        and not jump.stage
        for wished, goes, requested, turn, jump in zip(
            *(n.tolist() for n in numbers), state.jumps, strict=True
        )
    ]


def _undisturbed(
    state: CharacterState, probes: Sequence[ObstacleProbe], steady: Sequence[bool]
) -> list[bool]:
    """Return which of the `steady` characters have no obstacle ahead, traverse none, and are on no beam."""
    return [
        goes and probe is CLEAR and not traversal.kind and not feet.on_beam
        for goes, probe, traversal, feet in zip(steady, probes, state.traversals, state.feet, strict=True)
    ]


def _watch_strides(
    state: CharacterState, even: Sequence[bool], balanced: Sequence[bool], composed: Sequence[float]
) -> list[Vector]:
    """Return the hip displacements (metres) of `balanced` characters; updates their walkability from walks on `even` ground."""
    stands = [(bool(left), bool(right)) for left, right in (feet.held for feet in state.feet)]
    heights = state.poses.hips[:, 1].astype(np.float64) - state.ground
    walks = (state.trajectory.gait[:, PRESENT, Gait.JOG] < 0.5).tolist()
    blending = [blend.blending for blend in state.styles]
    state.walkable.update(heights, stands, walks, even, blending)
    shifts = state.balance.update(
        state.poses.positions, state.ground, state.trajectory.velocity, stands, balanced, composed
    )
    return [(x, 0.0, z) for x, z in shifts.tolist()]


def _input(state: CharacterState, probes: Sequence[ObstacleProbe], terrain: Terrain) -> Array:
    """x `(N, 472)`; updates the ground height under the bodies."""
    path, present = state.trajectory, features.L // 2
    positions, yaw = path.xz.take(SAMPLES, 1), path.yaw.take(SAMPLES, 1)
    directions = np.stack([np.sin(yaw), np.cos(yaw)], axis=-1)
    if terrain.steepest == 0.0:
        heights = np.full((*yaw.shape, 3), float(terrain.heights[0, 0]))
    elif terrain.steepest * RUN_M < EDGE_M:
        points = features.height_points(positions, directions)
        heights = within_steps(terrain.height(points[..., 0], points[..., 1]), present)
    else:
        mean = np.repeat(features.mean_heights(terrain, positions)[..., None], 3, axis=-1)
        along = within_steps(mean, present)[..., 0]
        for i, (traversal, probe) in enumerate(zip(state.traversals, probes, strict=True)):
            seen = seen_heights(traversal, positions[i], along[i], present, probe.ahead)
            along[i] = seen if state.feet[i].on_beam else features.softened(seen)
        heights = np.repeat(along[..., None], 3, axis=-1)
    ground = features.ground_height(heights)
    parts = InputParts(
        root_position=path.here,
        root_yaw=path.yaw[:, PRESENT],
        trajectory_positions=positions,
        trajectory_directions=directions,
        heights=heights,
        gait=path.gait.take(SAMPLES, 1),
        phase=state.phase.take(_PHASES, 1),
        joint_positions=state.joints,
        joint_velocities=state.velocities,
    )
    most = MAX_LIFT_M_PER_S * DT
    state.ground = np.minimum(np.maximum(ground, state.ground - most), state.ground + most)
    return features.build_input(parts, ground)


def _noise(model: MotionModel, state: CharacterState, temperature: Sequence[float]) -> list[Array]:
    """Return the sampler's noise of every character, reduced while it stands."""
    shape, stands = (1, *model.noise_shape), state.trajectory.gait[:, PRESENT, Gait.STAND].tolist()
    return [
        drifting_noise(shape, seed, frame * DT, max(most * (1.0 - (1.0 - REST_TEMPERATURE) * still), 0.0))
        for most, still, seed, frame in zip(
            temperature, stands, state.seed.tolist(), state.frame.tolist(), strict=True
        )
    ]


def _network(model: MotionModel, x: Array, noise: Sequence[Array], styles: Sequence[Style]) -> Array:
    """y `(N, 473)`.

    In full precision many characters are one batch. With 8-bit weights each has a call of its own: activations are scaled
    by the largest in a call, so that in a batch every character would depend on its neighbours.
    """
    if model.batches and len(x) > 1:
        return model.step(x, np.concatenate(noise), styles)[0]
    return np.concatenate([model.step(x[i : i + 1], noise[i], style)[0] for i, style in enumerate(styles)])


def _plant(
    state: CharacterState,
    hips: Array,
    local: Array,
    joints: Array,
    contacts: Array,
    shifts: Sequence[Vector],
    even: Sequence[bool],
    terrain: Terrain,
) -> tuple[Array, Array]:
    """Compute the poses to show: keyframed over an obstacle, else the network's with planted feet and the prompt's body edits.

    Returns hips `(N, 3)` and local rotations `(N, 31, 4)` before the foot lock.
    """
    unlocked = hips.copy(), local.copy(), contacts
    shown_hips, shown_local = np.empty_like(hips), np.empty_like(local)
    turned = []  # per character: local rotations of the last frame, and the limbs that walls may turn
    for i, traversal in enumerate(state.traversals):
        if traversal.kind:
            shown, before, limbs = _keyframed(state, i, unlocked, terrain), state.poses.local[i], KEYFRAMED
        else:
            stood = state.feet[i].feet[0].incoming is not None
            shown = _on_feet(state, i, unlocked, joints[i], shifts[i], even[i], terrain)
            # a body that was not standing is on ground that has just appeared under it
            before, limbs = state.poses.local[i] if stood else shown[1], LIMBS
        shown_hips[i], shown_local[i] = shown
        turned.append((before, limbs))
    state.hands.apply(shown_hips, shown_local, state.poses.positions, state.poses.local, _stopping(state))
    state.elbows.apply(shown_local, [not traversal.kind for traversal in state.traversals])
    if has_walls(terrain):
        for i, (before, limbs) in enumerate(turned):
            shown_local[i] = resolve_penetration(shown_hips[i], shown_local[i], before, terrain, limbs)
    state.poses = shown_poses(shown_hips, shown_local, contacts, state.trajectory, terrain)
    return unlocked[0], unlocked[1]


def _stopping(state: CharacterState) -> list[bool]:
    """Return which characters come to rest: nothing is requested of them, and no style is blended."""
    return [
        wished == 0.0 and not traversal.kind and not jump.stage and not style.blending
        for wished, traversal, jump, style in zip(
            state.wished_speed.tolist(), state.traversals, state.jumps, state.styles, strict=True
        )
    ]


def _keyframed(
    state: CharacterState, i: int, unlocked: tuple[Array, Array, Array], terrain: Terrain
) -> tuple[Array, Array]:
    """Return the pose of a character over its obstacle, and write it into `unlocked`: hips, local rotations, contacts."""
    hips, local, contacts = unlocked
    ground = float(state.ground[i])
    posed = traversal_pose(state.traversals[i], hips[i], local[i], ground, state.poses.pose(i), terrain)
    state.jumps[i].cancel(float(hips[i, 1]))
    state.edits[i].reset()
    hips[i], local[i], contacts[i] = posed
    return posed[0], posed[1]


def _on_feet(
    state: CharacterState,
    i: int,
    unlocked: tuple[Array, Array, Array],
    joints: Array,
    shift: Vector,
    even: bool,
    terrain: Terrain,
) -> tuple[Array, Array]:
    """Return the pose of a character with planted feet; a jump is written into `unlocked`."""
    (hips, local, contacts), jump = unlocked, state.jumps[i]
    root = root_velocity_of(state, i) if jump.stage else (0.0, 0.0)
    jump.advance(float(hips[i, 1]), float(state.ground[i]), root)
    if jump.stage:
        hips[i], local[i], contacts[i] = jump.pose(hips[i], local[i], contacts[i], terrain)
    edited = EditedPose(hips[i], local[i], contacts[i])
    if (asked := _edit_request(state, i, joints)) is not None:
        edited = state.edits[i].apply(*edited[:3], asked)
    if any(shift):
        edited = edited.moved(shift)
    patience = 1.0 + ADDED_PATIENCE_FRACTION * (1.0 - float(state.settling.fraction[i]))
    jogs = float(state.trajectory.gait[i, PRESENT, Gait.JOG])
    over, walks, bend = state.traversals[i].over, even and jogs < 0.5, jogs * JOGGING_KNEE_RAD
    support = Support(jump.airborne, patience, edited.legs, over, walks, bend)
    locked = state.feet[i].apply(edited.hips, edited.local, edited.contacts, terrain, DT, support)
    return locked.hips_position, locked.local_rotations


def _edit_request(state: CharacterState, index: int, joints: Array) -> EditRequest | None:
    """Return the body edits of a character, whose network joints `(31, 3)` are relative to its root.

    None if its prompt asks for none, none is fading out, and the trunk is not about to fold.
    """
    style, edits, path = state.styles[index].style, state.edits[index], state.trajectory
    shown = path.gait[index, PRESENT]
    gait = 1 if shown[Gait.JOG] > 0.5 else 2 if shown[Gait.CROUCH] > 0.5 else 0
    fold, folds = style.folds[gait], False
    if fold < inf:
        left, up, ahead = (joints[NECK] - joints[0]).tolist()
        folds = edits.trunk.watch(degrees(atan2(ahead, up)), degrees(atan2(left, up)), fold)
    if not (folds or style.is_edited[gait] or edits.active):
        return None
    x, z = path.velocity[index].tolist()
    left, right = state.poses.positions[index, ANKLES].tolist()
    yaw, ground = float(path.yaw[index, PRESENT]), float(state.ground[index])
    return EditRequest(style.asked[gait], yaw, (x, z), ground, (tuple(left), tuple(right)))


def _cross(
    state: CharacterState,
    unlocked: tuple[Array, Array],
    network: tuple[Array, Array],
    probes: Sequence[ObstacleProbe],
    styles: Sequence[Style],
) -> None:
    """End a traversal, or begin one from the shown pose."""
    for i, (traversal, feet) in enumerate(zip(state.traversals, state.feet, strict=True)):
        if traversal.kind:
            if end_when_over(traversal):
                feet.take_over((unlocked[0][i], unlocked[1][i]), (network[0][i], network[1][i]))
        else:
            speed = float(state.measured_speed[i])
            ahead = None if state.jumps[i].active else probes[i].ahead
            decide(traversal, state.poses.pose(i), feet.held, speed, styles[i].speeds[0], ahead)


def _feed_back(
    state: CharacterState,
    y: OutputParts,
    joints: Array,
    probes: Sequence[ObstacleProbe],
    styles: Sequence[Style],
    terrain: Terrain,
    response: Sequence[float],
) -> None:
    """Compute the next frame's input: body, phase and trajectory from the network's pose on the fixed skeleton, before foot lock.

    Training data has no poses after foot lock; the network would drift away on them. Arms that are held back
    while styles blend are fed back as they are shown, so that the network continues from there.
    """
    path = state.trajectory
    yaw = path.yaw[:, PRESENT]
    paces = [jump.pace for jump in state.jumps]
    rates, slowed = np.array(paces), state.settling.rate
    if any(pace != 1.0 for pace in paces):  # in slowed time the body moves part of the way
        joints = state.joints + rates[:, None, None] * (joints - state.joints)
    state.joints = joints
    state.velocities = y.joint_velocities * slowed[:, None, None]
    state.phase = at_rate(state.phase, advance_phase(state.phase, y.phase), rates * slowed)
    resting = path.gait[:, PRESENT, Gait.STAND]

    # the speed at which feet should be stepping: 0 at rest, in a jump, and until the root has started
    steps = [
        requested if measured > 0.5 * requested > 0.5 * MIN_GAIT_SPEED_M_PER_S and not jump.active else 0.0
        for requested, measured, jump in zip(
            state.requested_speed.tolist(), state.measured_speed.tolist(), state.jumps, strict=True
        )
    ]
    stalled = state.stall.update(state.joints, steps)
    if any(stalled):
        state.phase[stalled] = advance_by_cycles(state.phase[stalled], STALLED_RATE_HZ * DT)
    state.phase = state.rest.apply(state.phase, [style.rest for style in styles], resting)

    moved = y.root * slowed[:, None]
    velocity = root_velocity(state, moved[:, :2], y.contacts, probes, terrain, response)
    turn = moved[:, 2] * DT
    forecast = np.concatenate([y.trajectory_positions, y.trajectory_directions], 1)
    forecast = features.to_world(forecast, (yaw + turn)[:, None])
    path.advance(velocity * DT, turn, forecast[:, :FUTURE], forecast[:, FUTURE:])


def _set_back(
    model: MotionModel, before: CharacterState, state: CharacterState, sound: Flags, terrain: Terrain
) -> CharacterState:
    """Return the state in which characters with an invalid network output (not `sound`) stand where they stood."""
    if all(sound.tolist()):
        return state
    members = [part(state, i) for i in range(len(state))]
    for i in np.flatnonzero(~sound).tolist():
        (x, _, z), yaw = before.poses.root[i].tolist(), float(before.poses.yaw[i])
        members[i] = standing(model, terrain, state.styles[i], int(state.seed[i]), x, z, yaw)
    return joined(members)
