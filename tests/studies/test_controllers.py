"""Controllers by name: built-in and hosted ones stand in one collection."""

import pytest

from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.host import CONTROLLERS
from studies.core.controllers import check_controller, is_hosted
from studies.files.study_error import StudyError


def test_built_in_controllers_are_not_hosted():
    assert list(CONTROLLERS) == [
        *BUILT_IN,
        "mpc",
        "mpc-car",
        "mpc-opti",
        "mpc-train",
        "mpc-train-ideal",
    ]
    assert not any(is_hosted(name) for name in BUILT_IN)


@pytest.mark.parametrize("name", ["mpc", "mpc-car", "mpc-opti", "mpc-train", "mpc-train-ideal"])
def test_the_mpc_is_found_by_its_name(name):
    assert is_hosted(name)
    assert CONTROLLERS[name].name == name
    assert CONTROLLERS.origin(name) == "mpc.hosted"
    check_controller(name)


def test_an_unknown_controller_is_refused():
    with pytest.raises(StudyError, match="did you mean 'cut-and-ramp'"):
        check_controller("cut-and-rampp")


def test_a_controller_whose_package_lacks_something_is_refused(monkeypatch):
    class Missing(dict):
        def __getitem__(self, name):
            raise ModuleNotFoundError("No module named 'solver'")

    monkeypatch.setattr(CONTROLLERS, "_parts", Missing(lacking=None))
    with pytest.raises(StudyError, match=r"'lacking' needs .* not installed \(No module named"):
        check_controller("lacking")
