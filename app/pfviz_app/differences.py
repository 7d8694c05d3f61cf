"""What is unlike the usual, in whatever has fields."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def differences(one: DataclassInstance, other: DataclassInstance, names: Iterable[str] | None = None) -> dict[str, Any]:
    """The fields in which ``one`` differs from ``other``, and their values in ``one``.

    Args:
        one: a dataclass's instance.
        other: of the same class.
        names: of the fields that count; all by default.
    """
    counting = [field.name for field in fields(one)] if names is None else names
    return {name: getattr(one, name) for name in counting if getattr(one, name) != getattr(other, name)}
