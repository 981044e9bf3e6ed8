"""Sentences that several tests meet: each is written down here, and nowhere else."""

BUSY = "another process works on it"
COLOUR = "colour converted to grey; said once"
SIXTEEN_BIT = "16 bit scaled to grey levels 0 to 255; said once"
