"""Names of array types that every module uses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]  # of any shape; docstrings say which
Flags = NDArray[np.bool_]  # true or false of each
Float32Array = NDArray[np.float32]  # what the networks take and give
AnyArray = NDArray[Any]  # whose type is said beside it: indices, colours, bytes of a file
