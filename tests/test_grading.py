"""What the grader says to an answer that is wrong in two ways."""

from trinolab.course.child import outcome
from trinolab.course.exercises import exercise
from trinolab.course.grading import call_of, judge_outcomes


def test_a_usual_mistake_is_recognised_although_a_corner_case_fails_too():
    asked = exercise("04.2")
    usual = asked.mistakes[0]
    cases = call_of(asked).cases

    def with_corners(lost):
        found = [outcome(usual.gives, case) for case in cases]
        for k in lost:
            found[k] = {
                "raised": "IndexError: list index out of range",
                "printed": False,
                "changed": [],
            }
        return judge_outcomes(asked, found).says

    assert with_corners([1]) == f"{usual.says} Read chapter {usual.read}."
    assert "raises IndexError" in with_corners([0, 1])
