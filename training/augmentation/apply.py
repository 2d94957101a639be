"""Every kind of parametric edit under one name."""

from __future__ import annotations

import numpy as np

from training.augmentation import cycle_edits, pose_edits, root_edits
from training.augmentation.catalogue import PartEdit
from training.augmentation.pose_edits import EditedMotion

KINDS = pose_edits.KINDS | root_edits.KINDS | cycle_edits.KINDS


def apply(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """The motion with one edit, a little varied by `random` in strength and place; rhythm may change its length."""
    return KINDS[edit.kind](motion, edit, random)
