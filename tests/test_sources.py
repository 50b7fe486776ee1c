"""What decides a result is every file behind it, and nothing in them that is not run."""

import subprocess
import sys
from types import ModuleType

import pytest

from alloc import sources
from alloc.sources import closure, code_hash

FILES = {
    "pack/__init__.py": '"""A package."""\n\nVERSION = 1\n',
    "pack/top.py": (
        '"""Top."""\n\nfrom pack.part import leaf\nfrom pack.parts import PARTS\n\n\n'
        'def top():\n    """Do."""\n    return leaf() + 1\n'
    ),
    "pack/part/__init__.py": '"""A part."""\n',
    "pack/part/leaf.py": "def leaf():\n    from pack import lazy\n\n    return lazy.VALUE\n",
    "pack/lazy.py": "VALUE = 1.0  # first\nSCENARIO = 'derived'\n",
    "pack/derived.toml": "base = 'base'  # a comment\nlevel = 3.0\n",
    "pack/base.toml": "level = 1.0\n",
    "pack/unnamed.toml": "level = 1.0\n",
    "pack/parts/__init__.py": "PARTS = Registry('part', package='pack.parts')\n",
    "pack/parts/one.py": "PARTS.register('one', 1)\n",
    "pack/other.py": "VALUE = 2.0\n",
}
CLOSURE = [name for name in FILES if name not in ("pack/other.py", "pack/unnamed.toml")]


def forget(module=sources):
    """Clear what a process remembers of what does not change while it runs."""
    for remembered in vars(module).values():
        if hasattr(remembered, "cache_clear"):
            remembered.cache_clear()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Hash of the module `pack.top` of a small package, and what edits one of its files."""
    monkeypatch.setattr(sources, "ROOT", tmp_path)
    monkeypatch.setattr(sources, "PACKAGES", ("pack",))
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def edited(name, *replacements, end=""):
        path = tmp_path / name
        text = FILES[name]
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text + end)
        forget()
        found = code_hash("pack.top")
        path.write_text(FILES[name])
        forget()
        return found

    forget()
    yield edited
    forget()


@pytest.mark.parametrize("name", CLOSURE)
def test_an_edit_of_any_file_behind_a_module_changes_its_hash(package, name):
    before = code_hash("pack.top")
    assert package(name, end="\nMORE = 1\n") != before
    assert code_hash("pack.top") == before


@pytest.mark.parametrize("name", FILES)
def test_comments_do_not_count(package, name):
    assert package(name, end="\n\n# a word\n") == code_hash("pack.top")


def test_docstrings_do_not_count_but_values_do(package):
    before = code_hash("pack.top")
    words = package("pack/top.py", ('"""Top."""', '"""Peak."""'), ('"""Do."""', '"""Do it."""'))
    assert words == before
    assert package("pack/lazy.py", ("# first", "# second")) == before
    assert package("pack/lazy.py", ("1.0", "1.5")) != before
    assert package("pack/top.py", ("+ 1", "+ 2")) != before


def test_what_is_not_imported_does_not_count(package):
    before = code_hash("pack.top")
    assert package("pack/other.py", ("2.0", "3.0")) == before
    assert package("pack/top.py", ("import leaf", "import leaf  # and no more")) == before
    assert code_hash("pack.top", "pack.other") != before


def test_what_annotations_alone_name_counts_for_rows_and_not_for_kernels(package, tmp_path):
    """A kernel's types are in its signature, and no number depends on an annotation."""
    top = tmp_path / "pack" / "top.py"
    for use, counts in (
        ("def f(x: VALUE) -> VALUE:\n    y: VALUE = x\n    return y\n", False),
        ("def f(x: 'VALUE'):\n    return x\n", False),
        ("def f(x: VALUE):\n    return x * VALUE\n", True),
        ("def f(x: VALUE = VALUE):\n    return x\n", True),
        ("ALIAS = list[VALUE]\ndef f(x: ALIAS, y: VALUE):\n    return x\n", True),
        ("__all__ = ['VALUE']\ndef f(x: VALUE):\n    return x\n", True),
        ("def f(x):\n    return x\n", True),  # for others to import from here
    ):
        top.write_text(f"from pack.other import VALUE\n{use}")
        forget()
        assert ("pack.other" in closure("pack.top", later=False)) is counts, use
        assert "pack.other" in closure("pack.top"), use
        top.write_text(f"from .other import VALUE\n{use}")
        forget()
        assert "pack.other" in closure("pack.top"), use


def test_the_solvers_kernels_survive_another_constant_of_the_plants_laws():
    for module in ("mpc.solver", "mpc.condensing", "mpc.box_qp"):
        assert "alloc.plant.laws" not in closure(module, later=False)
        assert "alloc.plant.laws" in closure(module)


def test_of_installed_packages_the_version_counts(package, monkeypatch):
    before = code_hash("pack.top")
    for library in sources.LIBRARIES:
        with monkeypatch.context() as patch:
            found = {**sources.library_versions(), library: "0.0.0"}
            patch.setattr(sources, "library_versions", lambda found=found: found)
            forget()
            assert code_hash("pack.top") != before
    forget()
    assert code_hash("pack.top") == before


def test_a_part_of_another_package_counts_with_what_it_imports_there(
    package, tmp_path, monkeypatch
):
    own = tmp_path / "elsewhere" / "foreign"
    own.mkdir(parents=True)
    (own / "__init__.py").write_text("")
    (own / "part.py").write_text("import numpy\nfrom . import nearer\n")
    (own / "nearer.py").write_text("from .inner import VALUE\n")
    (own / "inner.py").write_text("VALUE = 1\n")
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    before = code_hash("pack.top", "foreign.part")
    (own / "inner.py").write_text("VALUE = 2\n")
    forget()
    assert code_hash("pack.top", "foreign.part") != before


def test_a_data_file_that_a_source_names_counts_and_so_does_the_one_that_it_names(package):
    before = code_hash("pack.top")
    assert package("pack/base.toml", ("1.0", "2.0")) != before
    assert package("pack/derived.toml", ("3.0", "4.0")) != before
    assert package("pack/derived.toml", ("# a comment", "# another")) == before
    assert package("pack/unnamed.toml", ("1.0", "2.0")) == before


def test_an_edited_plugin_changes_the_hash_be_it_code_or_a_train(tmp_path, monkeypatch):
    for file, text, other in (
        ("own.py", "VALUE = 1\n", "VALUE = 2\n"),
        ("train.toml", "mass_t = 30\n", "mass_t = 40\n"),
    ):
        name = f"{sources.PLUGIN_PREFIX}{file.partition('.')[0]}"
        module = ModuleType(name)
        module.__file__ = str(tmp_path / file)
        monkeypatch.setitem(sys.modules, name, module)
        hashes = set()
        for content in (text, other, text):
            (tmp_path / file).write_text(content)
            forget()
            hashes.add(code_hash(name))
        assert len(hashes) == 2
    forget()


def test_what_a_run_imports_is_in_its_closure():
    """Against what Python itself says that it imports."""
    text = (
        "import sys, studies.runs, alloc.simulation, alloc.rules.wear\n"
        "print(*(n for n in sys.modules if n.partition('.')[0] in ('alloc', 'mpc', 'studies')))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=True
    )
    assert set(loaded.stdout.split()) <= closure("studies.runs", "alloc.rules.wear")
