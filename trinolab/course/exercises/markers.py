"""Exercises of chapter 5: the markers."""

from __future__ import annotations

EXERCISES = ()
