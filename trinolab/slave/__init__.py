"""From the handle's pose to the slave arm, and back to the hand (Sect. 2, 3.1; control, bilateral and
wall are beyond the paper).

`teleoperate` is the command's way from files to files; its steps are `oneeuro` (a filter on the
pose), `mapping` (hand to tool), `control` (tool to joints), `arm` (the simulated arm), `session`
(all of them, tick by tick). `monitor` and `view` are what the operator sees, `task` is something to
do. `pointing` is a task of aimed movements, its log and how well it was done, `operators` are
models of a person who does it. `bilateral` and `wall` are about what the hand may feel.
"""
