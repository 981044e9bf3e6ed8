"""Films: `video` writes one and lets a page play it, `overlay` draws what the tracker saw."""
