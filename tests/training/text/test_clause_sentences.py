"""The sentences of the clause rules are those that the part edits were trained with."""

import pytest

pytest.importorskip("torch")
