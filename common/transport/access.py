"""Who may say and hear what: Zenoh's access rules, derived from the table of streams.

Whoever proves a role (by certificate or password) may publish the topics whose producer it is and
receive those whose readers name it; nothing else passes. Rules are written from the side of the
process that enforces them: "ingress" comes from the other, "egress" goes to it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

from common.transport.clock import NAME as CLOCK
from people4d.topics import EVERY_SERVICE, TOPICS, Topic, prefix, question

WATCHDOG = "watchdog"  # only hears how the others are
ROUTER = "router"
PEOPLE = ("planner", "operator")  # roles of programs that are no service of ours
HERE = ("lo",)  # interfaces of links that do not leave the host

# What a publisher sends, and what a subscriber sends. Tokens, queries and replies belong to topics
# that late joiners get the last message of.
OFFERS = ("put", "delete", "reply", "declare_queryable", "liveliness_token")
CLOCK_OFFERS, CLOCK_ASKS = ("reply", "declare_queryable"), ("query",)
ASKS = ("declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber")

Proof = Literal["cert_common_names", "usernames"]
Rule = Mapping[str, Any]
Said = tuple[Sequence[str], list[str]]  # kinds of Zenoh's messages, and their keys


def roles() -> tuple[str, ...]:
    """Return all roles: the services, then those of `PEOPLE`."""
    named = {WATCHDOG}.union(*({*topic.producers, *topic.readers.split()} for topic in TOPICS))
    return (ROUTER, *sorted(named - {ROUTER, EVERY_SERVICE, "*", *PEOPLE}), *PEOPLE)


def may_publish(role: str, topic: Topic) -> bool:
    """Return whether a role may publish a topic; of health only its own."""
    return role in topic.producers or (topic.producer == EVERY_SERVICE and role not in PEOPLE)


def may_read(role: str, topic: Topic) -> bool:
    """Return whether a role may receive a topic."""
    return topic.readers == "*" or role in topic.readers.split()


def access_control(proof: Proof, here: Sequence[str] = HERE) -> dict[str, Any]:
    """Return Zenoh's `access_control` for a router or a peer that others connect to.

    Args:
        proof: How Zenoh knows the role of the other: its certificate's name or its user name.
        here: Interfaces on which topics may pass that do not leave the host.
    """
    rules = [rule for role in roles() for topic in TOPICS for rule in _topic_rules(role, topic)]
    rules += [rule for role in roles() for rule in _presence_rules(role)]
    rules += [rule for role in roles() for rule in _clock_rules(role)]
    subjects, policies = [], []
    for role in roles():
        for name, limit in ((role, {}), (f"{role} here", {"interfaces": list(here)})):
            subjects.append({"id": name, proof: [role], **limit})
            mine = [rule["id"] for rule in rules if rule["id"].startswith(f"{name}: ")]
            policies.append({"subjects": [name], "rules": mine})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": [policy for policy in policies if policy["rules"]],
    }


def downsampling(interfaces: Sequence[str], highest_hz: float) -> list[dict[str, Any]]:
    """Return Zenoh's `downsampling` for slow links: topics of one key that come more often.

    Zenoh counts once for all keys that a rule covers, so that of a topic with one key for each
    camera or instance some would never pass; those are left alone.

    Args:
        interfaces: Names of the network interfaces of slow links.
        highest_hz: Most messages that may pass in a second, of each topic.
    """
    rules = [
        {"key_expr": topic.key_expression("*"), "freq": highest_hz}
        for topic in TOPICS
        if topic.rate_hz > highest_hz and "{" not in topic.key
    ]
    if not rules:
        return []
    slow = {"interfaces": list(interfaces), "messages": ["put"], "flows": ["egress"]}
    return [{**slow, "rules": rules}]


def _topic_rules(role: str, topic: Topic) -> Iterator[Rule]:
    """Yield the rules of one role on one topic; the router passes on what all others say."""
    name = role if topic.leaves_host else f"{role} here"
    keys = _keys(topic, "")
    own = _keys(topic, role) if topic.producer == EVERY_SERVICE and role != ROUTER else keys
    if may_publish(role, topic) or role == ROUTER:
        # Who speaks hears of those who listen, to all that there is of a topic.
        yield from _rules(f"{name}: publish {topic.name}", (OFFERS, own), (ASKS, keys))
    if may_read(role, topic) or role == ROUTER:
        yield from _rules(f"{name}: read {topic.name}", (ASKS, keys), (OFFERS, keys))


def _presence_rules(role: str) -> Iterator[Rule]:
    """Yield the rules of the tokens that tell which processes are there."""
    alive = [f"{prefix('*')}/alive/**"]
    if role not in PEOPLE:
        own = alive if role == ROUTER else [f"{prefix('*')}/alive/{role}/**"]
        yield from _rules(f"{role}: be alive", (OFFERS, own), (ASKS, alive))
    yield from _rules(f"{role}: see who is alive", (ASKS, alive), (OFFERS, alive))


def _clock_rules(role: str) -> Iterator[Rule]:
    """Yield the rules of the question for the time: everybody asks, the router answers."""
    key = [question("*", CLOCK)]
    if role == ROUTER:
        yield from _rules(f"{role}: tell the time", (CLOCK_OFFERS, key), (CLOCK_ASKS, key))
    yield from _rules(f"{role}: ask the time", (CLOCK_ASKS, key), (CLOCK_OFFERS, key))


def _rules(name: str, says: Said, hears: Said) -> Iterator[Rule]:
    for flow, (messages, keys) in (("ingress", says), ("egress", hears)):
        yield {
            "id": f"{name}, {flow}",
            "permission": "allow",
            "messages": list(messages),
            "flows": [flow],
            "key_exprs": keys,
        }


def _keys(topic: Topic, service: str) -> list[str]:
    """Return a topic's keys on any robot, only those of a service if one is named; and its cache's.

    Zenoh keeps the last message of a latched topic for late joiners below @adv.
    """
    own = topic.key.replace("{service}", service or "*")
    expression = f"{prefix('*')}/{re.sub('{[^}]*}', '*', own)}"
    return [expression, f"{expression}/@adv/**"]
