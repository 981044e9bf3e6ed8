"""The live system: cameras, or what stands in for them, to a moving arm, shown on a page of this computer.

`sources` always has the latest frame of each camera, `loop` takes it through tracker, mapping and
arm, `recording` keeps it, `picture` makes what the page shows of it, `server` lets one page in, and
`command` puts them together.
"""
