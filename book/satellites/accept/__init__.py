"""A data sheet for a rig, its handle and this measurement, made by one command: what was measured,
how, where in the field of view, how fast, and how sure each number is.

It is laid out after ASTM E2919 (static poses), ASTM F2554 (a pointer's tip), ISO 9283 (an arm's
poses and paths) and Wiles et al. 2004 (optical tracking systems). Their texts were not followed,
and conformity is not claimed.

`command` makes the sheet; `rest`, `static`, `moving`, `pointer`, `latency`, `availability` and
`arm` are its tests, `history` its control chart. Each test draws poses, renders and measures them
(`parts`, `run`), and makes numbers with intervals of what was found (`judge`). `setup` has what
all tests share, `size` how large a sheet may be, `tracks` the poses found in a sequence,
`workbench.intervals` the statistics, `numbers` the form of an answer, `figures` what is drawn, `work` the
parts of the tests, `sheet` the page, `renew` one test of the shipped sheet measured again.
"""
