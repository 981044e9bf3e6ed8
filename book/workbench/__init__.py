"""The workbench: what the book and its users do with the algorithms of `trinolab`.

`studies` are the seeded experiments behind the chapters, `plotting` their figures, `paper` the
ledger of the equations and their misprints, `sweep` runs a chapter at many settings, `course` has the
exercises. `cli` has the commands, and what they start stands beside it: `live`, `classkit`, `accept`,
`teleop`, `bags`. `second` is another renderer, and `pages` builds the book.

The workbench imports `trinolab`, and `trinolab` never imports the workbench.
"""
