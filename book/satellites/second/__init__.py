"""A second renderer of the handle, by path tracing: a room with textured lamps, varnished markers and
a lens that focuses.

It shares neither a line nor a model with the simulated bench: Mitsuba 3 follows the light, and of
this package it takes cameras, handles and files alone. What fits images of the bench may fit them
because it has the bench's own model; here it cannot. Mitsuba is the optional extra ``second``.
"""
