"""The slave arm at work: `session` runs filter, mapping, control and arm tick by tick, `teleoperate`
lets it follow a recording, `task` gives it one to do, `view` draws it, `operators` are models of the
person at the handle, `pointing` and `monitor` judge how they do.
"""
