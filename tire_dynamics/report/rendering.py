"""Templates of this folder made into pages, by Jinja2, which escapes every text."""

from __future__ import annotations

from typing import Any

__all__ = ["rendered"]


def rendered(template: str, **values: Any) -> str:
    """A template with its values; ``tojson`` in it makes JSON that no tag can end."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(__package__ or "", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return environment.get_template(template).render(values)
