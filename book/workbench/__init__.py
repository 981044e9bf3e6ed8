"""The workbench: what the book and its users do with the algorithms of `trinolab`.

`studies` are the seeded experiments behind the chapters, `plotting` their figures, `paper` the
ledger of the equations and their misprints, `sweep` runs a chapter at many settings, `course` has the
exercises. `cli` has the commands, and `pages` builds the book.

The workbench imports `trinolab`, and `trinolab` never imports the workbench. What stands by itself beside
both is in `satellites`.
"""
