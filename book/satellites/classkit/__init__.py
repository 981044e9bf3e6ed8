"""What a class, or anybody with webcams, needs between the cameras and a tracked handle (ours).

`kit` is a command's way from a handle file to a PDF at true scale: `wrap` unrolls the handle,
`sheets` lays out its pages, a calibration board and bars that check the printer. `preflight` is the
way of another command, from a recording to a verdict on the set-up: `seen` gathers what the images
show, `criteria` judges it. It stands above the chain and knows no simulated bench: what it says of
images it measures in them.
"""
