"""The book in the reader's browser: `fetch` gets the runtime, `site` builds the folder for a host,
`numbers` compares what the chapters glue there with the built pages.

Nothing else of the book needs it, and it is never fetched but by ``make browser``.
"""
