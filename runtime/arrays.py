"""Names of array types used by every module."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]  # of any shape; docstrings say which
Flags = NDArray[np.bool_]  # true or false of each
Float32Array = NDArray[np.float32]  # input and output of the networks
AnyArray = NDArray[Any]  # dtype stated beside it: indices, colours, bytes of a file
