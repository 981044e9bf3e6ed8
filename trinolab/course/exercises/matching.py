"""Exercises of chapter 6: matching."""

from __future__ import annotations

EXERCISES = ()
