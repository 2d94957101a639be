"""Settings of the foot lock: thresholds for holding and releasing a foot, and transition times."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FootLockSettings:
    """Thresholds and half-lives; metres, seconds, radians, contact probabilities."""

    contact_on: float = 0.5
    contact_off: float = 0.3
    lock_speed: float = 1.2  # m/s: a faster point is not held, whatever the network predicts
    lock_height: float = 0.2  # m above its resting height: nor is a higher one
    still_speed: float = 0.3  # m/s: a point slower than this and near the ground is in contact
    still_height: float = 0.025  # m over its resting height
    release_rise: float = 0.035  # m that the incoming point may rise above its lowest height while held
    release_rise_sure: float = 0.12  # m, while the network is sure of the contact
    release_offset: float = 0.2  # m between the held and the incoming point
    release_stretch: float = 0.04  # m that the leg would have to lengthen
    last_patience: float = 1.8  # factor on these limits for the only foot on the ground in a walk
    straightest: float = 0.97  # of leg and foot in line: beyond, the foot would turn over its toe
    # m that the ankle stays below its hip: a body walking down a steep slope leaves it behind
    release_under: float = 0.12
    # m behind the hips at which a foot begins to roll over its toe, fully at twice that
    trailing: float = 0.08
    rolls_away: float = 0.05  # m: limit of the roll's change of the hip-ankle distance
    refractory: float = 0.15  # s without a new hold after a forced release
    refractory_lift: float = 0.04  # m: a forced release becomes a small step
    release_half_life: float = 0.07
    rise_half_life: float = 0.03  # of a free foot's height above the incoming one, when rising
    fall_half_life: float = 0.03  # when falling
    far: float = 0.08  # m: larger differences
    far_slower: float = 0.12  # s/m: take longer by this per metre
    settle_half_life: float = 0.02  # half-life of a held point's height
    # m above or below the ground that a standing foot may keep: correcting them would be visible on a straight knee
    unseen: float = 0.0015
    settle_slower: float = 0.5  # s/m: added per metre of difference
    flat_half_life: float = 0.06  # of the sole's alignment to the ground,
    flat_slower: float = 6.0  # longer by this ratio per patience added at rest
    yaw_half_life: float = 0.10
    hips_half_life: float = 0.08
    max_yaw: float = 0.6
    max_drop: float = 0.35  # m that the hips may sink
    max_rise: float = 0.02  # m that they may be lifted
    carry_half_life: float = 0.02  # of the hips' offset
    max_room: float = 0.02  # m that the hips rise for a knee at its speed limit
    least_room: float = 1e-5  # m; less is ignored
    room_speed: float = 0.6  # m/s of that rise
    room_half_life: float = 0.05
    rise_over_half_life: float = 0.04  # of the hips' rise over a bar
    max_free_rise: float = 0.01  # m: limit of the pelvis offset from a foot in the air, up or down
    # of its length that a straight leg spans (16 degrees): full weight in the pelvis offset
    straight_span: float = 0.99
    bent_span: float = 0.94  # that a bent leg spans (40 degrees): no weight
    free_weight: float = 0.02  # weight of no leg, which keeps the hips in place
    sink: float = 0.002  # m that a sole may sink into the ground; deeper, a moving toe counts as skating
    look_ahead: float = 0.12  # s of swing within which edges are detected
    soft_floor: float = 0.015  # m above the ground within which a landing foot slows down
    swing_clearance: float = 0.02  # m between the ground and a sole that moves at `swing_speed` or faster
    swing_speed: float = 2.0  # m/s
    travel_clearance: float = 0.025  # m between a free toe and the ground at `travel_speed` or faster
    travel_speed: float = 0.8  # m/s
    travel_height: float = 0.015  # m: below it the toe may not travel freely,
    travel_near: float = 0.15  # m/s at ground level
    travel_rise: float = 1.0  # m/s added while rising, unlimited at `travel_height`
    max_behind: float = 0.2  # m: limit of its lag behind the incoming toe; more is caught up
    behind_seconds: float = 0.05  # in this time
    catch_up: float = 150.0  # m/s2 with which a toe held up by an edge returns to the incoming one
    catch_up_seconds: float = 0.1  # s in which a released toe returns to the incoming one
    shallow: float = 0.17  # slope (rise over run) of a toe's path; at twice that it needs no clearance
    clearance: float = 0.02  # m between the sole and an edge
    folded: float = 0.25  # m that an ankle stays below its hip while it clears the ground ahead
    edge_slope: float = 0.7  # rise over run from which the ground is an edge, not a slope
    ground_under_hips: float = 3.0  # m: no foot is put on ground farther below the hips
    ground_over_hips: float = 0.3  # m: nor above them; higher ground is a wall


SETTINGS = FootLockSettings()
