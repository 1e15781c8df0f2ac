"""Names for the array types that Hangtime's functions take and return."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Indices = NDArray[np.int32]  # of nodes, as a kernel reads them
Booleans = NDArray[np.bool_]
Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]  # of pictures: grey or colours
Unsigned = NDArray[np.uint16]  # of 16 bits: depths as a sensor counts them, states of frames
