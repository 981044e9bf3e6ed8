"""Wrong versions of the exercises' solutions: each differs in one place, as a slip of the pen would."""

import ast
import copy
import inspect
import signal
import textwrap
import warnings
from contextlib import contextmanager

from slips import changes, node_at

from workbench.course.child import outcome
from workbench.course.exercise import FunctionExercise
from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.course.grading import call_of, judge_outcomes

SYMMETRIC = "both sides give the same"
ABSOLUTE = "the absolute value is taken"
WHOLE_TURN = "angles are compared but for whole turns"
NORMALISED = "the numbers only shift and scale the unknowns, and are undone at the end"
NEVER_EQUAL = "no case lies on the border, where rounding would decide"
# What survives, by exercise and change: why it is no mistake.
HARMLESS = {
    ("01.3", "(1, -1): turned round"): SYMMETRIC,
    ("01.3", "(angles_deg - angle + 180) % 360 - 180: sides swapped"): ABSOLUTE,
    ("01.3", "round((angle - sense * angles_deg[0]) % 360, 6) % 360: Add"): WHOLE_TURN,
    ("01.3", "angles_deg - angle + 180: Sub"): WHOLE_TURN,
    ("01.3", "(angle - sense * angles_deg[0]) % 360: Add"): WHOLE_TURN,
    ("01.3", "np.abs(apart) < 1e-06: LtE"): NEVER_EQUAL,
    ("01.3", "np.abs(rows_mm - row) < 1e-06: LtE"): NEVER_EQUAL,
    ("01.3", "6: 7"): "digits beyond the tolerance",
    ("01.3", "angles_deg - angle: sides swapped"): ABSOLUTE,
    ("01.3", "rows_mm - row: sides swapped"): ABSOLUTE,
    ("01.3", "0: -1"): "each marker may be the one that is brought to a place",
    ("01.3", "0: 1"): "each marker may be the one that is brought to a place",
    ("02.3", "z <= 0: Lt"): "a division by 0 is no number between the edges",
    ("02.3", "-0.5 <= u / w <= width - 0.5: Lt"): NEVER_EQUAL,
    ("02.3", "-0.5 <= v / w <= height - 0.5: Lt"): NEVER_EQUAL,
    ("03.7", "frame.astype(float) - background: sides swapped"): ABSOLUTE,
    ("04.2", "innovation ** 2 <= 9 * expected: Lt"): NEVER_EQUAL,
    ("05.3", "0: -1"): "each run is longer than 0 already",
    ("05.3", "1: 0"): "the first count is equal to itself",
    ("05.6", "window - window.min(): sides swapped"): "the sign drops out of the ratio",
    ("06.3", "math.hypot(a, b): arguments swapped"): SYMMETRIC,
    (
        "07.3",
        "(H[:, 0] / np.linalg.norm(H), H[:, 1] / np.linalg.norm(H)): turned round",
    ): "the two equations keep their meaning",
    ("07.3", "row(h1, h2): arguments swapped"): SYMMETRIC,
    ("07.3", "np.subtract(row(h1, h1), row(h2, h2)): arguments swapped"): "an equation to 0",
    **{
        ("07.3", f"{text}: {change}"): NORMALISED
        for side in ("width", "height")
        for text, change in (
            (f"(1 - {side}) / 2 / unit", "sides swapped"),
            (f"(1 - {side}) / 2", "Mult"),
            (f"(1 - {side}) / 2", "sides swapped"),
            (f"1 - {side}", "Add"),
            (f"1 - {side}", "sides swapped"),
            ("2", "1"),
            ("2", "3"),
            ("1", "0"),
            ("1", "2"),
        )
    },
    ("08.3", "n @ d: sides swapped"): SYMMETRIC,
    ("08.3", "z > 0: GtE"): NEVER_EQUAL,
    ("08.3", "z * c + T[2] > 0: GtE"): NEVER_EQUAL,
    ("08.4", "np.linalg.det(U) * np.linalg.det(Vt): Div"): "determinants of 1 or -1",
    ("08.4", "p - p_mean: Add"): "the other factor's mean is 0, and a constant drops out",
    ("08.4", "q - q_mean: Add"): "the other factor's mean is 0, and a constant drops out",
    (
        "09.3",
        "if not kept.any():\n    return np.full(3, np.nan): never",
    ): "the mean of nothing is NaN by itself",
    ("09.3", "180 - (180 - difference) % 360: sides swapped"): ABSOLUTE,
    ("09.3", "measured_deg - set_deg: sides swapped"): ABSOLUTE,
    ("09.3", "180 - difference: Add"): ABSOLUTE,
    ("09.3", "180 - difference: sides swapped"): ABSOLUTE,
    ("10.3", "3: 4"): "the trace of a part with a fourth row or column has the same three numbers",
    ("12.3", "max(x_s - wall_m, 0.0): arguments swapped"): SYMMETRIC,
}
SECONDS = 5  # a mutant in all its cases; some never end


def exercises():
    """All exercises for which a function is written."""
    return [one for it in CHAPTERS for one in of_chapter(it) if isinstance(one, FunctionExercise)]


def mutants(asked):
    """What was changed in an exercise's solution, in words, and the changed function."""
    source = textwrap.dedent(inspect.getsource(asked.solution))
    whole = ast.parse(source)
    function = whole.body[0]
    function.decorator_list = []
    function.body = function.body[1:]  # without the docstring
    made = {}
    for place, node in enumerate(ast.walk(function)):
        for words, change in changes(node):
            other = copy.deepcopy(function)
            change(node_at(other, place))
            text = ast.unparse(ast.fix_missing_locations(other))
            if text != ast.unparse(function):
                made.setdefault(text, f"{ast.unparse(node)}: {words}")
    for argument in function.args.args:
        for value in (0, 1):
            other = copy.deepcopy(function)
            other.body.insert(
                0, ast.parse(f"{argument.arg} = {value} + 0 * {argument.arg}").body[0]
            )
            text = ast.unparse(ast.fix_missing_locations(other))
            made[text] = f"{argument.arg}: ignored, {value} in its place"
    for text, words in made.items():
        namespace = dict(asked.solution.__globals__)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            exec(compile(text, "<mutant>", "exec"), namespace)
        yield words, namespace[asked.name]


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


def survives(asked, function, seconds=SECONDS):
    """Whether the grader takes a function for right."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with at_most(seconds):
                found = [outcome(function, case) for case in call_of(asked).cases]
        except (Stopped, MemoryError):
            return False
    return judge_outcomes(asked, found).right
