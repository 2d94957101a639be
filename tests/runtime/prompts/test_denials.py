"""What a prompt says that a part does not do, and feet that are placed in turn."""

from __future__ import annotations

import pytest

from runtime.prompts.english.library import LibraryExpander
from tests.helpers.shipped import shipped_library


@pytest.fixture(scope="module")
def library() -> LibraryExpander:
    return shipped_library()


@pytest.mark.parametrize(
    "prompt", ["arms do not swing", "his arms don't swing", "the arms cannot swing", "the arms never swing"]
)
def test_arms_that_do_not_swing_hang_still(library, prompt):
    said = library.expand(prompt).descriptions
    assert "not swinging" in said.left_arm
    assert "not swinging" in said.right_arm


def test_a_denied_knee_is_stiff_and_a_denied_head_still(library):
    assert "stiff and straight" in library.expand("the left knee does not bend").descriptions.left_leg
    assert "still" in library.expand("the head doesn't move").descriptions.head


def test_one_foot_in_front_of_the_other_is_both_feet(library):
    said = library.expand("hands on hips, one foot in front of the other").descriptions
    assert "one line" in said.left_leg
    assert "one line" in said.right_leg
