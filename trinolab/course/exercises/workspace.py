"""Exercises of chapter 2: the workspace."""

from __future__ import annotations

EXERCISES = ()
