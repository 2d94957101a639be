"""The diffusion's noise over time."""

import numpy as np

from runtime.motion.noise import DriftingNoise

DT = 1.0 / 60.0


def test_it_is_standard_normal_in_every_frame():
    noise = DriftingNoise((1, 5, 8, 473), 3)
    for frame in range(200):
        values = noise.step(DT)
        assert values.shape == (1, 5, 8, 473)
        if frame % 40 == 0:
            assert abs(values.mean()) < 0.03
            assert abs(values.std() - 1.0) < 0.03
            assert abs((np.abs(values) > 2.0).mean() - 0.0455) < 0.01  # tails of a normal


def test_it_drifts_smoothly_and_forgets():
    noise = DriftingNoise((4000,), 0)
    values = np.stack([noise.step(DT) for _ in range(600)])
    change = np.diff(values, axis=0)
    assert np.abs(change).std() < 0.05  # a frame
    assert np.diff(change, axis=0).std() < 0.1 * change.std()  # no flicker: it goes on as it went
    correlation = [float(np.corrcoef(values[0], values[k])[0, 1]) for k in (1, 60, 120, 300)]
    assert correlation[0] > 0.99
    assert max(abs(c) for c in correlation[1:]) < 0.8


def test_seeds_differ_and_repeat():
    one, same, other = DriftingNoise((50,), 1), DriftingNoise((50,), 1), DriftingNoise((50,), 2)
    for _ in range(3):
        a, b, c = one.step(DT), same.step(DT), other.step(DT)
    assert np.array_equal(a, b)
    assert not np.allclose(a, c)
