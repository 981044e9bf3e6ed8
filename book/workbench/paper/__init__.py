"""The paper as printed: the ledger of its equations, and its misprints with what they do. Nothing
here is for use.
"""
