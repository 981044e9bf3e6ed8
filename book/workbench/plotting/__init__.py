"""Figures: arrays in, figures out. `basics` has what several chapters draw, the other modules a
chapter's own figures.
"""
