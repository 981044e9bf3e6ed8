"""Exercises of chapter 3: the background."""

from __future__ import annotations

EXERCISES = ()
