"""Values of glued objects as they are, beside the text that IPython displays of them.

``%precision 2`` rounds what is displayed. A number or text that is displayed carries its exact
value as well, once `carry_values` has run in the kernel; `value_of` reads it.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Mapping
from typing import Any

MIME = "application/vnd.trinolab.value"


def carry_values(shell: Any, mime: str) -> None:
    """Let an IPython shell add the exact value to each number and text that it displays.

    The function stands by itself: `source_for_kernel` sends its text to kernels of other
    environments.
    """
    from IPython.core.formatters import BaseFormatter
    from traitlets import ObjectName, Unicode

    class ValueFormatter(BaseFormatter):
        format_type = Unicode(mime)
        print_method = ObjectName("_repr_exact_value_")

    formatter = ValueFormatter(parent=shell.display_formatter)
    for kind in (bool, int, float, str):
        formatter.for_type(kind, repr)
    formatter.for_type_by_name("numpy", "generic", lambda value: repr(value.item()))
    shell.display_formatter.formatters[mime] = formatter
    shell.display_formatter.active_types = [*shell.display_formatter.active_types, mime]


def source_for_kernel() -> str:
    """Code that runs `carry_values` in a kernel, and leaves no name there."""
    function = inspect.getsource(carry_values)
    call = f"carry_values(get_ipython(), {MIME!r})"
    return f"from typing import Any\n{function}\n{call}\ndel carry_values, Any"


def glued_name(metadata: Mapping[str, Any]) -> str | None:
    """The name under which an output was glued; None for any other output."""
    record = metadata.get("scrapbook")
    return None if record is None else record["name"]


def value_of(data: Mapping[str, Any], metadata: Mapping[str, Any]) -> Any:
    """The value of a glued output.

    Parameters
    ----------
    data, metadata : mapping
        The output's MIME bundle and metadata.

    Returns
    -------
    object
        A number or text; the object that the displayed text denotes, if that is a literal; else
        the displayed text itself, as a `Displayed`.
    """
    prefix = metadata["scrapbook"].get("mime_prefix", "")
    if (exact := _parsed(data.get(prefix + MIME, ""))) is not None:
        return exact
    text = data.get(prefix + "text/plain", "")
    # NumPy 2 shows its scalars as np.float64(0.5) and np.True_
    bare = re.sub(r"^np\.(?:\w+\((.*)\)|(True|False)_)$", r"\1\2", text)
    value = _parsed(bare)
    return Displayed(text) if value is None and bare != "None" else value


class Displayed(str):
    """What IPython displays of an object that is neither a number nor a text."""

    __slots__ = ()


def _parsed(text: str) -> Any:
    for parse in (ast.literal_eval, float):
        try:
            return parse(text)
        except (SyntaxError, ValueError):
            continue
    return None
