"""From cameras to a recording folder: `devices` are what delivers images, `capture` writes them."""
