"""Zenoh's access rules, derived from the table of streams.

A process with a proven role (by certificate or password) may publish the topics that the role
produces and receive the topics that it reads; nothing else passes. Rules take the view of the
enforcing process: "ingress" comes from the other process, "egress" goes to it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

from common.transport.clock import CLOCK
from people4d.topics import EVERY_SERVICE, TOPICS, Topic, prefix, query_key

WATCHDOG = "watchdog"  # role of the reader of health only
ROUTER = "router"
CLIENT_ROLES = ("planner", "operator")  # roles of programs outside the pipeline
PIXELS = "raw/"  # key prefix of topics with images
LOCAL_INTERFACES = ("lo",)  # interfaces within the host

# Zenoh messages of a publisher and of a subscriber. Tokens, queries and replies belong to latched
# topics.
PUBLISHER = ("put", "delete", "reply", "declare_queryable", "liveliness_token")
SUBSCRIBER = ("declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber")
REPLIER, QUERIER = ("reply", "declare_queryable"), ("query",)

Proof = Literal["cert_common_names", "usernames"]
Rule = Mapping[str, Any]
Traffic = tuple[Sequence[str], list[str]]  # kinds of Zenoh's messages, and their keys


def roles() -> tuple[str, ...]:
    """Return all roles: services, then clients."""
    named = {WATCHDOG}.union(*({*topic.producers, *topic.readers.split()} for topic in TOPICS))
    return (ROUTER, *sorted(named - {ROUTER, EVERY_SERVICE, "*", *CLIENT_ROLES}), *CLIENT_ROLES)


def may_publish(role: str, topic: Topic) -> bool:
    """Check that a role may publish a topic; a service publishes only its own health."""
    return role in topic.producers or (topic.producer == EVERY_SERVICE and role not in CLIENT_ROLES)


def may_read(role: str, topic: Topic) -> bool:
    """Check that a role may receive a topic."""
    return topic.readers == "*" or role in topic.readers.split()


def access_control(
    proof: Proof, local: Sequence[str] = LOCAL_INTERFACES, privacy: bool = False
) -> dict[str, Any]:
    """Return Zenoh's `access_control` for a router or peer that accepts connections.

    Args:
        proof: Proof of the other's role: its certificate's name or its user name.
        local: Interfaces for topics that must not leave the host.
        privacy: True: no topic with pixels leaves the host.
    """
    subjects, policies, rules = [], [], list[Rule]()
    for role in roles():
        own = [rule for topic in TOPICS for rule in _topic_rules(role, topic, privacy)]
        own += [*_presence_rules(role), *_clock_rules(role)]
        rules += own
        for name, limit in ((role, {}), (f"{role} local", {"interfaces": list(local)})):
            subjects.append({"id": name, proof: [role], **limit})
            ids = [rule["id"] for rule in own if rule["id"].startswith(f"{name}: ")]
            policies.append({"subjects": [name], "rules": ids})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": [policy for policy in policies if policy["rules"]],
    }


def has_pixels(topic: Topic) -> bool:
    """Check that the messages of a topic hold images."""
    return topic.key.startswith(PIXELS)


def privacy_control(local: Sequence[str] = LOCAL_INTERFACES) -> dict[str, Any]:
    """Return Zenoh's `access_control` without roles: pixels pass on interfaces of the host only.

    On other interfaces only topics of the table without pixels pass, with tokens of processes and
    queries of the time; other topics might contain pixels. All subscriptions pass, so programs that
    subscribe to everything receive the rest.

    Args:
        local: Interfaces without restriction.
    """
    keys = [key for topic in TOPICS if not has_pixels(topic) for key in _keys(topic, "")]
    keys += [f"{prefix('*')}/alive/**", query_key("*", CLOCK)]
    every, rule = ["**", "**/@adv/**"], {"permission": "allow", "flows": ["ingress", "egress"]}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {**rule, "id": "subscribe", "messages": list(SUBSCRIBER), "key_exprs": every},
            {**rule, "id": "no pixels", "messages": list(PUBLISHER), "key_exprs": keys},
            {**rule, "id": "everything", "messages": list(PUBLISHER), "key_exprs": every},
        ],
        "subjects": [{"id": "any"}, {"id": "this host", "interfaces": list(local)}],
        "policies": [
            {"subjects": ["any"], "rules": ["subscribe", "no pixels"]},
            {"subjects": ["this host"], "rules": ["everything"]},
        ],
    }


def _topic_rules(role: str, topic: Topic, privacy: bool) -> Iterator[Rule]:
    """Yield the rules of one role on one topic; the router forwards all of them."""
    leaves_host = topic.leaves_host and not (privacy and has_pixels(topic))
    name = role if leaves_host else f"{role} local"
    keys = _keys(topic, "")
    own = _keys(topic, role) if topic.producer == EVERY_SERVICE and role != ROUTER else keys
    if may_publish(role, topic) or role == ROUTER:
        # A publisher of some keys receives subscriptions to all keys of a topic.
        yield from _rules(f"{name}: publish {topic.name}", (PUBLISHER, own), (SUBSCRIBER, keys))
    if may_read(role, topic) or role == ROUTER:
        yield from _rules(f"{name}: read {topic.name}", (SUBSCRIBER, keys), (PUBLISHER, keys))


def _presence_rules(role: str) -> Iterator[Rule]:
    """Yield the rules of the liveliness tokens of processes."""
    alive = [f"{prefix('*')}/alive/**"]
    if role not in CLIENT_ROLES:
        own = alive if role == ROUTER else [f"{prefix('*')}/alive/{role}/**"]
        yield from _rules(f"{role}: be alive", (PUBLISHER, own), (SUBSCRIBER, alive))
    yield from _rules(f"{role}: read who is alive", (SUBSCRIBER, alive), (PUBLISHER, alive))


def _clock_rules(role: str) -> Iterator[Rule]:
    """Yield the rules of the query of the time, to which the router replies."""
    key = [query_key("*", CLOCK)]
    if role == ROUTER:
        yield from _rules(f"{role}: serve the time", (REPLIER, key), (QUERIER, key))
    yield from _rules(f"{role}: query the time", (QUERIER, key), (REPLIER, key))


def _rules(name: str, sent: Traffic, received: Traffic) -> Iterator[Rule]:
    for flow, (messages, keys) in (("ingress", sent), ("egress", received)):
        yield {
            "id": f"{name}, {flow}",
            "permission": "allow",
            "messages": list(messages),
            "flows": [flow],
            "key_exprs": keys,
        }


def _keys(topic: Topic, service: str) -> list[str]:
    """Return the keys of a topic and its cache on any robot, of one service if it is named.

    Zenoh keeps the last message of a latched topic for late joiners below @adv.
    """
    own = topic.key.replace("{service}", service or "*")
    expression = f"{prefix('*')}/{re.sub('{[^}]*}', '*', own)}"
    return [expression, f"{expression}/@adv/**"]
