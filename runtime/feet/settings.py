"""Settings of the foot lock: what holds a foot, what frees it, and how fast it goes over from one to the other."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FootLockSettings:
    """Thresholds and half-lives; metres, seconds, radians, contact probabilities."""

    contact_on: float = 0.5
    contact_off: float = 0.3
    lock_speed: float = 1.2  # m/s: a faster point is not held, whatever the network says
    lock_height: float = 0.2  # m: nor one that is higher over its resting height
    still_speed: float = 0.3  # m/s: a point slower than this and near the ground is in contact
    still_height: float = 0.025  # m over its resting height
    release_rise: float = 0.035  # m that the incoming point may rise over its lowest while held
    release_rise_sure: float = 0.12  # the same while the network is sure of the contact
    release_offset: float = 0.2  # m between the held and the incoming point
    release_stretch: float = 0.04  # m that the leg would have to grow
    last_patience: float = 1.8  # times these, for the only foot on the ground in a walk
    straightest: float = 0.97  # of leg and foot in one line: rolled farther, the foot would turn over its toe
    # m that the ankle must stay under its hip: a body that goes down a steep slope leaves it behind
    release_under: float = 0.12
    # m behind the hips from which a foot begins to roll over its toe, wholly at twice that
    trailing: float = 0.08
    rolls_away: float = 0.05  # m that it rolls its ankle farther from the hip at most
    refractory: float = 0.15  # s without a new hold after a forced release
    refractory_lift: float = 0.04  # m: a forced release becomes a small step
    release_half_life: float = 0.07
    rise_half_life: float = 0.03  # of a free foot's height over the incoming one, upwards
    fall_half_life: float = 0.03  # the same downwards
    far: float = 0.08  # m: what is farther
    far_slower: float = 0.12  # s/m, takes so much longer
    settle_half_life: float = 0.02  # of a held point's height
    # m over or under the ground that a standing foot may keep: a straight knee shows them
    unseen: float = 0.0015
    settle_slower: float = 0.5  # s/m: added to it for every metre that is missing
    flat_half_life: float = 0.06  # of the sole's alignment to the ground
    yaw_half_life: float = 0.10
    hips_half_life: float = 0.08
    max_yaw: float = 0.6
    max_drop: float = 0.35  # m that the hips may sink
    max_rise: float = 0.02  # m that they may be carried up
    carry_half_life: float = 0.02  # in which the hips follow
    max_room: float = 0.012  # m that they make room for a knee that bends no faster
    least_room: float = 1e-5  # m; less is none
    room_speed: float = 0.3  # m/s in which they do
    room_half_life: float = 0.05
    rise_over_half_life: float = 0.04  # in which the hips rise over a bar
    max_free_rise: float = 0.01  # m that a foot in the air may carry them, up or down
    # fraction of its length that a straight leg spans (16 degrees): it carries the hips
    straight_span: float = 0.99
    bent_span: float = 0.94  # and a bent one (40 degrees), which does not
    free_weight: float = 0.02  # of no leg at all: the hips stay where they are
    sink: float = 0.002  # m that a sole may press into the ground; more, and a moving toe counts as skating
    look_ahead: float = 0.12  # s of swing in which edges are seen
    soft_floor: float = 0.015  # m over the ground in which a landing foot slows down
    swing_clearance: float = 0.02  # m between the ground and a sole that moves at `swing_speed` or faster
    swing_speed: float = 2.0  # m/s
    travel_clearance: float = 0.025  # m that a free toe keeps from the ground at `travel_speed` or faster
    travel_speed: float = 0.8  # m/s
    travel_height: float = 0.015  # m, and lower it may not travel freely,
    travel_near: float = 0.15  # m/s on the ground
    travel_rise: float = 1.0  # m/s more on the way up, beyond all bounds at `travel_height`
    max_behind: float = 0.2  # m that it may so stay behind the incoming one; what is more is taken up
    behind_seconds: float = 0.05  # in so many
    catch_up: float = 150.0  # m/s2 with which a toe that an edge held up comes back to the incoming one
    catch_up_seconds: float = 0.1  # in which one that was held comes back to the incoming one
    shallow: float = 0.17  # rise over run of a toe's way: at twice that it needs no clearance
    clearance: float = 0.02  # m between the sole and an edge
    folded: float = 0.25  # m that an ankle stays under its hip where it clears the ground ahead
    edge_slope: float = 0.7  # rise over run from which the ground is an edge, not a slope
    ground_under_hips: float = 3.0  # m: no foot is put on ground that is farther below the hips
    ground_over_hips: float = 0.3  # m: nor over them; higher ground is a wall


SETTINGS = FootLockSettings()
