"""What a model was measured to show of its codes: sides and ways round."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import model_folder
from runtime.errors import ModelError
from runtime.motion.calibration import Calibration
from runtime.motion.features import C
from runtime.motion.mirror import mirrored_code
from runtime.motion.model import load_model


def calibration(*rows: tuple[int, np.ndarray, float]) -> Calibration:
    """Of codes with part and lead; neutral is zero."""
    parts, codes, leads = ([row[k] for row in rows] for k in range(3))
    return Calibration(
        np.array(parts, np.int64),
        np.array(codes, np.float32).reshape(-1, 64),
        np.array(leads, np.float32),
        np.zeros((6, 64), np.float32),
    )


def code(part: int, values: np.ndarray) -> np.ndarray:
    z = np.zeros((6, 64), np.float32)
    z[part] = values
    return z


NEAR = np.full(64, 1.0, np.float32)


@pytest.mark.parametrize(("times", "lead"), [(1.0, -0.6), (0.6, -0.6), (0.35, 0.0), (-3.0, 0.0)])
def test_a_part_has_the_lead_of_the_nearest_code_and_its_mirror_image_the_opposite(
    times: float, lead: float
) -> None:
    measured, z = calibration((0, NEAR, -0.6)), code(0, times * NEAR)
    assert measured.side_leads(z).tolist() == pytest.approx([lead, 0, 0, 0, 0, 0])
    assert measured.side_leads(mirrored_code(z)).tolist() == pytest.approx([0, -lead, 0, 0, 0, 0])


def test_the_nearer_of_two_codes_counts() -> None:
    measured = calibration((0, NEAR, -0.6), (0, 2 * NEAR, 0.3))
    assert measured.side_leads(code(0, 1.9 * NEAR))[0] == pytest.approx(0.3)
    assert measured.side_leads(code(0, 1.1 * NEAR))[0] == pytest.approx(-0.6)


def test_a_lean_has_the_lead_of_its_mirror_image_with_the_other_sign() -> None:
    values = np.arange(64, dtype=np.float32) - 20.0
    measured, z = calibration((4, values, 0.5)), code(4, values)
    assert measured.side_leads(z)[4] == pytest.approx(0.5)
    assert measured.side_leads(mirrored_code(z))[4] == pytest.approx(-0.5)


def test_neutral_stays_neutral() -> None:
    measured = calibration((0, NEAR, -0.9))
    assert not measured.side_leads(np.zeros((6, 64), np.float32)).any()


CODE = {"part": "head", "lead": 0.0, "code": [0.0] * 64}


@pytest.mark.parametrize(
    "section",
    [
        {"phase": [1, 1, 1, 1], "codes": []},
        {"phase": [1, 1, 0.5, 1, 1], "codes": []},
        *(
            {"phase": [1] * C, "codes": [CODE | changed]}
            for changed in (
                {"part": "tail"},
                {"code": [0.0] * 63},
                {"lead": 7.0},
                {"lead": None},
            )
        ),
        {"phase": [1] * C, "codes": [{"part": "head", "code": [0.0] * 64}]},
        {"phase": [1] * C, "codes": 3},
        [],
    ],
)
def test_a_damaged_section_is_named(section: object, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(model_folder(), folder)
    metadata = json.loads((folder / "metadata.json").read_text("utf-8"))
    metadata["calibration"] = section
    (folder / "metadata.json").write_text(json.dumps(metadata), "utf-8")
    with pytest.raises(ModelError, match="field 'calibration'"):
        load_model(folder)
