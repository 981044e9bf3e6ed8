"""Exercises of chapter 8: the pose."""

from __future__ import annotations

EXERCISES = ()
