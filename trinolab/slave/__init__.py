"""Mathematics from the handle's pose to the slave arm, and back to the hand (Sect. 2, 3.1; control,
bilateral and wall are beyond the paper).

`oneeuro` is a filter on the pose, `mapping` takes the hand's motion to the tool's, `control` the tool's
to the joints', and `arm` is the simulated arm. `bilateral` and `wall`
are about what the hand may feel.
"""
