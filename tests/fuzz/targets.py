"""All that is fuzzed, by name."""

from tests.fuzz import files, messages, settings
from tests.fuzz.target import Target

TARGETS: dict[str, Target] = {
    target.name: target for target in (*messages.TARGETS, *files.TARGETS, *settings.TARGETS)
}
