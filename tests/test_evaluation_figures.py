"""What the figures of the evaluation show is what the model said."""

import numpy as np
import pytest
from walker import WalkerModel

from runtime.motion import features
from runtime.motion.features import OUTPUT
from runtime.skeleton import SPORT_SKELETON, J

pytest.importorskip("matplotlib")

from training.evaluation.motion.capture import Capture, ClipInfo
from training.evaluation.motion.driving import LEAD_IN_FRAMES
from training.evaluation.report.figures import _most_captured, blend_walk, hand_height, phase_curves

Z = np.full((6, 64), 0.01, np.float32)


class PhasedWalker(WalkerModel):
    """Its first phase channel turns once a second with amplitude 2."""

    def step(self, x, noise, style):
        y, alpha = super().step(x, noise, style)
        angle = 2 * np.pi * self.frame / 60
        y[0, OUTPUT["phase"]][:2] = 2 * np.sin(angle), 2 * np.cos(angle)
        return y, alpha


def test_phase_curves_are_the_phases_of_every_frame():
    curves = phase_curves(PhasedWalker(), Z, 1.0, 0)
    assert curves.shape == (60, features.C, 2)
    assert np.linalg.norm(curves[:, 0], axis=-1) == pytest.approx(np.full(60, 2.0), rel=1e-5)
    turn = np.unwrap(np.arctan2(curves[:, 0, 0], curves[:, 0, 1]))
    assert np.diff(turn) == pytest.approx(np.full(59, 2 * np.pi / 60), rel=1e-4)
    assert curves[0, 0, 0] == pytest.approx(2 * np.sin(2 * np.pi * (LEAD_IN_FRAMES + 1) / 60), abs=1e-4)


def test_hand_height_is_the_mean_of_both_hands():
    joints = np.zeros((3, J, 3))
    joints[:, SPORT_SKELETON.index("LeftHand"), 1] = 1.0
    joints[:, SPORT_SKELETON.index("RightHand"), 1] = 0.5
    assert hand_height(joints) == pytest.approx(np.full(3, 75.0))


def test_walks_of_a_blend_are_relative_to_the_root():
    joints, contacts = blend_walk(WalkerModel(), Z, 0)
    assert joints.shape == (240, J, 3)
    assert contacts.shape == (240, 4)
    assert np.abs(joints[:, 0, [0, 2]]).max() < 0.05


def test_the_styles_with_the_most_training_capture_are_shown(tmp_path):
    def clip(style, frames, held_out=False):
        return ClipInfo(tmp_path / "c.npz", style, style, held_out, frames, {})

    clips = [clip(f"style{k:02d}", 100 + k) for k in range(13)] + [clip("style00", 9000, held_out=True)]
    shown = _most_captured(Capture(tuple(clips)))
    assert shown == [f"style{k:02d}" for k in range(1, 13)]
