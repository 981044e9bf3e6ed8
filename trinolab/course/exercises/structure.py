"""Exercises of chapter 1: the structure of the system."""

from __future__ import annotations

EXERCISES = ()
