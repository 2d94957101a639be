"""What a model was measured to show of its codes: sides, ways round, and how far codes are drawn out."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import model_folder
from runtime.errors import ModelError
from runtime.motion.calibration import GAIN_FADE_FRACTION, Calibration
from runtime.motion.features import C
from runtime.motion.mirror import mirrored_code
from runtime.motion.model import load_model

SPREAD = 0.3  # of the sentences of every code here


def calibration(*rows: tuple[int, np.ndarray, float, float | tuple[float, float]]) -> Calibration:
    """Of codes with part, lead and gain (or two: alone, beside others); neutral is zero."""
    parts, codes, leads, gains = ([row[k] for row in rows] for k in range(4))
    gains = [gain if isinstance(gain, tuple) else (gain, gain) for gain in gains]
    leads, neutral = np.array(leads, np.float32), np.zeros((6, 64), np.float32)
    codes, gains = np.array(codes, np.float32).reshape(-1, 64), np.array(gains, np.float32).reshape(-1, 2)
    spread = np.full(len(parts), SPREAD, np.float32)
    return Calibration(np.array(parts, np.int64), codes, leads, gains, spread, neutral)


def code(part: int, values: np.ndarray) -> np.ndarray:
    z = np.zeros((6, 64), np.float32)
    z[part] = values
    return z


NEAR = np.full(64, 1.0, np.float32)


@pytest.mark.parametrize(("times", "lead"), [(1.0, -0.6), (0.6, -0.6), (0.35, 0.0), (-3.0, 0.0)])
def test_a_part_has_the_lead_of_the_nearest_code_and_its_mirror_image_the_opposite(
    times: float, lead: float
) -> None:
    measured, z = calibration((0, NEAR, -0.6, 1.0)), code(0, times * NEAR)
    assert measured.side_leads(z).tolist() == pytest.approx([lead, 0, 0, 0, 0, 0])
    assert measured.side_leads(mirrored_code(z)).tolist() == pytest.approx([0, -lead, 0, 0, 0, 0])


def test_the_nearer_of_two_codes_counts() -> None:
    measured = calibration((0, NEAR, -0.6, 1.5), (0, 2 * NEAR, 0.3, 1.0))
    assert measured.side_leads(code(0, 1.9 * NEAR))[0] == pytest.approx(0.3)
    assert measured.side_leads(code(0, 1.1 * NEAR))[0] == pytest.approx(-0.6)


def test_a_lean_has_the_lead_of_its_mirror_image_with_the_other_sign() -> None:
    values = np.arange(64, dtype=np.float32) - 20.0
    measured, z = calibration((4, values, 0.5, 1.0)), code(4, values)
    assert measured.side_leads(z)[4] == pytest.approx(0.5)
    assert measured.side_leads(mirrored_code(z))[4] == pytest.approx(-0.5)


def test_codes_near_a_measured_one_are_drawn_out_by_its_gain() -> None:
    measured = calibration((0, NEAR, 0.0, 1.8), (5, NEAR, 0.0, 1.4))
    z = code(0, NEAR) + code(5, NEAR) + code(2, NEAR)
    drawn = measured.drawn_out(z)
    np.testing.assert_allclose(drawn, 1.8 * code(0, NEAR) + 1.4 * code(5, NEAR) + code(2, NEAR), atol=1e-6)
    right = measured.drawn_out(mirrored_code(z))
    np.testing.assert_allclose(right, mirrored_code(drawn), atol=1e-6)
    own = (1.0 - SPREAD) * NEAR  # as far as its sentences lie
    np.testing.assert_allclose(measured.drawn_out(code(0, own))[0], 1.8 * own, atol=1e-5)
    half = (1.0 - SPREAD - GAIN_FADE_FRACTION / 2) * NEAR  # half of the way to where a gain ends
    np.testing.assert_allclose(measured.drawn_out(code(0, half))[0], 1.4 * half, atol=1e-5)
    far = (1.0 - SPREAD - 1.1 * GAIN_FADE_FRACTION) * NEAR
    np.testing.assert_array_equal(measured.drawn_out(code(0, far))[0], far)


@pytest.mark.parametrize(
    ("others", "gain"),
    [
        ((), 1.2),
        ((5,), 1.4),  # one of two
        ((0, 1), 1.4),  # both arms are one
        ((3,), 1.2),  # of a leg the other leg is none
        ((4, 5), 1.6),
        ((0, 1, 4, 5), 1.6),
    ],
)
def test_beside_others_a_part_has_the_gain_beside_others(others: tuple[int, ...], gain: float) -> None:
    rows = [(part, NEAR, 0.0, 1.0) for part in (0, 4, 5)]
    measured = calibration(*rows, (2, NEAR, 0.0, (1.2, 1.6)))
    z = code(2, NEAR) + sum((code(other, NEAR) for other in others), np.zeros((6, 64), np.float32))
    np.testing.assert_allclose(measured.drawn_out(z)[2], gain * NEAR, atol=1e-5)
    faint = code(2, NEAR) + 0.25 * (z - code(2, NEAR))  # others that hardly differ from neutral
    np.testing.assert_allclose(measured.drawn_out(faint)[2], 1.2 * NEAR, atol=1e-5)


def test_neutral_stays_neutral() -> None:
    measured = calibration((0, NEAR, -0.9, 2.0))
    assert not measured.drawn_out(np.zeros((6, 64), np.float32)).any()
    assert not measured.side_leads(np.zeros((6, 64), np.float32)).any()


CODE = {"part": "head", "lead": 0.0, "gain": 1.0, "gain_beside": 1.0, "spread": 0.2, "code": [0.0] * 64}


WRONG = (
    {"part": "tail"},
    {"code": [0.0] * 63},
    {"lead": 7.0},
    {"gain": 9.0},
    {"gain": 0.5},
    {"gain_beside": 9.0},
)
LESS = [{"part": "head", "lead": 0.0, "gain": 1.0, "code": [0.0] * 64}]


@pytest.mark.parametrize(
    "section",
    [
        {"phase": [1, 1, 1, 1], "codes": []},
        {"phase": [1, 1, 0.5, 1, 1], "codes": []},
        *({"phase": [1] * C, "codes": [CODE | changed]} for changed in (*WRONG, {"spread": 1.5}, {"spread": None})),
        *({"phase": [1] * C, "codes": codes} for codes in (LESS, 3)),
        [],
    ],
)  # fmt: skip
def test_a_damaged_section_is_named(section: object, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(model_folder(), folder)
    metadata = json.loads((folder / "metadata.json").read_text("utf-8"))
    metadata["calibration"] = section
    (folder / "metadata.json").write_text(json.dumps(metadata), "utf-8")
    with pytest.raises(ModelError, match="field 'calibration'"):
        load_model(folder)
