"""Identification: which image belongs to which marker of the handle. Poses from triplets, verified
in every image.

The paper takes it for granted that the markers are told apart (Sect. 5.2); this folder does it.
`identify` is the whole way; the modules are its steps: `layout` (handle and rig as arrays), `p3p`
and `search` (poses to try), `hypotheses` (what a pose explains), `scoring` (which poses hold),
`ends` (which way round the body is). `reconcile` corrects the rig by what the identified markers
contradict each other.
"""

from .identify import Hypothesis, choose, equivalents, identify, labelled_pixels, relabel

__all__ = ["Hypothesis", "choose", "equivalents", "identify", "labelled_pixels", "relabel"]
