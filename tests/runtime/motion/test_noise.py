"""The diffusion's noise over time."""

import numpy as np

from runtime.motion.noise import drifting_noise

DT = 1.0 / 60.0


def test_it_is_standard_normal_in_every_frame():
    for frame in range(0, 200, 40):
        values = drifting_noise((1, 5, 8, 473), 3, frame * DT)
        assert values.shape == (1, 5, 8, 473)
        assert abs(values.mean()) < 0.03
        assert abs(values.std() - 1.0) < 0.03
        assert abs((np.abs(values) > 2.0).mean() - 0.0455) < 0.01  # tails of a normal


def test_it_drifts_smoothly_and_forgets():
    values = np.stack([drifting_noise((4000,), 0, frame * DT) for frame in range(600)])
    change = np.diff(values, axis=0)
    assert np.abs(change).std() < 0.05  # a frame
    assert np.diff(change, axis=0).std() < 0.1 * change.std()  # no flicker: it goes on as it went
    correlation = [float(np.corrcoef(values[0], values[k])[0, 1]) for k in (1, 60, 120, 300)]
    assert correlation[0] > 0.99
    assert max(abs(c) for c in correlation[1:]) < 0.8


def test_seeds_differ_and_repeat():
    a, b, c = (drifting_noise((50,), seed, 0.05) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.allclose(a, c)
