"""Notebooks made for the purpose."""

import nbformat
from nbformat.v4 import new_code_cell, new_notebook


def make_notebook(path, *cells, parameters="a = 1.0\nseed = 0"):
    """Write a notebook from a parameters cell (None for none) and code cells; return its path."""
    first = (
        [] if parameters is None else [new_code_cell(parameters, metadata={"tags": ["parameters"]})]
    )
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook = new_notebook(
        cells=[*first, *map(new_code_cell, cells)], metadata={"kernelspec": kernel}
    )
    nbformat.write(notebook, path)
    return path


def glued(**values):
    """Code that glues expressions."""
    return "from myst_nb import glue\n" + "\n".join(
        f"glue({name!r}, {code}, display=False)" for name, code in values.items()
    )
