"""Exercises of chapter 10: estimators."""

from __future__ import annotations

EXERCISES = ()
