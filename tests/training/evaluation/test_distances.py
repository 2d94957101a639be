"""The table of several models' distances."""

from training.evaluation.compared_models import distances_table as table

RESULT = {
    "fmd": {
        "encoder": {"distance": 109.64, "ratio": 1.9, "takes": {"distance": 98.07, "ratio": 1.2}},
        "kinematic": {"distance": 31.1, "ratio": 1.1, "takes": {"distance": 29.4, "ratio": 0.8}},
    },
    "recognition": {"score": {"angry": 1.0, "old": 0.5}},
}


def test_a_row_for_each_model_with_its_reference():
    lines = table({"ours (diffusion)": RESULT, "other (mixture)": RESULT}).splitlines()
    assert len(lines) == 4
    assert lines[2] == "| ours (diffusion) | 98.07 (1.2 x, 1.9 x) | 29.40 (0.8 x, 1.1 x) | 75 % |"
    assert len({line.count("|") for line in lines}) == 1


def test_seeds_of_a_model_share_a_row():
    other = {
        **RESULT,
        "fmd": {n: {**f, "takes": {"distance": 100.07, "ratio": 1.4}} for n, f in RESULT["fmd"].items()},
    }
    lines = table({"full (diffusion)": RESULT, "full seed1 (diffusion)": other}).splitlines()
    assert len(lines) == 3
    assert lines[2].startswith("| full (diffusion), 2 seeds | 99.07 ± 1.41 (1.3 x, 1.9 x) |")
    alone = table({"full seed1 (diffusion)": RESULT}).splitlines()
    assert alone[2].startswith("| full seed1 (diffusion) | 98.07 (1.2 x, 1.9 x) |")
