"""Memory that is used again.

The system allocates a large array page by page and frees it with the array, which takes longer than
a loop over its elements.
"""

from __future__ import annotations

import math
import weakref
from collections import defaultdict, deque

import numpy as np
from numpy.typing import DTypeLike

# by its size, a power of two of bytes
_let_go: defaultdict[int, deque[memoryview]] = defaultdict(lambda: deque(maxlen=6))


def room(shape: tuple[int, ...], dtype: DTypeLike = float) -> np.ndarray:
    """An array like `numpy.empty`, in the memory of an earlier one that nobody holds any more."""
    count = math.prod(shape)
    size = 1 << (count * np.dtype(dtype).itemsize).bit_length()
    try:
        memory = _let_go[size].pop()
    except IndexError:
        memory = np.empty(size, np.uint8).data
    whole = np.frombuffer(memory, dtype, count)
    # each view holds `whole`, so that it ends after the last of them
    weakref.finalize(whole, _let_go[size].append, memory).atexit = False
    return whole.reshape(shape)
