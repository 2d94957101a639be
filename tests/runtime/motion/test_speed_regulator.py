"""The regulator of the root's speed, on bodies that follow late, too fast, too slowly or not at all."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.motion.features import FPS
from runtime.motion.pace import SpeedRegulator

# frames until a changed request is noticed, and followed; as the trained network
LATE = round(0.25 * FPS)
SLUGGISH = 0.7 * FPS


def gain(regulator: SpeedRegulator, asked: float, speed: float) -> float:
    return regulator.update([asked], [speed], [asked > 0.0])[0]


def walk(pace: float, asked: float, seconds: float = 12.0) -> np.ndarray:
    """Speeds of a body that goes `pace` times the speed it is asked for, late and sluggishly."""
    regulator, speed, requests, speeds = SpeedRegulator.at_rest(), 0.0, [0.0] * LATE, []
    for _ in range(round(seconds * FPS)):
        requests.append(asked * gain(regulator, asked, speed))
        speed += (pace * requests.pop(0) - speed) / SLUGGISH
        speeds.append(speed)
    return np.array(speeds)


@given(pace=st.floats(0.6, 1.4), asked=st.floats(0.3, 3.0))
def test_the_asked_speed_is_reached_and_kept(pace: float, asked: float):
    speeds = walk(pace, asked) / asked
    assert speeds.max() < 1.45
    settled = speeds[8 * FPS :]
    assert abs(settled.mean() - 1.0) < 0.03
    assert np.ptp(settled) < 0.1


def test_a_start_is_no_debt():
    """While a body sets off it lags behind the plan, which its gain does not remember."""
    regulator, plan = SpeedRegulator.at_rest(), np.minimum(np.arange(120) / 60.0, 1.0)
    for asked in plan[:60]:
        gain(regulator, asked, 0.3 * asked)
    assert regulator.integral[0] == 1.0
    for asked in plan[60:]:
        gain(regulator, asked, 0.3 * asked)
    assert regulator.integral[0] > 1.1  # but it remembers one that stays


def test_a_stop_forgets_the_walk_before():
    regulator = SpeedRegulator.at_rest()
    first = [gain(regulator, 1.0, 0.3) for _ in range(120)]
    assert gain(regulator, 0.0, 0.3) == 1.0
    assert [gain(regulator, 1.0, 0.3) for _ in range(120)] == first
