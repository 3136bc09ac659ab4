from __future__ import annotations

import ast

from terraport_pipeline.import_graph import Needs, modules_needed, needs_of

SOURCES = {
    "shop": "from shop.till import Till\nfrom shop.stock import count\n__all__ = ['Till']",
    "shop.till": "import shop.coins\ndef f():\n  from shop.bank import wire\n  wire(shop.coins)",
    "shop.coins": "",
    "shop.bank": "PROGRAM = 'import sys; from shop.vault import lock'",
    "shop.vault": "",
    "shop.stock": "'''Counts; see shop.coins.'''\nMODULE = f'shop.shelf.{1}'",
    "shop.shelf": "def label(): ...\nTOP = label()",
    "shop.shelf.low": "",
}


def needs(name: str) -> Needs | None:
    if name not in SOURCES:
        return None
    nodes = list(ast.walk(ast.parse(SOURCES[name])))
    return needs_of(nodes, name, package=name in {"shop", "shop.shelf"})


def below(package: str) -> list[str]:
    return [name for name in SOURCES if f"{name}.".startswith(f"{package}.")]


def modules_of(text: str) -> tuple[set[str], set[str]]:
    return modules_needed(needs_of(list(ast.walk(ast.parse(text)))).names, needs, below)


def test_a_name_that_a_package_hands_on_leads_to_where_it_comes_from() -> None:
    assert modules_of("from shop import Till\nTill()") == ({"shop.till"}, {"shop"})
    assert modules_of("import shop\nshop.count(3)") == ({"shop.stock"}, {"shop"})


def test_an_import_inside_a_function_counts_and_a_docstring_does_not() -> None:
    till, stock = needs("shop.till"), needs("shop.stock")
    assert till is not None
    assert stock is not None
    assert till.names == {"shop.bank.wire", "shop.coins"}
    assert "shop.coins" not in stock.names


def test_an_import_that_nobody_uses_is_handed_on_alone() -> None:
    package = needs("shop")
    assert package is not None
    assert package.names == frozenset()
    assert package.exports == {"Till": "shop.till.Till", "count": "shop.stock.count"}


def test_a_program_in_a_string_counts_and_so_does_a_module_that_is_named_late() -> None:
    bank, stock = needs("shop.bank"), needs("shop.stock")
    assert bank is not None
    assert stock is not None
    assert modules_needed(bank.names, needs, below)[0] == {"shop.vault"}
    assert modules_needed(stock.names, needs, below)[0] == {"shop.shelf", "shop.shelf.low"}


def test_a_package_with_code_of_its_own_is_used() -> None:
    assert modules_of("from shop.shelf import label\nlabel()") == ({"shop.shelf"}, {"shop"})


def test_whoever_asks_where_a_package_lies_reads_all_of_it() -> None:
    assert modules_of("import shop.shelf\nprint(shop.shelf.__file__)")[0] == {
        "shop.shelf",
        "shop.shelf.low",
    }


def test_a_string_that_only_looks_like_a_module_does_not_pull_in_the_package() -> None:
    assert modules_of("PROTOCOL = 'shop.v1'") == (set(), {"shop"})


def test_relative_imports_are_resolved() -> None:
    nodes = list(ast.walk(ast.parse("from .coins import penny\nfrom . import bank\npenny(bank)")))
    assert needs_of(nodes, "shop.till").names == {"shop.coins.penny", "shop.bank"}
    assert needs_of(nodes, "shop", package=True).names == {"shop.coins.penny", "shop.bank"}
