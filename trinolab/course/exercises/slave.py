"""Exercises of chapter 11: from master to slave."""

from __future__ import annotations

EXERCISES = ()
