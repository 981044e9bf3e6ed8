"""The live system: cameras, or what stands in for them, to a moving arm, shown on a page of this computer.

`sources` always has the latest frame of each camera, `loop` takes it through tracker, mapping and
arm, `pointing` is a task for the person, `recording` keeps the images, `picture` makes what the page
shows, `server` lets one page in, and `command` puts them together.
"""
