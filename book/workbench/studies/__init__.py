"""Experiments with a seed behind chapters, claims and shipped tables. Only the book and the
commands import them.
"""
