"""Sentences described of the left side: what is mirrored, what has no side, and that the codes are mirrored with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import ModelError
from runtime.prompts.content import GROUPS, input_sizes, one_sided, part_inputs, sentence_inputs
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.skeleton import PART_NAMES
from tests.helpers.tables import table

WORDS = [
    "left",
    "right",
    "Right",
    "leftward",
    "rightwards",
    "head",
    "turned",
    "to",
    "the",
    "and",
    "leaning",
    ",",
]


@pytest.mark.parametrize(
    ("part", "text", "description", "sign"), table(__file__, "a_sentence_describes_the_left")
)
def test_a_sentence_describes_the_left(part, text, description, sign):
    assert one_sided(part, text) == (description, sign)


@given(st.lists(st.sampled_from(WORDS), min_size=1, max_size=8).map(" ".join), st.sampled_from(PART_NAMES))
def test_mirrored_words_are_told_alike_with_the_other_sign(text, part):
    mirrored = mirror_text(text)
    other = {"left": "right_", "right": "left_"}.get(part.split("_")[0], "")
    description, sign = one_sided(part, text)
    told_mirrored, sign_mirrored = one_sided(other + part.split("_")[1] if other else part, mirrored)
    if sign == 0:
        assert (description, told_mirrored, sign_mirrored) == (text, mirrored, 0.0)
    else:
        assert description == told_mirrored
        assert sign_mirrored == (sign if other else -sign)


class _Words:
    """Embeddings that tell texts apart."""

    name, dimensions = "stand-in", 6

    def encode(self, texts):
        return np.stack([np.random.default_rng(list(t.encode())).normal(size=6) for t in texts]).astype("f4")


SIX = PartDescriptions(
    left_arm="left hand raised",
    right_arm="right arm hanging",
    left_leg="left knee bent",
    right_leg="right foot turned out",
    torso="torso leaning to the right",
    head="head up",
)


def test_inputs_hold_what_their_length_says():
    encoder = _Words()
    sizes = {6: (False, False), 7: (False, True)}
    assert input_sizes(6) == sizes | {6 + len(GROUPS): (True, False), 7 + len(GROUPS): (True, True)}
    for size in input_sizes(6):
        assert sentence_inputs(encoder, SIX.as_tuple(), size).shape == (6, size)
    with pytest.raises(ModelError, match="5 numbers"):
        sentence_inputs(encoder, SIX.as_tuple(), 5)
    plain = sentence_inputs(encoder, SIX.as_tuple(), 6)
    sided = sentence_inputs(encoder, SIX.as_tuple(), 7)
    assert np.array_equal(plain, encoder.encode(SIX.as_tuple()))
    assert sided[:, -1].tolist() == [1, 1, 1, 1, -1, 0]
    assert np.array_equal(sided[1, :-1], encoder.encode(["left arm hanging"])[0])
    words = part_inputs(encoder, ["right_arm"], ["right arm hanging"], True, True)[0, 6:-1]
    # the direction words are those of the left, too
    assert words[[name for name, _ in GROUPS].index("right")] == 0.0


@pytest.mark.needs_torch
def test_the_code_of_mirrored_words_is_the_mirrored_code():
    import torch

    from training.networks.content import PART_SIZE, PartTextEncoder, StatisticsReader

    torch.manual_seed(0)
    network = PartTextEncoder(7 + len(GROUPS), one_sided=True).eval()
    size = 7 + len(GROUPS)

    def codes(words):
        with torch.no_grad():
            return network(torch.as_tensor(sentence_inputs(_Words(), words.as_tuple(), size))[None]).mean[0]

    own, mirrored = codes(SIX), codes(SIX.mirrored())
    assert torch.equal(own[[0, 1, 2, 3]], mirrored[[1, 0, 3, 2]])
    half = PART_SIZE // 2
    assert torch.equal(own[4:, :half], mirrored[4:, :half])
    assert torch.equal(own[4:, half:], -mirrored[4:, half:])
    assert own[4, half:].abs().max() > 0.01
    assert not own[5, half:].any()  # a head held up has no side

    reader = StatisticsReader(one_sided=True)
    with torch.no_grad():
        for part in reader.parts:
            part.bias.normal_()
        read, other = reader(own[None]), reader(mirrored[None])
    pairs = {
        f"{a}_{limb}": f"{b}_{limb}"
        for limb in ("arm", "leg")
        for a, b in (("left", "right"), ("right", "left"))
    }
    for k, name in enumerate(PART_NAMES):
        parity = getattr(reader, f"parity_{name}")
        assert torch.allclose(read[k] * parity, other[PART_NAMES.index(pairs.get(name, name))], atol=1e-6)
