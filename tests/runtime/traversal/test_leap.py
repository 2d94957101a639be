"""One planned stride over an obstacle: soles over it, feet on the ground behind it, nothing that jumps."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.feet.ik import LEG_FEET, LEG_TOES
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.obstacle_detection import ObstacleKind
from runtime.traversal.leap import TOE_OFFSET_M, Leap, LeapStart, takeoff_m

DT = 1.0 / 60.0
HIPS_HEIGHT_M = 0.93
LOCAL = rotations.identity((31,))


def stride(kind: ObstacleKind, top: float, speed: float, stance: int = 0, farther: float = 0.0) -> LeapStart:
    """A foot that has just come down before the edge, the other one a step behind it with its heel raised."""
    seconds = 1.1 if speed < 1.8 else 0.75
    step = 0.5 * speed * seconds
    z = -takeoff_m(kind, top, speed) - farther
    raised = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(0.6))
    back = np.array([0.0, TOE_HEIGHT, z - step + TOE_OFFSET_M[2]]) - rotations.rotate(raised, TOE_OFFSET_M)
    feet = [np.array([0.0, ANKLE_HEIGHT, z]), back]
    turned = [rotations.identity(()), raised]
    sides = np.array([[0.09, 0.0, 0.0], [-0.09, 0.0, 0.0]])
    order = (0, 1) if stance == 0 else (1, 0)
    places, turns = np.array([feet[k] for k in order]) + sides, np.array([turned[k] for k in order])
    return LeapStart(z - 0.25, speed, seconds, 0.0, stance, places, turns, HIPS_HEIGHT_M)


def walked(leap: Leap) -> tuple[np.ndarray, np.ndarray]:
    """Positions `(T, 31, 3)` and contacts `(T, 4)`, of a network that stands upright."""
    poses, contacts = [], []
    for frame in range(1, round(leap.seconds / DT) + 1):
        t = frame * DT
        shown = leap.pose(t, np.array([0.0, HIPS_HEIGHT_M, leap.root_z(t)]), LOCAL)
        poses.append(SPORT_SKELETON.forward_kinematics(shown.hips, shown.local)[0])
        contacts.append(shown.contacts)
    return np.array(poses), np.array(contacts)


def soles(positions: np.ndarray) -> np.ndarray:
    """Points `(T, 4, 3)` of both feet's soles."""
    joints = [*LEG_FEET, *LEG_TOES]
    return positions[:, joints] - np.array([[0, ANKLE_HEIGHT, 0]] * 2 + [[0, TOE_HEIGHT, 0]] * 2)


@settings(max_examples=10)
@given(
    top=st.floats(0.15, 0.7), speed=st.floats(0.5, 2.3), stance=st.integers(0, 1), farther=st.floats(0.0, 0.4)
)
def test_soles_pass_over_a_bar_and_come_down_behind_it(
    top: float, speed: float, stance: int, farther: float
) -> None:
    assume(farther < 0.35 * speed)
    leap = Leap(ObstacleKind.BAR, 0.15, top, 0.0, stride(ObstacleKind.BAR, top, speed, stance, farther))
    positions, contacts = walked(leap)
    points = soles(positions)
    over = (points[..., 2] > 0.0) & (points[..., 2] < 0.15)
    assert over.any()
    assert points[..., 1][over].min() > top
    assert points[..., 1].min() > -0.03
    assert (points[-1, :2, 2] > 0.15).all()  # both heels are behind it
    assert np.linalg.norm(np.diff(positions, axis=0), axis=-1).max() < 0.3  # 18 m/s, of a knee that jogs
    assert contacts[-1].any()


@settings(max_examples=10)
@given(length=st.floats(0.3, 1.0), speed=st.floats(0.6, 2.8), beyond=st.floats(-0.3, 0.2))
def test_a_gap_is_flown_over(length: float, speed: float, beyond: float) -> None:
    leap = Leap(ObstacleKind.GAP, length, 0.0, beyond, stride(ObstacleKind.GAP, 0.0, speed))
    positions, contacts = walked(leap)
    stands = contacts > 0.5
    assert not (stands.any(1)).all()  # for a while no foot stands
    z = soles(positions)[:, [0, 2, 1, 3], 2]  # in the order of the contacts
    assert not (stands & (z > 0.08) & (z < length - 0.02)).any()
    ends = soles(positions)[-1, :, 1].reshape(2, 2).min(0)  # of each foot, heel or toe
    assert ends[1] == pytest.approx(beyond, abs=0.2)  # about to leave
    assert ends[0] == pytest.approx(beyond, abs=0.03)


@pytest.mark.parametrize("top", [0.3, 0.5, -0.3, -0.5])
def test_a_step_is_taken_with_the_whole_body(top: float) -> None:
    kind = ObstacleKind.UP if top > 0.0 else ObstacleKind.DOWN
    positions, _ = walked(Leap(kind, 0.0, 0.0, top, stride(kind, 0.0, 1.2)))
    assert positions[0, 0, 1] == pytest.approx(HIPS_HEIGHT_M, abs=0.02)
    assert positions[-1, 0, 1] == pytest.approx(HIPS_HEIGHT_M + top, abs=0.13)
    assert np.abs(np.diff(positions[:, 0, 1])).max() < 0.08  # no faster than a fall


def test_the_root_leaves_and_arrives_at_its_speed() -> None:
    leap = Leap(ObstacleKind.BAR, 0.1, 0.4, 0.0, stride(ObstacleKind.BAR, 0.4, 1.3))
    z = np.array([leap.root_z(t) for t in np.arange(0.0, leap.seconds + DT, DT)])
    assert z[0] == pytest.approx(leap.stride.start_z)
    assert z[-1] == pytest.approx(leap.end_z, abs=1e-6)
    assert (z[1] - z[0]) / DT == pytest.approx(1.3, abs=0.15)
    assert (z[-1] - z[-2]) / DT == pytest.approx(1.3, abs=0.3)
    assert np.diff(z).min() > 0.0
