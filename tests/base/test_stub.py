"""The stub of the compiled core: what it says and what the module has are the same, name by name, both ways."""

import ast
import inspect
from pathlib import Path
from typing import Any

import oarlock
import oarlock._core as _core
import pytest

STUB = ast.parse((Path(oarlock.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))

Parameters = list[tuple[str, str, bool]]
"""Name, kind and whether there is a default, of each parameter but self."""

UNSAID = {"__doc__", "__file__", "__loader__", "__name__", "__package__", "__spec__", "__all__"}
"""What every module has."""


def public(names: Any) -> set[str]:
    return {name for name in names if not name.startswith("_")}


def written(function: ast.FunctionDef, *, bound: bool) -> Parameters:
    given = function.args
    positional = [*given.posonlyargs, *given.args]
    kinds = ["POSITIONAL_ONLY"] * len(given.posonlyargs) + ["POSITIONAL_OR_KEYWORD"] * len(given.args)
    defaults = [False] * (len(positional) - len(given.defaults)) + [True] * len(given.defaults)
    found = list(zip([one.arg for one in positional], kinds, defaults, strict=True))[1 if bound else 0 :]
    if given.vararg:
        found.append((given.vararg.arg, "VAR_POSITIONAL", False))
    found += [
        (one.arg, "KEYWORD_ONLY", default is not None)
        for one, default in zip(given.kwonlyargs, given.kw_defaults, strict=True)
    ]
    if given.kwarg:
        found.append((given.kwarg.arg, "VAR_KEYWORD", False))
    return found


def compiled(function: Any, *, bound: bool) -> Parameters:
    given = list(inspect.signature(function).parameters.values())[1 if bound else 0 :]
    return [(one.name, one.kind.name, one.default is not one.empty) for one in given]


CLASSES = {node.name: node for node in STUB.body if isinstance(node, ast.ClassDef)}
FUNCTIONS = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}
CONSTANTS = {
    node.target.id: node for node in STUB.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
}


def members(name: str) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in CLASSES[name].body if isinstance(node, ast.FunctionDef)}


def is_property(function: ast.FunctionDef) -> bool:
    return any(isinstance(one, ast.Name) and one.id == "property" for one in function.decorator_list)


def test_the_module_has_what_the_stub_says_and_nothing_else():
    assert {*CLASSES, *FUNCTIONS, *CONSTANTS} == public(set(dir(_core)) - UNSAID)
    for name, node in CONSTANTS.items():
        assert isinstance(node.annotation, ast.Name)
        assert type(getattr(_core, name)).__name__ == node.annotation.id, name


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions_take_what_the_stub_says(name):
    assert compiled(getattr(_core, name), bound=False) == written(FUNCTIONS[name], bound=False)


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_classes_have_what_the_stub_says(name):
    found = getattr(_core, name)
    if issubclass(found, Exception):
        assert members(name) == {}
        assert [ast.unparse(base) for base in CLASSES[name].bases] == [base.__name__ for base in found.__bases__]
        return
    said = members(name)
    assert public(said) == public(vars(found))
    for member, function in said.items():
        if member == "__new__":
            assert compiled(found, bound=False) == written(function, bound=True)
        elif is_property(function):
            assert inspect.isdatadescriptor(vars(found)[member]), member
        else:
            assert compiled(vars(found)[member], bound=True) == written(function, bound=True), member
    if "__new__" not in said:
        with pytest.raises(TypeError, match=r"No constructor|cannot create"):
            found()
