"""Exercises of chapter 9: Table 1."""

from __future__ import annotations

EXERCISES = ()
