"""The data sets that training knows: one record each, in the order in which they are imported."""

from __future__ import annotations

from training.data.record import DataSet
from training.data.sets import (
    accad,
    bandai,
    cmu,
    fair_zombie,
    jlpm,
    o3de,
    pfnn,
    small_mit,
    style100,
    walking_stick,
)

DATA_SETS: tuple[DataSet, ...] = (
    o3de.RECORD,
    accad.RECORD,
    style100.RECORD,
    style100.MORE,
    bandai.RECORD,
    cmu.RECORD,
    cmu.SUBJECT_91,
    fair_zombie.RECORD,
    small_mit.RECORD,
    walking_stick.RECORD,
    jlpm.RECORD,
    pfnn.RECORD,
    pfnn.ROLLOUTS,
)
