"""Untrusted YAML, without aliases and bounded in size and depth."""

from typing import Any

import yaml

MAX_CHARACTERS = 2**18
MAX_DEPTH = 32  # of nested lists and maps

# libyaml's loader, where installed, does not recurse and is quick.
EVENTS: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def parse_yaml(text: str) -> Any:
    """Parse YAML without aliases, a few lines of which expand to a list of any length.

    Raises:
        ValueError: It is not YAML, is too long or too deep, or has aliases.
    """
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"it is longer than {MAX_CHARACTERS} characters")
    depth = 0
    try:
        for event in yaml.parse(text, EVENTS):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise ValueError("lists or maps are nested too deeply")
            if isinstance(event, yaml.AliasEvent):
                raise ValueError("it has aliases (*), which are not supported")
        return yaml.load(text, EVENTS)
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())[:200]) from error
