"""Identification: which image belongs to which marker of the handle. Poses from triplets, verified
in every image.

The paper assumes that the markers are identified (Sect. 5.2); this folder identifies them.
`identify` is the whole method, and the modules are its steps: `layout` (handle and rig as arrays),
`p3p` and `search` (poses to try), `hypotheses` (what a pose explains), `scoring` (which poses
hold), `ends` (which way round the body is). `reconcile` corrects the rig by the contradictions
between the identified markers.
"""

from .identify import Hypothesis, choose, equivalents, identify, labelled_pixels, relabel

__all__ = ["Hypothesis", "choose", "equivalents", "identify", "labelled_pixels", "relabel"]
