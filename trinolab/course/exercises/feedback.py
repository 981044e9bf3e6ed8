"""Exercises of chapter 12: force feedback."""

from __future__ import annotations

EXERCISES = ()
