"""Exercises of chapter 7: calibration."""

from __future__ import annotations

EXERCISES = ()
