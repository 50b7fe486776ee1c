"""Parts by name: those that ship, those of installed packages, those registered at run time."""

import pickle
from importlib.metadata import EntryPoint

import pytest

from alloc import registry as registry_module
from alloc.registry import Registry
from alloc.rules import RULES


@pytest.fixture
def rules(monkeypatch):
    entries = [EntryPoint("tan", "math:tan", "group"), EntryPoint("broken", "nowhere:x", "group")]
    monkeypatch.setattr(registry_module, "offered", lambda group: entries)
    return Registry("rule", "group", LookupError)


def test_a_part_is_found_by_its_name(rules):
    rules.register("one", 1)
    assert rules["one"] == rules.find("one") == 1
    assert rules.origin("one") == __name__


def test_parts_of_installed_packages_are_loaded_when_asked_for(rules):
    import math

    assert list(rules) == ["tan", "broken"]
    assert rules["tan"] is math.tan
    assert rules.origin("tan") == "math"
    with pytest.raises(ModuleNotFoundError):
        rules["broken"]


def test_an_unknown_name_is_refused_with_the_nearest(rules):
    rules.register("greedy", 1)
    with pytest.raises(LookupError, match="unknown rule 'gredy'; did you mean 'greedy'"):
        rules.find("gredy")


def test_a_name_is_taken_once(rules):
    rules.register("one", 1, "elsewhere")
    with pytest.raises(LookupError, match="rule 'one' exists already, from elsewhere"):
        rules.register("one", 2)
    with pytest.raises(LookupError, match="rule 'tan' exists already, from an installed package"):
        rules.register("tan", 2)
    assert rules["one"] == 1


def test_a_module_may_register_its_part_again(rules):
    rules.register("one", 1)
    rules.register("one", 2)
    assert rules["one"] == 2


def test_shipped_parts_come_first_in_their_order():
    from alloc.plant.sets import SETS

    names = list(SETS)
    assert names[:2] == ["one-axle", "jp4209318-3car"]
    assert SETS.shipped() == names
    assert SETS.origin("freight-17") == "alloc.plant.sets"


def test_another_process_takes_its_own_registry():
    assert pickle.loads(pickle.dumps(RULES)) is RULES
