"""Every threshold of identification and following is a parameter that is read, and refuses what is no
number in its range.
"""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import trinolab
from trinolab.following.parameters import FollowParameters
from trinolab.identity.parameters import IdentityParameters
from trinolab.parameters import Parameters

PACKAGE = Path(trinolab.__file__).parent
IDENTITY = {field.name for field in fields(IdentityParameters)}
FOLLOW = {field.name for field in fields(FollowParameters)} - {
    field.name for field in fields(Parameters)
}


@pytest.mark.parametrize(("folder", "names"), [("identity", IDENTITY), ("following", FOLLOW)])
def test_each_number_is_read(folder, names):
    sources = [path.read_text() for path in (PACKAGE / folder).glob("*.py")]
    read = set(re.findall(r"\.(\w+)", "\n".join(sources)))
    assert names <= read


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e9, "1", None])
def test_what_is_no_number_in_range_is_refused_by_name(bad):
    for kind, names in ((IdentityParameters, IDENTITY), (FollowParameters, FOLLOW - {"motion"})):
        for name in names - ({"enough_evidence"} if bad == -1e9 else set()):
            with pytest.raises(ValueError, match=name):
                kind(**{name: bad})


@pytest.mark.parametrize(
    "given", [{"certain_deg": 75.0}, {"fit_gates": ()}, {"fit_gates": (4.0, 0.0)}]
)
def test_angles_and_gates_fit_together(given):
    with pytest.raises(ValueError, match=next(iter(given))):
        IdentityParameters(**given)
