"""An extension of Griffe: the roles of docstrings, as :class:`Job`, become links of the reference.

Sphinx would resolve them; MkDocs shows docstrings as Markdown.
"""

import re

import griffe

ROLE = re.compile(r":(?:class|meth|func|attr):`([^`]+)`")


class DocstringRoles(griffe.Extension):
    """Rewrites the docstrings of a package when it has been read."""

    def on_package(self, *, pkg: griffe.Module, **_: object) -> None:
        """Called with the package."""
        rewrite(pkg, pkg, set(pkg.exports or ()))


def rewrite(item: griffe.Object, package: griffe.Module, public: set[str]) -> None:
    """Rewrites the docstrings of an object and of what it contains."""
    if item.docstring is not None:
        item.docstring.value = ROLE.sub(lambda role: link(role[1], item, package, public), item.docstring.value)
    for member in item.members.values():
        if not member.is_alias:
            rewrite(member, package, public)


def link(name: str, item: griffe.Object, package: griffe.Module, public: set[str]) -> str:
    """The link to a public object; its name as code if it is a member of a class that is not public."""
    if name.split(".")[0] in public:
        return f"[`{name}`][{package.path}.{name}]"
    owner = item if item.is_class else item.parent
    if owner is not None and owner.is_class and owner.name in public:
        return f"[`{name}`][{package.path}.{owner.name}.{name}]"
    return f"`{name}`"
