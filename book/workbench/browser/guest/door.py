"""The one way out of a session in the browser: a call that takes bytes and gives bytes.

A frame is the length of a header (4 bytes), the header as JSON, and the bytes of its arrays, one
after the other; the header's ``arrays`` holds the type and the shape of each.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

_call: Callable[[bytes], bytes] | None = None


def opened_by(call: Callable[[bytes], bytes]) -> None:
    """Say what carries a frame to the page's side, and its answer back."""
    global _call
    _call = call


def ask(header: dict[str, Any], arrays: Sequence[np.ndarray] = ()) -> tuple[Any, list[np.ndarray]]:
    """Ask the page's side; return the answer's header and its arrays.

    Raises
    ------
    RuntimeError
        If the other side could not do it, with what it said.
    """
    if _call is None:
        raise RuntimeError("no page is on the other side")
    answer, results = _unpack(_call(_pack(header, arrays)))
    if "error" in answer:
        raise RuntimeError(answer["error"])
    return answer, results


def _pack(header: dict[str, Any], arrays: Sequence[np.ndarray]) -> bytes:
    about = [{"type": array.dtype.name, "shape": array.shape} for array in arrays]
    text = json.dumps({**header, "arrays": about}).encode()
    return b"".join([len(text).to_bytes(4, "little"), text, *(array.tobytes() for array in arrays)])


def _unpack(frame: bytes) -> tuple[dict[str, Any], list[np.ndarray]]:
    start = 4 + int.from_bytes(frame[:4], "little")
    header = json.loads(frame[4:start])
    arrays = []
    for about in header.pop("arrays"):
        count = int(np.prod(about["shape"]))
        array = np.frombuffer(frame, about["type"], count, start).reshape(about["shape"]).copy()
        arrays.append(array)
        start += array.nbytes
    return header, arrays
