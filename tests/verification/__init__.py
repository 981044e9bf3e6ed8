"""The heavy counts of `make verify`, a module a section; each prints its report."""
