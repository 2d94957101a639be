"""Values of JSON that nobody vouches for, and the curves that ease."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import scalar_math
from runtime.checked import number_field, read_number, read_text, read_whole, text_field
from runtime.easing import smootherstep, smoothstep


@pytest.mark.parametrize("value", [True, "1", None, math.nan, math.inf, -math.inf, 2e9, 10**400, [1]])
def test_what_is_no_number_is_refused_or_replaced(value: Any) -> None:
    with pytest.raises(ValueError, match="expected a number"):
        read_number(value)
    if value != 2e9:
        assert number_field({"x": value}, "x", 0.5) == 0.5


@pytest.mark.parametrize("value", [True, 1.0, "1", -1, 1 << 63])
def test_what_is_no_count_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match="whole"):
        read_whole(value)


@pytest.mark.parametrize("value", [5, None, "a\0b", "\ud800", "x" * 11])
def test_what_is_no_text_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match="text"):
        read_text(value, 10)
    assert text_field({"x": 5}, "x", "usual") == "usual"


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_eased_curves_rise_from_0_to_1(a: float, b: float) -> None:
    low, high = sorted((a, b))
    for curve in (smoothstep, smootherstep):
        begin, end = (float(curve(np.array(t))) for t in (low, high))
        assert 0.0 <= begin <= end + 1e-12 <= 1.0 + 1e-9
        assert float(curve(np.array(low))) + float(curve(np.array(1.0 - low))) == pytest.approx(1.0)
    assert scalar_math.smoothstep(a) == pytest.approx(float(smoothstep(np.array(a))))
