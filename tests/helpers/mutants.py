"""Wrong versions of the exercises' solutions: each differs in one place, as a slip of the pen would.

``harmless.txt`` names those that the graders take for right, with the reason why they are no mistakes.
"""

import ast
import copy
import inspect
import signal
import textwrap
import warnings
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from slips import changes, node_at
from solutions import judged

TABLE = Path(__file__).with_name("harmless.txt").read_text(encoding="utf-8")
HARMLESS = {tuple(line.split(" | ")[:2]) for line in TABLE.splitlines()}
SECONDS = 5  # a mutant in all its cases; some never end


def mutants(asked):
    """What was changed in an exercise's solution, in words, and the changed function's source."""
    source = textwrap.dedent(inspect.getsource(asked.solution))
    function = ast.parse(source).body[0]
    function.decorator_list = []
    function.body = function.body[1:]  # without the docstring
    made = {}
    for place, node in enumerate(ast.walk(function)):
        for words, change in changes(node):
            other = copy.deepcopy(function)
            change(node_at(other, place))
            text = ast.unparse(ast.fix_missing_locations(other))
            if text != ast.unparse(function):
                made.setdefault(text, f"{' '.join(ast.unparse(node).split())}: {words}")
    for name in [argument.arg for argument in function.args.args]:
        for value in (0, 1):
            other = copy.deepcopy(function)
            other.body.insert(0, ast.parse(f"{name} = {value} + 0 * {name}").body[0])
            text = ast.unparse(ast.fix_missing_locations(other))
            made[text] = f"{name}: ignored, {value} in its place"
    return [(words, text) for text, words in made.items()]


class Stopped(BaseException):
    """A mutant does not end."""


@contextmanager
def at_most(seconds):
    def stop(*_):
        raise Stopped

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def survives(asked, text):
    """Whether the grader takes a mutant for right."""
    namespace = dict(asked.solution.__globals__)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(compile(text, "<mutant>", "exec"), namespace)
        try:
            with at_most(SECONDS):
                # which of the usual mistakes it is does not matter
                return judged(replace(asked, mistakes=()), namespace[asked.name]).right
        except (Stopped, MemoryError):
            return False
