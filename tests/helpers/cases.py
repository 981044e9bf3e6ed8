"""Cases as rows of a plain text table: what is given, a bar, and what follows from it. A section
begins with a dollar sign and its name; a number sign begins a comment.
"""


def cases(path, section=None):
    """Rows (section, given, follows) of a table, or rows (given, follows) of one section."""
    found, name = [], ""
    for row in path.read_text(encoding="utf-8").splitlines():
        if row.startswith("$"):
            name = row[1:].strip()
        elif row and row[0] != "#":
            given, follows = (part.strip() for part in row.rsplit(" |", 1))
            found.append((name, given, follows))
    return found if section is None else [row[1:] for row in found if row[0] == section]


def unescaped(written):
    r"""Text in which ``\n`` stands for the end of a line, and so on."""
    return written.encode().decode("unicode_escape")
