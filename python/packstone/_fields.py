"""What all builders of requests are: dictionaries."""

from __future__ import annotations

from typing import Any


class Fields(dict[str, Any]):
    """A dictionary without the fields that are `None`."""

    def __init__(self, **fields: Any) -> None:
        super().__init__({name: value for name, value in fields.items() if value is not None})

    def __repr__(self) -> str:
        return f"{type(self).__name__}({super().__repr__()})"
